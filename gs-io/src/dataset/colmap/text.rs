//! COLMAP's text files: one record per line, words separated by blanks, comments after `#`. An
//! image has two lines, of which the second, its keypoints, may be empty.

use std::{collections::BTreeMap, path::Path, str::FromStr};

use glam::{DQuat, dvec2, dvec3};
use gs_core::Choice as _;

use super::{
    CameraModel, ColmapCamera, ColmapImage, ColmapObservation, ColmapPoint, camera_model::unknown_model,
    model::NO_POINT,
};
use crate::{error::Error, text::utf8_text};

/// `cameras.txt`: id, model, columns, rows, parameters.
pub(super) fn cameras(path: &Path, bytes: &[u8]) -> Result<BTreeMap<u32, ColmapCamera>, Error> {
    let mut lines = Lines::new(path, "a COLMAP cameras.txt", bytes)?;
    let mut cameras = BTreeMap::new();
    while let Some(mut words) = lines.record()? {
        let id = words.number("a camera's number")?;
        let model = words.word("a camera model")?;
        let model = CameraModel::from_name(model).ok_or_else(|| unknown_model(path, shortened(model)))?;
        let (width, height) = (words.number("a width in px")?, words.number("a height in px")?);
        let parameters = model.parameter_names().iter().map(|name| words.number(name)).collect::<Result<_, _>>()?;
        words.end()?;
        cameras.insert(id, ColmapCamera { model, width, height, parameters });
    }
    Ok(cameras)
}

/// `images.txt`: id, quaternion w x y z, translation, camera, name; then the keypoints: x, y, point
/// or −1.
pub(super) fn images(path: &Path, bytes: &[u8]) -> Result<Vec<ColmapImage>, Error> {
    let mut lines = Lines::new(path, "a COLMAP images.txt", bytes)?;
    let mut images = Vec::new();
    while let Some(mut words) = lines.record()? {
        let id = words.number("an image's number")?;
        let [w, x, y, z] = words.numbers("a quaternion w x y z")?;
        let [tx, ty, tz] = words.numbers("a translation")?;
        let camera_id = words.number("a camera's number")?;
        let name = words.rest("an image's name")?.to_owned();
        let mut observations = Vec::new();
        if let Some(mut words) = lines.next()? {
            words.check_keypoints(&name)?;
            while !words.is_empty() {
                let [x, y] = words.numbers("a keypoint x y")?;
                // -1 stands for no point, in files of old versions the largest number.
                let point: i128 = words.number("a point's number or -1")?;
                let point = u64::try_from(point).ok().filter(|point| *point != NO_POINT);
                observations.push(ColmapObservation { position: dvec2(x, y), point });
            }
        }
        let (rotation, translation) = (DQuat::from_xyzw(x, y, z, w), dvec3(tx, ty, tz));
        images.push(ColmapImage { id, rotation, translation, camera_id, name, observations });
    }
    Ok(images)
}

/// `points3D.txt`: id, position, colour, error, track.
pub(super) fn points(path: &Path, bytes: &[u8]) -> Result<Vec<ColmapPoint>, Error> {
    let mut lines = Lines::new(path, "a COLMAP points3D.txt", bytes)?;
    let mut points = Vec::new();
    while let Some(mut words) = lines.record()? {
        let id = words.number("a point's number")?;
        let [x, y, z] = words.numbers("a position")?;
        let color = [words.number("red, 0 to 255")?, words.number("green, 0 to 255")?, words.number("blue, 0 to 255")?];
        let error = words.number("an error in px")?;
        points.push(ColmapPoint { id, position: dvec3(x, y, z), color, error });
    }
    Ok(points)
}

/// The lines of a file with their numbers.
struct Lines<'a> {
    path: &'a Path,
    what: &'static str,
    rest: std::slice::Split<'a, u8, fn(&u8) -> bool>,
    line: usize,
}

/// The remaining words of a line.
struct Words<'a> {
    path: &'a Path,
    what: &'static str,
    line: usize,
    rest: &'a str,
}

impl<'a> Lines<'a> {
    fn new(path: &'a Path, what: &'static str, bytes: &'a [u8]) -> Result<Self, Error> {
        Ok(Self { path, what, rest: utf8_text(path, bytes)?.split(|byte| *byte == b'\n'), line: 0 })
    }

    /// The next line, empty or not; `None` at the end.
    fn next(&mut self) -> Result<Option<Words<'a>>, Error> {
        let Some(bytes) = self.rest.next() else { return Ok(None) };
        self.line += 1;
        let words = Words { path: self.path, what: self.what, line: self.line, rest: "" };
        match std::str::from_utf8(bytes) {
            Ok(text) => Ok(Some(Words { rest: text.trim(), ..words })),
            Err(_) => Err(words.damaged("UTF-8 text", "other bytes".to_owned())),
        }
    }

    /// The next line that is neither empty nor a comment; `None` at the end.
    fn record(&mut self) -> Result<Option<Words<'a>>, Error> {
        loop {
            match self.next()? {
                Some(words) if words.rest.is_empty() || words.rest.starts_with('#') => {}
                other => return Ok(other),
            }
        }
    }
}

impl<'a> Words<'a> {
    /// Fails where the line is the first of another image, not the keypoints of the image of this name.
    fn check_keypoints(&self, name: &str) -> Result<(), Error> {
        let is_number = |word: &str| word.parse::<f64>().is_ok();
        let mut words = self.rest.split_whitespace();
        if words.by_ref().take(9).filter(|word| is_number(word)).count() == 9
            && words.next().is_some_and(|w| !is_number(w))
        {
            let expected =
                format!("the keypoints of {}, the second line of each image, which may be empty", shortened(name));
            return Err(self.damaged(&expected, "the next image".to_owned()));
        }
        Ok(())
    }

    fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    fn word(&mut self, expected: &str) -> Result<&'a str, Error> {
        let (word, rest) = self.rest.split_once(char::is_whitespace).unwrap_or((self.rest, ""));
        if word.is_empty() {
            return Err(self.damaged(expected, "the end of the line".to_owned()));
        }
        self.rest = rest.trim_start();
        Ok(word)
    }

    fn number<T: FromStr>(&mut self, expected: &str) -> Result<T, Error> {
        let word = self.word(expected)?;
        word.parse().map_err(|_| self.damaged(expected, format!("`{}`", shortened(word))))
    }

    fn numbers<const N: usize>(&mut self, expected: &str) -> Result<[f64; N], Error> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.number(expected)?;
        }
        Ok(values)
    }

    /// The rest of the line, blanks included.
    fn rest(&mut self, expected: &str) -> Result<&'a str, Error> {
        match std::mem::take(&mut self.rest) {
            "" => Err(self.damaged(expected, "the end of the line".to_owned())),
            rest => Ok(rest),
        }
    }

    fn end(&self) -> Result<(), Error> {
        if self.is_empty() {
            Ok(())
        } else {
            Err(self.damaged("the end of the line", format!("`{}`", shortened(self.rest))))
        }
    }

    fn damaged(&self, expected: &str, found: String) -> Error {
        let (path, what) = (self.path.to_owned(), self.what);
        Error::Damaged { path, what, place: format!("line {}", self.line), expected: expected.to_owned(), found }
    }
}

/// A word shortened for a message.
fn shortened(word: &str) -> String {
    word.chars().filter(|c| !c.is_control()).take(40).collect()
}
