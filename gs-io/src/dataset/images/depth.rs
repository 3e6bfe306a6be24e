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
            true => Npy::open(path)?.values(path)?,
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
    let size = if is_npy(path) { Npy::open(path)?.size } else { grey_size(path)? };
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

/// A NumPy array of two dimensions (*source:* NumPy Enhancement Proposal 1).
struct Npy {
    /// Columns and rows.
    size: (u32, u32),
    kind: Kind,
    /// Byte offset of the numbers in the file.
    start: usize,
}

/// The type of an array's numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    F32,
    F64,
    U16,
}

impl Npy {
    /// Reads the header, whose claim must be that of the file's size.
    fn open(path: &Path) -> Result<Self, Error> {
        let (file, metadata) = open(path, "a depth map")?;
        let mut bytes = Vec::new();
        file.take(HEADER_BYTES).read_to_end(&mut bytes).map_err(|source| Error::read(path, source))?;
        Self::header(&bytes, metadata.len()).map_err(|message| Error::bad_depth(path, message))
    }

    /// The header in the first bytes of a file of `file_bytes`.
    fn header(bytes: &[u8], file_bytes: u64) -> Result<Self, String> {
        let not = "it is not a NumPy array (.npy)";
        let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or(not)?;
        let (length, start) = match *rest {
            [1, _, a, b, ..] => (usize::from(u16::from_le_bytes([a, b])), 10),
            [2 | 3, _, a, b, c, d, ..] => (u32::from_le_bytes([a, b, c, d]) as usize, 12),
            _ => return Err(not.to_owned()),
        };
        let text = bytes.get(start..).and_then(|rest| rest.get(..length)).ok_or("its header is cut off")?;
        let text = std::str::from_utf8(text).map_err(|_| not)?;
        let value = |key: &str| {
            let (_, rest) = text.split_once(&format!("'{key}':"))?;
            Some(rest.trim_start())
        };
        let (descr, order, shape) =
            value("descr").zip(value("fortran_order")).zip(value("shape")).map(|((a, b), c)| (a, b, c)).ok_or(not)?;
        let kinds = [("'<f4'", Kind::F32), ("'<f8'", Kind::F64), ("'<u2'", Kind::U16)];
        let kind = kinds.iter().find(|(name, _)| descr.starts_with(name)).map(|(_, kind)| *kind);
        let kind = kind.ok_or("its numbers must be of type float32, float64 or uint16, little-endian")?;
        if !order.starts_with("False") {
            return Err("it must be in C order".to_owned());
        }
        let shape = shape.strip_prefix('(').and_then(|rest| rest.split_once(')')).map(|(inside, _)| inside);
        let sides: Vec<u32> = shape.ok_or(not)?.split(',').filter_map(|side| side.trim().parse().ok()).collect();
        let &[height, width] = &sides[..] else {
            return Err(format!(
                "it must have two dimensions (rows, columns), not ({})",
                shape.unwrap_or_default().trim()
            ));
        };
        check_size(width, height).map_err(|_| format!("it has {height} rows and {width} columns"))?;
        let expected = u64::from(width) * u64::from(height) * kind.bytes() as u64;
        let found = file_bytes.saturating_sub((start + length) as u64);
        if found != expected {
            return Err(format!("it has {found} bytes of numbers, but {expected} are needed"));
        }
        Ok(Self { size: (width, height), kind, start: start + length })
    }

    /// The size and the numbers, row-major.
    fn values(&self, path: &Path) -> Result<((u32, u32), Vec<f32>), Error> {
        let bytes = read_file(path, FILE)?;
        let numbers = bytes.get(self.start..).unwrap_or_default();
        let values: Vec<f32> = match self.kind {
            Kind::F32 => numbers.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
            Kind::F64 => numbers.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect(),
            Kind::U16 => numbers.as_chunks::<2>().0.iter().map(|b| f32::from(u16::from_le_bytes(*b))).collect(),
        };
        match values.len() == self.size.0 as usize * self.size.1 as usize {
            true => Ok((self.size, values)),
            false => Err(Error::bad_depth(path, "it has changed while it was read")),
        }
    }
}

impl Kind {
    fn bytes(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::F64 => 8,
            Self::U16 => 2,
        }
    }
}
