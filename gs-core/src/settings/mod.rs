//! Settings of a rendering: effects and accuracy.

mod choice;
mod dropout;

pub use self::{choice::Choice, dropout::Dropout};

use serde::{Deserialize, Deserializer, Serialize, de::Error as _};

use crate::{
    constants::{ALPHA_CUT, ALPHA_MAX, TRANSMITTANCE_MIN},
    effects::{Background, Blend, Effects, Order},
    error::Error,
};

/// Gives settings types a method `with`, by which code outside of their crate changes fields, even
/// where they are `#[non_exhaustive]`.
#[macro_export]
macro_rules! impl_with {
    ($($settings:ty),+ $(,)?) => {$(
        impl $settings {
            /// Returns these settings after `change`, which assigns fields: `settings.with(|s|
            /// s.field = value)`.
            #[must_use]
            pub fn with(mut self, change: impl FnOnce(&mut Self)) -> Self {
                change(&mut self);
                self
            }
        }
    )+};
}

crate::impl_with!(Accuracy, RenderSettings);

/// Treatment of α below the cut. Exhaustive: a backend must handle or refuse each value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cut {
    /// α below [`Accuracy::alpha_cut`] is 0, as in every engine: a step of that height in the
    /// image.
    #[default]
    Hard,
    /// α is never cut. For finite differences; backends may refuse it, the oracle offers it.
    Smooth,
}

/// How far a Gaussian reaches: to where α falls to the cut. There is no other value. The type
/// exists for the key `extent` of scene files and settings files, which earlier versions had a choice for.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Extent {
    #[default]
    AlphaCut,
}

crate::choices! {
    /// What the pixels of a rendering show. Exhaustive: a backend must handle or refuse each value.
    #[derive(Default)]
    pub enum Output {
        /// The colours of the Gaussians.
        #[default]
        Color = "color",
        /// The inverse depths of the Gaussians in all three channels, in inverse world units: each has
        /// 1/z as its colour, where z is the depth of its mean along the optical axis. 3D scenes.
        ///
        /// The SH coefficients have no effect, and no gradient.
        InverseDepth = "inverse-depth",
        /// Alpha in all three channels: each Gaussian has 1 as its colour. 3D scenes.
        ///
        /// Without a background ([`RenderSettings::of_alpha`]), a pixel under [`Blend::Over`] is 1 − T,
        /// where T is the transmittance of all Gaussians. The SH coefficients have no effect, and no
        /// gradient.
        Alpha = "alpha",
    }
}

impl Output {
    fn is_color(&self) -> bool {
        *self == Self::Color
    }
}

/// The approximations of a rendering.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Accuracy {
    /// The α cut: α (under [`Blend::Sum`]: weight) below this adds nothing. 1e-6..=0.5, default
    /// [`ALPHA_CUT`]. A Gaussian reaches √(2 ln(o / cut)) σ, so a faint one is small.
    pub alpha_cut: f32,
    /// Hard or smooth cut.
    pub cut: Cut,
    /// Upper bound of α, where its gradient is zero. 1e-6..=0.9999, default [`ALPHA_MAX`].
    pub alpha_max: f32,
    /// Transmittance below which a pixel is full. 0..=0.5, default [`TRANSMITTANCE_MIN`].
    pub transmittance_min: f32,
    /// The key `extent` of files; see [`Extent`].
    extent: Extent,
}

impl Default for Accuracy {
    fn default() -> Self {
        Self {
            alpha_cut: ALPHA_CUT,
            cut: Cut::Hard,
            alpha_max: ALPHA_MAX,
            transmittance_min: TRANSMITTANCE_MIN,
            extent: Extent::AlphaCut,
        }
    }
}

impl Accuracy {
    /// The most accurate settings that [`RenderSettings::validate`] allows with a hard cut, from
    /// which errors are measured. With n Gaussians at a pixel, the cut changes the pixel by less
    /// than n · 1e-6 and the bound of α by 1e-4.
    pub const TIGHTEST: Self =
        Self { alpha_cut: 1e-6, cut: Cut::Hard, alpha_max: 0.9999, transmittance_min: 0.0, extent: Extent::AlphaCut };

