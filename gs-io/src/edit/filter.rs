//! A condition on a property of a Gaussian, such as `opacity<0.02`.

use std::str::FromStr;

use glam::Vec3;
use gs_core::{Scene as _, Scene3d, math::sh, sigmoid};

/// A property: its name, and its value for a Gaussian; `None` for what only views can tell.
type Property = (&'static str, Option<fn(&Scene3d, usize) -> f32>);

/// The properties. Sizes are standard deviations along the longest or the shortest axis, in units of the scene.
const PROPERTIES: [Property; 10] = [
    ("opacity", Some(|scene, i| sigmoid(scene.opacity_logits[i]))),
    ("size", Some(|scene, i| scene.log_scales[i].max_element().exp())),
    ("thickness", Some(|scene, i| scene.log_scales[i].min_element().exp())),
    ("x", Some(|scene, i| scene.means[i].x)),
    ("y", Some(|scene, i| scene.means[i].y)),
    ("z", Some(|scene, i| scene.means[i].z)),
    ("red", Some(|scene, i| color(scene, i)[0])),
    ("green", Some(|scene, i| color(scene, i)[1])),
    ("blue", Some(|scene, i| color(scene, i)[2])),
    ("contribution", None),
];

/// The colour without its dependence on the direction.
fn color(scene: &Scene3d, index: usize) -> [f32; 3] {
    sh::color(0, Vec3::Z, &scene.sh[index * scene.sh_len()..][..1])
}

/// A comparison of a property with a number, parsed from text such as `opacity<0.02`. The properties are opacity
/// (0 to 1), size and thickness (the standard deviation along the longest and the shortest axis, world units), x, y, z,
/// red, green and blue (without what depends on the direction), and contribution: the sum of the Gaussian's blending
/// weights in the view where it is largest, px, which only views can tell ([`Self::needs_views`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filter {
    /// Its place in [`PROPERTIES`].
    property: usize,
    /// Whether it asks for more than the number, or for less.
    more: bool,
    or_equal: bool,
    number: f32,
}

impl FromStr for Filter {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let at = text
            .find(['<', '>'])
            .ok_or_else(|| "a filter is a property, <, <=, > or >=, and a number, such as opacity<0.02".to_owned())?;
        let (name, more, number) = (text[..at].trim(), text[at..].starts_with('>'), &text[at + 1..]);
        let or_equal = number.starts_with('=');
        let property = PROPERTIES.iter().position(|(known, _)| *known == name).ok_or_else(|| {
            let names = PROPERTIES.map(|(name, _)| name).join(", ");
            format!("`{name}` is no property of a Gaussian: use {names}")
        })?;
        let number = number.strip_prefix('=').unwrap_or(number).trim();
        match number.parse::<f32>() {
            Ok(value) if value.is_finite() => Ok(Self { property, more, or_equal, number: value }),
            _ => Err(format!("`{number}` is not a number of 32 bits")),
        }
    }
}

impl Filter {
    /// Whether the property depends on views.
    pub fn needs_views(&self) -> bool {
        PROPERTIES[self.property].1.is_none()
    }

    /// Which Gaussians it is true of, `[N]`; `None` where that depends on views.
    pub(super) fn holds(&self, scene: &Scene3d) -> Option<Vec<bool>> {
        let value = PROPERTIES[self.property].1?;
        Some((0..scene.len()).map(|index| self.is_true_of(value(scene, index))).collect())
    }

    /// Whether a Gaussian with this value of the property fulfils it.
    pub fn is_true_of(&self, value: f32) -> bool {
        let differs = if self.more { value > self.number } else { value < self.number };
        differs || self.or_equal && value == self.number
    }
}
