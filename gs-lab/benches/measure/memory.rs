//! Memory of this process in bytes, on Linux only.

/// Resets the peak to the present memory, and returns that.
pub(crate) fn forget_peak() -> Option<u64> {
    std::fs::write("/proc/self/clear_refs", "5").ok()?;
    status_bytes("VmRSS:")
}

/// Peak memory since the start or the last [`forget_peak`].
pub(crate) fn peak() -> Option<u64> {
    status_bytes("VmHWM:")
}

/// A field of `/proc/self/status`.
fn status_bytes(field: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(field))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}
