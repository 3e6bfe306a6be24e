//! The settings that are measured, and the values that are tried.

use std::fmt;

use gs_core::{
    Extent, RenderSettings,
    effects::{Antialias, Order},
};

/// A setting of a rendering with a value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Setting {
    /// Contributions with a smaller α are left out.
    AlphaCut(f32),
    /// Blending stops before the transmittance of a pixel falls below this.
    TransmittanceMin(f32),
    /// Upper limit of α.
    AlphaMax(f32),
    /// How far from its mean a Gaussian is evaluated.
    Extent(Extent),
    /// Sort order of blending.
    Order(Order),
    /// Treatment of Gaussians narrower than a pixel.
    Antialias(Antialias),
    /// Highest SH degree.
    ShDegree(u8),
}

impl Setting {
    /// `settings` with this value.
    pub(super) fn applied_to(self, settings: &RenderSettings) -> RenderSettings {
        let mut settings = *settings;
        let RenderSettings { effects, accuracy, .. } = &mut settings;
        match self {
            Self::AlphaCut(cut) => accuracy.alpha_cut = cut,
            Self::TransmittanceMin(minimum) => accuracy.transmittance_min = minimum,
            Self::AlphaMax(clamp) => accuracy.alpha_max = clamp,
            Self::Extent(extent) => accuracy.extent = extent,
            Self::Order(order) => effects.order = order,
            Self::Antialias(antialias) => effects.antialias = antialias,
            Self::ShDegree(degree) => effects.sh_degree = degree,
        }
        settings
    }

    /// The value of the same setting in `settings`.
    pub(super) fn of(self, settings: &RenderSettings) -> Self {
        let RenderSettings { effects, accuracy, .. } = settings;
        match self {
            Self::AlphaCut(_) => Self::AlphaCut(accuracy.alpha_cut),
            Self::TransmittanceMin(_) => Self::TransmittanceMin(accuracy.transmittance_min),
            Self::AlphaMax(_) => Self::AlphaMax(accuracy.alpha_max),
            Self::Extent(_) => Self::Extent(accuracy.extent),
            Self::Order(_) => Self::Order(effects.order),
            Self::Antialias(_) => Self::Antialias(effects.antialias),
            Self::ShDegree(_) => Self::ShDegree(effects.sh_degree),
        }
    }

    /// Name and value as text.
    pub(super) fn change(self) -> Change {
        let (axis, value) = match self {
            Self::AlphaCut(cut) => ("alpha cut", fraction(cut)),
            Self::TransmittanceMin(minimum) => ("full below", fraction(minimum)),
            Self::AlphaMax(clamp) => ("alpha max", clamp.to_string()),
            Self::Extent(Extent::AlphaCut) => ("extent", "of the cut".to_owned()),
            Self::Extent(Extent::Sigmas(k)) => ("extent", format!("{k} sigma")),
            Self::Order(order) => ("order", order.name().to_owned()),
            Self::Antialias(antialias) => ("antialias", antialias.name().to_owned()),
            Self::ShDegree(degree) => ("SH degree", degree.to_string()),
        };
        Change { axis: axis.to_owned(), value }
    }
}

/// A difference from a backend's default: a setting of the rendering, or of the backend.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Change {
    /// The setting: "alpha cut".
    pub axis: String,
    /// The setting's value: "1/1024".
    pub value: String,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.axis, self.value)
    }
}

/// The values of each setting to try instead of those of `base`. With `Blend::Sum`, transmittance
/// and the limit of α do not apply; in 2D, sort order, antialiasing and SH do not.
pub(super) fn alternatives(base: &RenderSettings) -> Vec<Setting> {
    let over = base.effects.blend == gs_core::Blend::Over;
    let in_space = base.effects.order != Order::Index;
    let cuts = [16, 32, 64, 128, 255, 512, 1024, 2048, 4096, 16384].map(|n| 1.0 / n as f32);
    let mut all: Vec<Setting> = cuts.into_iter().chain([1e-6]).map(Setting::AlphaCut).collect();
    all.extend([2.0, 2.5, 3.0, 4.0].map(|k| Setting::Extent(Extent::Sigmas(k))));
    if over {
        all.extend([0.1, 0.03, 1e-2, 1e-3, 1e-4, 1e-5, 0.0].map(Setting::TransmittanceMin));
        all.extend([0.99, 0.999, 0.9999].map(Setting::AlphaMax));
    }
    if in_space {
        all.extend([Order::Index, Order::Global, Order::PerPixel].map(Setting::Order));
        all.extend(Antialias::ALL.map(Setting::Antialias));
        all.extend((0..base.effects.sh_degree).map(Setting::ShDegree));
    }
    all.retain(|setting| setting.applied_to(base) != *base);
    all
}

/// A number as "1/n" if it is such a fraction.
fn fraction(value: f32) -> String {
    let n = (1.0 / value).round();
    let is_fraction = (2.0..1e5).contains(&n) && (1.0 / n - value).abs() <= f32::EPSILON * value && value < 0.1;
    let decimal = value.to_string();
    if is_fraction && decimal.len() > 6 {
        format!("1/{n}")
    } else if value > 0.0 && value < 1e-3 {
        format!("{value:e}")
    } else {
        decimal
    }
}

#[cfg(test)]
mod tests {
    use gs_core::Blend;

    use super::*;

    #[test]
    fn values_are_said_as_they_are_meant() {
        let said = |setting: Setting| setting.change().to_string();
        assert_eq!(said(Setting::AlphaCut(1.0 / 255.0)), "alpha cut 1/255");
        assert_eq!(said(Setting::AlphaCut(1e-6)), "alpha cut 1e-6");
        assert_eq!(said(Setting::AlphaCut(1.0 / 16.0)), "alpha cut 0.0625");
        assert_eq!(said(Setting::TransmittanceMin(0.0)), "full below 0");
        assert_eq!(said(Setting::TransmittanceMin(1e-4)), "full below 1e-4");
        assert_eq!(said(Setting::Extent(Extent::Sigmas(2.5))), "extent 2.5 sigma");
    }

    #[test]
    fn only_what_a_scene_can_have_is_tried_and_never_what_it_has() {
        let sum = RenderSettings::blended(Blend::Sum);
        let tried = alternatives(&sum);
        assert!(tried.iter().all(|s| matches!(s, Setting::AlphaCut(_) | Setting::Extent(_))), "{tried:?}");
        let mut space = RenderSettings::blended(Blend::Over);
        space.effects.order = Order::Global;
        space.effects.sh_degree = 2;
        let tried = alternatives(&space);
        for expected in [Setting::Order(Order::PerPixel), Setting::ShDegree(1), Setting::TransmittanceMin(0.0)] {
            assert!(tried.contains(&expected), "{expected:?}");
        }
        for setting in tried {
            let settings = setting.applied_to(&space);
            settings.validate().unwrap();
            assert_ne!(settings, space);
        }
    }
}
