//! A table of Adam's bias corrections 1/(1 − β^t), which depend on each Gaussian's own step count.

/// Step counts are clamped to this. The correction there is at most 1 + 5e-5, for β = 0.99999.
///
/// It bounds the length of the table, which would otherwise depend on the contents of a checkpoint.
const MOST_STEPS: u32 = 1 << 20;

/// The corrections of both moments of G groups of parameters at one step count.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bias<const G: usize> {
    pub(crate) first: [f32; G],
    pub(crate) second: [f32; G],
}

/// Corrections by step count for one set of betas. The table ends where all of them are 1.
#[derive(Debug)]
pub struct BiasTable<const G: usize> {
    betas: Option<[[f32; 2]; G]>,
    by_steps: Vec<Bias<G>>,
}

impl<const G: usize> Default for BiasTable<G> {
    fn default() -> Self {
        Self { betas: None, by_steps: Vec::new() }
    }
}

impl<const G: usize> BiasTable<G> {
    /// Extends the table to one more than the largest of `steps`.
    ///
    /// `betas` has β₁ and β₂ of each group.
    pub(crate) fn prepare(&mut self, betas: [[f32; 2]; G], steps: &[u32]) {
        let most = steps.iter().max().map_or(0, |&t| t.saturating_add(1));
        if self.betas != Some(betas) {
            self.betas = Some(betas);
            self.by_steps.clear();
        }
        let done = |bias: &Bias<G>| bias.first.iter().chain(&bias.second).all(|&c| c == 1.0);
        for t in self.by_steps.len() as u32..=most.min(MOST_STEPS) {
            if self.by_steps.last().is_some_and(done) {
                break;
            }
            let correction = |beta: f32| (1.0 / (1.0 - f64::from(beta).powi(t.max(1) as i32))) as f32;
            self.by_steps.push(Bias {
                first: betas.map(|[beta, _]| correction(beta)),
                second: betas.map(|[_, beta]| correction(beta)),
            });
        }
    }

    /// The corrections at a step count, after [`Self::prepare`].
    #[inline(always)]
    pub(crate) fn at(&self, steps: u32) -> &Bias<G> {
        &self.by_steps[(steps as usize).min(self.by_steps.len() - 1)]
    }
}
