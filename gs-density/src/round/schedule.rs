//! The number of Gaussians that a run should have after a round.

/// The scheduled number of Gaussians after the round at `progress`, given the `count` after the
/// round before, which was at progress `previous`.
///
/// From N₀ Gaussians and with a budget of N, the schedule is N₀ + (N − N₀)(2p − p²), steep at first
/// and flat at the end. Each round continues the schedule from the current count, so that later
/// rounds replace Gaussians that were pruned. At progress 1 the result is the budget for any
/// `count`. *Source:* the schedule of Taming 3DGS (Mallick et al. 2024).
pub(crate) fn scheduled_count(count: usize, budget: usize, previous: f32, progress: f32) -> usize {
    let left = |progress: f32| f64::from(1.0 - progress.clamp(0.0, 1.0)).powi(2);
    let rest = if left(previous) > 0.0 { left(progress) / left(previous) } else { 0.0 };
    let (count, budget) = (count as f64, budget as f64);
    (budget - (budget - count) * rest.min(1.0)).round() as usize
}
