//! The order of training views: each once per epoch, shuffled.

use gs_density::Rng;
use rand::{SeedableRng, seq::SliceRandom};

/// Stream of random numbers for the order, independent of all others.
const ORDER_STREAM: u64 = 0x0076_6965_7773;

/// The shuffled order of one epoch; a function of (seed, epoch), so that checkpoints need not store
/// it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Order {
    epoch: Option<u32>,
    views: Vec<u32>,
}

impl Order {
    /// Index of the view, of `count` views, for the step after `step` steps.
    pub(crate) fn view(&mut self, seed: u32, step: u32, count: usize) -> usize {
        let count = u32::try_from(count).unwrap_or(u32::MAX).max(1);
        let epoch = step / count;
        if self.epoch != Some(epoch) {
            self.views.clear();
            self.views.extend(0..count);
            let state = (u64::from(seed) << 32 | u64::from(epoch)) ^ ORDER_STREAM.rotate_left(16);
            self.views.shuffle(&mut Rng::seed_from_u64(state));
            self.epoch = Some(epoch);
        }
        self.views[(step % count) as usize] as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_epoch_has_every_view_once_and_is_repeatable() {
        let all = |seed| {
            let mut order = Order::default();
            (0..50).map(|step| order.view(seed, step, 10)).collect::<Vec<_>>()
        };
        let first = all(1);
        for epoch in first.chunks(10) {
            let mut sorted = epoch.to_vec();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..10).collect::<Vec<_>>());
        }
        assert_ne!(first[..10], first[10..20]);
        assert_ne!(first, all(2));
        // An order that begins in the middle draws what one that has run from the start draws.
        let mut resumed = Order::default();
        assert_eq!((23..50).map(|step| resumed.view(1, step, 10)).collect::<Vec<_>>(), first[23..]);
        assert_eq!(resumed.view(1, 7, 1), 0);
    }
}
