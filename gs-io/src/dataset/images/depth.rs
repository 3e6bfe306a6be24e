//! Reading of depth maps: grey images and NumPy arrays (`.npy`), as sensors and networks write
//! them.
//!
//! Values are depths along the optical axis or inverse depths, up to a scale and a shift for each
//! image. The code that uses them must find scale and shift. Values that are 0, negative or not
//! finite mean "unknown".

use std::{
    io::Read,
    path::{Path, PathBuf},
};

use gs_core::{Camera, check_size};

use super::{DepthFile, View, shape::same_shape, shrink::resized};
use crate::{
    atomic::{open, read_file},
    dataset::{FILE, SourceCamera},
    error::Error,
    image::{decode_grey, grey_size},
    npy::Npy,
};

/// Largest accepted header of a NumPy array, bytes. It usually has 128.
const HEADER_BYTES: u64 = 4096;

/// File extensions that are tried, in this order, for the depth map of an image.
const ENDINGS: [&str; 4] = ["npy", "png", "tiff", "tif"];

/// The depth map of a view, undistorted.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    /// The view's camera with the map's columns and rows.
    pub camera: Camera,
    /// The stored values, row-major `[height · width]`; 0 where nothing is known.
    pub values: Vec<f32>,
    /// World units of a stored value of 1, if the data set's format defines them.
    pub unit: Option<f32>,
}

impl View {
    /// Reads the depth map, if there is one, and undistorts it if needed, without interpolation.
    ///
    /// # Errors
    /// [`Error::Unusable`] for a map that is not grey, has no known value, is damaged, or has another
    /// aspect ratio than the image; those of reading a file.
    pub fn read_depth(&self) -> Result<Option<DepthMap>, Error> {
        let Some(DepthFile { path, unit }) = &self.depth else { return Ok(None) };
        let (size, values) = match is_npy(path) {
            true => npy_values(path)?,
            false => decode_grey(path)?,
        };
        check_shape(path, size, &self.source)?;
        let SourceCamera { width, height, .. } = self.source;
        let scale = glam::dvec2(f64::from(size.0) / f64::from(width), f64::from(size.1) / f64::from(height));
        let side = |full: u32, scale: f64| (f64::from(full) * scale).round().max(1.0) as u32;
        let camera = resized(&self.full, (side(self.full.width, scale.x), side(self.full.height, scale.y)));
        let at = |x: u32, y: u32| {
            let place = glam::dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let pixel = self.source.to_pixel((place - camera.center.as_dvec2()) / camera.focal.as_dvec2())? * scale;
            // False for NaN. Rounding of the camera to f32 may lead out of the frame by a hair.
            let inside = pixel.cmpge(glam::DVec2::splat(-0.01)).all()
                && pixel.x <= f64::from(size.0) + 0.01
                && pixel.y <= f64::from(size.1) + 0.01;
            let (x, y) = ((pixel.x as u32).min(size.0 - 1), (pixel.y as u32).min(size.1 - 1));
            inside.then(|| values[(y * size.0 + x) as usize])
        };
        let known = |value: &f32| *value > 0.0 && value.is_finite();
        let pixels = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y)));
        let values: Vec<f32> = pixels.map(|(x, y)| at(x, y).filter(known).unwrap_or(0.0)).collect();
        if values.iter().all(|value| *value == 0.0) {
            return Err(Error::bad_depth(path, "no value is above 0"));
        }
        Ok(Some(DepthMap { camera, values, unit: *unit }))
    }
}

/// Finds the depth map of the image `file` in a folder of depth maps.
pub(crate) fn find(folder: &Path, file: &Path) -> Option<PathBuf> {
    let beside = |ending: &str| {
        let mut appended = folder.join(file).into_os_string();
        appended.push(".");
        appended.push(ending);
        [folder.join(file).with_extension(ending), PathBuf::from(appended)]
    };
    ENDINGS.iter().flat_map(|ending| beside(ending)).find(|path| path.is_file())
}

/// Checks the header of a depth map against the camera of its image.
pub(crate) fn check(path: &Path, source: &SourceCamera) -> Result<(), Error> {
    let size = match is_npy(path) {
        true => npy(path).map(|Npy { columns, rows, .. }| (columns, rows))?,
        false => grey_size(path)?,
    };
    check_shape(path, size, source)
}

fn check_shape(path: &Path, size: (u32, u32), source: &SourceCamera) -> Result<(), Error> {
    match same_shape(size, (f64::from(source.width), f64::from(source.height))) {
        true => Ok(()),
        false => Err(Error::image_shape(path, size, (source.width, source.height))),
    }
}

fn is_npy(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npy"))
}

/// The header of a NumPy array.
fn npy(path: &Path) -> Result<Npy, Error> {
    let (file, metadata) = open(path, "a depth map")?;
    let mut bytes = Vec::new();
    file.take(HEADER_BYTES).read_to_end(&mut bytes).map_err(|source| Error::read(path, source))?;
    let npy = Npy::header(&bytes, metadata.len()).map_err(|message| Error::bad_depth(path, message))?;
    let Npy { rows, columns, .. } = npy;
    match check_size(columns, rows) {
        Ok(()) => Ok(npy),
        Err(_) => Err(Error::bad_depth(path, format!("it has {rows} rows and {columns} columns"))),
    }
}

/// The size of a NumPy array and its numbers, row-major.
fn npy_values(path: &Path) -> Result<((u32, u32), Vec<f32>), Error> {
    let npy = npy(path)?;
    let bytes = read_file(path, FILE)?;
    let numbers = npy.numbers(&bytes).ok_or_else(|| Error::bad_depth(path, "it has changed while it was read"))?;
    Ok(((npy.columns, npy.rows), numbers.map(|number| number as f32).collect()))
}
