//! The losses of a run as they arrive. Backends may report them some steps late, but in order and
//! each once.

/// The losses of a run up to the last that has arrived.
#[derive(Debug)]
pub(crate) struct Losses {
    /// Number of steps whose losses have arrived, all of them finite; steps before a resumed run
    /// included.
    arrived: u32,
    /// The last loss, where it is one of this run.
    last: Option<f32>,
    /// Losses that have not been reported, the last of them that of step `arrived`.
    pending: Vec<f32>,
    /// The first step, counted from 1, whose loss was not finite, and that loss.
    diverged: Option<(u32, f32)>,
}

impl Losses {
    /// The losses of a run that starts after `step` steps.
    pub(crate) fn after(step: u32) -> Self {
        Self { arrived: step, last: None, pending: Vec::new(), diverged: None }
    }

    /// Number of steps whose losses have arrived.
    pub(crate) fn arrived(&self) -> u32 {
        self.arrived
    }

    /// The loss of step [`Self::arrived`]; `None` before the first loss of this run.
    pub(crate) fn last(&self) -> Option<f32> {
        self.last
    }

    /// The first step whose loss was not finite, and that loss. Later losses are dropped.
    pub(crate) fn diverged(&self) -> Option<(u32, f32)> {
        self.diverged
    }

    /// The list to which new losses are appended before [`Self::record`].
    pub(crate) fn list(&mut self) -> &mut Vec<f32> {
        &mut self.pending
    }

    /// Records the losses that were appended to the list since it had the length `known`; calls
    /// `each` with the step and loss of each that is finite.
    pub(crate) fn record(&mut self, known: usize, mut each: impl FnMut(u32, f32)) {
        let broken = |loss: &f32| !loss.is_finite();
        if let Some(finite) = self.pending[known..].iter().position(broken) {
            let step = self.arrived + finite as u32 + 1;
            self.diverged.get_or_insert((step, self.pending[known + finite]));
            self.pending.truncate(known + finite);
        }
        for &loss in &self.pending[known..] {
            self.arrived += 1;
            each(self.arrived, loss);
        }
        self.last = self.pending.last().copied().or(self.last);
    }

    /// The step of the first pending loss, and all pending losses.
    pub(crate) fn pending(&self) -> (u32, &[f32]) {
        (self.arrived + 1 - self.pending.len() as u32, &self.pending)
    }

    /// Forgets pending losses once they are reported.
    pub(crate) fn clear_pending(&mut self) {
        self.pending.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrive(losses: &mut Losses, new: &[f32]) {
        let known = losses.list().len();
        losses.list().extend(new);
        losses.record(known, |_, _| {});
    }

    #[test]
    fn every_loss_is_reported_with_its_step() {
        let mut losses = Losses::after(7);
        assert_eq!((losses.last(), losses.pending()), (None, (8, &[][..])));
        arrive(&mut losses, &[0.5, 0.4]);
        arrive(&mut losses, &[]);
        arrive(&mut losses, &[0.3]);
        assert_eq!((losses.arrived(), losses.last(), losses.pending()), (10, Some(0.3), (8, &[0.5, 0.4, 0.3][..])));
        losses.clear_pending();
        assert_eq!((losses.last(), losses.pending()), (Some(0.3), (11, &[][..])));
        arrive(&mut losses, &[0.2]);
        assert_eq!(losses.pending(), (11, &[0.2][..]));
    }

    #[test]
    fn the_first_that_is_not_finite_counts() {
        let mut losses = Losses::after(0);
        arrive(&mut losses, &[0.5]);
        assert_eq!(losses.diverged(), None);
        arrive(&mut losses, &[0.4, f32::INFINITY, f32::NAN]);
        assert_eq!(losses.diverged(), Some((3, f32::INFINITY)));
        assert_eq!((losses.arrived(), losses.pending()), (2, (1, &[0.5, 0.4][..])));
    }
}
