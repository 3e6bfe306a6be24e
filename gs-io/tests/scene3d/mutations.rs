//! Damaged and truncated files of every kind: thousands of them, always the same.

use std::path::Path;

use gs_core::Scene;
use gs_io::{Error, Format3d, decode_3d};

use super::samples::corpus;

/// Mutants of each file.
const MUTANTS: u32 = 600;

/// Little-endian numbers that are often handled wrongly.
const NASTY: [u64; 8] = [0, 1, 0x7f, 0xff, 0xffff, 0x7fff_ffff, 0xffff_ffff, u64::MAX];

/// A simple random generator (Marsaglia's xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % limit.max(1) as u64) as usize
    }
}

fn mutate(good: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = good.to_vec();
    for _ in 0..=random.below(3) {
        let at = random.below(bytes.len());
        match random.below(7) {
            0 => bytes.truncate(at),
            1 => bytes[at] ^= 1 << random.below(8),
            2 => bytes[at] = random.below(256) as u8,
            3 => {
                let (nasty, len) = (NASTY[random.below(NASTY.len())].to_le_bytes(), [1, 2, 4, 8][random.below(4)]);
                bytes.iter_mut().skip(at).zip(&nasty[..len]).for_each(|(byte, &new)| *byte = new);
            }
            4 => _ = bytes.remove(at),
            5 => {
                let part = bytes[at..bytes.len().min(at + 1 + random.below(40))].to_vec();
                let to = random.below(bytes.len());
                bytes.splice(to..to, part);
            }
            _ => {
                // In text headers, another digit.
                let digits: Vec<usize> = (0..bytes.len()).filter(|&k| bytes[k].is_ascii_digit()).collect();
                if let Some(&place) = digits.get(random.below(digits.len())) {
                    bytes[place] = b'0' + random.below(10) as u8;
                }
            }
        }
        if bytes.is_empty() {
            break;
        }
    }
    bytes
}

/// The result must be a scene or a line that says why not.
fn decode(format: Format3d, bytes: &[u8], name: &str) -> bool {
    match decode_3d(format, bytes, Path::new(name)) {
        Ok(file) => {
            // Arrays of different lengths would be a reader's mistake, not the file's.
            assert!(!matches!(file.scene.validate(), Err(gs_core::Error::Length { .. })));
            assert!(file.scene.len() < 1_000_000, "{name}: {} Gaussians of {} bytes", file.scene.len(), bytes.len());
            true
        }
        Err(error) => {
            let text = error.to_string();
            // An error about a missing glTF buffer names the buffer.
            assert!(text.contains(name) || matches!(error, Error::Missing { .. } | Error::NotAFile { .. }), "{text}");
            assert!(!text.contains('\n') && text.len() > name.len() + 20, "{text:?}");
            false
        }
    }
}

#[test]
fn mutants_of_all_kinds_are_read_or_refused() {
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    for (name, good) in corpus() {
        let format = Format3d::recognise(&good[..good.len().min(64)], Path::new(name)).unwrap();
        assert!(decode(format, &good, name), "{name}");
        let refused = (0..MUTANTS).filter(|_| !decode(format, &mutate(&good, &mut random), name)).count();
        assert!(refused > 50, "{name}: only {refused} of {MUTANTS} refused");
    }
}

#[test]
fn files_cut_short_anywhere_are_refused() {
    for (name, good) in corpus() {
        let format = Format3d::recognise(&good[..good.len().min(64)], Path::new(name)).unwrap();
        // What follows the last vertex of the text is ignored; the gzip's size field is not.
        let needed = if name == "text.ply" { good.len() - 10 } else { good.len() };
        for end in (0..needed).filter(|end| format != Format3d::Splat || end % 32 != 0) {
            assert!(!decode(format, &good[..end], name), "{name} cut to {end} of {} bytes", good.len());
        }
    }
}

#[test]
fn any_bytes_may_be_called_any_kind() {
    let kinds = [Format3d::Ply, Format3d::CompressedPly, Format3d::Splat, Format3d::Spz];
    let packed = [Format3d::Sog, Format3d::SogFolder, Format3d::StreamedSog, Format3d::Rad, Format3d::Ksplat];
    for format in kinds.into_iter().chain([Format3d::Gltf, Format3d::Glb]).chain(packed) {
        for (name, bytes) in corpus() {
            decode(format, &bytes, name);
        }
        decode(format, b"", "nothing at all");
    }
}
