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
#[derive(Debug, Clone, Copy)]
pub struct Filter {
    property: &'static Property,
    comparison: Comparison,
    number: f32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Comparison {
    Less,
    LessOrEqual,
    More,
    MoreOrEqual,
}

impl PartialEq for Filter {
    fn eq(&self, other: &Self) -> bool {
        (self.property.0, self.comparison, self.number) == (other.property.0, other.comparison, other.number)
    }
}

impl FromStr for Filter {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (at, comparison, length) = text
            .find(['<', '>'])
            .map(|at| match (&text[at..=at], text[at + 1..].starts_with('=')) {
                ("<", false) => (at, Comparison::Less, 1),
                ("<", true) => (at, Comparison::LessOrEqual, 2),
                (_, false) => (at, Comparison::More, 1),
                (_, true) => (at, Comparison::MoreOrEqual, 2),
            })
            .ok_or_else(|| "a filter is a property, <, <=, > or >=, and a number, such as opacity<0.02".to_owned())?;
        let name = text[..at].trim();
        let property = PROPERTIES.iter().find(|(known, _)| *known == name).ok_or_else(|| {
            let names = PROPERTIES.map(|(name, _)| name).join(", ");
            format!("`{name}` is no property of a Gaussian: use {names}")
        })?;
        let number = text[at + length..].trim();
        match number.parse::<f32>() {
            Ok(value) if value.is_finite() => Ok(Self { property, comparison, number: value }),
            _ => Err(format!("`{number}` is not a number of 32 bits")),
        }
    }
}

impl Filter {
    /// Whether the property depends on views.
    pub fn needs_views(&self) -> bool {
        self.property.1.is_none()
    }

    /// Which Gaussians it is true of, `[N]`; `None` where that depends on views.
    pub(super) fn holds(&self, scene: &Scene3d) -> Option<Vec<bool>> {
        let value = self.property.1?;
        Some((0..scene.len()).map(|index| self.is_true_of(value(scene, index))).collect())
    }

    /// Whether a Gaussian with this value of the property fulfils it.
    pub fn is_true_of(&self, value: f32) -> bool {
        match self.comparison {
            Comparison::Less => value < self.number,
            Comparison::LessOrEqual => value <= self.number,
            Comparison::More => value > self.number,
            Comparison::MoreOrEqual => value >= self.number,
        }
    }
}
