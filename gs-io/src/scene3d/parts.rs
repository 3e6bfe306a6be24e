//! Scenes read and written part by part, in little memory: `.splat`, and binary PLY whose rows have one size.
//!
//! A part is a scene. Its bytes are those of a file of its own, which [`decode_3d`] reads: the header with another
//! number of vertices, and some of the rows.

use std::{
    borrow::Borrow,
    fs::File,
    io::{self, Read as _, Write},
    path::{Path, PathBuf},
};

use gs_core::{Scene as _, Scene3d};

use super::{
    ConversionLoss, File3d, Format3d, WriteOptions3d, Written3d, ply, splat,
    whole::{WANTED, checked, decode_3d, encode_3d},
};
use crate::{
    atomic::{open, read_exactly, write_durably},
    error::Error,
};

/// Most Gaussians in a part: a few dozen MB.
const PART: u64 = 1 << 16;

/// Most bytes of a header.
const LONGEST_HEADER: u64 = 1 << 16;

/// The parts of a scene file, one after the other, as [`read_3d`](super::read_3d) would read them.
#[derive(Debug)]
pub struct Parts3d {
    path: PathBuf,
    format: Format3d,
    file: File,
    /// The file up to the number of vertices, and from there to the rows.
    header: [Vec<u8>; 2],
    row_bytes: u64,
    bytes: u64,
    /// Gaussians in the file, and those that were read.
    all: u64,
    read: u64,
}

impl Parts3d {
    /// Opens a file. `None` where it must be read as a whole: another format, or a PLY in text, with lists, with
    /// further elements, or with means of 64 bits.
    ///
    /// # Errors
    /// [`Error::Missing`], [`Error::NotAFile`] or [`Error::Read`].
    pub fn open(path: impl AsRef<Path>) -> Result<Option<Self>, Error> {
        let path = path.as_ref();
        let (mut file, metadata) = open(path, WANTED)?;
        let failed = |source| Error::read(path, source);
        let start = read_exactly(&mut file, metadata.len().min(LONGEST_HEADER)).map_err(failed)?;
        let (format, header, row_bytes, all) = match Format3d::recognise(&start, path) {
            Some(Format3d::Ply) => match ply::rows_of(path, &start) {
                Some((header, row_bytes, all)) => (Format3d::Ply, header, row_bytes, all),
                None => return Ok(None),
            },
            Some(Format3d::Splat) => {
                let row_bytes = splat::RECORD_BYTES as u64;
                (Format3d::Splat, Default::default(), row_bytes, metadata.len() / row_bytes)
            }
            _ => return Ok(None),
        };
        let header_bytes = header_of(&header, format, all).len() as u64;
        // Anything else is for the reader of whole files, which says what is wrong.
        if all == 0
            || all.checked_mul(row_bytes).and_then(|rows| rows.checked_add(header_bytes)) != Some(metadata.len())
        {
            return Ok(None);
        }
        io::Seek::seek(&mut file, io::SeekFrom::Start(header_bytes)).map_err(failed)?;
        Ok(Some(Self { path: path.to_owned(), format, file, header, row_bytes, bytes: metadata.len(), all, read: 0 }))
    }

    /// Number of Gaussians in the file.
    pub fn gaussians(&self) -> u64 {
        self.all
    }

    fn read_part(&mut self) -> Result<File3d, Error> {
        let number = PART.min(self.all - self.read);
        let mut bytes = header_of(&self.header, self.format, number);
        let rows = number * self.row_bytes;
        let read = (&mut self.file).take(rows).read_to_end(&mut bytes).map_err(|e| Error::read(&self.path, e))?;
        let part = decode_3d(self.format, &bytes[..], &self.path).and_then(|part| checked(part, &self.path));
        let first = self.read as usize;
        self.read = if read as u64 == rows { self.read + number } else { self.all };
        part.map_err(|error| match error {
            Error::Content { path, source: gs_core::Error::NotFinite { what, index, value } } => {
                Error::Content { path, source: gs_core::Error::NotFinite { what, index: first + index, value } }
            }
            other => other,
        })
    }
}

impl Iterator for Parts3d {
    type Item = Result<File3d, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        (self.read < self.all).then(|| {
            let part = self.read_part();
            if part.is_err() {
                self.read = self.all;
            }
            part
        })
    }
}

