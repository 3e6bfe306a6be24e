//! Photographs of a video: sharp frames at regular distances of motion.

mod choice;
mod ffmpeg;
mod motion;

use std::{
    fs,
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
};

use gs_core::counted;
use gs_io::OutputFolder;
use serde::{Deserialize, Serialize};

use self::{
    choice::{Choice, Frame, MOST, choose},
    ffmpeg::{Probe, next_frame, probe, read},
};
use crate::{
    error::Error,
    input::photographs::{Identity, Photographs, identity},
    reporter::{Reporter, Stage},
    work::{WORK, remove},
};

/// Endings of the names of videos, in lower case.
const ENDINGS: [&str; 12] = ["mp4", "mov", "m4v", "mkv", "webm", "avi", "mts", "m2ts", "3gp", "mpg", "mpeg", "wmv"];

/// Frames that are looked at, about; of short videos all.
const LOOKED_AT: f64 = 2_000.0;

/// Frames per second that are looked at where the length is not known.
const RATE: f64 = 10.0;

/// The longer side of the frames that are looked at, px.
const SIDE: usize = 480;

/// The fewest frames that make a scene.
const FEWEST: usize = 5;

/// Frames below which a video is too short.
const ENOUGH: usize = 10;

/// Filters that give each frame one tick at 25 frames per second, so that ffmpeg neither repeats one nor leaves one out.
const TICKS: &str = "settb=1/25,setpts=N";

/// What was made of a video, in the folder of the data set.
pub(crate) const RECORD: &str = "frames.json";

/// A video, of which the sharpest frames become photographs.
#[derive(Debug, Clone, PartialEq)]
pub struct Video {
    /// The file.
    pub path: PathBuf,
    probe: Probe,
}

/// What is stored as [`RECORD`].
#[derive(Serialize, Deserialize)]
struct Record {
    video: Identity,
    frames: Vec<Taken>,
}

/// A frame that became a photograph.
#[derive(Serialize, Deserialize)]
struct Taken {
    name: String,
    /// Its time in the video, s.
    seconds: f64,
}

/// Whether a file is named as a video.
pub fn is_video(path: &Path) -> bool {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    path.is_file() && ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
}

impl Video {
    /// Looks into a video with ffprobe.
    ///
    /// # Errors
    /// [`Error::NoFfmpeg`], [`Error::Video`] for a file that is none.
    pub(crate) fn open(path: &Path) -> Result<Self, Error> {
        Ok(Self { path: path.to_owned(), probe: probe(path)? })
    }

    /// Puts the chosen frames into `images` of the folder, unless an earlier run did and `resume` is set.
    pub(crate) fn photographs(
        &self,
        (folder, resume): (&OutputFolder, bool),
        reporter: &mut dyn Reporter,
    ) -> Result<Photographs, Error> {
        let record = folder.path().join(RECORD);
        let stored = fs::read(&record).ok().and_then(|bytes| serde_json::from_slice::<Record>(&bytes).ok());
        let is_there = |record: &Record| {
            let mut names = record.frames.iter().map(|frame| folder.path().join("images").join(&frame.name));
            record.video == identity("", &self.path) && names.all(|path| path.is_file())
        };
        let record = match stored.filter(|record| resume && is_there(record)) {
            Some(record) => record,
            None => self.extract(folder, reporter)?,
        };
        let mut found = Photographs::of(&self.path, &folder.path().join("images"))?;
        found.files.retain(|photograph| record.frames.iter().any(|frame| frame.name == photograph.name));
        Ok(found)
    }

    /// Chooses frames and writes them.
    fn extract(&self, folder: &OutputFolder, reporter: &mut dyn Reporter) -> Result<Record, Error> {
        let rate = match self.probe.seconds {
            Some(seconds) => self.probe.rate.min(LOOKED_AT / seconds),
            None => self.probe.rate.min(RATE),
        };
        // As ffmpeg is told it.
        let rate = ((rate * 1e4).round() / 1e4).max(1e-4);
        let (frames, complaint) = self.look(rate, reporter)?;
        let choice = choose(&frames, MOST);
        self.check(&choice, frames.len(), complaint.as_deref())?;
        if let Some(complaint) = complaint {
            reporter.note(&format!("{}: parts of it cannot be read ({complaint})", self.path.display()));
        }
        reporter.note(&sentence(&choice, (frames.len(), rate < self.probe.rate)));
        drop(frames);
        let work = folder.path().join(WORK).join("frames");
        remove(&work)?;
        let written = self.write(rate, &choice.frames, &work, reporter);
        let record = written.and_then(|()| self.publish(rate, &choice.frames, &work, folder));
        remove(&work)?;
        record
    }

    /// Looks at frames of the video, and returns what ffmpeg complained about.
    fn look(&self, rate: f64, reporter: &mut dyn Reporter) -> Result<(Vec<Frame>, Option<String>), Error> {
        let total = self.probe.seconds.map_or(0, |seconds| (seconds * rate) as usize);
        let filters = format!(
            "fps={rate:.4},scale={SIDE}:{SIDE}:force_original_aspect_ratio=decrease:flags=area,format=gray,{TICKS}"
        );
        let mut frames: Vec<Frame> = Vec::new();
        let next = |pipe: &mut BufReader<_>| next_frame(pipe).map(|(width, pixels)| Frame::of(width, &pixels));
        let arguments = ["-r", "25", "-f", "image2pipe", "-c:v", "pgm", "-"];
        let (_, complaint) = read(&self.path, (&filters, Path::new(".")), &arguments, next, |frame| {
            frames.extend(frame);
            reporter.progress(Stage::Video, frames.len(), total.max(frames.len()));
            cancelled(reporter, Stage::Video)
        })?;
        Ok((frames, complaint))
    }

