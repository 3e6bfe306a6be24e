//! Compares both sort orders under a slowly moving camera.
//!
//! The measure is [`flicker`], the second difference of three frames, in 8-bit levels. Its square,
//! summed over the frames of an arc and halved because each jump is in two triples, measures the
//! jumps. Averaged over the possible positions of a jump it does not depend on the step, while
//! motion contributes in proportion to the cube of the step. So each flight is evaluated with three
//! steps; what does not change with the step is popping. The coarser steps skip frames of the
//! finest, so all use the same pictures.
//!
//! Squares are summed because sharp edges between intersecting Gaussians sweep over the picture and
//! make its pixels jump one by one, which is not visible. The sum of magnitudes would be the same
//! for an area that jumps at once; the sum of squares is not.

use gs_backend::FutureExt as _;
use std::collections::VecDeque;

use gs_core::{
    Camera, Error as CoreError, Image, Optimizer, Parameterization, RenderSettings, Scene3d, effects::Order,
};
use rayon::prelude::*;

use super::flicker::{Flicker, flicker};
use crate::result::mean;
use gs_core::view::Orbit;
use gs_train::Error;

/// The orders that are compared.
pub(crate) const ORDERS: [Order; 2] = [Order::Global, Order::PerPixel];

/// Distances between the frames of a triple: the finest step and its multiples.
pub const STRIDES: [usize; 3] = [1, 2, 4];

/// Visible flicker: more than four 8-bit levels over a window. Popping is counted above this.
pub(crate) const VISIBLE_LEVELS: f64 = 4.0;

/// Largest number of frames of a stretch.
const MOST_FRAMES: u32 = 10_000;

/// Largest number of frames of all stretches together.
const MOST_FRAMES_IN_ALL: u64 = 1_000_000;

/// Largest number of pixels of a frame, so that 4K fits. A stretch needs about 300 bytes a pixel,
/// or 2.5 GB.
const MOST_PIXELS: u64 = 1 << 23;

/// Slow camera movements along short stretches of an orbit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlowOrbit {
    /// The orbit. As many stretches as it has frames begin evenly spread along it.
    pub orbit: Orbit,
    /// Frames per stretch: 9, which the coarsest triple needs, to 10,000.
    pub frames: u32,
    /// Angle between two frames, degrees: above 0, at most 5.
    pub step_degrees: f32,
}

impl SlowOrbit {
    /// The cameras of each stretch; the first begins with `first`.
    ///
    /// # Errors
    /// [`CoreError::Setting`] where frames or step are not possible, or would take too much memory.
    pub fn stretches(&self, first: &Camera) -> Result<Vec<Vec<Camera>>, CoreError> {
        let least = 2 * STRIDES[STRIDES.len() - 1] as u32 + 1;
        if !(least..=MOST_FRAMES).contains(&self.frames) {
            return Err(CoreError::setting("frames of a stretch", self.frames, "9 to 10,000"));
        }
        if !(1..=MOST_FRAMES).contains(&self.orbit.frames) {
            return Err(CoreError::setting("stretches of the orbit", self.orbit.frames, "1 to 10,000"));
        }
        if !(self.step_degrees > 0.0 && self.step_degrees <= 5.0) {
            return Err(CoreError::setting("the step between frames", self.step_degrees, "above 0, at most 5 degrees"));
        }
        let in_all = u64::from(self.frames) * u64::from(self.orbit.frames);
        if in_all > MOST_FRAMES_IN_ALL {
            return Err(CoreError::setting("frames of all stretches together", in_all, "at most 1,000,000"));
        }
        let pixels = u64::from(first.width) * u64::from(first.height);
        if pixels > MOST_PIXELS {
            return Err(CoreError::setting("pixels of a frame", pixels, "at most 8,388,608, such as 3840x2160"));
        }
        let angle = |frame: u32| (self.step_degrees * frame as f32).to_radians();
        let stretch = |begin| (0..self.frames).map(|frame| self.orbit.turned(begin, angle(frame))).collect();
        Ok(self.orbit.cameras(first).iter().map(stretch).collect())
    }
}

/// The jumps with one order, evaluated with one step.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Popping {
    /// Squared jumps while the camera turns by a degree, 8-bit levels², averaged over pixels; one
    /// value per stretch.
    pub(crate) squares_per_degree: Vec<f64>,
    /// Visible jumps ([`VISIBLE_LEVELS`]) of a pixel while the camera turns by a degree, averaged
    /// over pixels; one value per stretch.
    pub(crate) times_per_degree: Vec<f64>,
    /// The highest flicker of any window, 8-bit levels.
    pub(crate) highest: f64,
    /// Root mean square flicker of each triple of frames, 8-bit levels, stretch after stretch.
    pub(crate) trajectory: Vec<f64>,
}

impl Popping {
    /// Squared jumps while the camera turns by a degree, 8-bit levels², averaged over pixels and
    /// stretches.
    pub(crate) fn squares(&self) -> f64 {
        mean(&self.squares_per_degree)
    }

    /// Visible jumps of a pixel while the camera turns by a degree, averaged over pixels and
    /// stretches.
    pub(crate) fn times(&self) -> f64 {
        mean(&self.times_per_degree)
    }
}

/// Both orders, evaluated with one step.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct AtStep {
    /// Angle between frames, degrees.
    pub step_degrees: f64,
    /// Results of the two orders, in the order of [`ORDERS`].
    pub(crate) orders: [Popping; 2],
}

impl AtStep {
    /// The result with the global sort.
    pub(crate) fn tile(&self) -> &Popping {
        &self.orders[0]
    }

    /// The result with the per-pixel sort.
    pub(crate) fn pixel(&self) -> &Popping {
        &self.orders[1]
    }
}