/// The scene of a file of at least `least` bytes, which is not in memory beside it; `None` for other files, for
/// those that must be read as a whole, and for damaged ones, of which the reader of whole files says what is wrong.
pub(super) fn joined(path: &Path, least: u64) -> Result<Option<File3d>, Error> {
    let Some(parts) = Parts3d::open(path)?.filter(|parts| parts.bytes >= least) else { return Ok(None) };
    let bytes = parts.bytes;
    let mut whole: Option<File3d> = None;
    for part in parts {
        let Ok(part) = part else { return Ok(None) };
        match &mut whole {
            None => whole = Some(File3d { bytes, ..part }),
            Some(whole) => {
                whole.scene.append(part.scene);
                ConversionLoss::merge(&mut whole.losses, part.losses);
            }
        }
    }
    Ok(whole)
}

/// The header of a file with this number of Gaussians.
fn header_of([before, after]: &[Vec<u8>; 2], format: Format3d, number: u64) -> Vec<u8> {
    let number = if format == Format3d::Ply { number.to_string() } else { String::new() };
    [before, number.as_bytes(), after].concat()
}

/// Whether [`write_parts_3d`] can write a file of this name.
pub fn writes_parts_3d(path: impl AsRef<Path>) -> bool {
    matches!(Format3d::to_write(path.as_ref()), Some(Format3d::Ply | Format3d::Splat))
}

/// Writes a scene of this many Gaussians part by part, as [`write_3d`](super::write_3d) writes it: atomically, as
/// PLY or `.splat`. The first part has the SH degree of all.
///
/// # Errors
/// Those of [`write_3d`](super::write_3d) and of the parts. [`Error::UnknownEnding`] where
/// [`writes_parts_3d`] is false; [`Error::Write`] where the parts have another number of Gaussians.
pub fn write_parts_3d<E: From<Error>>(
    path: impl AsRef<Path>,
    gaussians: usize,
    options: &WriteOptions3d,
    parts: impl IntoIterator<Item = Result<impl Borrow<Scene3d>, E>>,
) -> Result<Written3d, E> {
    let path = path.as_ref();
    let format = Format3d::to_write(path).filter(|_| writes_parts_3d(path));
    let format = format.ok_or_else(|| Format3d::unknown_ending(path))?;
    if gaussians == 0 {
        return Err(Error::empty(path).into());
    }
    let (mut losses, mut failure, mut written) = (Vec::new(), None, 0);
    // For the header, which stands before the first part even if that is empty.
    let mut all = Some(gaussians);
    let result = write_durably(path, |file| {
        for part in parts {
            let put = part.and_then(|part| {
                let part: &Scene3d = part.borrow();
                written += part.len();
                put(path, format, part, options, all.take(), &mut losses, file).map_err(E::from)
            });
            if let Err(error) = put {
                failure = Some(error);
                return Err(io::ErrorKind::Other.into());
            }
        }
        if written != gaussians {
            let message =
                format!("the parts have {written} Gaussians instead of {gaussians}; has their scene changed?");
            return Err(io::Error::other(message));
        }
        Ok(())
    });
    if let Some(error) = failure {
        return Err(error);
    }
    result?;
    Ok(Written3d { format, losses, beside: Vec::new(), order: None })
}

/// Writes a part, with the header of all in front of the first.
fn put(
    path: &Path,
    format: Format3d,
    part: &Scene3d,
    options: &WriteOptions3d,
    of: Option<usize>,
    losses: &mut Vec<ConversionLoss>,
    file: &mut dyn Write,
) -> Result<(), Error> {
    let failed = |source| Error::write(path, source);
    if format == Format3d::Ply {
        part.validate().map_err(Error::content(path))?;
        ConversionLoss::merge(losses, ConversionLoss::of_infinite_logits(part));
        let (comments, world) = ply::comments(options);
        of.map_or(Ok(()), |all| ply::write_header(part.sh_degree, all, &comments, world, file)).map_err(failed)?;
        return ply::write_rows(part, world, file).map_err(failed);
    }
    if part.is_empty() {
        return Ok(());
    }
    let encoded = encode_3d(path, part, options)?;
    ConversionLoss::merge(losses, encoded.written.losses);
    file.write_all(&encoded.bytes).map_err(failed)
}

