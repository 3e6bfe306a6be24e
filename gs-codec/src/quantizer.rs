//! Quantization: a Gaussian becomes a few integers, and these a Gaussian again.
//!
//! All parameters are rounded so that each adds about the same squared error to the image. The unit
//! is the energy of a Gaussian: the amplitude u = c·√(π·s₁·s₂) is the colour c times the L2 norm of
//! its weight, so rounding u by δ changes the image by δ². With u in units of the step, as integers
//! of length n, a shift by ξ standard deviations changes the image by about (n·ξ)²/2, a change of
//! ln(s₁s₂) or ln(s₁/s₂) by x changes it by (n·x)²/4, and a turn by θ by (n·θ·sinh(ln(s₁/s₂)))². So
//! the steps of all other parameters follow from n, which is decoded first.
//!
//! Reconstruction uses products, quotients and square roots of `f64` alone: its bits are the same on
//! every machine.

use std::f64::consts::FRAC_1_SQRT_2;

use glam::{DVec3, Vec2, Vec3, dvec3};
use gs_core::Gaussian2d;

use crate::{
    exp2::{OCTAVE, exp2},
    grid::Grid,
    layer::{Code, LayerHead},
};

/// Largest sum of squares of an amplitude.
pub(crate) const MAX_NORM2: i64 = 1 << 40;
/// Largest number of directions of a Gaussian.
const MAX_DIRECTIONS: f64 = 32_768.0;
/// Range of log₂(s₁s₂), units of [`HALF`].
pub(crate) const AREA_RANGE: (i32, i32) = (-10 * HALF, 30 * HALF);
/// Largest log₂(s₁/s₂), units of [`HALF`].
pub(crate) const MAX_ASPECT: i32 = 20 * HALF;
/// Units of an octave of areas and aspects. log₂ s is half a sum of the two.
pub(crate) const HALF: i32 = OCTAVE / 2;

/// Quantizes the Gaussians of one layer.
#[derive(Debug, Clone)]
pub struct Quantizer {
    head: LayerHead,
    grid: Grid,
    /// Step of amplitudes.
    step: f64,
}

/// Steps of a Gaussian of some amplitude.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Steps {
    /// |u| in steps, in the middle of its class.
    pub(crate) norm: f64,
    /// Step of area and aspect, units of [`HALF`].
    pub(crate) log: i32,
}

/// The class of an amplitude: the octave of the sum of its squares, 0 to 40. Within a class all steps
/// are equal, so that colours can still change a little when the geometry is settled.
pub(crate) fn class_of(amplitude: [i32; 3]) -> u32 {
    let norm2: i64 = amplitude.iter().map(|&q| i64::from(q) * i64::from(q)).sum();
    norm2.clamp(1, MAX_NORM2).ilog2()
}

/// The decoded shape of a Gaussian.
#[derive(Debug, Clone, Copy)]
struct Shape {
    /// Scales, px.
    scales: [f64; 2],
    /// sin² and sin·cos of the angle, roughly.
    sin2: f64,
    sin_cos: f64,
}

impl Quantizer {
    /// A quantizer for layers with this head on a canvas of this size, px.
    pub fn new(head: LayerHead, size: (u32, u32)) -> Self {
        Self { head, grid: Grid::new(&head, size), step: exp2(head.step.into()) }
    }

    /// The head of the layer.
    pub fn head(&self) -> &LayerHead {
        &self.head
    }

    pub(crate) fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The integers of a Gaussian; `None` where it adds less to the image than half a step, or is
    /// not finite.
    pub fn quantize(&self, g: &Gaussian2d) -> Option<Code> {
        let finite = g.mean.is_finite() && g.log_scale.is_finite() && g.rotation.is_finite() && g.color.is_finite();
        if !finite {
            return None;
        }
        let (mut large, mut small, mut angle) =
            (f64::from(g.log_scale.x), f64::from(g.log_scale.y), f64::from(g.rotation) / std::f64::consts::PI);
        if small > large {
            (large, small, angle) = (small, large, angle + 0.5);
        }
        let octave = f64::from(HALF) / std::f64::consts::LN_2;
        let norm = (std::f64::consts::PI * (large + small).exp()).sqrt();
        let amplitude = self.rounded(g.color.as_dvec3() * norm)?;
        let steps = self.steps(amplitude);
        let area = rounded_to((large + small) * octave, steps.log, AREA_RANGE);
        let aspect = rounded_to((large - small) * octave, steps.log, (0, MAX_ASPECT));
        let directions = self.directions(&steps, aspect * steps.log);
        let turn = (angle * f64::from(directions)).round().rem_euclid(f64::from(directions)) as u32;
        let shape = shape(area * steps.log, aspect * steps.log, turn, directions);
        let (columns, rows) = self.places(&steps, &shape);
        let mean = g.mean.as_dvec2();
        let y = self.grid.rounded(mean.y, rows, self.grid.rows);
        // A needle moves along itself by what its row is off.
        let [large, small] = shape.scales.map(|s| s * s);
        let (yy, xy) = (large * shape.sin2 + small * (1.0 - shape.sin2), (large - small) * shape.sin_cos);
        let x = mean.x - xy / yy * (mean.y - self.grid.at(y, rows));
        let x = self.grid.rounded(x, columns, self.grid.columns);
        Some(Code { amplitude, area, aspect, turn, column: x.0, row: y.0, x: x.1, y: y.1 })
    }

