//! The first Gaussians of a data set by name, as in `gs train --start` and in study files.

use gs_core::Error;
use gs_io::dataset::{Dataset, Split};

use super::init::Start;

gs_core::choices! {
    /// What a training on a data set starts from.
    #[non_exhaustive]
    pub enum StartName {
        /// The points of the data set: [`Start::Points`].
        Points = "points",
        /// The points and those found in the images: [`Start::PointsAndImages`].
        PointsAndImages = "points-and-images",
        /// The points and those of the depth maps: [`Start::Depths`].
        Depths = "depths",
        /// Points found in the images: [`Start::Images`].
        Images = "images",
        /// Random points: [`Start::Random`].
        Random = "random",
    }
}

impl StartName {
    /// The start that suits a data set: depth maps if it has any, otherwise points, or images if it
    /// has no points either.
    pub fn usual(dataset: &Dataset) -> Self {
        match (has_depths(dataset), dataset.points.is_empty()) {
            (true, _) => Self::Depths,
            (false, false) => Self::Points,
            (false, true) => Self::Images,
        }
    }

    /// The start from a data set.
    ///
    /// # Errors
    /// [`Error::Setting`] where the data set has no points or no depth maps to start from.
    pub fn of(self, dataset: &Dataset) -> Result<Start, Error> {
        let lacks = |allowed| Err(Error::setting("start", self, allowed));
        match self {
            Self::Points | Self::PointsAndImages if dataset.points.is_empty() => {
                lacks("images or random for a data set without points")
            }
            Self::Depths if !has_depths(dataset) => lacks("another one for a data set without depth maps"),
            Self::Points => Ok(Start::Points(dataset.points.clone())),
            Self::PointsAndImages => Ok(Start::PointsAndImages(dataset.points.clone())),
            Self::Depths => Ok(Start::Depths(dataset.points.clone())),
            Self::Images => Ok(Start::Images),
            Self::Random => Ok(Start::Random),
        }
    }
}

fn has_depths(dataset: &Dataset) -> bool {
    dataset.views_of(Split::Train).any(|view| view.depth.is_some())
}
