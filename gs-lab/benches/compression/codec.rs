//! JPEG, WebP, AVIF and JPEG XL files of an image, made by the formats' own programs.
//!
//! The programs need not be there: a format without them is left out, except JPEG, which the crate
//! `image` then encodes.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::Path,
    process::Command,
};

use gs_core::Image;
use gs_lab::Error;
use image::{ExtendedColorType, codecs::jpeg::JpegEncoder};
use rayon::prelude::*;
use tempfile::TempDir;

/// An image format and what makes and reads its files.
#[derive(Debug)]
pub(crate) struct Codec {
    /// Name of the format.
    pub(crate) name: &'static str,
    /// Ending of its files.
    ending: &'static str,
    /// Levels of quality that make a curve, from the smallest file.
    pub(crate) levels: &'static [u32],
    /// The value of the encoder's quality flag at a level.
    flag: fn(u32) -> String,
    /// The command that encodes `IN` as `FILE` in the quality `Q`; its input is a PPM or a PNG.
    encode: &'static [&'static str],
    input: &'static str,
    /// The command that decodes `FILE` as `OUT`, whose ending follows.
    decode: &'static [&'static str],
    output: &'static str,
}

/// The formats, the oldest first.
pub(crate) const CODECS: [Codec; 4] = [
    Codec {
        name: "JPEG",
        ending: "jpg",
        levels: &[4, 8, 15, 25, 40, 60, 80, 90, 95],
        flag: |level| level.to_string(),
        encode: &["cjpeg", "-quality", "Q", "-optimize", "-outfile", "FILE", "IN"],
        input: "ppm",
        decode: &["djpeg", "-outfile", "OUT", "FILE"],
        output: "ppm",
    },
    Codec {
        name: "WebP",
        ending: "webp",
        levels: &[0, 2, 6, 12, 25, 45, 65, 80, 90, 96],
        flag: |level| level.to_string(),
        encode: &["cwebp", "-quiet", "-m", "6", "-q", "Q", "IN", "-o", "FILE"],
        input: "png",
        decode: &["dwebp", "-quiet", "FILE", "-ppm", "-o", "OUT"],
        output: "ppm",
    },
    Codec {
        name: "AVIF",
        ending: "avif",
        levels: &[3, 7, 13, 19, 25, 31, 37, 43, 49, 54],
        flag: |level| (63 - level).to_string(),
        encode: &["avifenc", "-s", "5", "-j", "1", "--min", "Q", "--max", "Q", "IN", "FILE"],
        input: "png",
        decode: &["avifdec", "-j", "1", "FILE", "OUT"],
        output: "png",
    },
    Codec {
        name: "JPEG XL",
        ending: "jxl",
        levels: &[0, 50, 80, 100, 115, 125, 132, 138, 142, 145, 147],
        // The distance, 15 to 0.1: thresholds of visibility.
        flag: |level| format!("{:.1}", f64::from(150 - level) / 10.0),
        encode: &["cjxl", "-e", "7", "--num_threads=0", "-d", "Q", "IN", "FILE"],
        input: "png",
        decode: &["djxl", "--num_threads=0", "FILE", "OUT"],
        output: "ppm",
    },
];

/// A file of an image, decoded.
#[derive(Debug, Clone)]
pub(crate) struct Coded {
    /// Size of the file on disk.
    pub(crate) bytes: u64,
    /// The decoded picture.
    pub(crate) picture: Image,
}

/// An image that the formats' programs can read, in a folder of its own that goes with it.
#[derive(Debug)]
pub(crate) struct Original<'a> {
    image: &'a Image,
    folder: TempDir,
}

impl<'a> Original<'a> {
    /// Writes the image, rounded to 8 bits, into a temporary folder.
    ///
    /// # Errors
    /// [`Error::Path`] where that fails.
    pub(crate) fn new(image: &'a Image) -> Result<Self, Error> {
        let failed = |source| Error::Path { path: std::env::temp_dir(), source };
        let folder = tempfile::tempdir().map_err(failed)?;
        gs_io::write_png(folder.path().join("in.png"), image)?;
        write_ppm(&folder.path().join("in.ppm"), image).map_err(failed)?;
        Ok(Self { image, folder })
    }
}

