//! Adam's bias corrections 1/(1 − β^t), which depend on each Gaussian's own step count: looked up, not computed.

/// Step counts beyond this are taken as this: even β = 0.99999 leaves a correction of 1 + 5e-5 there. It bounds the table below, whose
/// length a checkpoint could otherwise dictate.
const MOST_STEPS: u32 = 1 << 20;

/// The corrections of both moments of G groups of parameters at one step count.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bias<const G: usize> {
    pub(crate) first: [f32; G],
    pub(crate) second: [f32; G],
}

/// Corrections by step count, made once per set of betas; it ends where all of them have become 1.
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
    /// Makes sure of an entry for every count up to one more than the largest of `steps`; `betas` are those of the first and second moments.
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

    /// The corrections at a step count that [`Self::prepare`] has seen to.
    #[inline(always)]
    pub(crate) fn at(&self, steps: u32) -> &Bias<G> {
        &self.by_steps[(steps as usize).min(self.by_steps.len() - 1)]
    }
}
