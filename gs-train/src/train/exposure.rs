//! Correction of exposure and white balance: an affine colour map for each training view, solved
//! while the scene is trained.
//!
//! A few times in a run, each training view is rendered, not larger than in the steps, and the map
//! from rendering to image is solved by least squares over the pixels of both at a reduced size of a
//! few thousand pixels. Later steps compare renderings with images to which the inverse maps are applied. The mean map
//! is the identity, which fixes the colours of the scene.
//!
//! Whether images differ is decided without rendered colours, by neighbouring images alone ([`neighbours`]): what
//! a scene has learned, also from corrected images, is no evidence.

mod neighbours;

use std::collections::BTreeMap;

use gs_core::{Rasterizer, RenderSettings, Scene3d, metrics::mean};
use gs_io::dataset::PosedImage;
use serde::{Deserialize, Serialize};

use self::neighbours::{Halves, SmallView};
use super::rendered_depths::{clear_depth, depths_and_gaps};
use crate::error::Error;
use crate::run::{table, to_table};
use crate::views::{ColorMap, PosedView, possible, reduced, reduced_camera};

gs_core::choices! {
    /// How differences in exposure and white balance between images are treated.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum Exposure {
        /// The scene is trained on the images as they are.
        #[default]
        Off = "off": "Train on the images as they are",
        /// Each training view has an affine colour map, solved while the scene is trained. Needs at
        /// least two training views.
        Affine = "affine": "Correct the colours of each training view by an affine map found during the training",
        /// Like [`Self::Affine`] if neighbouring images differ in exposure or white balance when the maps are
        /// first to be solved. Otherwise like [`Self::Off`], with the same bits, also in runs that are too short
        /// to tell and where fewer than half of the views can be compared with others.
        Auto = "auto": "As affine if neighbouring images differ in exposure or white balance, otherwise as off",
    }
}

impl Exposure {
    pub(super) fn is_off(&self) -> bool {
        *self == Self::Off
    }

    /// Number of solutions in a run with this many training views and steps, where the images do not
    /// differ.
    pub(crate) fn solutions(self, views: u32, iterations: u32) -> usize {
        let least = LEAST_STEPS_PER_VIEW.saturating_mul(views);
        let is_late = |share: f64| (share * f64::from(iterations)).round() >= f64::from(least);
        match self {
            Self::Off => 0,
            Self::Affine => SOLVED_AT.len(),
            Self::Auto => usize::from(SOLVED_AT.into_iter().any(is_late)),
        }
    }
}

/// Shares of a run after which the maps are solved: late enough for recognizable renderings, early
/// enough for the scene to adapt to the corrected images.
const SOLVED_AT: [f64; 4] = [0.2, 0.35, 0.5, 0.65];

/// Least [gain](ExposureReport::gain_db) with which [`Exposure::Auto`] corrects the images. Captures as they are
/// have up to 0.26 dB; most have 0.57 or more after a factor exp(N(0, 0.06)) for each image. A correction that is
/// missed costs less than a wrong one.
const LEAST_GAIN_DB: f64 = 0.4;

/// Least number of steps for each training view before the first solution of [`Exposure::Auto`]:
/// a scene that is hardly trained has other depths than what the images show.
const LEAST_STEPS_PER_VIEW: u32 = 5;

/// Approximate number of pixels at which a rendering is compared with its image: many for the
/// twelve unknowns of a map.
const PIXELS: u64 = 10_000;

/// Least number of pixels in each half of a view whose gain is measured.
const LEAST_PAIRS: usize = 50;

/// Squared distance of colours that is added to all errors: differences far below five levels of 255 in each
/// channel gain nothing, however well images agree otherwise.
const SMALL_ERROR: f64 = 3.0 * 4e-4;

/// Range of pixel values that count as not clipped by the camera.
const UNCLIPPED: [f32; 2] = [0.01, 0.98];

