//! Entry points for the fuzz targets into readers that are private.

use std::path::Path;

use crate::{
    dataset::{CameraModel, ColmapCamera, ColmapModel, SourceCamera},
    error::Error,
};

/// Reads a model of COLMAP from the bytes of its cameras, images and points, binary or text, and
/// checks whether its cameras are possible.
///
/// # Errors
/// [`Error::Damaged`] and [`Error::Unusable`].
pub fn read_colmap(is_text: bool, cameras: &[u8], images: &[u8], points: Option<&[u8]>) -> Result<(), Error> {
    let read = if is_text { ColmapModel::from_text } else { ColmapModel::from_binary };
    let model = read(Path::new("fuzzed"), cameras, images, points)?;
    model.cameras.values().for_each(|camera| _ = camera.source());
    Ok(())
}

/// The camera of an image of 64×48 px with COLMAP's camera model of this id and these parameters;
/// `None` where it is impossible.
pub fn camera(model: u8, parameters: Vec<f64>) -> Option<SourceCamera> {
    let model = *CameraModel::ALL.get(usize::from(model))?;
    ColmapCamera { model, width: 64, height: 48, parameters }.source().ok()
}
