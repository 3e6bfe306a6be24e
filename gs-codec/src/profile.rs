//! ICC profiles, compressed by zlib as in a PNG: a profile of half a kilobyte takes 330 bytes.

use std::io::{Read, Write};

use flate2::{Compression, read::ZlibDecoder, write::ZlibEncoder};

use crate::error::Error;

/// The longest profile, bytes, as it is and compressed.
const MOST_BYTES: usize = u16::MAX as usize;

/// Length of a profile in a file, bytes; 0 where there is none.
pub fn profile_bytes(profile: &[u8]) -> usize {
    if profile.is_empty() { 0 } else { 2 + compressed(profile).len() }
}

/// The block of a profile: the length of what follows, and the compressed profile.
pub(crate) fn pack(profile: &[u8]) -> Result<Vec<u8>, Error> {
    check_length(profile.len())?;
    let content = compressed(profile);
    check_length(content.len())?;
    Ok([&(content.len() as u16).to_le_bytes(), &content[..]].concat())
}

/// The profile of compressed bytes. No more than a profile may have is read.
pub(crate) fn unpack(content: &[u8]) -> Result<Vec<u8>, Error> {
    let mut profile = Vec::new();
    let mut stream = ZlibDecoder::new(content).take(MOST_BYTES as u64 + 1);
    stream.read_to_end(&mut profile).map_err(|_| Error::Profile)?;
    check_length(profile.len())?;
    Ok(profile)
}

fn compressed(profile: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(profile).and_then(|()| encoder.finish()).expect("memory can be written to")
}

fn check_length(length: usize) -> Result<(), Error> {
    let range = 1..=MOST_BYTES as i64;
    Error::within("the length of the colour profile", length as i64, range, "1 to 65,535 bytes")
}