    /// Fails where too few frames were chosen.
    fn check(&self, choice: &Choice, frames: usize, complaint: Option<&str>) -> Result<(), Error> {
        if choice.frames.len() >= FEWEST {
            return Ok(());
        }
        let problem = match (frames, complaint) {
            (0, complaint) => {
                format!("ffmpeg cannot read any frame of it ({})", complaint.unwrap_or("there is none"))
            }
            (..ENOUGH, _) => format!(
                "it has only {}, too few for a scene: film for half a minute or longer while you walk around",
                counted(frames, "frame")
            ),
            _ if choice.plain * 2 > frames => {
                "most of it is dark or shows plain surfaces: film with more light, and what has texture".to_owned()
            }
            _ => format!(
                "the camera hardly moves in it: {} of {frames} frames show it from a new place, but {FEWEST} are needed; \
                 walk around while you film",
                choice.frames.len()
            ),
        };
        Err(Error::Video { path: self.path.clone(), problem })
    }

    /// Writes frames at full size into a folder.
    fn write(&self, rate: f64, frames: &[usize], to: &Path, reporter: &mut dyn Reporter) -> Result<(), Error> {
        fs::create_dir_all(to).map_err(Error::at(to))?;
        let numbers: Vec<String> = frames.iter().map(|frame| format!("eq(n,{frame})")).collect();
        let filters = format!("fps={rate:.4},select='{}',{TICKS}", sum(&numbers));
        let arguments = ["-r", "25", "-q:v", "2", "-progress", "-", "-nostats", "%04d.jpg"];
        let next = |pipe: &mut BufReader<_>| pipe.lines().next()?.ok();
        let (succeeded, complaint) = read(&self.path, (&filters, to), &arguments, next, |line| {
            if let Some(done) = line.and_then(|line| line.strip_prefix("frame=")?.trim().parse().ok()) {
                reporter.progress(Stage::Frames, done, frames.len());
            }
            cancelled(reporter, Stage::Frames)
        })?;
        let is_written = |at| fs::metadata(to.join(name(at))).is_ok_and(|file| file.len() > 0);
        if succeeded && (0..frames.len()).all(is_written) {
            return Ok(());
        }
        let why = complaint.unwrap_or_else(|| "some are missing".to_owned());
        Err(Error::Video { path: self.path.clone(), problem: format!("ffmpeg could not write its frames ({why})") })
    }

    /// Moves written frames into `images`.
    fn publish(&self, rate: f64, frames: &[usize], from: &Path, folder: &OutputFolder) -> Result<Record, Error> {
        let taken = |(at, frame): (usize, &usize)| Taken { name: name(at), seconds: *frame as f64 / rate };
        let record = Record { video: identity("", &self.path), frames: frames.iter().enumerate().map(taken).collect() };
        let images = folder.path().join("images");
        fs::create_dir_all(&images).map_err(Error::at(&images))?;
        folder.claim(record.frames.iter().map(|frame| format!("images/{}", frame.name)).chain([RECORD.to_owned()]))?;
        folder.remove(RECORD)?;
        for Taken { name, .. } in &record.frames {
            let to = folder.file(&format!("images/{name}"));
            fs::rename(from.join(name), &to).map_err(Error::at(&to))?;
        }
        let text = serde_json::to_vec_pretty(&record).unwrap_or_default();
        gs_io::write_durably(folder.file(RECORD), |file| file.write_all(&text))?;
        Ok(record)
    }
}

/// The name of a photograph by its place among all.
fn name(at: usize) -> String {
    format!("{:04}.jpg", at + 1)
}

/// An expression of ffmpeg for a sum. Halves are summed first, because ffmpeg nests at most 100 terms.
fn sum(terms: &[String]) -> String {
    match terms {
        [] => "0".to_owned(),
        [term] => term.clone(),
        _ => {
            let (first, second) = terms.split_at(terms.len() / 2);
            format!("({}+{})", sum(first), sum(second))
        }
    }
}

fn cancelled(reporter: &dyn Reporter, stage: Stage) -> Result<(), Error> {
    if reporter.is_cancelled() { Err(Error::Cancelled { stage: stage.words() }) } else { Ok(()) }
}

/// What was chosen, in words.
fn sentence(choice: &Choice, (frames, thinned): (usize, bool)) -> String {
    let Choice { frames: chosen, blurred, plain, step } = choice;
    let most = if chosen.len() == MOST { format!(" (at most {MOST})") } else { String::new() };
    let thinned = if thinned { " that were looked at" } else { "" };
    let plain =
        if *plain > 0 { format!(", {plain} that show nothing but plain surfaces or darkness") } else { String::new() };
    format!(
        "{} of {frames} frames{thinned} are used{most}: the sharpest wherever the picture has moved by {:.0} %; left out: \
         {blurred} that are blurred{plain}, and {} between these",
        chosen.len(),
        step * 100.0,
        frames - chosen.len() - blurred - choice.plain
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_many_terms_are_not_nested_deeply() {
        for count in [0, 1, 2, 101, MOST] {
            let terms: Vec<String> = (0..count).map(|at| format!("t{at}")).collect();
            let text = sum(&terms);
            let found: Vec<&str> =
                text.split(['(', ')', '+']).filter(|term| !term.is_empty() && *term != "0").collect();
            assert_eq!(found, terms, "{text}");
            let depths = text.chars().scan(0_i32, |depth, c| {
                *depth += i32::from(c == '(') - i32::from(c == ')');
                Some(*depth)
            });
            assert!(depths.max().unwrap_or(0) <= 9, "{text}");
            // Each sum has two terms.
            assert_eq!(text.matches('+').count(), text.matches('(').count());
        }
    }
}
