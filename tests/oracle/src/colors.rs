//! Colours of pixels by the definitions of [`pixel`](super::pixel), without derivatives and without
//! an analysis of roundings: fast enough for scenes of many Gaussians.

use gs_core::{
    Cut, RenderSettings,
    effects::{Blend, Order},
};

use super::{Oracle, Projection, Splat};

impl Oracle {
    /// The unclamped colours of the pixels in these columns and rows.
    ///
    /// `projected` is the result of [`Self::project`].
    pub fn colors_at(&self, projected: &[Projection], pixels: &[[u32; 2]]) -> Vec<[f64; 3]> {
        pixels.iter().map(|&[x, y]| self.color(projected, [f64::from(x) + 0.5, f64::from(y) + 0.5])).collect()
    }

    fn color(&self, projected: &[Projection], p: [f64; 2]) -> [f64; 3] {
        let RenderSettings { effects, accuracy, .. } = &self.settings;
        let background = self.settings.background_color().map(f64::from);
        let over = effects.blend == Blend::Over;
        let drawable = projected.iter().filter_map(|projection| match projection {
            Projection::Drawable(splat) => Some(splat),
            Projection::Left(_) => None,
        });
        let seen = drawable.filter_map(|splat| {
            let opacity = if over { splat.appearance().opacity } else { 1.0 };
            let value = opacity * (-splat.sigma(p)).exp();
            (accuracy.cut == Cut::Smooth || value >= f64::from(accuracy.alpha_cut)).then_some((splat, value))
        });
        if !over {
            return seen.fold(background, |color, (splat, w)| {
                let shown = splat.appearance().color;
                [0, 1, 2].map(|k| color[k] + w * shown[k])
            });
        }
        let mut seen: Vec<(f64, &Box<dyn Splat>, f64)> =
            seen.map(|(splat, value)| (splat.depth(p, effects.order).value, splat, value)).collect();
        if effects.order != Order::Index {
            seen.sort_by(|a, b| a.0.total_cmp(&b.0)); // Stable: ties by index.
        }
        let (mut color, mut t) = ([0.0; 3], 1.0);
        for (_, splat, value) in seen {
            let alpha = value.min(f64::from(accuracy.alpha_max));
            let behind = t * (1.0 - alpha);
            if behind < f64::from(accuracy.transmittance_min) {
                break;
            }
            let shown = splat.appearance().color;
            color = [0, 1, 2].map(|k| color[k] + t * alpha * shown[k]);
            t = behind;
        }
        [0, 1, 2].map(|k| color[k] + t * background[k])
    }
}
