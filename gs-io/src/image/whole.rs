//! Checks whether a file contains a whole image, without decoding it.

use std::io::{self, Read, Seek, SeekFrom};

use image::ImageFormat;

/// Bytes at the end of a file in which the end marker is searched, because programs append data of
/// their own.
const END_BYTES: u64 = 64 << 10;

/// JPEG's markers of the start of a scan and of the end of the image. Scans have a 0 after each
/// 0xff, so they never contain these.
const SCAN_START: [u8; 2] = [0xff, 0xda];
const IMAGE_END: [u8; 2] = [0xff, 0xd9];

/// Whether a file seems to contain its image to the end. `false` is no proof that it does not;
/// `true` means that it was not cut off.
pub(super) fn seems_whole(format: ImageFormat, reader: &mut (impl Read + Seek)) -> io::Result<bool> {
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
pub(super) fn jpeg_is_cut_at(reader: &mut (impl Read + Seek)) -> io::Result<Option<usize>> {
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
pub(super) fn jpeg_channels(reader: &mut (impl Read + Seek)) -> io::Result<Option<u8>> {
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

fn bytes(reader: &mut (impl Read + Seek), at: u64, count: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    reader.seek(SeekFrom::Start(at))?;
    reader.take(count).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn last(bytes: &[u8], pattern: &[u8]) -> Option<usize> {
    bytes.windows(pattern.len()).rposition(|window| window == pattern)
}