/// Key of the maps in the metadata of checkpoints.
const KEY: &str = "exposure";

/// The maps of a run, as stored in its checkpoints.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
struct Maps {
    /// For each training view, the map from its image's colours to the scene's; empty before they
    /// are first solved, and where they are not used.
    of_views: Vec<ColorMap>,
    /// Report of the comparison before the first solution.
    report: Option<ExposureReport>,
}

/// Report on differences in exposure and white balance between the training views of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct ExposureReport {
    /// Whether the images are corrected: with [`Exposure::Auto`], only where the gain is large enough.
    pub used: bool,
    /// How much better neighbouring images agree with a colour map for each of them than with a common one, dB.
    /// The map of a view is fitted in one half of it, from the colours that the nearest other images have at the
    /// same places, and judged in the other half; mean over both halves of the training views.
    pub gain_db: f64,
    /// Number of training views whose halves both show places that other views show, too.
    #[serde(default)]
    pub compared: usize,
}

/// The maps, and the reduced views from which they are solved.
#[derive(Debug, Default)]
pub(crate) struct Exposures {
    maps: Maps,
    /// The training views at a small size.
    small: Vec<SmallView>,
}

impl SmallView {
    fn read(view: &PosedView) -> Result<Self, Error> {
        let camera = &view.camera;
        let pixels = u64::from(camera.width) * u64::from(camera.height);
        let factor = possible(camera, (pixels / PIXELS).isqrt().max(1).next_power_of_two() as u32);
        let posed = reduced(&view.image()?, factor)?;
        let [low, high] = UNCLIPPED;
        let tells = |index: usize, color: &[f32; 3]| {
            color.iter().all(|value| (low..=high).contains(value))
                && posed.mask.as_ref().is_none_or(|mask| mask[index])
                && posed.alpha.as_ref().is_none_or(|alpha| alpha[index] >= 1.0)
        };
        let colors = posed.image.pixels().iter().enumerate();
        let colors = colors.map(|(index, color)| if tells(index, color) { *color } else { [f32::NAN; 3] }).collect();
        Ok(Self { camera: reduced_camera(camera, factor), factor, colors })
    }
}

/// Gain in a half of a view by a map fitted to its other half, over the mean of the maps of all views, dB; mean
/// over the halves.
///
/// The mean map is left out: it is an error of the first colours, not a difference between images.
fn gain_db(views: &[Halves]) -> f64 {
    let gains = [[0, 1], [1, 0]].into_iter().flat_map(|[from, to]| {
        let maps: Vec<ColorMap> = views.iter().map(|halves| ColorMap::robust_fit(&halves[from])).collect();
        let common = mean_of_possible(&maps);
        maps.into_iter().zip(views).map(move |(map, halves)| {
            let error = |map: ColorMap| map.squared_error(&halves[to]) / halves[to].len() as f64 + SMALL_ERROR;
            10.0 * (error(common) / error(map)).log10()
        })
    });
    let gains: Vec<f64> = gains.filter(|gain| gain.is_finite()).collect();
    if gains.is_empty() { 0.0 } else { mean(gains) }
}

impl Exposures {
    /// The maps of a checkpoint with this metadata, of a run with `views` training views.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where they are not those of such a run.
    pub(crate) fn from_metadata(metadata: &BTreeMap<String, String>, views: usize) -> Result<Self, Error> {
        if !metadata.contains_key(KEY) {
            return Ok(Self::default());
        }
        let maps: Maps = table(metadata, KEY)?;
        let found = maps.of_views.len();
        if found != 0 && found != views {
            return Err(Error::Checkpoint(format!("its `{KEY}` is of {found} views, not of {views}")));
        }
        if !maps.of_views.iter().all(ColorMap::is_finite) {
            return Err(Error::Checkpoint(format!("its `{KEY}` is not finite")));
        }
        Ok(Self { maps, small: Vec::new() })
    }