    /// An amplitude in steps; `None` where it rounds to 0.
    fn rounded(&self, amplitude: DVec3) -> Option<[i32; 3]> {
        let along = AXES.map(|axis| amplitude.dot(axis) / self.step);
        let rounded = along.map(|value| value.round().clamp(-500_000.0, 500_000.0) as i32);
        (rounded != [0; 3]).then_some(rounded)
    }

    /// The steps of a Gaussian of this amplitude.
    pub(crate) fn steps(&self, amplitude: [i32; 3]) -> Steps {
        let norm = exp2(OCTAVE / 4 + OCTAVE / 2 * class_of(amplitude) as i32);
        let log = f64::from(HALF) * 2.0 * std::f64::consts::LOG2_E * ratio(self.head.shape_ratio) / norm;
        Steps { norm, log: log.round().clamp(1.0, f64::from(4 * HALF)) as i32 }
    }

    /// Number of directions of a Gaussian of this aspect, units of [`HALF`].
    pub(crate) fn directions(&self, steps: &Steps, aspect: i32) -> u32 {
        let quotient = exp2(2 * aspect);
        let sinh = (quotient - 1.0 / quotient) * 0.5;
        let count = std::f64::consts::PI * steps.norm * sinh / ratio(self.head.turn_ratio);
        count.ceil().clamp(1.0, MAX_DIRECTIONS) as u32
    }

    /// Numbers of places in a cell, along x and y.
    fn places(&self, steps: &Steps, shape: &Shape) -> (u32, u32) {
        let [large, small] = shape.scales;
        let high = (large * large * shape.sin2 + small * small * (1.0 - shape.sin2)).sqrt();
        let step = std::f64::consts::SQRT_2 * ratio(self.head.mean_ratio) / steps.norm;
        let places = |size: f64| (f64::from(self.head.cell) / (size * step)).round().clamp(1.0, 4096.0) as u32;
        (places(large * small / high), places(high))
    }

    /// Numbers of places in a cell, along x and y, of a Gaussian whose shape is known.
    pub(crate) fn places_of(&self, code: &Code, steps: &Steps, directions: u32) -> (u32, u32) {
        self.places(steps, &shape(code.area * steps.log, code.aspect * steps.log, code.turn, directions))
    }

    /// The Gaussian of these integers.
    pub fn reconstruct(&self, code: &Code) -> Gaussian2d {
        let steps = self.steps(code.amplitude);
        let (area, aspect) = (code.area * steps.log, code.aspect * steps.log);
        let directions = self.directions(&steps, aspect);
        let (columns, rows) = self.places_of(code, &steps, directions);
        let octave = std::f64::consts::LN_2 / f64::from(OCTAVE);
        let mean = [self.grid.at((code.column, code.x), columns), self.grid.at((code.row, code.y), rows)];
        let color = self.step / (std::f64::consts::PI * exp2(2 * area)).sqrt();
        let along = AXES.iter().zip(code.amplitude).map(|(&axis, q)| axis * f64::from(q));
        Gaussian2d {
            mean: Vec2::from_array(mean.map(|v| v as f32)),
            log_scale: Vec2::new(
                (f64::from(area + aspect) * octave) as f32,
                (f64::from(area - aspect) * octave) as f32,
            ),
            rotation: (f64::from(code.turn) * std::f64::consts::PI / f64::from(directions)) as f32,
            opacity_logit: f32::INFINITY,
            color: along.fold(Vec3::ZERO.as_dvec3(), |sum, v| sum + v * color).as_vec3(),
        }
    }
}

/// Orthonormal axes of amplitudes in RGB: luminance, red − blue, green − magenta.
const AXES: [DVec3; 3] = [
    dvec3(0.577_350_269_189_625_8, 0.577_350_269_189_625_8, 0.577_350_269_189_625_8),
    dvec3(FRAC_1_SQRT_2, 0.0, -FRAC_1_SQRT_2),
    dvec3(-0.408_248_290_463_863, 0.816_496_580_927_726, -0.408_248_290_463_863),
];

/// A ratio of the head, in units of 1/32.
fn ratio(value: u8) -> f64 {
    f64::from(value) / 32.0
}

fn rounded_to(value: f64, step: i32, (least, most): (i32, i32)) -> i32 {
    let step = f64::from(step);
    (value / step).round().clamp((f64::from(least) / step).ceil(), (f64::from(most) / step).floor()) as i32
}

/// The shape of these values, units of [`HALF`], and directions. Sine and cosine are those of
/// Bhaskara's formula, which only decides about steps.
fn shape(area: i32, aspect: i32, turn: u32, directions: u32) -> Shape {
    let scales = [exp2(area + aspect), exp2(area - aspect)];
    let (sin, cos) = sin_cos(f64::from(turn) / f64::from(directions));
    Shape { scales, sin2: sin * sin, sin_cos: sin * cos }
}

/// Sine and cosine of half turns in 0..1, with an error below 0.002 and sin² + cos² = 1.
pub(crate) fn sin_cos(half_turns: f64) -> (f64, f64) {
    let product = half_turns * (1.0 - half_turns);
    let sin = 16.0 * product / (5.0 - 4.0 * product);
    let cos = (1.0 - sin * sin).max(0.0).sqrt();
    (sin, if half_turns > 0.5 { -cos } else { cos })
}
