//! What a picture should be: by the 64-bit oracle where it is asked, by the tightest settings of a backend everywhere else.
//!
//! The oracle is dense: a pixel costs as much as the scene has Gaussians. So it is asked at a sample of pixels, evenly spread, and, of each picture that is judged, at
//! the pixel where it is worst. Where that is, the backend's rendering without cut-offs says, which is itself held against the oracle at all of those.

use std::{cell::RefCell, collections::HashMap};

use gs_core::{Error, Image, RenderSettings, Scene, Scene2d, Scene3d};
use gs_oracle::{Oracle, OracleScene, OracleView, Projection};
use rayon::prelude::*;

use super::PictureError;

/// Pairs of a Gaussian and a pixel that the oracle is asked for, in all views: some seconds.
const PAIRS: usize = 200_000_000;

/// Fewest and most pixels of a view that it is asked at.
const SAMPLE: [usize; 2] = [128, 8192];

/// The part of the width that neighbours in the sample lie apart: the golden ratio, by which any number of them is evenly spread.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// A kind of scene that the oracle can render.
pub trait Verifiable: Scene<View: OracleView> {
    /// The scene as the oracle sees it.
    fn rows(&self) -> OracleScene;
}

impl Verifiable for Scene2d {
    fn rows(&self) -> OracleScene {
        self.into()
    }
}

impl Verifiable for Scene3d {
    fn rows(&self) -> OracleScene {
        self.into()
    }
}

type SplatOf<S> = <<S as Scene>::View as OracleView>::Splat;

/// One view's picture as it should be.
pub struct Truth<S: Verifiable> {
    oracle: Oracle<S::View>,
    projected: Vec<Projection<SplatOf<S>>>,
    /// Without cut-offs, by a backend.
    tightest: Image,
    /// Pixels at which the oracle was asked, and what it says.
    sample: Vec<([u32; 2], [f64; 3])>,
    /// The same of pixels at which some picture was worst.
    worst: RefCell<HashMap<[u32; 2], [f64; 3]>>,
}

impl<S: Verifiable> std::fmt::Debug for Truth<S> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Truth").field("sample", &self.sample.len()).finish_non_exhaustive()
    }
}

impl<S: Verifiable> Truth<S> {
    /// The truth of one of `views` views of a scene; `settings` are without cut-offs, and `tightest` is their picture by a backend.
    ///
    /// # Errors
    /// Those of [`Oracle::new`], where the oracle does not have an effect.
    pub fn new(
        scene: &OracleScene,
        view: &S::View,
        settings: &RenderSettings,
        tightest: Image,
        views: usize,
    ) -> Result<Self, Error> {
        let oracle = Oracle::new(*view, *settings)?;
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

    /// Pixels at which the oracle is asked whatever the picture.
    pub fn sampled(&self) -> usize {
        self.sample.len()
    }

    /// How far a picture of this view is from what it should be. Its largest difference is that at the worst pixel and those of the sample, by the
    /// oracle; the means are over all pixels by the tightest rendering, or over the sample by the oracle, whichever say more.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`].
    pub fn error(&self, picture: &Image) -> Result<PictureError, Error> {
        self.tightest.same_size(picture)?;
        let difference = |[x, y]: [u32; 2], true_color: [f64; 3]| {
            let shown = picture.pixel(x, y);
            [0, 1, 2].map(|k| f64::from(shown[k]) - true_color[k])
        };
        let pairs = picture.pixels().iter().zip(self.tightest.pixels());
        let everywhere =
            PictureError::of(pairs.clone().map(|(a, b)| [0, 1, 2].map(|k| f64::from(a[k]) - f64::from(b[k]))));
        let largest = |(a, b): (&[f32; 3], &[f32; 3])| {
            (0..3)
                .map(|k| (a[k] - b[k]).abs())
                .fold(0.0f32, |most, v| if v.is_nan() { f32::INFINITY } else { most.max(v) })
        };
        let worst = pairs.map(largest).enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(index, _)| index);
        let width = picture.width() as usize;
        let place = [(worst % width) as u32, (worst / width) as u32];
        let at_worst = *self
            .worst
            .borrow_mut()
            .entry(place)
            .or_insert_with(|| self.oracle.colors_at(&self.projected, &[place])[0]);
        let sampled = PictureError::of(self.sample.iter().map(|&(place, color)| difference(place, color)));
        let at_worst = PictureError::of(std::iter::once(difference(place, at_worst)));
        Ok(PictureError {
            max: sampled.max.max(at_worst.max),
            mean: everywhere.mean.max(sampled.mean),
            mean_squared: everywhere.mean_squared.max(sampled.mean_squared),
            share_visible: everywhere.share_visible,
        })
    }

    /// The largest difference between the tightest rendering and the oracle, at all pixels at which that was asked so far.
    pub fn uncertainty(&self) -> f64 {
        let worst = self.worst.borrow();
        let asked = self.sample.iter().map(|(place, color)| (place, color)).chain(worst.iter());
        let differences = asked.map(|(&[x, y], color)| {
            let shown = self.tightest.pixel(x, y);
            [0, 1, 2].map(|k| f64::from(shown[k]) - color[k])
        });
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
            // Rows one after the other, columns by the golden ratio.
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
