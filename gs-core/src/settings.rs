//! How exactly, and with which effects, a frame is rendered.

use serde::{Deserialize, Serialize};

use crate::{
    constants::{ALPHA_CUT, ALPHA_MAX, TRANSMITTANCE_MIN},
    effects::{Background, Blend, Effects},
    error::Error,
};

/// What happens at the α cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cut {
    /// α below [`Accuracy::alpha_cut`] is 0: a step of that height in the image. What every engine does.
    #[default]
    Hard,
    /// No step: α is never cut. For finite differences; backends may refuse it, the oracle offers it.
    Smooth,
}

/// The approximations of a rendering, each with its error and its price.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct Accuracy {
    /// α (under [`Blend::Sum`]: weight) below this adds nothing. 1e-6..=0.5, default [`ALPHA_CUT`].
    pub alpha_cut: f32,
    /// Hard or smooth.
    pub cut: Cut,
    /// α is clamped to this, with zero gradient where it is. 0.5..=0.9999, default [`ALPHA_MAX`].
    pub alpha_max: f32,
    /// A pixel is full when its transmittance would fall below this. 0..=0.5, default [`TRANSMITTANCE_MIN`].
    pub transmittance_min: f32,
}

impl Default for Accuracy {
    fn default() -> Self {
        Self { alpha_cut: ALPHA_CUT, cut: Cut::Hard, alpha_max: ALPHA_MAX, transmittance_min: TRANSMITTANCE_MIN }
    }
}

/// Everything that a rendering depends on besides the scene and the view.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct RenderSettings {
    /// Which effects.
    pub effects: Effects,
    /// How exactly.
    pub accuracy: Accuracy,
    /// The colour behind, used when `effects.background` is [`Background::Solid`].
    pub background: [f32; 3],
}

impl RenderSettings {
    /// The default settings with this blending and nothing behind.
    pub fn blended(blend: Blend) -> Self {
        Self { effects: Effects { blend, ..Effects::default() }, ..Self::default() }
    }

    /// The same settings before a solid background.
    pub fn on(mut self, background: [f32; 3]) -> Self {
        self.effects.background = Background::Solid;
        self.background = background;
        self
    }

    /// The colour behind: black unless the background effect is on.
    pub fn backdrop(&self) -> [f32; 3] {
        match self.effects.background {
            Background::None => [0.0; 3],
            Background::Solid => self.background,
        }
    }

    /// Fails where a number is outside its range or an effect contradicts another.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        let a = &self.accuracy;
        if !(1e-6..=0.5).contains(&a.alpha_cut) {
            return Err(Error::setting("alpha-cut", a.alpha_cut, "1e-6 to 0.5"));
        }
        if !(0.5..=0.9999).contains(&a.alpha_max) {
            return Err(Error::setting("alpha-max", a.alpha_max, "0.5 to 0.9999"));
        }
        if !(0.0..=0.5).contains(&a.transmittance_min) {
            return Err(Error::setting("transmittance-min", a.transmittance_min, "0 to 0.5"));
        }
        if self.effects.sh_degree > 3 {
            return Err(Error::setting("sh-degree", self.effects.sh_degree, "0 to 3"));
        }
        if !self.background.iter().all(|v| v.is_finite()) {
            return Err(Error::setting("background", format!("{:?}", self.background), "finite"));
        }
        Ok(())
    }
}
