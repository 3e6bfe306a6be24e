//! `gs info --measure`: lengths and areas in a 3D scene.

use std::str::FromStr;

use glam::{DVec2, DVec3, Vec2};
use gs_core::{Region, Scene as _, counted};
use gs_io::File3d;
use serde::Serialize;

use super::number;
use crate::{failure::Failure, terminal::output};

/// What is measured, in coordinates of the scene.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Measure {
    Distance(DVec3, DVec3),
    /// Corners (x, z), as seen from above.
    Polygon(Vec<DVec2>),
}

/// What `gs info --measure --json` prints, in units of the scene and of its world.
#[derive(Debug, Serialize)]
struct Measured {
    /// A length.
    length: f64,
    length_in_world: f64,
    /// An area, whose border has the length.
    area: Option<f64>,
    area_in_world: Option<f64>,
    /// Gaussians above and below the area, and the range of y of their means.
    gaussians: Option<usize>,
    y: Option<[f32; 2]>,
}

impl FromStr for Measure {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (values, is_polygon) = text.strip_prefix("polygon:").map_or((text, false), |values| (values, true));
        let values: Option<Vec<f64>> =
            values.split(',').map(|value| value.trim().parse().ok().filter(|value: &f64| value.is_finite())).collect();
        match values.as_deref() {
            Some(&[a, b, c, d, e, f]) if !is_polygon => Ok(Self::Distance(DVec3::new(a, b, c), DVec3::new(d, e, f))),
            Some(values) if is_polygon && values.len() >= 6 && values.len().is_multiple_of(2) => {
                Ok(Self::Polygon(values.chunks_exact(2).map(DVec2::from_slice).collect()))
            }
            _ => Err("write it as X,Y,Z,X,Y,Z or as polygon:X,Z,X,Z,X,Z".to_owned()),
        }
    }
}

impl Measure {
    /// Prints it.
    pub(super) fn print(&self, file: &File3d, json: bool) -> Result<(), Failure> {
        let unit = file.trained_with.frame.unit;
        let measured = match self {
            Self::Distance(a, b) => Measured::of(a.distance(*b), unit),
            Self::Polygon(corners) => {
                let edges = || corners.iter().zip(corners.iter().cycle().skip(1));
                let area = 0.5 * edges().map(|(a, b)| a.perp_dot(*b)).sum::<f64>().abs();
                let prism =
                    Region::Prism { corners: corners.iter().map(|corner| corner.as_vec2()).collect::<Vec<Vec2>>() };
                let inside = (0..file.scene.len()).map(|index| file.scene.means[index]);
                let heights: Vec<f32> = inside.filter(|mean| prism.contains(*mean)).map(|mean| mean.y).collect();
                let y = [f32::min, f32::max].map(|pick: fn(f32, f32) -> f32| heights.iter().copied().reduce(pick));
                Measured {
                    area: Some(area),
                    area_in_world: Some(area * unit * unit),
                    gaussians: Some(heights.len()),
                    y: y[0].zip(y[1]).map(|(low, high)| [low, high]),
                    ..Measured::of(edges().map(|(a, b)| a.distance(*b)).sum(), unit)
                }
            }
        };
        output::answer(json, &measured, || measured.text())
    }
}

impl Measured {
    fn of(length: f64, unit: f64) -> Self {
        Self { length, length_in_world: length * unit, area: None, area_in_world: None, gaussians: None, y: None }
    }

    fn text(&self) -> String {
        let both = |value: f64, world: f64| match value == world {
            true => format!("{value:.6}"),
            false => format!("{value:.6} (in the world: {world:.6})"),
        };
        let mut text = format!("length     {}", both(self.length, self.length_in_world));
        if let (Some(area), Some(world), Some(gaussians)) = (self.area, self.area_in_world, self.gaussians) {
            text += &format!("\narea       {}\ninside     {}", both(area, world), counted(gaussians, "Gaussian"));
        }
        self.y.map_or(text.clone(), |[low, high]| format!("{text}, y from {} to {}", number(low), number(high)))
    }
}
