//! The reference picture of a view: by the 64-bit oracle at some pixels, by a backend's tightest
//! settings elsewhere.
//!
//! The oracle is dense: a pixel costs time in proportion to the number of Gaussians. It computes a
//! sample of evenly spread pixels and, for each picture that is judged, the pixel with the largest
//! error. That pixel is found with the backend's rendering without cut-offs, which is compared with
//! the oracle at all computed pixels.

use std::{cell::RefCell, collections::HashMap};

use gs_core::{Error, Image, RenderSettings, Scene};
use gs_oracle::{Oracle, OracleScene, OracleView, Projection};
use rayon::prelude::*;

use super::picture_error::{PictureError, difference, largest};

/// Largest number of pairs of a Gaussian and a pixel that the oracle computes for the samples of
/// all views: some seconds.
const PAIRS: usize = 200_000_000;

/// Fewest and most pixels in the sample of a view.
const SAMPLE: [usize; 2] = [128, 8192];

/// Distance of neighbours in the sample, as a share of the width: the golden ratio spreads any
/// number of pixels evenly.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// A kind of scene that the oracle can render.
pub trait Verifiable: Scene<View: OracleView + Copy> {
    /// The scene in the oracle's form.
    fn rows(&self) -> OracleScene;
}

impl<S: Scene<View: OracleView + Copy>> Verifiable for S
where
    for<'s> &'s S: Into<OracleScene>,
{
    fn rows(&self) -> OracleScene {
        self.into()
    }
}

/// The reference picture of a view.
pub(crate) struct Reference {
    oracle: Oracle,
    projected: Vec<Projection>,
    /// A backend's rendering without cut-offs.
    tightest: Image,
    /// The sampled pixels with the oracle's colours.
    sample: Vec<([u32; 2], [f64; 3])>,
    /// Worst pixels of pictures so far, with the oracle's colours.
    worst: RefCell<HashMap<[u32; 2], [f64; 3]>>,
}

impl std::fmt::Debug for Reference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reference").field("sample", &self.sample.len()).finish_non_exhaustive()
    }
}

impl Reference {
    /// The reference picture of one of `views` views of a scene. `settings` have no cut-offs, and
    /// `tightest` is a backend's rendering with them.
    pub(crate) fn new(
        scene: &OracleScene,
        view: impl OracleView,
        settings: &RenderSettings,
        tightest: Image,
        views: usize,
    ) -> Result<Self, Error> {
        let oracle = Oracle::new(view, *settings)?;
        let projected = oracle.project(scene);
        let (width, height) = tightest.size();
        let all = width as usize * height as usize;
        let affordable = PAIRS / views.max(1) / scene.gaussians.len().max(1);
        let pixels = spread(width, height, affordable.clamp(SAMPLE[0], SAMPLE[1]).min(all));
        let colors: Vec<[f64; 3]> =
            pixels.par_chunks(16).flat_map_iter(|pixels| oracle.colors_at(&projected, pixels)).collect();
        let sample = pixels.into_iter().zip(colors).collect();
        Ok(Self { oracle, projected, tightest, sample, worst: RefCell::default() })
    }

    /// Number of pixels in the sample.
    pub(crate) fn sampled(&self) -> usize {
        self.sample.len()
    }

    /// The error of a picture of this view. The maximum is over the worst pixel and the sample, by
    /// the oracle. The means are over all pixels by the tightest rendering, or over the sample by
    /// the oracle, whichever are larger.
    pub(crate) fn error(&self, picture: &Image) -> Result<PictureError, Error> {
        let everywhere = PictureError::between(picture, &self.tightest)?;
        let off = |[x, y]: [u32; 2], color: [f64; 3]| difference(picture.pixel(x, y), color);
        let pairs = picture.pixels().iter().zip(self.tightest.pixels());
        let differences = pairs.map(|(&a, &b)| largest(difference(a, b.map(f64::from))));
        let worst = differences.enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(index, _)| index as u32);
        let place = [worst % picture.width(), worst / picture.width()];
        let at_worst = *self
            .worst
            .borrow_mut()
            .entry(place)
            .or_insert_with(|| self.oracle.colors_at(&self.projected, &[place])[0]);
        let sampled = PictureError::of(self.sample.iter().map(|&(place, color)| off(place, color)));
        let means = [
            everywhere.mean.max(sampled.mean),
            everywhere.mean_squared.max(sampled.mean_squared),
            everywhere.share_visible,
        ];
        Ok(PictureError::new(sampled.max.max(largest(off(place, at_worst))), means))
    }

    /// Largest difference between the tightest rendering and the oracle, at all pixels that the
    /// oracle has computed so far.
    pub(crate) fn uncertainty(&self) -> f64 {
        let worst = self.worst.borrow();
        let asked = self.sample.iter().map(|(place, color)| (place, color)).chain(worst.iter());
        let differences = asked.map(|(&[x, y], &color)| difference(self.tightest.pixel(x, y), color));
        PictureError::of(differences).max
    }
}

/// `count` pixels of a picture, evenly spread by the golden ratio, all different.
fn spread(width: u32, height: u32, count: usize) -> Vec<[u32; 2]> {
    let all = u64::from(width) * u64::from(height);
    if count as u64 >= all {
        return (0..height).flat_map(|y| (0..width).map(move |x| [x, y])).collect();
    }
    let mut places: Vec<u64> = (0..count as u64)
        .map(|i| {
            // Rows in order, columns by the golden ratio.
            let row = i * u64::from(height) / count as u64;
            let column = ((i as f64 * GOLDEN).fract() * f64::from(width)) as u64;
            (row * u64::from(width) + column).min(all - 1)
        })
        .collect();
    places.sort_unstable();
    places.dedup();
    places.into_iter().map(|place| [(place % u64::from(width)) as u32, (place / u64::from(width)) as u32]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_is_spread_over_the_picture() {
        let places = spread(300, 200, 400);
        assert!(places.len() > 390);
        for quarter in 0..4u32 {
            let (x, y) = (150 * (quarter % 2), 100 * (quarter / 2));
            let inside = |&&[px, py]: &&[u32; 2]| (x..x + 150).contains(&px) && (y..y + 100).contains(&py);
            let count = places.iter().filter(inside).count();
            assert!((85..=115).contains(&count), "{count} in quarter {quarter}");
        }
        assert_eq!(spread(1, 1, 1), [[0, 0]]);
        assert_eq!(spread(2, 2, 4), [[0, 0], [1, 0], [0, 1], [1, 1]]);
    }
}
