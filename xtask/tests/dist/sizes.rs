//! The sizes of the files.

use std::fs;

use super::bench::{Bench, Outcome, expect};
use xtask::system::{at, entries};

/// The endings of files, and the most bytes that one may have.
const LIMITS: [(&str, u64); 4] = [("gz", 25_000_000), ("zip", 25_000_000), ("deb", 25_000_000), ("whl", 10_000_000)];

pub(super) fn test(bench: &Bench<'_>) -> Result<Outcome, String> {
    let mut seen = Vec::new();
    for path in entries(bench.release)? {
        let size = fs::metadata(&path).map_err(at(&path))?.len();
        let limit = LIMITS.iter().find(|(ending, _)| path.extension().is_some_and(|found| found == *ending));
        if let Some((ending, limit)) = limit {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            expect((1..=*limit).contains(&size), || format!("{name} has {size} bytes, and not up to {limit}"))?;
            seen.push(format!("{ending} {:.2} MB", size as f64 / 1e6));
        }
    }
    seen.sort();
    Ok(Outcome::Passed(seen.join(", ")))
}
