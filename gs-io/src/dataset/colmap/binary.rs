//! COLMAP's binary files: little-endian, without padding; each starts with its number of records.

use std::path::Path;

use super::{
    CameraModel, ColmapObservation,
    camera_model::unknown_model,
    model::NO_POINT,
    records::{Number, Records, WHAT},
};
use crate::{error::Error, scene3d::source::Source};

/// Records of a kind: their plural, and the least size of one, bytes.
type Kind = (&'static str, usize);

/// Id, model and size.
pub(super) const CAMERAS: Kind = ("cameras", 4 + 4 + 8 + 8);
/// Id, pose, camera, end of the name, number of keypoints.
pub(super) const IMAGES: Kind = ("images", 4 + 7 * 8 + 4 + 1 + 8);
/// Id, position, colour, error, length of the track.
pub(super) const POINTS: Kind = ("points", 8 + 3 * 8 + 3 + 8 + 8);
/// Position, point.
const KEYPOINTS: Kind = ("keypoints", 8 + 8 + 8);
/// Image, keypoint.
const TRACK: Kind = ("observations of a point", 4 + 4);

/// The records of a binary file.
pub(super) struct Binary<'a> {
    source: Source<'a>,
    at: usize,
    /// Records that follow.
    left: usize,
}

impl<'a> Binary<'a> {
    /// The records of a file, which are of this kind.
    pub(super) fn new(path: &'a Path, bytes: &'a [u8], kind: Kind) -> Result<Self, Error> {
        let mut file = Self { source: Source { path, what: WHAT, bytes, beside: None }, at: 0, left: 0 };
        file.left = file.count(kind)?;
        Ok(file)
    }

    /// Reads a number of records, and checks that the rest of the file has room for them.
    fn count(&mut self, (records, least): Kind) -> Result<usize, Error> {
        let start = self.at;
        let count: u64 = self.number(&format!("the number of {records}"))?;
        let room = (self.source.bytes.len() - self.at) / least;
        let is_possible = |count: &usize| *count <= room;
        usize::try_from(count).ok().filter(is_possible).ok_or_else(|| {
            let expected = format!("at most {room} {records}, for which there is room");
            self.source.damaged(start, expected, count.to_string())
        })
    }
}

impl Records for Binary<'_> {
    fn next(&mut self) -> Result<bool, Error> {
        if let Some(left) = self.left.checked_sub(1) {
            self.left = left;
            return Ok(true);
        }
        match self.source.bytes.len() - self.at {
            0 => Ok(false),
            more => Err(self.source.damaged(self.at, "the end of the file", format!("{more} more bytes"))),
        }
    }

    fn number<T: Number>(&mut self, expected: &str) -> Result<T, Error> {
        let bytes = self.source.slice(self.at, T::BYTES as u64, expected)?;
        self.at += bytes.len();
        T::of_bytes(bytes).ok_or_else(|| self.source.damaged(self.at, expected, "another number of bytes"))
    }

    fn model(&mut self) -> Result<CameraModel, Error> {
        let id = self.number("a camera model")?;
        CameraModel::from_id(id).ok_or_else(|| unknown_model(self.source.path, id))
    }

    /// A text that ends with a 0 byte; invalid UTF-8 becomes U+FFFD.
    fn name(&mut self) -> Result<String, Error> {
        let rest = &self.source.bytes[self.at..];
        let Some(length) = rest.iter().position(|byte| *byte == 0) else {
            let found = "none to the end of the file";
            return Err(self.source.damaged(self.at, "a name that ends with a 0 byte", found));
        };
        self.at += length + 1;
        Ok(String::from_utf8_lossy(&rest[..length]).into_owned())
    }

    fn observations(&mut self, _: &str) -> Result<Vec<ColmapObservation>, Error> {
        let count = self.count(KEYPOINTS)?;
        let observation = |_| {
            let position = self.keypoint()?;
            let point = Some(self.number("a point's number")?).filter(|point| *point != NO_POINT);
            Ok(ColmapObservation { position, point })
        };
        (0..count).map(observation).collect()
    }

    fn pass_over_track(&mut self) -> Result<(), Error> {
        // That many bytes are there: `count` has seen to it.
        self.at += self.count(TRACK)? * TRACK.1;
        Ok(())
    }

    fn end(&mut self) -> Result<(), Error> {
        Ok(())
    }
}
