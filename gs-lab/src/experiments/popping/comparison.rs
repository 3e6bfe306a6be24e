//! Both orders of blending before a camera that moves slowly: how much of what changes jumps.
//!
//! The measure is [`flicker`], the second difference of three frames, in 8-bit levels. Its square, summed over the frames of an arc and halved, as each
//! jump is in two triples, is what jumped there: on average over the places of a stretch that a jump may have, it does not depend on the step (the
//! coarser triples of a short stretch see its middle more often than its ends), while motion contributes in proportion to the step's cube. So
//! each flight is looked at with three steps, and what stays is popping. The coarser steps skip frames of the finest: all are made of the same
//! pictures.
//!
//! Squares, because sharp edges between Gaussians that pass through each other sweep over the picture and make its pixels jump, one by one. Nobody
//! sees that. Of an area that jumps at once and one whose pixels jump each at its own time the magnitudes have the same sum; the squares have not.

use pollster::FutureExt as _;
use std::collections::VecDeque;

use gs_core::{
    Camera, Error as CoreError, Image, Optimizer, Parameterization, RenderSettings, Scene3d, effects::Order,
};
use rayon::prelude::*;

use super::flicker::{Flicker, flicker};
use crate::statistics::mean;
use gs_core::view::Orbit;
use gs_train::Error;

/// The orders that are compared, the field's first.
pub const ORDERS: [Order; 2] = [Order::Global, Order::PerPixel];

/// Frames from one of a triple to the next: the finest step and its multiples.
pub const STRIDES: [usize; 3] = [1, 2, 4];

/// Flicker that is seen: of more than four 8-bit levels over a window, a difference that an attentive eye notices. Popping is counted from here on.
pub const VISIBLE_LEVELS: f64 = 4.0;

/// Most frames of a stretch.
const MOST_FRAMES: u32 = 10_000;

/// Most frames of all stretches together.
const MOST_FRAMES_IN_ALL: u64 = 1_000_000;

/// Most pixels of a frame: 4K fits. What is held of a stretch at a time takes some 300 bytes a pixel, of these 2.5 GB.
const MOST_PIXELS: u64 = 1 << 23;

/// Short stretches of an orbit, slowly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlowOrbit {
    /// What is gone around; as many stretches begin as it has frames, evenly spread.
    pub orbit: Orbit,
    /// Frames of a stretch: 9, which the coarsest triple needs, to 10,000.
    pub frames: u32,
    /// Between two frames, degrees: the finest step. Above 0, at most 5.
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

/// What jumped under one order, looked at with one step.
#[derive(Debug, Clone, PartialEq)]
pub struct Popping {
    /// The squares of what jumps while the camera turns by a degree: 8-bit levels², mean over pixels; one a stretch.
    pub squares_per_degree: Vec<f64>,
    /// How often a pixel jumps visibly ([`VISIBLE_LEVELS`]) while the camera turns by a degree, mean over pixels; one a stretch.
    pub times_per_degree: Vec<f64>,
    /// The highest flicker of any window, 8-bit levels.
    pub highest: f64,
    /// The root mean square flicker of each triple of frames, 8-bit levels, stretch after stretch.
    pub trajectory: Vec<f64>,
}

impl Popping {
    /// The squares of what jumps while the camera turns by a degree, 8-bit levels², mean over pixels and stretches.
    pub fn squares(&self) -> f64 {
        mean(&self.squares_per_degree)
    }

    /// How often a pixel jumps visibly while the camera turns by a degree, mean over pixels and stretches.
    pub fn times(&self) -> f64 {
        mean(&self.times_per_degree)
    }
}

/// Both orders, looked at with one step.
#[derive(Debug, Clone, PartialEq)]
pub struct AtStep {
    /// Between frames, degrees.
    pub step_degrees: f64,
    /// One for each of [`ORDERS`].
    pub orders: [Popping; 2],
}

impl AtStep {
    /// By one depth a Gaussian.
    pub fn tile(&self) -> &Popping {
        &self.orders[0]
    }

    /// By the depth at each pixel.
    pub fn pixel(&self) -> &Popping {
        &self.orders[1]
    }
}

/// Where popping shows best: the frames around the triple, and the pixel, where the first of [`ORDERS`] flickers most beyond the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// The cameras of the triple, at the finest step.
    pub cameras: [Camera; 3],
    /// Column and row of the window's middle.
    pub pixel: (u32, u32),
    /// How much more the first order flickers there, 8-bit levels.
    pub excess: f64,
}

/// What came out of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// One for each of [`STRIDES`], the finest first.
    pub steps: Vec<AtStep>,
    /// Where it shows best.
    pub moment: Moment,
}

impl Comparison {
    /// At the finest step, of which motion contributes least.
    pub fn finest(&self) -> &AtStep {
        &self.steps[0]
    }
}

/// Renders each stretch in both orders, all else as `render` has it, and measures what jumps.
///
/// # Errors
/// [`CoreError::Setting`] where the flight is not possible; those of the backend, such as [`CoreError::Unsupported`] where it has not both
/// orders.
pub fn compare<R: Optimizer<Scene3d>>(
    rasterizer: &R,
    scene: &Scene3d,
    flight: &SlowOrbit,
    first: &Camera,
    render: &RenderSettings,
) -> Result<Comparison, Error> {
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
    Ok(Comparison { steps: STRIDES.into_iter().zip(tallies).map(step).collect(), moment: best })
}

/// The settings with another order.
pub(super) fn ordered(render: &RenderSettings, order: Order) -> RenderSettings {
    let mut render = *render;
    render.effects.order = order;
    render
}

/// For each stride, that of each order's triple which ends with the newest frame (at the front); empty while there are too few frames.
fn flickers(frames: &[VecDeque<Image>; 2]) -> Result<Vec<Vec<Flicker>>, CoreError> {
    let of = |frames: &VecDeque<Image>, stride: usize| {
        let triple = [frames.get(2 * stride)?, frames.get(stride)?, frames.front()?];
        Some(flicker(triple))
    };
    STRIDES.par_iter().map(|&stride| frames.par_iter().filter_map(|frames| of(frames, stride)).collect()).collect()
}

/// Where the first flickers most beyond the second, and by how many 8-bit levels.
fn greatest_excess(a: &Flicker, b: &Flicker) -> Option<(f64, (u32, u32))> {
    let excess = a.values().iter().zip(b.values()).map(|(a, b)| a - b);
    let (index, excess) = excess.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    Some((f64::from(excess) * 255.0, a.position(index)))
}

/// What is added up over triples.
#[derive(Default)]
struct Tally {
    /// Mean square flicker of each triple, levels², and the share of its windows that is visible; stretch by stretch.
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
