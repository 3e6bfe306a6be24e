//! Which of the wanted effects a scene requires, and why. The others can be left out without a
//! visible change.
//!
//! A scene alone does not say how it should look: it was trained with some order and antialiasing.
//! So the effects of given render settings are decided: those that can be left out, or made
//! cheaper, such that no pixel changes by more than [`HALF_DISPLAY_STEP`]. The decision comes from
//! bounds, never from trial renderings, and an effect without a bound stays:
//!
//! - **order**: exact, from the Gaussians that lie on the same pixels and whose depths swap there.
//!   Under `Sum` the order has no effect.
//! - **blend**: stays. Without it, opacities mean nothing.
//! - **sh-degree**: a pixel is C = Σ Tα c + T′ c′ with Σ Tα + T′ = 1, so it changes by no more than
//!   the colour that changes most. Over all directions that is bounded by the norms of the
//!   coefficients left out ([`sh::change_bound`]); in given views it is computed. Under `Sum`,
//!   where weights may add up to more than 1, only coefficients that are 0 are left out.
//! - **antialias**: stays wherever something is drawn. Without it every Gaussian's edge moves, and
//!   α steps from the cut to 0 there: 1/255.
//! - **background**: black needs none, as no background is black too.

mod overlap;
mod scene2d;
mod scene3d;

use serde::Serialize;

use super::{Effect, Effects};
#[cfg(doc)]
use crate::{
    constants::{HALF_DISPLAY_STEP, NARROW_PX},
    math::sh,
};
use crate::{error::Error, scene::Scene, settings::RenderSettings};

/// Render settings reduced to the effects that a scene requires, and how that was decided.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct RequiredEffects {
    /// The wanted settings with the required effects.
    pub settings: RenderSettings,
    /// A decision for each effect, in the order of [`Effect::ALL`].
    pub decisions: Vec<EffectDecision>,
}

/// Decision about one effect.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct EffectDecision {
    /// The effect.
    pub effect: Effect,
    /// Value in the wanted settings.
    pub wanted: &'static str,
    /// Value that is required.
    pub value: &'static str,
    /// Whether the wanted value is required.
    pub answer: Requirement,
    /// Reason, a sentence without its full stop.
    pub reason: String,
}

/// Whether a wanted effect is required.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Requirement {
    /// The wanted value is required.
    Required,
    /// A cheaper value is enough.
    InPart,
    /// The effect can be left out.
    NotRequired,
    /// The effect is off in the wanted settings.
    Off,
}

/// The wanted effects with one of them reduced, and the reason.
pub(super) type Decision = (Effects, String);

/// A scene whose required effects can be found: [`Scene2d`](crate::Scene2d) and
/// [`Scene3d`](crate::Scene3d).
///
/// Other crates should not implement it. `decide` must have a bound for every effect, and later
/// versions may add effects.
pub trait RequiresEffects: Scene {
    /// What is required of each effect of these valid settings, in the order of [`Effect::ALL`].
    fn decide(&self, views: &[Self::View], settings: &RenderSettings) -> [Decision; Effect::ALL.len()];
}

impl Effects {
    /// The effects of the `wanted` settings that a scene requires when it is seen through these
    /// `views`.
    ///
    /// An effect is left out only where it is certain that no pixel changes by more than
    /// [`HALF_DISPLAY_STEP`]: in these views or, if there are none, in any view. Invalid views show
    /// nothing. To see the actual difference, render with the returned settings and with the wanted
    /// ones.
    ///
    /// # Errors
    /// Those of [`RenderSettings::validate`] for the wanted settings.
    ///
    /// ```
    /// use gs_core::{Blend, Effects, Scene2d, RenderSettings, effects::{Antialias, Order}};
    ///
    /// let mut wanted = RenderSettings::blended(Blend::Over).on([0.0; 3]);
    /// wanted.effects.order = Order::Global;
    /// let found = Effects::required(&Scene2d::default(), &[], &wanted)?;
    /// assert_eq!(found.settings.effects, Effects { blend: Blend::Over, ..Effects::default() });
    /// # Ok::<(), gs_core::Error>(())
    /// ```
    pub fn required<S: RequiresEffects>(
        scene: &S,
        views: &[S::View],
        wanted: &RenderSettings,
    ) -> Result<RequiredEffects, Error> {
        wanted.validate()?;
        Ok(RequiredEffects::collected(wanted, Effect::ALL.into_iter().zip(scene.decide(views, wanted))))
    }
}

