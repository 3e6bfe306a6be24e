//! Which of the effects that are wanted a scene calls for, and why: the others can be left out, and nobody will see it.
//!
//! What a scene shall look like, it does not say itself: a trained scene means the order and the antialiasing that it was trained with. So the
//! question is put to settings: which of their effects can be left out, or made cheaper, such that no pixel changes by more than
//! [`HALF_DISPLAY_STEP`]? It is answered by bounds, never by trial, and whatever has no bound stays:
//!
//! - **order**: exactly, by which Gaussians lie on the same pixels and whose depths change places there. Under `Sum` nothing depends on it.
//! - **blend**: stays. Without it, opacities mean nothing.
//! - **sh-degree**: a pixel is C = Σ Tα c + T′ c′ with Σ Tα + T′ = 1, so that it changes by no more than that Gaussian's colour which changes
//!   most. Over all directions that is bounded by the norms of the coefficients left out ([`sh::change_bound`]); in given views it is computed.
//!   Under `Sum`, where weights may add up to more than 1, only coefficients that are 0 are left out.
//! - **antialias**: stays wherever something is drawn. Without it every Gaussian's edge moves, and α steps from the cut to 0 there: 1/255.
//! - **background**: none is needed before black, which is what none looks like.

mod overlap;
mod scene2d;
mod scene3d;

use serde::Serialize;

use super::{Effect, Effects};
#[cfg(doc)]
use crate::{
    constants::{HALF_DISPLAY_STEP, NARROW_PX},
    sh,
};
use crate::{error::Error, scene::Scene, settings::RenderSettings};

/// Settings without what a scene does not call for, and how that was decided.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct CalledFor {
    /// The wanted settings with the effects that are called for.
    pub settings: RenderSettings,
    /// One of each effect, in the order of [`Effect::ALL`].
    pub verdicts: Vec<Verdict>,
}

/// What was decided about one effect.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Verdict {
    /// The effect.
    pub effect: Effect,
    /// Its value in the wanted settings.
    pub wanted: &'static str,
    /// The value that is called for.
    pub value: &'static str,
    /// Whether that is all of it.
    pub answer: Answer,
    /// Why, a sentence without its full stop.
    pub reason: String,
}

/// Whether a wanted effect is called for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Answer {
    /// As it is wanted.
    CalledFor,
    /// A cheaper value does.
    InPart,
    /// It can be left out.
    NotCalledFor,
    /// It is not wanted.
    Off,
}

/// The wanted effects with what is left of one of them, and why.
pub type Decision = (Effects, String);

/// A scene that can be asked which effects it calls for.
pub trait CallsForEffects: Scene {
    /// Says of each effect, in the order of [`Effect::ALL`], what of it is called for where these settings, which are valid, are wanted.
    fn decide(&self, views: &[Self::View], settings: &RenderSettings) -> [Decision; Effect::ALL.len()];
}

impl Effects {
    /// Which effects of the `wanted` settings a scene calls for where it is seen through these `views`. Views that are not possible show
    /// nothing.
    ///
    /// An effect is left out only where it is certain that no pixel changes by more than [`HALF_DISPLAY_STEP`]: in any view whatever, if there
    /// are no `views`; in these, if there are. Rendering with the settings that are returned and with the wanted ones shows what the difference
    /// is in fact.
    ///
    /// # Errors
    /// Those of [`RenderSettings::validate`], of the wanted settings.
    ///
    /// ```
    /// use gs_core::{Blend, Effects, Scene2d, RenderSettings, effects::{Antialias, Order}};
    ///
    /// let mut wanted = RenderSettings::blended(Blend::Over).on([0.0; 3]);
    /// wanted.effects.order = Order::Global;
    /// let called = Effects::called_for(&Scene2d::default(), &[], &wanted)?;
    /// assert_eq!(called.settings.effects, Effects { blend: Blend::Over, ..Effects::default() });
    /// # Ok::<(), gs_core::Error>(())
    /// ```
    pub fn called_for<S: CallsForEffects>(
        scene: &S,
        views: &[S::View],
        wanted: &RenderSettings,
    ) -> Result<CalledFor, Error> {
        wanted.validate()?;
        let mut settings = *wanted;
        let decisions = Effect::ALL.into_iter().zip(scene.decide(views, wanted));
        let verdicts = decisions.map(|(effect, (effects, reason))| {
            settings.effects = effect.copied(&effects, &settings.effects);
            Verdict::new(effect, &wanted.effects, &settings.effects, reason)
        });
        let verdicts = verdicts.collect();
        Ok(CalledFor { settings, verdicts })
    }
}

impl Verdict {
    /// Of an effect that has one value in the `wanted` effects and another, or the same, in those that are left.
    pub fn new(effect: Effect, wanted: &Effects, left: &Effects, reason: String) -> Self {
        let off = effect.value(&effect.off(wanted));
        let (wanted, value) = (effect.value(wanted), effect.value(left));
        let answer = match (wanted == off, wanted == value, value == off) {
            (true, ..) => Answer::Off,
            (_, true, _) => Answer::CalledFor,
            (_, _, true) => Answer::NotCalledFor,
            _ => Answer::InPart,
        };
        Self { effect, wanted, value, answer, reason }
    }
}

/// What is said of a background, whatever the scene.
fn background(settings: &RenderSettings) -> Decision {
    let without = Effect::Background.off(&settings.effects);
    match settings.background_color() {
        _ if without == settings.effects => (without, "none is asked for".to_owned()),
        [0.0, 0.0, 0.0] => (without, "black is what none looks like".to_owned()),
        [r, g, b] => (settings.effects, format!("{r},{g},{b} shows where something stays transparent")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene2d;

    #[test]
    fn settings_that_are_not_possible_call_for_nothing() {
        let mut wanted = RenderSettings::default();
        wanted.effects.sh_degree = 4;
        let refused = Effects::called_for(&Scene2d::default(), &[], &wanted).unwrap_err();
        assert_eq!(refused, RenderSettings::validate(&wanted).unwrap_err());
    }

    #[test]
    fn an_answer_is_about_what_is_wanted() {
        let degree = |sh_degree| Effects { sh_degree, ..Effects::default() };
        let answer =
            |wanted, left| Verdict::new(Effect::ShDegree, &degree(wanted), &degree(left), String::new()).answer;
        assert_eq!(
            [answer(3, 3), answer(3, 1), answer(3, 0), answer(0, 0)],
            [Answer::CalledFor, Answer::InPart, Answer::NotCalledFor, Answer::Off]
        );
    }
}