    /// Maps that no training solves again, one for each of its views; none if they are not used.
    #[cfg(feature = "edit")]
    pub(crate) fn settled(of_views: Vec<ColorMap>) -> Self {
        Self { maps: Maps { of_views, report: None }, small: Vec::new() }
    }

    /// The metadata for a checkpoint; `None` before the first solution.
    pub(super) fn to_metadata(&self) -> Result<Option<(&'static str, String)>, Error> {
        if self.maps == Maps::default() {
            return Ok(None);
        }
        Ok(Some((KEY, to_table(KEY, &self.maps)?)))
    }

    /// Report of the comparison before the first solution.
    pub(super) fn report(&self) -> Option<ExposureReport> {
        self.maps.report
    }

    /// Whether images have maps.
    pub(super) fn are_used(&self) -> bool {
        !self.maps.of_views.is_empty()
    }

    /// The map from the colours of a training view's image to the colours of the scene, if any.
    pub(crate) fn map(&self, index: usize) -> Option<&ColorMap> {
        self.maps.of_views.get(index)
    }

    /// Whether a run with this setting and number of training views, before the step after `step`
    /// of `iterations` steps, is to solve the maps.
    pub(super) fn is_due(&self, exposure: Exposure, views: u32, step: u32, iterations: u32) -> bool {
        let at = |share: f64| step > 0 && (share * f64::from(iterations)).round() as u32 == step;
        match exposure {
            Exposure::Off => false,
            Exposure::Affine => SOLVED_AT.into_iter().any(at),
            Exposure::Auto => match self.maps.report {
                None => SOLVED_AT.into_iter().any(at) && step >= LEAST_STEPS_PER_VIEW.saturating_mul(views),
                Some(report) => report.used && SOLVED_AT.into_iter().any(at),
            },
        }
    }

    /// Solves all maps again for the current scene, from renderings whose sides are divided by
    /// `factor`, a power of two. The first time, decides whether they are used.
    ///
    /// # Errors
    /// Those of the backend, and of reading an image.
    pub(super) async fn solve<R: Rasterizer<Scene3d>>(
        &mut self,
        (on, splats): (&R, &R::Splats),
        views: &[PosedView],
        render: &RenderSettings,
        (exposure, factor): (Exposure, u32),
    ) -> Result<(), Error> {
        if self.small.is_empty() {
            self.small = views.iter().map(SmallView::read).collect::<Result<_, _>>()?;
        }
        if self.maps.report.is_none() {
            let ExposureReport { gain_db, compared, .. } = self.compared((on, splats), render).await?;
            let differ = gain_db >= LEAST_GAIN_DB && 2 * compared >= views.len();
            let used = exposure == Exposure::Affine || differ;
            self.maps.report = Some(ExposureReport { used, gain_db, compared });
            if !used {
                self.small = Vec::new();
                return Ok(());
            }
        }
        let mut fits = Vec::with_capacity(views.len());
        for (view, small) in views.iter().zip(&self.small) {
            let by = factor.min(small.factor);
            let image = on.draw(splats, &reduced_camera(&view.camera, by), render).await?.0;
            let rendered = reduced(&PosedImage { image, alpha: None, mask: None }, small.factor / by)?.image;
            fits.push(ColorMap::robust_fit(&small.pairs(|index| Some(rendered.pixels()[index])).concat()));
        }
        self.maps.of_views = undone(&fits);
        Ok(())
    }

    /// What a comparison of neighbouring views finds, at the same places by the depths of the scene.
    async fn compared<R: Rasterizer<Scene3d>>(
        &self,
        (on, splats): (&R, &R::Splats),
        render: &RenderSettings,
    ) -> Result<ExposureReport, Error> {
        let render = depths_and_gaps(render);
        let mut depths = Vec::with_capacity(self.small.len());
        for view in &self.small {
            let rendered = on.draw(splats, &view.camera, &render).await?.0;
            depths.push(rendered.pixels().iter().map(|pixel| clear_depth(*pixel).unwrap_or(0.0)).collect());
        }
        let mut halves = neighbours::pairs(&self.small, &depths);
        halves.retain(|halves| halves.iter().all(|half| half.len() >= LEAST_PAIRS));
        Ok(ExposureReport { used: false, gain_db: gain_db(&halves), compared: halves.len() })
    }
}

