//! The start of a training by its settings.

use gs_io::dataset::Dataset;

use super::settings::TrainSettings;
use crate::start::StartName;

impl StartName {
    /// [`Self::usual`], but points together with points found in the images if there are fewer than
    /// [`PointInit::search_below`](crate::train::PointInit::search_below) of these settings requires.
    pub fn usual_for(dataset: &Dataset, settings: &TrainSettings) -> Self {
        let fewest = f64::from(settings.init.search_below) * f64::from(settings.gaussians);
        match Self::usual(dataset) {
            Self::Points if (dataset.points.len() as f64) < fewest => Self::PointsAndImages,
            usual => usual,
        }
    }
}
