//! When the effects of a training's settings join it: by the clock, or when the scene that is being trained calls for them.
//!
//! An effect that has not joined costs nothing: its kernels are not run, and what it alone trains stands still. Two can join half-way, as a scene
//! means nearly the same with and without them at that moment: antialiasing, and harmonics, degree by degree, whose coefficients are 0 before.
//! Blending cannot. Under [`Blend::Sum`] colours are shares that add up, and nothing is opaque; under [`Blend::Over`] they are what is seen, and
//! hide what is behind. So opacity is there from the first step or never: photographs of a 3D scene call for it, as what is in front hides
//! what is behind; an image, in which nothing is behind anything, does not.

use std::fmt;

use gs_core::{
    Effects, Error,
    effects::{Antialias, called_for::Narrow},
};
use serde::{Deserialize, Serialize};

#[cfg(doc)]
use crate::train::ViewDependence;
#[cfg(doc)]
use gs_core::Blend;

/// When antialiasing and harmonics join.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Joining {
    /// By the clock: antialiasing is there from the first step, harmonics grow by a degree every so many steps (3DGS).
    #[default]
    Scheduled,
    /// When they are called for; those that never are never join. What has joined stays.
    WhenCalledFor(Calls),
}

/// What calls for an effect while a scene is being trained.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Calls {
    /// Antialiasing is asked for before the first step and every so many steps, at least 1. Harmonics are asked for as often as, by the clock,
    /// a degree would join.
    pub every: u32,
    /// Antialiasing joins when, in some view, more than this share of the Gaussians are narrower than a pixel, 0 to 1.
    pub narrow: f32,
    /// The harmonics of the next degree join when they explain more than this share of how residuals vary between views, 0 to 1
    /// ([`ViewDependence`]), and that by more than half a step of a display. Residuals of shapes and places that are still wrong depend on the view, too, and are not told apart: while a scene
    /// is far from its photographs, harmonics may join that it will not need.
    pub view_dependence: f32,
}

impl Default for Calls {
    fn default() -> Self {
        Self { every: 100, narrow: 0.01, view_dependence: 0.25 }
    }
}

impl Joining {
    /// [`Self::WhenCalledFor`] with the usual bounds, for a run of so many steps: in short ones, antialiasing is asked for more often.
    pub fn when_called_for(iterations: u32) -> Self {
        Self::WhenCalledFor(Calls { every: (iterations / 30).clamp(1, 100), ..Calls::default() })
    }

    /// Fails where a number is outside its range.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the offender.
    pub fn validate(&self) -> Result<(), Error> {
        let Self::WhenCalledFor(Calls { every, narrow, view_dependence }) = *self else { return Ok(()) };
        if every == 0 {
            return Err(Error::setting("joining.every", every, "at least 1"));
        }
        for (what, share) in [("joining.narrow", narrow), ("joining.view-dependence", view_dependence)] {
            if !(0.0..=1.0).contains(&share) {
                return Err(Error::setting(what, share, "0 to 1"));
            }
        }
        Ok(())
    }

    /// Whether, and by which bounds, antialiasing is asked for after `step` steps; not once it has joined.
    pub(crate) fn asks_for_antialias(&self, step: u32, wanted: &Effects, joins: &Joins) -> Option<Calls> {
        let Self::WhenCalledFor(calls) = self else { return None };
        let missing = wanted.antialias != Antialias::None && joins.antialias().is_none();
        (missing && step.is_multiple_of(calls.every)).then_some(*calls)
    }

    /// The wanted effects without what has not joined by the end of `step` steps.
    pub(crate) fn effects_after(&self, step: u32, wanted: &Effects, joins: &Joins) -> Effects {
        let joins = joins.until(step);
        match self {
            Self::Scheduled => *wanted,
            Self::WhenCalledFor(_) => Effects {
                sh_degree: joins.sh_degree().min(wanted.sh_degree),
                antialias: joins.antialias().map_or(Antialias::None, |_| wanted.antialias),
                ..*wanted
            },
        }
    }
}

/// Harmonics of one more degree join.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct HarmonicsJoin {
    /// The degree that is evaluated from now on.
    pub degree: u8,
    /// The share of how residuals vary between views that they explain; nothing where the first scene had them already.
    pub explains: Option<f32>,
}

/// Antialiasing joins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct AntialiasJoin {
    /// Which.
    pub antialias: Antialias,
    /// Gaussians narrower than a pixel, in the view with the largest share of them.
    pub narrow: u32,
    /// Gaussians that this view shows.
    pub shown: u32,
}

impl AntialiasJoin {
    pub(crate) fn new(antialias: Antialias, Narrow { narrow, shown }: Narrow) -> Self {
        let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        Self { antialias, narrow: count(narrow), shown: count(shown) }
    }
}

/// What joins a training after one step, and why.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct Joined {
    /// Harmonics.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub harmonics: Option<HarmonicsJoin>,
    /// Antialiasing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub antialias: Option<AntialiasJoin>,
}

impl Joined {
    /// Whether nothing joins.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// This, and of the other what is not in it.
    pub(crate) fn or(self, other: Self) -> Self {
        Self { harmonics: self.harmonics.or(other.harmonics), antialias: self.antialias.or(other.antialias) }
    }
}

/// Sentences without the last full stop.
impl fmt::Display for Joined {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let harmonics = self.harmonics.map(|HarmonicsJoin { degree, explains }| match explains {
            Some(share) => format!(
                "harmonics of degree {degree} join: they explain {:.1} % of how residuals vary between views",
                100.0 * share
            ),
            None => format!("harmonics of degree {degree} join: the first scene has them"),
        });
        let antialias = self.antialias.map(|AntialiasJoin { antialias, narrow, shown }| {
            let name = antialias.name();
            format!("antialiasing ({name}) joins: {narrow} of {shown} Gaussians of a view are narrower than a pixel")
        });
        let told: Vec<String> = antialias.into_iter().chain(harmonics).collect();
        f.write_str(&told.join(". "))
    }
}

/// What has joined a training, and after which step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Join {
    /// Steps done by then.
    pub step: u32,
    /// What, and why.
    #[serde(flatten)]
    pub joined: Joined,
}

/// All that has joined a training so far, in its order.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Joins {
    /// At most one entry a step.
    pub joins: Vec<Join>,
}

impl Joins {
    /// Those up to the end of `step` steps.
    fn until(&self, step: u32) -> Self {
        Self { joins: self.joins.iter().filter(|join| join.step <= step).copied().collect() }
    }

    /// What joined after exactly so many steps.
    pub(crate) fn at(&self, step: u32) -> Joined {
        self.joins.iter().find(|join| join.step == step).map_or_else(Joined::default, |join| join.joined)
    }

    /// The highest degree of harmonics that has joined.
    pub(crate) fn sh_degree(&self) -> u8 {
        self.joins.iter().filter_map(|join| join.joined.harmonics).map(|join| join.degree).max().unwrap_or(0)
    }

    fn antialias(&self) -> Option<AntialiasJoin> {
        self.joins.iter().find_map(|join| join.joined.antialias)
    }
}
