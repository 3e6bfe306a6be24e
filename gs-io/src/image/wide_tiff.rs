//! Grey TIFF files with 32 or 64 bits per pixel, as depth maps have them. The decoder of the other
//! images does not read them.

use std::{
    fs::File,
    io::{BufReader, Seek},
    path::{Path, PathBuf},
};

use gs_core::memory;
use image::ImageFormat;
use tiff::{
    ColorType, TiffError,
    decoder::{Decoder, DecodingResult, Limits},
};

use super::kind;
use crate::{atomic::open, error::Error};

/// A file with its header read.
pub(super) struct WideTiff {
    path: PathBuf,
    decoder: Decoder<BufReader<File>>,
    /// Columns and rows.
    pub(super) size: (u32, u32),
    bits: u8,
}

impl WideTiff {
    /// Opens a file; `None` for any other image, and for a TIFF that this decoder cannot read
    /// either.
    pub(super) fn open(path: &Path) -> Result<Option<Self>, Error> {
        let mut reader = BufReader::new(open(path, "an image file")?.0);
        if kind::format_of(path, &mut reader)? != ImageFormat::Tiff {
            return Ok(None);
        }
        reader.rewind().map_err(|source| Error::read(path, source))?;
        let Ok(decoder) = Decoder::new(reader) else { return Ok(None) };
        let mut decoder = decoder.with_limits(Limits::unlimited());
        let (Ok(ColorType::Gray(bits @ (32 | 64))), Ok(size)) = (decoder.colortype(), decoder.dimensions()) else {
            return Ok(None);
        };
        Error::check_image_size(path, size)?;
        Ok(Some(Self { path: path.to_owned(), decoder, size, bits }))
    }

    /// The size and the numbers, row-major.
    pub(super) fn values(mut self) -> Result<((u32, u32), Vec<f32>), Error> {
        let pixels = self.size.0 as usize * self.size.1 as usize;
        // Decoders abort where an allocation fails.
        let bytes = pixels * (usize::from(self.bits) / 8 + 2 * size_of::<f32>());
        memory::reserved::<u8>(bytes, "decoding the image").map_err(Error::content(&self.path))?;
        let values: Vec<f32> = match self.decoder.read_image().map_err(|error| damaged(&self.path, error))? {
            DecodingResult::F32(values) => values,
            DecodingResult::F64(values) => values.into_iter().map(|value| value as f32).collect(),
            DecodingResult::U32(values) => values.into_iter().map(|value| value as f32).collect(),
            DecodingResult::U64(values) => values.into_iter().map(|value| value as f32).collect(),
            _ => {
                return Err(Error::bad_depth(&self.path, "signed integers are not supported"));
            }
        };
        match values.len() == pixels {
            true => Ok((self.size, values)),
            false => Err(Error::bad_depth(&self.path, format!("it has {} numbers for {pixels} pixels", values.len()))),
        }
    }
}

fn damaged(path: &Path, error: TiffError) -> Error {
    match error {
        TiffError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => Error::read(path, source),
        error => {
            let message = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
            Error::damaged_image(path, "TIFF", message)
        }
    }
}
