//! Recognises files by their first bytes: readable images, and other files with advice on
//! converting them.

use std::{
    io::{Read, Seek},
    path::Path,
};

use image::ImageFormat;

use crate::error::Error;

/// The kinds of images that can be read, as messages list them.
const READABLE: &str = "PNG, JPEG, BMP, TIFF, WebP, GIF and PNM";

/// Bytes at the start of a file that identify its kind.
const START_BYTES: u64 = 1024;

/// Signatures of unreadable kinds that people have as photographs: position, bytes, name, usual extension.
const SIGNATURES: [(usize, &[u8], &str, &str); 14] = [
    (0, b"\xff\x0a", "a JPEG XL image", "jxl"),
    (4, b"JXL \r\n\x87\n", "a JPEG XL image", "jxl"),
    (4, b"jP  \r\n\x87\n", "a JPEG 2000 image", "jp2"),
    (4, b"ftypavi", "an AVIF image", "avif"),
    (4, b"ftyphe", "a HEIC image", "heic"),
    (4, b"ftypmif1", "a HEIC or AVIF image", "heic"),
    (4, b"ftypmsf1", "a HEIC or AVIF image", "heic"),
    (4, b"ftypcrx ", "a camera's raw image", "cr3"),
    (0, b"FUJIFILMCCD-RAW", "a camera's raw image", "raf"),
    (0, b"IIRO", "a camera's raw image", "orf"),
    (0, b"IIU\0", "a camera's raw image", "rw2"),
    (0, b"8BPS", "a Photoshop document", "psd"),
    (0, b"%PDF", "a PDF document", "pdf"),
    (0, b"\x76\x2f\x31\x01", "an OpenEXR image", "exr"),
];

/// Extensions of raw images that are TIFF files, whose first picture is a thumbnail.
const RAW_TIFF: [&str; 7] = ["dng", "nef", "arw", "cr2", "pef", "srw", "nrw"];

/// The format of the content.
pub(super) fn format_of(path: &Path, reader: &mut (impl Read + Seek)) -> Result<ImageFormat, Error> {
    let start = start_of(reader).map_err(|error| Error::read(path, error))?;
    let ending = path.extension().map_or_else(String::new, |ending| ending.to_string_lossy().to_lowercase());
    match image::guess_format(&start) {
        Ok(ImageFormat::Tiff) if RAW_TIFF.contains(&ending.as_str()) => {
            Err(not_readable(path, "a camera's raw image", &ending))
        }
        Ok(format) if format.reading_enabled() => Ok(format),
        _ => Err(no_image(path, &start)),
    }
}

/// The error for an image of a known kind that cannot be read.
fn not_readable(path: &Path, what: &str, extension: &str) -> Error {
    let found = format!("is {what}, but {READABLE} are the images that can be read");
    Error::NotAnImage { path: path.to_owned(), found, hint: convert(extension) }
}

/// The error for an unsupported variant of a readable format.
pub(super) fn not_supported(path: &Path, format: &str, message: &str) -> Error {
    let found = format!("is a {format} image of a kind that cannot be read ({message})");
    Error::NotAnImage { path: path.to_owned(), found, hint: convert(&format.to_lowercase()) }
}

/// The error for an image in CMYK.
pub(super) fn cmyk(path: &Path, extension: &str) -> Error {
    let found = "is an image in CMYK, a printer's colours, which only its profile could turn into RGB".to_owned();
    let hint = format!("{} -profile sRGB.icc photo.png", convert(extension).trim_end_matches(" photo.png"));
    Error::NotAnImage { path: path.to_owned(), found, hint }
}

fn convert(extension: &str) -> String {
    format!("convert it to PNG, for example with ImageMagick: magick photo.{extension} photo.png")
}

fn start_of(reader: &mut (impl Read + Seek)) -> std::io::Result<Vec<u8>> {
    let mut start = Vec::new();
    reader.take(START_BYTES).read_to_end(&mut start)?;
    reader.rewind()?;
    Ok(start)
}

fn no_image(path: &Path, start: &[u8]) -> Error {
    let error = |found: String, hint: &str| Error::NotAnImage { path: path.to_owned(), found, hint: hint.to_owned() };
    if start.is_empty() {
        return error("is empty".to_owned(), "fetch or export it again");
    }
    let known = SIGNATURES.iter().find(|(at, bytes, ..)| start.get(*at..).is_some_and(|rest| rest.starts_with(bytes)));
    if let Some((_, _, what, extension)) = known {
        return not_readable(path, what, extension);
    }
    if start.get(4..8) == Some(b"ftyp") {
        return error(
            "is a video, not an image".to_owned(),
            "take a frame of it: ffmpeg -i video.mp4 -frames:v 1 frame.png",
        );
    }
    if let Some(text) = text_of(start) {
        let text = text.to_lowercase();
        return match () {
            () if text.contains("<svg") => not_readable(path, "an SVG drawing", "svg"),
            () if text.contains("<html") || text.contains("<!doctype html") => {
                error("is a web page, not an image".to_owned(), "fetch the image itself")
            }
            () => error("is text, not an image".to_owned(), "name an image file"),
        };
    }
    let bytes: Vec<String> = start.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    let found = format!("is no image of a known kind (it begins with the bytes {})", bytes.join(" "));
    error(found, &format!("name an image; {READABLE} can be read"))
}

/// The first bytes as text, if they are; the last character may be cut off.
fn text_of(start: &[u8]) -> Option<&str> {
    let text = match std::str::from_utf8(start) {
        Ok(text) => text,
        Err(error) if error.error_len().is_none() => std::str::from_utf8(&start[..error.valid_up_to()]).ok()?,
        Err(_) => return None,
    };
    text.chars().all(|c| !c.is_control() || c.is_whitespace()).then_some(text)
}