    /// The settings of 3DGS: α up to 0.99. *Source:* Kerbl et al. 2023, `forward.cu`.
    ///
    /// The square of three standard deviations by which 3DGS picks tiles, and which leaves out a
    /// part of opaque Gaussians, is not imitated.
    pub const THREE_DGS: Self = Self {
        alpha_cut: ALPHA_CUT,
        cut: Cut::Hard,
        alpha_max: 0.99,
        transmittance_min: TRANSMITTANCE_MIN,
        extent: Extent::AlphaCut,
    };
}

/// Everything that a rendering depends on besides the scene and the view.
///
/// The default is the least that a scene needs: no view-dependent colours, no antialiasing, the
/// order of the scene. A 3D scene of a file is rendered as its training rendered it by gs-io's
/// `File3d::render`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct RenderSettings {
    /// Effects.
    pub effects: Effects,
    /// Approximations.
    pub accuracy: Accuracy,
    /// Background colour, used where `effects.background` is [`Background::Solid`].
    #[serde(deserialize_with = "three")]
    pub background: [f32; 3],
    /// Depth, in world units, from which gradients count fully in
    /// [`Statistics::PixelGradient`](crate::effects::Statistics::PixelGradient): see
    /// [`Self::statistic_weight`]. At 0, the default, all count fully. Not negative. Training sets
    /// it as the policy asks; images do not depend on it.
    #[serde(skip_serializing_if = "is_zero")]
    pub full_depth: f32,
    /// What the pixels show. Default [`Output::Color`].
    #[serde(skip_serializing_if = "Output::is_color")]
    pub output: Output,
    /// Gaussians to leave out at random; only for 3D scenes under [`Blend::Over`]. Default: none.
    /// Training sets it for each step.
    #[serde(skip_serializing_if = "Dropout::is_none")]
    pub dropout: Dropout,
    /// Whether backward passes and training steps also differentiate by the camera: see
    /// [`Rasterizer::camera_gradient`](crate::Rasterizer::camera_gradient) and
    /// [`Optimizer::camera_gradients`](crate::Optimizer::camera_gradients). Only for 3D scenes;
    /// backends may refuse it. Default: no. Images do not depend on it.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub camera_gradient: bool,
}

/// Exactly three numbers: readers of TOML overlook what follows them.
fn three<'de, D: Deserializer<'de>>(source: D) -> Result<[f32; 3], D::Error> {
    let numbers = Vec::<f32>::deserialize(source)?;
    let count = numbers.len();
    numbers.try_into().map_err(|_| D::Error::custom(format_args!("expected 3 values, found {count}")))
}

/// Settings files leave out default values.
fn is_zero(depth: &f32) -> bool {
    *depth == 0.0
}

impl RenderSettings {
    /// The weight of the gradient of a Gaussian at this depth, world units, in
    /// [`Statistics::PixelGradient`](crate::effects::Statistics::PixelGradient): (depth /
    /// [`Self::full_depth`])², at most 1.
    #[inline]
    pub fn statistic_weight(&self, depth: f32) -> f32 {
        if depth < self.full_depth { (depth / self.full_depth).powi(2) } else { 1.0 }
    }

    /// The default settings with this blending and no background.
    pub fn blended(blend: Blend) -> Self {
        Self { effects: Effects { blend, ..Effects::default() }, ..Self::default() }
    }

    /// Returns these settings with a solid background.
    #[must_use]
    pub fn on(mut self, background: [f32; 3]) -> Self {
        self.effects.background = Background::Solid;
        self.background = background;
        self
    }

    /// Returns these settings for the alpha of the same picture: [`Output::Alpha`] without a
    /// background.
    #[must_use]
    pub fn of_alpha(mut self) -> Self {
        self.effects.background = Background::None;
        self.output = Output::Alpha;
        self
    }

