//! Changes between the steps of a run: rounds of density control, noise, and the removal of broken
//! Gaussians.

use gs_core::{
    Binning, DensityStatistics, EditPlan, MeanNoise, Optimizer,
    edit::{AfterEdit, EditCounts, PruneCause, Removal},
    effects::Statistics,
};
use gs_density::{CountSchedule, DensityGaussian, Observation};

use crate::run::trainer::{Trainer, policy, random};
use crate::{
    error::Error,
    run::{
        checkpoint::Record,
        task::{At, LoopSettings, RunSettings, Trainable, TrainingTask},
    },
};

impl<R: Optimizer<S>, S: Trainable> Trainer<'_, R, S> {
    /// Runs a round of density control; `progress` as in [`Observation`].
    pub(super) async fn control_density(&mut self, progress: f32) -> Result<EditCounts, Error> {
        let Record { settings, step, .. } = &self.record;
        let LoopSettings { iterations, seed, budget, exactly, policy: named, .. } = settings.of_loop();
        let policy = policy(&self.custom, settings);
        let fixed = settings.fixed();
        let mut scene = self.rasterizer.download(&self.splats).await?;
        let needs = policy.needs();
        let mut statistics = match needs.statistics {
            Statistics::None => DensityStatistics::zeros(scene.len()),
            _ => self.rasterizer.statistics(&self.splats).await?,
        };
        let extent = self.task.extent();
        let effects = self.effects();
        let rounds = self.rounds();
        let progress_before = rounds.progress(step.saturating_sub(rounds.every), iterations).unwrap_or_default();
        let mut evidence = match policy.evidence(step - 1, progress) {
            Some(request) => {
                let at = At { on: self.rasterizer, splats: &self.splats, settings, effects };
                self.task.evidence(at, &scene, *step, request).await?
            }
            None => None,
        };
        let residual = match needs.residual {
            true => self.task.residual(At { on: self.rasterizer, splats: &self.splats, settings, effects }).await?,
            false => None,
        };
        if fixed > 0 {
            let first = fixed as usize;
            let is_moving: Vec<bool> = (0..scene.len()).map(|index| index >= first).collect();
            scene.retain(&is_moving);
            drop((statistics.signal_sum.drain(..first), statistics.visible.drain(..first)));
            evidence.iter_mut().for_each(|evidence| evidence.remove_first(first));
        }
        let observation = Observation {
            scene: &scene,
            statistics: &statistics,
            residual,
            evidence: evidence.as_ref(),
            extent,
            step: step - 1,
            progress,
            progress_before,
            budget: (budget - fixed) as usize,
        };
        let rng = &mut random(seed, *step);
        let plan = match exactly {
            true => CountSchedule::from(named).plan(policy, &observation, rng)?,
            false => policy.plan(&observation, rng)?,
        };
        let plan = plan.behind(fixed);
        let counts = plan.counts();
        // The edit needs memory of about the scene's size.
        drop(scene);
        self.rasterizer.edit(&mut self.splats, &plan).await?;
        // A higher ceiling, such as FastGS's 0.8, leaves the image much as it was.
        if plan.opacity_ceiling.is_some_and(|ceiling| ceiling < 0.5) {
            self.watch.record_reset(self.record.step);
        }
        self.record.edits.accumulate(&counts);
        self.forget_average();
        self.binning = Binning::Fresh;
        self.task.after_edit(self.rasterizer, &mut self.splats, &self.record.settings, &effects).await?;
        Ok(counts)
    }

    /// Adds the policy's noise after this step, except the last, after which nothing could adapt.
    pub(super) fn add_noise(&mut self) -> Result<(), Error> {
        let Record { settings, step, .. } = &self.record;
        let Some(noise) = self.policy().needs().noise.filter(|noise| noise.is_due(*step) && !self.is_finished()) else {
            return Ok(());
        };
        let rate = self.lr_scale() * settings.mean_factor(*step);
        let noise = noise.of_step::<S>(self.task.extent(), rate, settings.of_loop().seed, *step);
        let noise = MeanNoise { fixed: settings.fixed(), ..noise };
        Ok(self.rasterizer.add_noise(&mut self.splats, &noise)?)
    }

    /// Removes, after the last step, Gaussians that are not finite, which draw nothing and which
    /// files refuse, and those that the task does not want.
    pub(super) async fn clean_up(&mut self, edits: &mut Option<EditCounts>) -> Result<(), Error> {
        let scene = self.rasterizer.download(&self.splats).await?;
        let unwanted = self.task.unwanted(&scene, &self.record.settings, &self.effects());
        let cause = |index: u32| match scene.gaussian(index as usize).is_finite() {
            false => Some(PruneCause::NotFinite),
            true => unwanted.binary_search(&index).is_ok().then_some(PruneCause::Unimportant),
        };
        let removed: Vec<Removal> =
            (0..scene.len() as u32).filter_map(|index| Some(Removal { index, cause: cause(index)? })).collect();
        if !removed.is_empty() {
            let plan = EditPlan { removed, statistics: AfterEdit::Keep, ..EditPlan::default() };
            self.rasterizer.edit(&mut self.splats, &plan).await?;
            let counts = plan.counts();
            self.record.edits.accumulate(&counts);
            edits.get_or_insert_default().accumulate(&counts);
        }
        Ok(())
    }
}