/// The maps from the images to the scene, given the maps from the scene to its images. The scene's
/// colours become those of the mean image. A map that cannot be inverted within
/// [`ColorMap::inverse`]'s limit, which no camera makes, is not in the mean, and is replaced by the
/// identity.
fn undone(fits: &[ColorMap]) -> Vec<ColorMap> {
    let mean = mean_of_possible(fits);
    fits.iter().map(|fit| fit.inverse().map_or(ColorMap::IDENTITY, |inverse| mean.after(&inverse))).collect()
}

/// The mean of the maps that have an inverse.
fn mean_of_possible(maps: &[ColorMap]) -> ColorMap {
    let possible: Vec<ColorMap> = maps.iter().filter(|map| map.inverse().is_some()).copied().collect();
    ColorMap::mean(&possible)
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::Camera;

    use super::*;

    #[test]
    fn maps_undo_what_cameras_did_up_to_the_mean() {
        let camera = |gain: f64, offset: f64| {
            ColorMap::from(std::array::from_fn(|k| {
                let mut row = [0.0, 0.0, 0.0, offset];
                row[k] = gain * (1.0 + 0.1 * k as f64);
                row
            }))
        };
        let cameras = [camera(0.6, 0.02), camera(1.0, 0.0), camera(0.8, -0.05)];
        let undone = undone(&cameras);
        let color = [0.3f32, 0.5, 0.2];
        let expected = ColorMap::mean(&cameras).apply(color);
        for (camera, map) in cameras.iter().zip(&undone) {
            let found = map.apply(camera.apply(color));
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} {expected:?}");
        }
        // A map that no camera makes changes none of the others.
        let with_black = super::undone(&[&cameras[..], &[camera(0.0, 0.3)]].concat());
        assert_eq!((&with_black[..3], with_black[3]), (&undone[..], ColorMap::IDENTITY));
        assert_eq!(super::undone(&[camera(0.0, 0.3)]), [ColorMap::IDENTITY]);
    }

    #[test]
    fn an_error_common_to_all_views_is_no_exposure_difference() {
        // Views of other colours and with other errors.
        let taken = |(view, gain): (usize, f32)| -> Halves {
            let spread = |i: usize, by: f32| (by * (60 * view + i) as f32).fract();
            let color = |i: usize| [0.618, 0.414, 0.732].map(|by| 0.1 + 0.5 * spread(i, by));
            let error = |i: usize| 0.05 * spread(i, 0.303);
            [0..30, 30..60].map(|half| half.map(|i| (color(i), color(i).map(|c| gain * c + error(i)))).collect())
        };
        let gain = |gains: [f32; 3]| gain_db(&gains.into_iter().enumerate().map(taken).collect::<Vec<_>>());
        assert!(gain([0.7; 3]).abs() < LEAST_GAIN_DB, "first colours that are too bright: {} dB", gain([0.7; 3]));
        assert!(gain([0.7, 0.9, 1.1]) > 5.0, "{} dB", gain([0.7, 0.9, 1.1]));
        assert_eq!(gain_db(&[]), 0.0);
    }

    /// A row of 24 cameras before a plane that shines, taken with other exposures.
    #[test]
    fn only_differences_between_neighbours_are_corrected() {
        let (side, distance) = (48, 4.0);
        let lens = Camera::looking_forward(side, side, 1.0);
        let number = |i: usize| i as f32 / 23.0 - 0.5;
        let gain = |exposure: &dyn Fn(usize) -> f32| {
            let view = |i: usize| {
                let x = 2.0 * number(i);
                let camera = Camera { translation: Vec3::new(-x, 0.0, distance), ..lens };
                let color = |pixel: u32| {
                    let at = Vec2::new((pixel % side) as f32, (pixel / side) as f32) + 0.5;
                    let at = (at - camera.center) / camera.focal * distance + Vec2::new(x, 0.0);
                    let texture = [1.1, 1.7, 2.3].map(|by| 0.4 + 0.2 * (by * at.x).sin() * (2.0 * by * at.y).cos());
                    // What a camera at the side sees of the plane is brighter.
                    texture.map(|value| exposure(i).exp() * value * (1.0 + 0.02 * (at.x - x)))
                };
                SmallView { camera, factor: 1, colors: (0..side * side).map(color).collect() }
            };
            let depths = vec![vec![distance; (side * side) as usize]; 24];
            gain_db(&neighbours::pairs(&(0..24).map(view).collect::<Vec<_>>(), &depths))
        };
        // The same exposures, along the path of the camera and without order.
        let (smooth, scattered) = (gain(&|i| 0.2 * number(i)), gain(&|i| 0.2 * number(7 * i % 24)));
        assert!(smooth < LEAST_GAIN_DB && gain(&|_| 0.0) < LEAST_GAIN_DB, "{smooth} dB, {} dB", gain(&|_| 0.0));
        assert!(scattered > 2.0, "{scattered} dB");
    }

    #[test]
    fn maps_come_back_from_a_checkpoint_and_damaged_ones_are_refused() {
        let maps = Maps {
            of_views: vec![ColorMap::from([[0.1 + 0.2, 0.0, 0.0, 1e-9], [0.0, 1.0 / 3.0, 0.0, 0.0], [0.5; 4]]); 2],
            report: Some(ExposureReport { used: true, gain_db: 1.0 / 7.0, compared: 2 }),
        };
        let exposures = Exposures { maps: maps.clone(), small: Vec::new() };
        let (key, text) = exposures.to_metadata().unwrap().unwrap();
        let of =
            |text: &str, views| Exposures::from_metadata(&BTreeMap::from([(key.to_owned(), text.to_owned())]), views);
        assert_eq!(of(&text, 2).unwrap().maps, maps);
        for (text, views) in [(text.as_str(), 3), (&text.replace("0.5", "nan"), 2), ("of-views = 7", 2), ("x = 1", 2)] {
            assert!(matches!(of(text, views), Err(Error::Checkpoint(_))), "{text}");
        }
        assert_eq!(Exposures::default().to_metadata().unwrap(), None);
        assert_eq!(Exposures::from_metadata(&BTreeMap::new(), 2).unwrap().maps, Maps::default());
    }

    #[test]
    fn auto_decides_once() {
        let (mut exposures, steps) = (Exposures::default(), 1000);
        let due = |exposures: &Exposures, exposure| {
            (0..=steps).filter(|&step| exposures.is_due(exposure, 40, step, steps)).count()
        };
        assert_eq!(
            [Exposure::Off, Exposure::Affine, Exposure::Auto].map(|of| due(&exposures, of)),
            [0, SOLVED_AT.len(), SOLVED_AT.len()]
        );
        exposures.maps.report = Some(ExposureReport { used: true, gain_db: 2.0, compared: 40 });
        assert_eq!(due(&exposures, Exposure::Auto), SOLVED_AT.len());
        exposures.maps.report = Some(ExposureReport { used: false, gain_db: 0.1, compared: 40 });
        assert_eq!(due(&exposures, Exposure::Auto), 0);
        // Five steps for each of these views are 200, 205, 650 and 655.
        let first = |views| (0..=steps).find(|&step| Exposures::default().is_due(Exposure::Auto, views, step, steps));
        assert_eq!([40, 41, 130, 131].map(first), [Some(200), Some(350), Some(650), None]);
    }
}
