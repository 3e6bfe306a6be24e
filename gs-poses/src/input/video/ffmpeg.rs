//! Runs ffmpeg and ffprobe.

use std::{
    io::{self, BufRead, BufReader, Read},
    path::{Path, PathBuf},
    process::{Child, ChildStdout, Command, Stdio},
    sync::mpsc::{RecvTimeoutError, sync_channel},
    thread,
};

use serde::Deserialize;

use crate::{colmap::process::PAUSE, error::Error};

/// Frames that are read before they are taken.
const AHEAD: usize = 16;

/// What ffprobe says about a video.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Probe {
    /// Frames per second, on average.
    pub(super) rate: f64,
    /// Length, s; `None` where the file does not say it.
    pub(super) seconds: Option<f64>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Answer {
    streams: Vec<Stream>,
    format: Stream,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Stream {
    avg_frame_rate: String,
    duration: String,
}

/// Looks into a file.
pub(super) fn probe(path: &Path) -> Result<Probe, Error> {
    let words = "-v error -select_streams V:0 -show_entries stream=avg_frame_rate,duration:format=duration -of json";
    let output = Command::new("ffprobe").args(words.split(' ')).arg(whole(path)).stdin(Stdio::null()).output();
    let output = output.map_err(|error| no_ffmpeg(path, error))?;
    let problem = |problem: String| Error::Video { path: path.to_owned(), problem };
    if !output.status.success() {
        let why = complaint(&String::from_utf8_lossy(&output.stderr));
        return Err(problem(format!(
            "ffmpeg cannot read it ({why}): name a video, or a folder of photographs; a recording or a copy that broke \
             off must be made again"
        )));
    }
    let answer: Answer = serde_json::from_slice(&output.stdout).unwrap_or_default();
    let Some(stream) = answer.streams.first() else {
        return Err(problem("it has no moving picture: name a video, or a folder of photographs".to_owned()));
    };
    let rate = stream.avg_frame_rate.split_once('/').and_then(|(frames, seconds)| {
        Some(frames.parse::<f64>().ok()? / seconds.parse::<f64>().ok()?).filter(|rate| rate.is_finite() && *rate > 0.0)
    });
    let seconds = [&stream.duration, &answer.format.duration].into_iter().find_map(|text| text.parse().ok());
    Ok(Probe { rate: rate.unwrap_or(25.0), seconds: seconds.filter(|seconds: &f64| *seconds > 0.0) })
}

/// An absolute path: ffmpeg takes others for the names of protocols or options.
fn whole(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

fn no_ffmpeg(path: &Path, error: io::Error) -> Error {
    match error.kind() {
        io::ErrorKind::NotFound => Error::NoFfmpeg { path: path.to_owned() },
        _ => Error::at("ffmpeg")(error),
    }
}

/// The first line of what ffmpeg wrote, without the part of the program that wrote it and the name of the file.
fn complaint(said: &str) -> String {
    let line = said.lines().find(|line| !line.trim().is_empty()).unwrap_or("it does not say why");
    let line = line.rsplit_once("] ").map_or(line, |(_, line)| line);
    line.rsplit_once(": ").map_or(line, |(_, line)| line).trim().to_owned()
}

/// A run of ffmpeg, which is killed where it is dropped.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Reads a video through filters, at work in `folder`. `arguments` say what becomes of the frames, and `next` takes the
/// next part of what ffmpeg writes to standard output. `each` is told each part, and `None` about ten times a second;
/// its error ends the work. Returns whether ffmpeg succeeded, and what it complained about.
pub(super) fn read<T: Send + 'static>(
    path: &Path,
    (filters, folder): (&str, &Path),
    arguments: &[&str],
    next: impl Fn(&mut BufReader<ChildStdout>) -> Option<T> + Send + 'static,
    mut each: impl FnMut(Option<T>) -> Result<(), Error>,
) -> Result<(bool, Option<String>), Error> {
    let mut command = Command::new("ffmpeg");
    command.args(["-nostdin", "-y", "-v", "error", "-i"]).arg(whole(path)).args(["-map", "0:V:0", "-vf", filters]);
    command.args(arguments).current_dir(folder).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut running = Running(command.spawn().map_err(|error| no_ffmpeg(path, error))?);
    let mut errors = running.0.stderr.take();
    let said = thread::spawn(move || {
        let mut text = Vec::new();
        errors.as_mut().map(|errors| errors.read_to_end(&mut text));
        String::from_utf8_lossy(&text).into_owned()
    });
    let (sender, parts) = sync_channel(AHEAD);
    let pipe = running.0.stdout.take().map(BufReader::new);
    thread::spawn(move || {
        let Some(mut pipe) = pipe else { return };
        while next(&mut pipe).is_some_and(|part| sender.send(part).is_ok()) {}
    });
    loop {
        match parts.recv_timeout(PAUSE) {
            Ok(part) => each(Some(part))?,
            Err(RecvTimeoutError::Timeout) => each(None)?,
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    // Ctrl-C in a terminal also reaches ffmpeg.
    each(None)?;
    let status = running.0.wait().map_err(Error::at("ffmpeg"))?;
    let said = said.join().unwrap_or_default();
    let complaint = (!status.success() || !said.trim().is_empty()).then(|| complaint(&said));
    Ok((status.success(), complaint))
}

/// Width and pixels of the next frame of a stream of PGM images; `None` at its end.
pub(super) fn next_frame(stream: &mut impl BufRead) -> Option<(usize, Vec<u8>)> {
    let mut header = [0; 3];
    let mut line = String::new();
    stream.read_line(&mut line).ok().filter(|_| line.trim() == "P5")?;
    let mut numbers = Vec::new();
    while numbers.len() < header.len() {
        line.clear();
        stream.read_line(&mut line).ok().filter(|read| *read > 0)?;
        numbers.extend(line.split_whitespace().map_while(|word| word.parse::<usize>().ok()));
    }
    header.copy_from_slice(numbers.get(..3)?);
    let [width, height, most] = header;
    let mut pixels = vec![0; width.checked_mul(height).filter(|count| most == 255 && (1..1 << 24).contains(count))?];
    stream.read_exact(&mut pixels).ok()?;
    Some((width, pixels))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_read_up_to_the_last_whole_one() {
        let bytes = b"P5\n2 1\n255\n\x01\x02P5\n3 1\n255\n\x03\x04\x05P5\n2 2\n255\n\x06".to_vec();
        let mut stream = BufReader::new(&bytes[..]);
        let frames: Vec<_> = std::iter::from_fn(|| next_frame(&mut stream)).collect();
        assert_eq!(frames, [(2, vec![1, 2]), (3, vec![3, 4, 5])]);
        for damaged in ["", "P5\n", "P5\n0 4\n255\n", "P5\n99999 99999\n255\n", "P6\n1 1\n255\n\0\0\0", "P5\nx\n"] {
            assert_eq!(next_frame(&mut BufReader::new(damaged.as_bytes())), None, "{damaged:?}");
        }
    }

    #[test]
    fn complaints_are_short() {
        let said = "[mov,mp4 @ 0x55] moov atom not found\ntrunc.mp4: Invalid data found when processing input\n";
        assert_eq!(complaint(said), "moov atom not found");
        assert_eq!(complaint("/a b/notes.txt: Invalid data found\n"), "Invalid data found");
        assert_eq!(complaint(""), "it does not say why");
    }
}
