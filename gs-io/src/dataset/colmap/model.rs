//! A sparse model of COLMAP as its files have it.

use std::collections::BTreeMap;

use glam::{DQuat, DVec2, DVec3, dvec2};

use super::CameraModel;
use crate::dataset::{Lens, Skip, SourceCamera, read::WorldPoint};

/// The id that stands for no point.
pub(super) const NO_POINT: u64 = u64::MAX;

/// A sparse model as stored in its files. Only the format is checked.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct ColmapModel {
    /// Cameras by id.
    pub(crate) cameras: BTreeMap<u32, ColmapCamera>,
    /// Registered images, in file order.
    pub(crate) images: Vec<ColmapImage>,
    /// Points, in file order.
    pub(crate) points: Vec<ColmapPoint>,
}

/// A camera, which several images may share.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ColmapCamera {
    /// The model, which defines the parameters.
    pub(crate) model: CameraModel,
    /// Columns of the camera's images, px.
    pub(crate) width: u64,
    /// Rows of the camera's images, px.
    pub(crate) height: u64,
    /// The parameters, in the order in which COLMAP documents them.
    pub(crate) parameters: Vec<f64>,
}

impl ColmapCamera {
    /// The camera of the images at full size.
    ///
    /// # Errors
    /// [`Skip::BadCamera`] or [`Skip::Panorama`].
    pub(crate) fn source(&self) -> Result<SourceCamera, Skip> {
        let size = dvec2(self.width as f64, self.height as f64);
        let intrinsics = self.model.intrinsics(&self.parameters, size)?;
        let lens = Lens::new(intrinsics.distortion).ok_or(Skip::BadCamera)?;
        let sides = u32::try_from(self.width).ok().zip(u32::try_from(self.height).ok()).ok_or(Skip::BadCamera)?;
        let source = intrinsics.source(size, sides, lens);
        source.fault().is_none().then_some(source).ok_or(Skip::BadCamera)
    }
}

/// A registered image.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ColmapImage {
    /// The id.
    pub(crate) id: u32,
    /// World-to-camera rotation, not normalised.
    pub(crate) rotation: DQuat,
    /// World-to-camera translation, world units.
    pub(crate) translation: DVec3,
    /// The id of the image's camera.
    pub(crate) camera_id: u32,
    /// The path below the image folder.
    pub(crate) name: String,
    /// The image's keypoints.
    pub(crate) observations: Vec<ColmapObservation>,
}

/// A keypoint of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ColmapObservation {
    /// Position in px of the distorted image, from its top-left corner; pixel (i, j) has its centre
    /// at (i + ½, j + ½).
    pub(crate) position: DVec2,
    /// The id of the keypoint's point, if it was triangulated.
    pub(crate) point: Option<u64>,
}

/// A triangulated point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ColmapPoint {
    /// The id.
    pub(crate) id: u64,
    /// Position, world units.
    pub(crate) position: DVec3,
    /// Colour, RGB.
    pub(crate) color: [u8; 3],
    /// Mean reprojection error, px; −1 where COLMAP did not compute it.
    pub(crate) error: f64,
}

/// Points in the engine's form; those that are not finite are counted later.
pub(crate) fn points_of(points: &[ColmapPoint]) -> impl Iterator<Item = WorldPoint> {
    points.iter().map(|point| WorldPoint { position: point.position, color: point.color.map(|c| f32::from(c) / 255.0) })
}
