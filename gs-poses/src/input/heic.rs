//! HEIC photographs, which other programs convert.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
};

use crate::error::Error;

/// Programs that convert HEIC photographs to JPEG, with their options before the names of both files.
const CONVERTERS: [(&str, [&str; 2]); 4] = [
    ("heif-dec", ["-q", "95"]),
    ("heif-convert", ["-q", "95"]),
    ("magick", ["-quality", "95"]),
    ("convert", ["-quality", "95"]),
];

/// A HEIC photograph.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Heic {
    /// The path of its JPEG below the folder of photographs, with `/`.
    pub(crate) name: String,
    pub(crate) path: PathBuf,
    pub(crate) mask: Option<PathBuf>,
}

/// A program that converts HEIC photographs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Converter(&'static str, [&'static str; 2]);

impl Converter {
    /// The first that is installed, to convert this photograph.
    pub(crate) fn find(photograph: &Path) -> Result<Self, Error> {
        // Windows has another program of the name `convert`.
        let programs = CONVERTERS.iter().take(if cfg!(windows) { 3 } else { 4 });
        let found = programs.copied().find(|(program, _)| output(Command::new(program).arg("-version")).is_some());
        found
            .map(|(program, options)| Self(program, options))
            .ok_or_else(|| Error::NoConverter { path: photograph.to_owned() })
    }

    /// Converts a photograph to a JPEG in an empty folder, or says why it cannot be converted.
    pub(crate) fn convert(self, photograph: &Path, folder: &Path) -> Result<PathBuf, String> {
        let source = std::path::absolute(photograph).unwrap_or_else(|_| photograph.to_owned());
        let done = output(Command::new(self.0).args(self.1).arg(source).arg(folder.join("photograph.jpg")));
        // Of several pictures in a file, which get numbers, the first.
        let mut files: Vec<PathBuf> =
            fs::read_dir(folder).into_iter().flatten().flatten().map(|file| file.path()).collect();
        files.sort();
        let whole = done.as_ref().is_some_and(|done| done.status.success());
        let Some(file) = files.into_iter().next().filter(|_| whole) else {
            let said = done.map(|done| String::from_utf8_lossy(&done.stderr).into_owned()).unwrap_or_default();
            let line = said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("it does not say why");
            return Err(format!("{}: {} cannot convert it ({})", photograph.display(), self.0, line.trim()));
        };
        let upright = fs::read(&file).and_then(|mut bytes| {
            set_upright(&mut bytes);
            fs::write(&file, bytes)
        });
        upright.map(|()| file).map_err(|error| format!("{}: {error}", photograph.display()))
    }
}

fn output(command: &mut Command) -> Option<Output> {
    command.stdin(Stdio::null()).output().ok()
}

/// Sets the orientation in a JPEG's EXIF data to upright. A HEIC file has its own rotation in addition to the EXIF
/// orientation. Converters apply that rotation, so the EXIF orientation must be reset.
fn set_upright(jpeg: &mut [u8]) -> Option<()> {
    let tiff = jpeg.windows(6).position(|bytes| bytes == b"Exif\0\0")? + 6;
    let little = jpeg.get(tiff..)?.starts_with(b"II");
    let number = |jpeg: &[u8], at: usize, length: usize| {
        let bytes = jpeg.get(at..at + length)?.iter();
        let add = |sum, byte: &u8| sum << 8 | usize::from(*byte);
        Some(if little { bytes.rev().fold(0, add) } else { bytes.fold(0, add) })
    };
    let directory = tiff + number(jpeg, tiff + 4, 4)?;
    let entries = (0..number(jpeg, directory, 2)?).map(|entry| directory + 2 + 12 * entry);
    let at = entries.into_iter().find(|at| number(jpeg, *at, 2) == Some(0x0112))? + 8;
    let upright = if little { [1, 0] } else { [0, 1] };
    jpeg.get_mut(at..at + 2)?.copy_from_slice(&upright);
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_orientation_becomes_upright() {
        let big = b"\xff\xd8..Exif\0\0MM\0\x2a\0\0\0\x08\0\x02\x01\x0f\0\x02\0\0\0\x04abcd\x01\x12\0\x03\0\0\0\x01\0\x06\0\0rest";
        let little =
            b"\xff\xd8..Exif\0\0II\x2a\0\x08\0\0\0\x02\0\x0f\x01\x02\0\x04\0\0\0abcd\x12\x01\x03\0\x01\0\0\0\x08\0\0\0rest";
        for bytes in [&big[..], little] {
            let mut changed = bytes.to_vec();
            assert_eq!(set_upright(&mut changed), Some(()));
            let differ: Vec<_> = bytes.iter().zip(&changed).filter(|(old, new)| old != new).collect();
            assert!(matches!(differ[..], [(6 | 8, 1)]), "{differ:?}");
            (0..24).for_each(|end| assert_eq!(set_upright(&mut bytes[..end].to_vec()), None));
        }
        assert_eq!(set_upright(&mut b"\xff\xd8 no data".to_vec()), None);
    }
}
