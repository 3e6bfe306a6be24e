//! COLMAP's text files: one record per line, words separated by blanks, comments after `#`. An
//! image has two lines, of which the second, its keypoints, may be empty.

use std::path::Path;

use gs_core::Choice as _;

use super::{
    CameraModel, ColmapObservation,
    camera_model::unknown_model,
    model::NO_POINT,
    records::{Number, Records, WHAT},
};
use crate::{error::Error, text::utf8_text};

/// The records of a text file.
pub(super) struct Text<'a> {
    path: &'a Path,
    lines: std::slice::Split<'a, u8, fn(&u8) -> bool>,
    /// Number of the line, counted from 1.
    line: usize,
    /// The remaining words of the line.
    rest: &'a str,
}

impl<'a> Text<'a> {
    pub(super) fn new(path: &'a Path, bytes: &'a [u8]) -> Result<Self, Error> {
        Ok(Self { path, lines: utf8_text(path, bytes)?.split(|byte| *byte == b'\n'), line: 0, rest: "" })
    }

    /// Goes to the next line, which may be empty. Returns whether there is one.
    fn next_line(&mut self) -> Result<bool, Error> {
        let Some(bytes) = self.lines.next() else { return Ok(false) };
        self.line += 1;
        match std::str::from_utf8(bytes) {
            Ok(text) => self.rest = text.trim(),
            Err(_) => return Err(self.damaged("UTF-8 text", "other bytes".to_owned())),
        }
        Ok(true)
    }

    /// Fails if the line is the first one of another image instead of the keypoints of `name`.
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

    fn word(&mut self, expected: &str) -> Result<&'a str, Error> {
        let (word, rest) = self.rest.split_once(char::is_whitespace).unwrap_or((self.rest, ""));
        if word.is_empty() {
            return Err(self.damaged(expected, "the end of the line".to_owned()));
        }
        self.rest = rest.trim_start();
        Ok(word)
    }

    fn damaged(&self, expected: &str, found: String) -> Error {
        let (path, place) = (self.path.to_owned(), format!("line {}", self.line));
        Error::Damaged { path, what: WHAT, place, expected: expected.to_owned(), found }
    }
}

impl Records for Text<'_> {
    /// The next line that is neither empty nor a comment.
    fn next(&mut self) -> Result<bool, Error> {
        while self.next_line()? {
            if !self.rest.is_empty() && !self.rest.starts_with('#') {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// A whole number may be written with a point: 96.0.
    fn number<T: Number>(&mut self, expected: &str) -> Result<T, Error> {
        let word = self.word(expected)?;
        let whole = || word.split_once('.').filter(|(_, rest)| rest.bytes().all(|digit| digit == b'0'));
        let number = word.parse().ok().or_else(|| whole()?.0.parse().ok());
        number.ok_or_else(|| self.damaged(expected, format!("`{}`", shortened(word))))
    }

    fn model(&mut self) -> Result<CameraModel, Error> {
        let name = self.word("a camera model")?;
        CameraModel::from_name(name).ok_or_else(|| unknown_model(self.path, shortened(name)))
    }

    /// The rest of the line, blanks included.
    fn name(&mut self) -> Result<String, Error> {
        match std::mem::take(&mut self.rest) {
            "" => Err(self.damaged("an image's name", "the end of the line".to_owned())),
            rest => Ok(rest.to_owned()),
        }
    }

    fn observations(&mut self, name: &str) -> Result<Vec<ColmapObservation>, Error> {
        let mut observations = Vec::new();
        if self.next_line()? {
            self.check_keypoints(name)?;
        }
        while !self.rest.is_empty() {
            let position = self.keypoint()?;
            // -1 stands for no point, in files of old versions the largest number.
            let expected = "a point's number or -1";
            let word = self.word(expected)?;
            let point: i128 = word.parse().map_err(|_| self.damaged(expected, format!("`{}`", shortened(word))))?;
            let point = u64::try_from(point).ok().filter(|point| *point != NO_POINT);
            observations.push(ColmapObservation { position, point });
        }
        Ok(observations)
    }

    /// The rest of the line is not read.
    fn pass_over_track(&mut self) -> Result<(), Error> {
        Ok(())
    }

    fn end(&mut self) -> Result<(), Error> {
        match self.rest {
            "" => Ok(()),
            more => Err(self.damaged("the end of the line", format!("`{}`", shortened(more)))),
        }
    }
}

/// A word shortened for a message.
fn shortened(word: &str) -> String {
    word.chars().filter(|c| !c.is_control()).take(40).collect()
}
