//! Binary PLY files of ten Gaussians, to be broken.

use std::{fs, path::Path};

/// Rows that a file has.
const VERTICES: usize = 10;

/// Overwrites numbers in the row of a vertex; `from_end` counts numbers from the row's end.
pub(crate) fn break_ply(path: &Path, vertex: usize, from_end: usize, values: &[f32]) {
    const HEADER_END: &[u8] = b"end_header\n";
    let mut bytes = fs::read(path).unwrap();
    let rows = bytes.windows(HEADER_END.len()).position(|w| w == HEADER_END).unwrap() + HEADER_END.len();
    let row = (bytes.len() - rows) / VERTICES;
    let at = rows + (vertex + 1) * row - 4 * from_end;
    let new: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes[at..at + new.len()].copy_from_slice(&new);
    fs::write(path, bytes).unwrap();
}
