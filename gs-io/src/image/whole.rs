//! Checks whether a file contains a whole image and only one, without decoding it.

use std::io::{Read, Result, Seek, SeekFrom};

use image::ImageFormat;

use super::ImageRemark;

/// Bytes at the end of a file in which the end marker is searched, because programs append data of
/// their own.
const END_BYTES: u64 = 64 << 10;

/// JPEG's markers of the start of a scan and of the end of the image. Scans have a 0 after each
/// 0xff, so they never contain these.
const SCAN_START: [u8; 2] = [0xff, 0xda];
const IMAGE_END: [u8; 2] = [0xff, 0xd9];

/// Whether a file seems to contain its image to the end. `false` is no proof that it does not;
/// `true` means that it was not cut off.
pub(super) fn seems_whole(format: ImageFormat, reader: &mut (impl Read + Seek)) -> Result<bool> {
    let length = reader.seek(SeekFrom::End(0))?;
    let end = bytes(reader, length.saturating_sub(END_BYTES), END_BYTES)?;
    let start = bytes(reader, 0, 16)?;
    reader.rewind()?;
    let claimed = |at: usize| start.get(at..at + 4).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    Ok(match format {
        ImageFormat::Jpeg => {
            let (scan, image) = (last(&end, &SCAN_START), last(&end, &IMAGE_END));
            image.is_some() && image > scan
        }
        ImageFormat::Png => last(&end, b"IEND").is_some(),
        ImageFormat::Gif => end.contains(&b';'),
        ImageFormat::WebP => claimed(4).is_some_and(|size| size + 8 <= length + 1),
        ImageFormat::Bmp => claimed(2).is_some_and(|size| size <= length),
        _ => true,
    })
}

/// The length of a JPEG that ends before its end marker. Decoders silently fill the missing part
/// with grey.
pub(super) fn jpeg_is_cut_at(reader: &mut (impl Read + Seek)) -> Result<Option<usize>> {
    if seems_whole(ImageFormat::Jpeg, reader)? {
        return Ok(None);
    }
    let mut bytes = Vec::new();
    reader.read_to_end(&mut bytes)?;
    reader.rewind()?;
    let (scan, image) = (last(&bytes, &SCAN_START), last(&bytes, &IMAGE_END));
    Ok((scan.is_some() && image < scan).then_some(bytes.len()))
}

/// Number of channels in a JPEG's frame header; `None` without a frame header.
pub(super) fn jpeg_channels(reader: &mut (impl Read + Seek)) -> Result<Option<u8>> {
    let mut at = 2;
    let channels = loop {
        let segment = bytes(reader, at, 10)?;
        let [0xff, marker, high, low, ..] = segment[..] else { break None };
        match marker {
            // Fill bytes before a marker, and markers without content.
            0xff => at += 1,
            0x01 | 0xd0..=0xd8 => at += 2,
            0xc4 | 0xc8 | 0xcc => at += 2 + u64::from(u16::from_be_bytes([high, low])),
            0xc0..=0xcf => break segment.get(9).copied(),
            0xd9 | 0xda => break None,
            _ => at += 2 + u64::from(u16::from_be_bytes([high, low])),
        }
    };
    reader.rewind()?;
    Ok(channels)
}

/// The remark on a file with more than one image. For PNG, the header has this information.
pub(super) fn more_than_one(format: ImageFormat, reader: &mut (impl Read + Seek)) -> Result<Option<ImageRemark>> {
    let several = match format {
        // The flags of the extended header.
        ImageFormat::WebP => {
            let start = bytes(reader, 12, 9)?;
            (start.starts_with(b"VP8X") && start.get(8).is_some_and(|flags| flags & 2 != 0))
                .then_some(ImageRemark::FirstFrame)
        }
        ImageFormat::Gif => {
            let mut bytes = Vec::new();
            reader.read_to_end(&mut bytes)?;
            has_second_frame(&bytes).unwrap_or(false).then_some(ImageRemark::FirstFrame)
        }
        // The decoder reports invalid offsets.
        ImageFormat::Tiff => has_second_page(reader).unwrap_or(false).then_some(ImageRemark::FirstPage),
        _ => None,
    };
    reader.rewind()?;
    Ok(several)
}

/// Whether a GIF has two images; `None` where it ends too early. *Source:* the GIF89a
/// specification.
fn has_second_frame(bytes: &[u8]) -> Option<bool> {
    let table = |flags: u8| if flags & 0x80 != 0 { 3 << ((flags & 7) + 1) } else { 0 };
    // The position after the data blocks that begin here; an empty block ends them.
    let after_blocks = |mut at: usize| loop {
        let length = usize::from(*bytes.get(at)?);
        at += 1 + length;
        if length == 0 {
            return Some(at);
        }
    };
    let (mut at, mut frames) = (13 + table(*bytes.get(10)?), 0);
    while frames < 2 {
        at = match bytes.get(at)? {
            // An extension with its label.
            0x21 => after_blocks(at + 2)?,
            // A frame: position and size, colour table, and first code size.
            0x2c => {
                frames += 1;
                after_blocks(at + 11 + table(*bytes.get(at + 9)?))?
            }
            _ => return Some(false),
        };
    }
    Some(true)
}

/// Whether a TIFF's first directory refers to a second one. BigTIFF uses 8-byte numbers instead of
/// 4 and 2 bytes.
fn has_second_page(reader: &mut (impl Read + Seek)) -> Result<bool> {
    let head = bytes(reader, 0, 16)?;
    let little = head.starts_with(b"II");
    let number = |bytes: &[u8]| {
        let join = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        if little { bytes.iter().rev().fold(0, join) } else { bytes.iter().fold(0, join) }
    };
    let big = head.get(2..4).is_some_and(|version| number(version) == 43);
    let (offset_at, offset, count, entry) = if big { (8, 8, 8, 20) } else { (4, 4, 2, 12) };
    let Some(directory) = head.get(offset_at..offset_at + offset).map(number) else { return Ok(false) };
    let entries = number(&bytes(reader, directory, count)?);
    let next = directory.saturating_add(count).saturating_add(entries.saturating_mul(entry));
    Ok(number(&bytes(reader, next, offset as u64)?) != 0)
}

fn bytes(reader: &mut (impl Read + Seek), at: u64, count: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    reader.seek(SeekFrom::Start(at))?;
    reader.take(count).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn last(bytes: &[u8], pattern: &[u8]) -> Option<usize> {
    bytes.windows(pattern.len()).rposition(|window| window == pattern)
}