/// The frames and the pixel at which the first of [`ORDERS`] flickers most beyond the other.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Moment {
    /// The cameras of the triple, with the finest step.
    pub(crate) cameras: [Camera; 3],
    /// Column and row of the window's middle.
    pub(crate) pixel: (u32, u32),
    /// The excess of the first order's flicker, 8-bit levels.
    pub(crate) excess: f64,
}

/// The result of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct PoppingComparison {
    /// Results for each of [`STRIDES`], the finest first.
    pub(crate) steps: Vec<AtStep>,
    /// Where popping shows best.
    pub(crate) moment: Moment,
}

impl PoppingComparison {
    /// The finest step, to which motion contributes least.
    pub(crate) fn finest(&self) -> &AtStep {
        &self.steps[0]
    }
}

/// Renders each stretch with both orders and otherwise the settings `render`, and measures the
/// jumps.
///
/// # Errors
/// [`CoreError::Setting`] where the flight is not possible; those of the backend, such as
/// [`CoreError::Unsupported`] where it does not support both orders.
pub fn compare<R: Optimizer<Scene3d>>(
    rasterizer: &R,
    scene: &Scene3d,
    flight: &SlowOrbit,
    first: &Camera,
    render: &RenderSettings,
) -> Result<PoppingComparison, Error> {
    let splats = rasterizer.upload(scene, Parameterization::ScaleRotation)?;
    let stretches = flight.stretches(first)?;
    let mut tallies = [(); STRIDES.len()].map(|()| [Tally::default(), Tally::default()]);
    let mut best = Moment { cameras: [*first; 3], pixel: (0, 0), excess: f64::NEG_INFINITY };
    for stretch in &stretches {
        tallies.iter_mut().flatten().for_each(Tally::begin_stretch);
        let mut frames: [VecDeque<Image>; 2] = Default::default();
        for (number, camera) in stretch.iter().enumerate() {
            for (order, frames) in ORDERS.into_iter().zip(&mut frames) {
                frames.push_front(
                    rasterizer
                        .image(&rasterizer.forward(&splats, camera, &ordered(render, order)).block_on()?)
                        .block_on()?,
                );
                frames.truncate(2 * STRIDES[STRIDES.len() - 1] + 1);
            }
            let found = flickers(&frames)?;
            for (tallies, found) in tallies.iter_mut().zip(&found) {
                tallies.iter_mut().zip(found).for_each(|(tally, found)| tally.add(found));
            }
            if let [tile, pixel] = found[0].as_slice()
                && let Some((excess, pixel)) = greatest_excess(tile, pixel).filter(|(excess, _)| *excess > best.excess)
            {
                best = Moment { cameras: [stretch[number - 2], stretch[number - 1], *camera], pixel, excess };
            }
        }
    }
    let step = |(stride, tallies): (usize, [Tally; 2])| {
        let step_degrees = f64::from(flight.step_degrees) * stride as f64;
        AtStep { step_degrees, orders: tallies.map(|tally| tally.popping(step_degrees)) }
    };
    Ok(PoppingComparison { steps: STRIDES.into_iter().zip(tallies).map(step).collect(), moment: best })
}

/// The settings with another order.
pub(crate) fn ordered(render: &RenderSettings, order: Order) -> RenderSettings {
    let mut render = *render;
    render.effects.order = order;
    render
}

/// The flicker for each stride and order: that of the triple that ends with the newest frame (at
/// the front); empty with too few frames.
fn flickers(frames: &[VecDeque<Image>; 2]) -> Result<Vec<Vec<Flicker>>, CoreError> {
    let of = |frames: &VecDeque<Image>, stride: usize| {
        let triple = [frames.get(2 * stride)?, frames.get(stride)?, frames.front()?];
        Some(flicker(triple))
    };
    STRIDES.par_iter().map(|&stride| frames.par_iter().filter_map(|frames| of(frames, stride)).collect()).collect()
}

/// The pixel at which `a` flickers most beyond `b`, with the excess in 8-bit levels.
fn greatest_excess(a: &Flicker, b: &Flicker) -> Option<(f64, (u32, u32))> {
    let excess = a.values().iter().zip(b.values()).map(|(a, b)| a - b);
    let (index, excess) = excess.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    Some((f64::from(excess) * 255.0, a.position(index)))
}

/// Sums over triples.
#[derive(Default)]
struct Tally {
    /// Mean square flicker of each triple, levels², and its share of visible windows, by stretch.
    stretches: Vec<Vec<(f64, f64)>>,
    highest: f64,
}

impl Tally {
    fn begin_stretch(&mut self) {
        self.stretches.push(Vec::new());
    }

    fn add(&mut self, found: &Flicker) {
        let highest = found.values().iter().copied().fold(0.0, f32::max);
        self.highest = self.highest.max(255.0 * f64::from(highest));
        let triple = (255.0 * 255.0 * found.mean_square(), found.share_above(VISIBLE_LEVELS as f32 / 255.0));
        if let Some(stretch) = self.stretches.last_mut() {
            stretch.push(triple);
        }
    }

    fn popping(self, step_degrees: f64) -> Popping {
        // Each jump is in two triples.
        let per_degree = |of: fn(&(f64, f64)) -> f64| {
            self.stretches.iter().map(|stretch| mean(stretch.iter().map(of)) / (2.0 * step_degrees)).collect()
        };
        Popping {
            squares_per_degree: per_degree(|triple| triple.0),
            times_per_degree: per_degree(|triple| triple.1),
            highest: self.highest,
            trajectory: self.stretches.iter().flatten().map(|triple| triple.0.sqrt()).collect(),
        }
    }
}
