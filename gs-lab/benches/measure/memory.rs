//! Memory that this process holds, in bytes, as Linux tells it; elsewhere nothing is told.

/// Lets the peak begin anew at what is held now, and returns that.
pub(crate) fn forget_peak() -> Option<u64> {
    std::fs::write("/proc/self/clear_refs", "5").ok()?;
    status_bytes("VmRSS:")
}

/// The most that was held since the start or the last [`forget_peak`].
pub(crate) fn peak() -> Option<u64> {
    status_bytes("VmHWM:")
}

/// A memory's size in `/proc/self/status`.
fn status_bytes(field: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(field))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}