#[cfg(all(test, feature = "write"))]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::{read_3d, write_3d};

    /// More Gaussians than a part has.
    fn scene() -> Scene3d {
        let gaussian = |i: u32| gs_core::Gaussian3d {
            mean: Vec3::new(i as f32, 0.5, -1.0),
            log_scale: Vec3::splat(-3.0),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: if i.is_multiple_of(1000) { f32::INFINITY } else { 0.25 },
            sh: vec![Vec3::splat(0.1); 4],
        };
        (0..PART as u32 + 5000).map(gaussian).collect()
    }

    #[test]
    fn parts_are_read_and_written_as_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["scene.ply", "scene.splat"] {
            let (whole, again) = (folder.path().join(name), folder.path().join(format!("again-{name}")));
            let options = WriteOptions3d::default();
            let scene = scene();
            let written = write_3d(&whole, &scene, &options).unwrap();
            let parts = Parts3d::open(&whole).unwrap().unwrap();
            assert_eq!(parts.gaussians(), PART + 5000);
            let parts: Vec<File3d> = parts.collect::<Result<_, _>>().unwrap();
            assert_eq!(parts.iter().map(|part| part.scene.len()).collect::<Vec<_>>(), [PART as usize, 5000]);
            let mut joined = Scene3d { sh_degree: parts[0].scene.sh_degree, ..Scene3d::default() };
            parts.into_iter().for_each(|part| joined.append(part.scene));
            let file = read_3d(&whole).unwrap();
            assert_eq!(joined, file.scene);
            assert_eq!(super::joined(&whole, 0).unwrap(), Some(file));
            assert_eq!(super::joined(&whole, u64::MAX).unwrap(), None, "small files are read at once");
            // The parts of the scene itself, so that the losses are the same.
            let part = |numbers: std::ops::Range<usize>| {
                Ok::<Scene3d, Error>(numbers.map(|index| scene.gaussian(index)).collect())
            };
            let halves = [part(0..100), part(100..scene.len())];
            let found = write_parts_3d::<Error>(&again, scene.len(), &options, halves).unwrap();
            assert_eq!((found.format, found.losses), (written.format, written.losses));
            assert_eq!(std::fs::read(&again).unwrap(), std::fs::read(&whole).unwrap());
        }
    }

    #[test]
    fn parts_may_be_empty_but_have_the_announced_number_of_gaussians() {
        let folder = tempfile::tempdir().unwrap();
        let few: Scene3d = (0..7).map(|index| scene().gaussian(index)).collect();
        for name in ["scene.ply", "scene.splat"] {
            let path = folder.path().join(name);
            let write = |gaussians| {
                let nothing = Scene3d { sh_degree: few.sh_degree, ..Scene3d::default() };
                let parts = [Ok(nothing.clone()), Ok(few.clone()), Ok(nothing)];
                write_parts_3d::<Error>(&path, gaussians, &WriteOptions3d::default(), parts)
            };
            write(7).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            write_3d(&path, &few, &WriteOptions3d::default()).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), bytes);
            let error = write(8).unwrap_err().to_string();
            assert!(error.contains("7 Gaussians instead of 8"), "{error}");
            assert_eq!(std::fs::read(&path).unwrap(), bytes, "the older file stays");
        }
    }

    #[test]
    fn damage_is_named_with_its_place_in_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.ply");
        write_3d(&path, &scene(), &WriteOptions3d::default()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let mut broken = bytes.clone();
        let row = (bytes.len() - bytes.windows(11).position(|w| w == b"end_header\n").unwrap() - 11) / scene().len();
        let at = bytes.len() - 7 * row;
        broken[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        std::fs::write(&path, &broken).unwrap();
        let error = Parts3d::open(&path).unwrap().unwrap().find_map(Result::err).unwrap();
        assert_eq!(error.to_string(), read_3d(&path).unwrap_err().to_string());
        assert_eq!(joined(&path, 0).unwrap(), None);
        // What is cut off, in text or of another format is for the reader of whole files.
        std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        assert!(Parts3d::open(&path).unwrap().is_none());
    }
}