    /// The background colour: black unless the background effect is on.
    pub fn background_color(&self) -> [f32; 3] {
        match self.effects.background {
            Background::Solid => self.background,
            Background::None => [0.0; 3],
        }
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub fn validate(&self) -> Result<(), Error> {
        let a = &self.accuracy;
        Error::within("alpha-cut", a.alpha_cut, 1e-6..=0.5, "1e-6 to 0.5")?;
        Error::within("alpha-max", a.alpha_max, 1e-6..=0.9999, "1e-6 to 0.9999")?;
        Error::within("transmittance-min", a.transmittance_min, 0.0..=0.5, "0 to 0.5")?;
        Error::within("sh-degree", self.effects.sh_degree, ..=3, "0 to 3")?;
        Error::within("full-depth", self.full_depth, 0.0..=f32::MAX, "0 or more, and finite")?;
        self.dropout.validate()?;
        if self.effects.blend == Blend::Sum && !self.dropout.is_none() {
            return Err(Error::setting(
                "dropout with blend = \"sum\"",
                self.dropout.rate,
                "0: only blend = \"over\" has opacities to compensate with",
            ));
        }
        if !self.background.iter().all(|v| v.is_finite()) {
            return Err(Error::setting("background", format!("{:?}", self.background), "finite"));
        }
        Ok(())
    }

    /// [`Self::validate`] for a backend that offers all but the smooth cut.
    ///
    /// # Errors
    /// Those of [`Self::validate`]; [`Error::Unsupported`].
    pub fn check_for(&self, backend: &'static str) -> Result<(), Error> {
        self.validate()?;
        match self.accuracy.cut {
            Cut::Hard => Ok(()),
            Cut::Smooth => Err(Error::unsupported(backend, "a smooth cut, which would touch every pixel")),
        }
    }

    /// [`Self::check_for`] for 2D scenes, which have neither depth nor camera.
    ///
    /// # Errors
    /// Those of [`Self::check_for`].
    pub fn check_for_2d(&self, backend: &'static str) -> Result<(), Error> {
        self.check_for(backend)?;
        let (order, output) = (self.effects.order, self.output);
        let effect = match () {
            () if order != Order::Index => format!("order {order:?} of a 2D scene, which has no depth"),
            () if !output.is_color() => format!("output \"{}\" of a 2D scene, which shows colours only", output.name()),
            () if !self.dropout.is_none() => "dropout in a 2D scene".to_owned(),
            () if self.camera_gradient => "the gradient by the camera of a 2D scene, which has no camera".to_owned(),
            () => return Ok(()),
        };
        Err(Error::unsupported(backend, effect))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_a_key_for_the_extent() {
        let file = serde_json::to_string(&Accuracy::default()).unwrap();
        assert!(file.contains("\"extent\":\"alpha-cut\""), "{file}");
        assert_eq!(serde_json::from_str::<Accuracy>(&file).unwrap(), Accuracy::default());
        assert!(serde_json::from_str::<Accuracy>("{\"extent\":{\"sigmas\":3.0}}").is_err());
    }

    #[test]
    fn outputs_have_the_names_of_settings_files() {
        for output in [Output::Color, Output::InverseDepth, Output::Alpha] {
            assert_eq!(serde_json::to_string(&output).unwrap(), format!("\"{}\"", output.name()));
        }
    }

    #[test]
    fn gradients_fade_towards_the_camera() {
        let settings = RenderSettings { full_depth: 4.0, ..RenderSettings::default() };
        assert_eq!([1.0, 2.0, 4.0, 9.0].map(|depth| settings.statistic_weight(depth)), [0.0625, 0.25, 1.0, 1.0]);
        assert_eq!(RenderSettings::default().statistic_weight(0.0), 1.0);
        assert!(RenderSettings { full_depth: f32::NAN, ..settings }.validate().is_err());
    }

    #[test]
    fn the_named_accuracies_are_possible_and_come_back_from_a_file() {
        for accuracy in [Accuracy::default(), Accuracy::TIGHTEST, Accuracy::THREE_DGS] {
            let settings = RenderSettings { accuracy, ..RenderSettings::default() };
            settings.validate().unwrap();
            let file = serde_json::to_string(&settings).unwrap();
            assert_eq!(serde_json::from_str::<RenderSettings>(&file).unwrap(), settings, "{file}");
        }
    }
}
