//! Compares two ways of drawing a scene under a slowly moving camera.
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

use std::collections::VecDeque;

use gs_core::{Camera, Error as CoreError, Image, view::Orbit};
use gs_train::Error;
use rayon::prelude::*;

use super::{
    flicker::{Flicker, flicker},
    ways::Ways,
};
use crate::result::mean;

/// Distances between the frames of a triple: the finest step and its multiples.
const STRIDES: [usize; 3] = [1, 2, 4];

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
    pub(crate) orbit: Orbit,
    /// Frames per stretch: 9, which the coarsest triple needs, to 10,000.
    pub(crate) frames: u32,
    /// Angle between two frames, degrees: above 0, at most 5.
    pub(crate) step_degrees: f32,
}

impl SlowOrbit {
    /// A flight whose coarsest triples have frames `step_degrees` apart.
    pub fn new(orbit: Orbit, frames: u32, step_degrees: f32) -> Self {
        Self { orbit, frames, step_degrees: step_degrees / STRIDES[STRIDES.len() - 1] as f32 }
    }

    /// The cameras of each stretch; the first begins with `first`.
    ///
    /// # Errors
    /// [`CoreError::Setting`] where frames or step are not possible, or would take too much memory.
    pub fn stretches(&self, first: &Camera) -> Result<Vec<Vec<Camera>>, CoreError> {
        let Self { orbit, frames, step_degrees } = *self;
        let least = 2 * STRIDES[STRIDES.len() - 1] as u32 + 1;
        let in_all = u64::from(frames) * u64::from(orbit.frames);
        let pixels = u64::from(first.width) * u64::from(first.height);
        CoreError::within("frames of a stretch", frames, least..=MOST_FRAMES, "9 to 10,000")?;
        CoreError::within("stretches of the orbit", orbit.frames, 1..=MOST_FRAMES, "1 to 10,000")?;
        let steps = f32::MIN_POSITIVE..=5.0;
        CoreError::within("the step between frames", step_degrees, steps, "above 0, at most 5 degrees")?;
        CoreError::within("frames of all stretches together", in_all, ..=MOST_FRAMES_IN_ALL, "at most 1,000,000")?;
        let most = "at most 8,388,608, such as 3840x2160";
        CoreError::within("pixels of a frame", pixels, ..=MOST_PIXELS, most)?;
        let angle = |frame: u32| (step_degrees * frame as f32).to_radians();
        let stretch = |begin| (0..frames).map(|frame| orbit.turned(begin, angle(frame))).collect();
        Ok(orbit.cameras(first).iter().map(stretch).collect())
    }
}

/// The jumps in one way of drawing, evaluated with one step.
#[derive(Debug, Clone, PartialEq, Default)]
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

/// Both ways, evaluated with one step.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct AtStep {
    /// Angle between frames, degrees.
    pub(crate) step_degrees: f64,
    pub(crate) ways: [Popping; 2],
}

/// The frames and the pixel at which the first way flickers most beyond the other.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Moment {
    /// The triple with the finest step, in both ways.
    pub(crate) frames: [Vec<Image>; 2],
    /// Column and row of the window's middle.
    pub(crate) pixel: (u32, u32),
    /// The excess of the first way's flicker, 8-bit levels.
    pub(crate) excess: f64,
}

/// The result of a flight.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PoppingComparison {
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

/// Renders each stretch in both ways, and measures the jumps.
///
/// # Errors
/// [`CoreError::Setting`] where the flight is not possible; those of the ways.
pub(crate) fn compare(ways: &mut dyn Ways, flight: &SlowOrbit, first: &Camera) -> Result<PoppingComparison, Error> {
    let stretches = flight.stretches(first)?;
    let step = |stride: usize| f64::from(flight.step_degrees) * stride as f64;
    let mut steps = STRIDES.map(|stride| AtStep { step_degrees: step(stride), ways: Default::default() });
    let mut best = Moment { frames: Default::default(), pixel: (0, 0), excess: f64::NEG_INFINITY };
    for stretch in &stretches {
        let mut triples: [[Vec<Triple>; 2]; STRIDES.len()] = Default::default();
        let mut frames: [VecDeque<Image>; 2] = Default::default();
        for (number, camera) in stretch.iter().enumerate() {
            for (frames, image) in frames.iter_mut().zip(ways.frames(number, camera)?) {
                frames.push_front(image);
                frames.truncate(2 * STRIDES[STRIDES.len() - 1] + 1);
            }
            let found = flickers(&frames)?;
            for ((at, triples), found) in steps.iter_mut().zip(&mut triples).zip(&found) {
                for ((popping, triples), flicker) in at.ways.iter_mut().zip(triples).zip(found) {
                    let highest = flicker.values().iter().copied().fold(0.0, f32::max);
                    popping.highest = popping.highest.max(255.0 * f64::from(highest));
                    let squares = 255.0 * 255.0 * flicker.mean_square();
                    triples.push(Triple { squares, visible: flicker.share_above(VISIBLE_LEVELS as f32 / 255.0) });
                }
            }
            if let [first, second] = found[0].as_slice()
                && let Some((excess, pixel)) =
                    greatest_excess(first, second).filter(|(excess, _)| *excess > best.excess)
            {
                let frames = frames.each_ref().map(|frames| frames.iter().take(3).rev().cloned().collect());
                best = Moment { frames, pixel, excess };
            }
        }
        for (at, triples) in steps.iter_mut().zip(&triples) {
            at.ways.iter_mut().zip(triples).for_each(|(popping, triples)| popping.add(triples, at.step_degrees));
        }
    }
    Ok(PoppingComparison { steps: steps.to_vec(), moment: best })
}

/// The flicker for each stride and way: that of the triple that ends with the newest frame (at
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

/// A triple of frames.
#[derive(Debug, Clone, Copy)]
struct Triple {
    /// Mean square flicker, levels².
    squares: f64,
    /// Its share of visible windows.
    visible: f64,
}

impl Popping {
    /// Adds a stretch.
    fn add(&mut self, stretch: &[Triple], step_degrees: f64) {
        // Each jump is in two triples.
        let per_degree = |of: fn(&Triple) -> f64| mean(stretch.iter().map(of)) / (2.0 * step_degrees);
        self.squares_per_degree.push(per_degree(|triple| triple.squares));
        self.times_per_degree.push(per_degree(|triple| triple.visible));
        self.trajectory.extend(stretch.iter().map(|triple| triple.squares.sqrt()));
    }
}