impl Codec {
    /// Whether there is something that makes files of this format.
    pub(crate) fn is_there(&self) -> bool {
        self.has_program() || self.name == "JPEG"
    }

    fn has_program(&self) -> bool {
        [self.encode[0], self.decode[0]].iter().all(|name| Command::new(name).arg("--version").output().is_ok())
    }

    /// What makes the files, for readers: `cwebp -m 6`.
    pub(crate) fn maker(&self) -> String {
        if !self.has_program() {
            return "the crate image".to_owned();
        }
        let is_placeholder = |word: &&&str| ["IN", "FILE", "-o", "-outfile", "-quiet"].contains(*word);
        let words = self.encode.iter().filter(|word| !is_placeholder(word)).map(|word| match *word {
            "Q" => "…",
            word => word,
        });
        words.collect::<Vec<_>>().join(" ")
    }

    /// The files of these levels.
    ///
    /// # Errors
    /// [`Error::Picture`] with what the program says, [`Error::Io`] for a picture that cannot be read.
    pub(crate) fn files(&self, of: &Original<'_>, levels: &[u32]) -> Result<Vec<Coded>, Error> {
        levels.par_iter().map(|&level| self.file(of, level)).collect()
    }

    fn file(&self, of: &Original<'_>, level: u32) -> Result<Coded, Error> {
        let folder = of.folder.path();
        let file = folder.join(format!("{level}.{}", self.ending));
        let decoded = folder.join(format!("{level}-{}.{}", self.ending, self.output));
        let picture = if self.has_program() {
            self.call(self.encode, of, &file, &decoded, level)?;
            self.call(self.decode, of, &file, &decoded, level)?;
            gs_io::read_image(&decoded)?.image
        } else {
            write_jpeg(&file, of.image, level).map_err(|source| self.failed(source.to_string()))?;
            gs_io::read_image(&file)?.image
        };
        let bytes = fs::metadata(&file).map_err(|source| Error::Path { path: file, source })?.len();
        Ok(Coded { bytes, picture })
    }

    fn call(&self, command: &[&str], of: &Original<'_>, file: &Path, decoded: &Path, level: u32) -> Result<(), Error> {
        let input = of.folder.path().join(format!("in.{}", self.input));
        let mut program = Command::new(command[0]);
        for &word in &command[1..] {
            match word {
                "IN" => program.arg(&input),
                "FILE" => program.arg(file),
                "OUT" => program.arg(decoded),
                "Q" => program.arg((self.flag)(level)),
                word => program.arg(word),
            };
        }
        let run = program.output().map_err(|error| self.failed(format!("{}: {error}", command[0])))?;
        match run.status.success() {
            true => Ok(()),
            false => Err(self.failed(format!("{}: {}", command[0], String::from_utf8_lossy(&run.stderr).trim()))),
        }
    }

    fn failed(&self, message: String) -> Error {
        Error::Picture { name: format!("the {} file", self.name), message }
    }
}

fn write_ppm(path: &Path, image: &Image) -> io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    writeln!(file, "P6 {} {} 255", image.width(), image.height())?;
    file.write_all(&image.to_8_bits())?;
    file.flush()
}

fn write_jpeg(path: &Path, image: &Image, level: u32) -> Result<(), image::ImageError> {
    let mut file = BufWriter::new(File::create(path)?);
    let encoder = JpegEncoder::new_with_quality(&mut file, level.clamp(1, 100) as u8);
    image::ImageEncoder::write_image(
        encoder,
        &image.to_8_bits(),
        image.width(),
        image.height(),
        ExtendedColorType::Rgb8,
    )?;
    Ok(file.flush()?)
}
