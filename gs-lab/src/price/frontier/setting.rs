//! The settings that are varied, and the values that are tried.

use std::fmt;

use gs_core::{
    Blend, RenderSettings,
    effects::{Effect, Order},
};

/// What can be varied.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Axis {
    /// α below which contributions are left out.
    AlphaCut,
    /// Blending stops before the transmittance of a pixel falls below this.
    TransmittanceMin,
    /// Upper limit of α.
    AlphaMax,
    /// An effect.
    Effect(Effect),
}

/// A setting with a value: that of an axis in render settings.
#[derive(Debug, Clone, Copy)]
pub(super) struct Setting {
    axis: Axis,
    source: RenderSettings,
}

impl Setting {
    /// `settings` with this value.
    pub(super) fn applied_to(&self, settings: &RenderSettings) -> RenderSettings {
        let mut settings = *settings;
        let (accuracy, source) = (&mut settings.accuracy, &self.source.accuracy);
        match self.axis {
            Axis::AlphaCut => accuracy.alpha_cut = source.alpha_cut,
            Axis::TransmittanceMin => accuracy.transmittance_min = source.transmittance_min,
            Axis::AlphaMax => accuracy.alpha_max = source.alpha_max,
            Axis::Effect(effect) => settings.effects = effect.copied(&self.source.effects, &settings.effects),
        }
        settings
    }

    /// Name and value as text.
    pub(super) fn change(&self) -> Change {
        let RenderSettings { effects, accuracy, .. } = &self.source;
        let (axis, value) = match self.axis {
            Axis::AlphaCut => ("alpha cut", fraction(accuracy.alpha_cut)),
            Axis::TransmittanceMin => ("full below", fraction(accuracy.transmittance_min)),
            Axis::AlphaMax => ("alpha max", accuracy.alpha_max.to_string()),
            Axis::Effect(effect) => (effect.name(), effect.value(effects).to_owned()),
        };
        Change { axis: axis.to_owned(), value }
    }
}

/// A difference from a backend's default: a setting of the rendering, or of the backend.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Change {
    /// The setting: "alpha cut".
    pub(crate) axis: String,
    /// The setting's value: "1/1024".
    pub(crate) value: String,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.axis, self.value)
    }
}

/// The values of each setting to try instead of those of `base`. With `Blend::Sum`, transmittance
/// and the limit of α do not apply; in 2D, sort order, antialiasing and SH do not.
pub(super) fn alternatives(base: &RenderSettings) -> Vec<Setting> {
    let mut all = Vec::new();
    let mut try_each = |axis, values: &[f32], set: fn(&mut RenderSettings, f32)| {
        all.extend(values.iter().map(|&value| Setting { axis, source: base.with(|s| set(s, value)) }));
    };
    let cuts = [16.0f32, 32.0, 64.0, 128.0, 255.0, 512.0, 1024.0, 2048.0, 4096.0, 16384.0, 1e6].map(f32::recip);
    try_each(Axis::AlphaCut, &cuts, |s, cut| s.accuracy.alpha_cut = cut);
    if base.effects.blend == Blend::Over {
        let full = [0.1, 0.03, 1e-2, 1e-3, 1e-4, 1e-5, 0.0];
        try_each(Axis::TransmittanceMin, &full, |s, least| s.accuracy.transmittance_min = least);
        try_each(Axis::AlphaMax, &[0.99, 0.999, 0.9999], |s, most| s.accuracy.alpha_max = most);
    }
    if base.effects.order != Order::Index {
        // Another background would be another scene.
        for effect in Effect::OPTIONAL.into_iter().filter(|effect| *effect != Effect::Background) {
            let values = effect.values(&base.effects).into_iter();
            all.extend(
                values
                    .map(|effects| Setting { axis: Axis::Effect(effect), source: base.with(|s| s.effects = effects) }),
            );
        }
    }
    all.retain(|setting| setting.source != *base);
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
    use super::*;

    /// A setting with a value of its own.
    fn setting(axis: Axis, set: impl FnOnce(&mut RenderSettings)) -> Setting {
        Setting { axis, source: RenderSettings::default().with(set) }
    }

    #[test]
    fn values_are_said_as_they_are_meant() {
        let said = |axis, set: fn(&mut gs_core::Accuracy)| setting(axis, |s| set(&mut s.accuracy)).change().to_string();
        assert_eq!(said(Axis::AlphaCut, |a| a.alpha_cut = 1.0 / 255.0), "alpha cut 1/255");
        assert_eq!(said(Axis::AlphaCut, |a| a.alpha_cut = 1e-6), "alpha cut 1e-6");
        assert_eq!(said(Axis::AlphaCut, |a| a.alpha_cut = 1.0 / 16.0), "alpha cut 0.0625");
        assert_eq!(said(Axis::TransmittanceMin, |a| a.transmittance_min = 0.0), "full below 0");
        assert_eq!(said(Axis::TransmittanceMin, |a| a.transmittance_min = 1e-4), "full below 1e-4");
    }

    #[test]
    fn only_what_a_scene_can_have_is_tried_and_never_what_it_has() {
        let tried = alternatives(&RenderSettings::blended(Blend::Sum));
        assert!(tried.iter().all(|s| s.axis == Axis::AlphaCut), "{tried:?}");
        let mut space = RenderSettings::blended(Blend::Over);
        space.effects.order = Order::Global;
        space.effects.sh_degree = 2;
        let tried = alternatives(&space);
        let names: Vec<String> = tried.iter().map(|setting| setting.change().to_string()).collect();
        for expected in ["order per-pixel", "sh-degree 1", "antialias mip", "full below 0", "alpha cut 1e-6"] {
            assert!(names.iter().any(|name| name == expected), "{expected}: {names:?}");
        }
        for setting in tried {
            let settings = setting.applied_to(&space);
            settings.validate().unwrap();
            assert_ne!(settings, space);
        }
    }
}