impl RequiredEffects {
    /// Forces effects, whatever the scene requires: for each effect, effects that have it as
    /// chosen, and the reason.
    ///
    /// ```
    /// use gs_core::{Blend, RenderSettings, effects::{Effect, RequiredEffects}};
    ///
    /// let wanted = RenderSettings::blended(Blend::Over).on([1.0; 3]);
    /// let without = |effect: Effect| (effect.off(&wanted.effects), "nothing is wanted".to_owned());
    /// let found = RequiredEffects::decided(&wanted, without);
    /// assert_eq!(found.settings.effects.blend, Blend::Sum);
    /// ```
    pub fn decided(wanted: &RenderSettings, mut decide: impl FnMut(Effect) -> (Effects, String)) -> Self {
        Self::collected(wanted, Effect::ALL.into_iter().map(|effect| (effect, decide(effect))))
    }

    fn collected(wanted: &RenderSettings, decisions: impl Iterator<Item = (Effect, Decision)>) -> Self {
        let mut settings = *wanted;
        let decisions = decisions.map(|(effect, (effects, reason))| {
            settings.effects = effect.copied(&effects, &settings.effects);
            EffectDecision::new(effect, &wanted.effects, &settings.effects, reason)
        });
        let decisions = decisions.collect();
        Self { settings, decisions }
    }
}

impl EffectDecision {
    /// The decision about an effect of the `wanted` effects whose value in `left` remains.
    pub fn new(effect: Effect, wanted: &Effects, left: &Effects, reason: String) -> Self {
        let off = effect.value(&effect.off(wanted));
        let (wanted, value) = (effect.value(wanted), effect.value(left));
        let answer = match (wanted == off, wanted == value, value == off) {
            (true, ..) => Requirement::Off,
            (_, true, _) => Requirement::Required,
            (_, _, true) => Requirement::NotRequired,
            _ => Requirement::InPart,
        };
        Self { effect, wanted, value, answer, reason }
    }
}

/// The decision about the background, which does not depend on the scene.
fn background(settings: &RenderSettings) -> Decision {
    let without = Effect::Background.off(&settings.effects);
    match settings.background_color() {
        _ if without == settings.effects => (without, "the settings have none".to_owned()),
        [0.0, 0.0, 0.0] => (without, "black looks the same as none".to_owned()),
        [r, g, b] => (settings.effects, format!("{r},{g},{b} shows where something stays transparent")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene2d;

    #[test]
    fn impossible_settings_require_nothing() {
        let mut wanted = RenderSettings::default();
        wanted.effects.sh_degree = 4;
        let refused = Effects::required(&Scene2d::default(), &[], &wanted).unwrap_err();
        assert_eq!(refused, RenderSettings::validate(&wanted).unwrap_err());
    }

    #[test]
    fn an_answer_is_about_what_is_wanted() {
        let degree = |sh_degree| Effects { sh_degree, ..Effects::default() };
        let answer =
            |wanted, left| EffectDecision::new(Effect::ShDegree, &degree(wanted), &degree(left), String::new()).answer;
        assert_eq!(
            [answer(3, 3), answer(3, 1), answer(3, 0), answer(0, 0)],
            [Requirement::Required, Requirement::InPart, Requirement::NotRequired, Requirement::Off]
        );
    }
}
