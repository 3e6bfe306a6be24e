//! What a run knows of its losses. Backends may tell them some steps late, but in order and each once, so that the first that is not
//! finite is known with its step.

/// The losses of a run up to the last that has been seen.
#[derive(Debug)]
pub(crate) struct Losses {
    /// Steps of the fit whose losses have been seen, all of them finite.
    seen: u32,
    /// That of step `seen`, where it is a step of this run.
    last: Option<f32>,
    /// Those that nobody has been told, the last of them that of step `seen`.
    untold: Vec<f32>,
    /// The first step, counted from 1, whose loss was not finite, and that loss.
    diverged: Option<(u32, f32)>,
}

impl Losses {
    /// Of a run that begins after `step` steps of its fit.
    pub(crate) fn after(step: u32) -> Self {
        Self { seen: step, last: None, untold: Vec::new(), diverged: None }
    }

    /// Steps of the fit whose losses have been seen.
    pub(crate) fn seen(&self) -> u32 {
        self.seen
    }

    /// The loss of step [`Self::seen`]; nothing where this run has seen none.
    pub(crate) fn last(&self) -> Option<f32> {
        self.last
    }

    /// The first step whose loss was not finite, and that loss; what came after it is not looked at.
    pub(crate) fn diverged(&self) -> Option<(u32, f32)> {
        self.diverged
    }

    /// The end of this list is where new losses go, before [`Self::see`].
    pub(crate) fn list(&mut self) -> &mut Vec<f32> {
        &mut self.untold
    }

    /// Takes note of the losses that were added to the list since it had this length; `hear` is called with each that is finite and its
    /// step.
    pub(crate) fn see(&mut self, known: usize, mut hear: impl FnMut(u32, f32)) {
        let broken = |loss: &f32| !loss.is_finite();
        if let Some(finite) = self.untold[known..].iter().position(broken) {
            let step = self.seen + finite as u32 + 1;
            self.diverged.get_or_insert((step, self.untold[known + finite]));
            self.untold.truncate(known + finite);
        }
        for &loss in &self.untold[known..] {
            self.seen += 1;
            hear(self.seen, loss);
        }
        self.last = self.untold.last().copied().or(self.last);
    }

    /// The losses that nobody has been told, and the step of the first.
    pub(crate) fn untold(&self) -> (u32, &[f32]) {
        (self.seen + 1 - self.untold.len() as u32, &self.untold)
    }

    /// What is untold now needs not be told again.
    pub(crate) fn forget_untold(&mut self) {
        self.untold.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn see(losses: &mut Losses, new: &[f32]) {
        let known = losses.list().len();
        losses.list().extend(new);
        losses.see(known, |_, _| {});
    }

    #[test]
    fn every_loss_is_told_with_its_step() {
        let mut losses = Losses::after(7);
        assert_eq!((losses.last(), losses.untold()), (None, (8, &[][..])));
        see(&mut losses, &[0.5, 0.4]);
        see(&mut losses, &[]);
        see(&mut losses, &[0.3]);
        assert_eq!((losses.seen(), losses.last(), losses.untold()), (10, Some(0.3), (8, &[0.5, 0.4, 0.3][..])));
        losses.forget_untold();
        assert_eq!((losses.last(), losses.untold()), (Some(0.3), (11, &[][..])));
        see(&mut losses, &[0.2]);
        assert_eq!(losses.untold(), (11, &[0.2][..]));
    }

    #[test]
    fn the_first_that_is_not_finite_counts() {
        let mut losses = Losses::after(0);
        see(&mut losses, &[0.5]);
        assert_eq!(losses.diverged(), None);
        see(&mut losses, &[0.4, f32::INFINITY, f32::NAN]);
        assert_eq!(losses.diverged(), Some((3, f32::INFINITY)));
        assert_eq!((losses.seen(), losses.untold()), (2, (1, &[0.5, 0.4][..])));
    }
}
