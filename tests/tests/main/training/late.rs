//! A backend that reports its losses late makes no difference to a fit, to what is written about
//! it, or to how it fails.

use super::fixture_2d::{rasterizer, small_fit, small_target};
use gs_core::{
    AdamRates, Backend, Blend, Canvas, Culled, DensityStatistics, EditPlan, Error as CoreError, Gaussian2d, Image,
    Loss, MeanNoise, Optimizer, Parameterization, Rasterizer, RenderSettings, SavedState, Scene2d, SplatsState,
    TargetImage, TrainStep, Wait,
};
use gs_cpu::{CpuRasterizer, Splats2d};
use gs_train::{Control, Error, FitSettings, MetricsLog, Observer, Outcome, Progress, Rounds, Trainer};
use gs_wgpu::{WgpuRasterizer, WgpuSettings};
use pollster::FutureExt as _;

/// The CPU backend's splats, and the losses that are not reported yet.
struct Kept {
    sound: Splats2d,
    losses: Vec<f32>,
}

impl From<Splats2d> for Kept {
    fn from(sound: Splats2d) -> Self {
        Self { sound, losses: Vec::new() }
    }
}

/// The CPU backend, but the last losses are returned only to callers that wait for them.
struct Late {
    sound: CpuRasterizer,
    by: usize,
}

type Sound = CpuRasterizer;

impl Backend for Late {
    fn describe(&self) -> String {
        format!("{} steps late", self.by)
    }
}

impl Rasterizer<Scene2d> for Late {
    type Splats = Kept;
    type ForwardPass = <Sound as Rasterizer<Scene2d>>::ForwardPass;
    type Gradients = <Sound as Rasterizer<Scene2d>>::Gradients;
    type Target = <Sound as Rasterizer<Scene2d>>::Target;

    fn upload(&self, scene: &Scene2d, parameterization: Parameterization) -> Result<Self::Splats, CoreError> {
        self.sound.for_2d().upload(scene, parameterization).map(Kept::from)
    }

    async fn download(&self, splats: &Self::Splats) -> Result<Scene2d, CoreError> {
        self.sound.for_2d().download(&splats.sound).await
    }

    fn len(&self, splats: &Self::Splats) -> usize {
        self.sound.for_2d().len(&splats.sound)
    }

    fn upload_target<'a>(&self, target: impl Into<TargetImage<'a>>) -> Result<Self::Target, CoreError> {
        self.sound.for_2d().upload_target(target)
    }

    async fn forward(
        &self,
        splats: &Self::Splats,
        view: &Canvas,
        settings: &RenderSettings,
    ) -> Result<Self::ForwardPass, CoreError> {
        self.sound.for_2d().forward(&splats.sound, view, settings).await
    }

    async fn image(&self, frame: &Self::ForwardPass) -> Result<Image, CoreError> {
        self.sound.for_2d().image(frame).await
    }

    fn culled(&self, frame: &Self::ForwardPass) -> Culled {
        self.sound.for_2d().culled(frame)
    }

    async fn backward(
        &self,
        splats: &Self::Splats,
        frame: Self::ForwardPass,
        target: &Self::Target,
        loss: &Loss,
    ) -> Result<(f32, Self::Gradients), CoreError> {
        self.sound.for_2d().backward(&splats.sound, frame, target, loss).await
    }

    async fn image_vjp(
        &self,
        splats: &Self::Splats,
        frame: Self::ForwardPass,
        v_image: &Image,
    ) -> Result<Self::Gradients, CoreError> {
        self.sound.for_2d().image_vjp(&splats.sound, frame, v_image).await
    }

    async fn gradients(&self, splats: &Self::Splats, gradients: &Self::Gradients) -> Result<Scene2d, CoreError> {
        self.sound.for_2d().gradients(&splats.sound, gradients).await
    }
}

impl Optimizer<Scene2d> for Late {
    async fn save(&self, splats: &Self::Splats) -> Result<SplatsState, CoreError> {
        self.sound.for_2d().save(&splats.sound).await
    }

    fn restore(&self, state: &SplatsState) -> Result<Self::Splats, CoreError> {
        self.sound.for_2d().restore(state).map(Kept::from)
    }

    async fn step(
        &self,
        splats: &mut Self::Splats,
        gradients: &Self::Gradients,
        rates: &AdamRates,
    ) -> Result<(), CoreError> {
        self.sound.for_2d().step(&mut splats.sound, gradients, rates).await
    }

    async fn train_step(
        &self,
        splats: &mut Self::Splats,
        view: &Canvas,
        target: &Self::Target,
        step: &TrainStep<'_>,
    ) -> Result<(), CoreError> {
        self.sound.for_2d().train_step(&mut splats.sound, view, target, step).await
    }

    async fn losses(&self, splats: &mut Self::Splats, wait: Wait, losses: &mut Vec<f32>) -> Result<(), CoreError> {
        let unread = &mut splats.losses;
        self.sound.for_2d().losses(&mut splats.sound, Wait::All, unread).await?;
        let kept = match wait {
            Wait::Arrived => self.by.min(unread.len()),
            Wait::All => 0,
        };
        losses.extend(unread.drain(..unread.len() - kept));
        Ok(())
    }

    async fn solve_colors(
        &self,
        splats: &mut Self::Splats,
        view: &Canvas,
        target: &Self::Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), CoreError> {
        self.sound.for_2d().solve_colors(&mut splats.sound, view, target, settings, iterations).await
    }

    async fn statistics(&self, splats: &Self::Splats) -> Result<DensityStatistics, CoreError> {
        self.sound.for_2d().statistics(&splats.sound).await
    }

    fn add_noise(&self, splats: &mut Self::Splats, noise: &MeanNoise) -> Result<(), CoreError> {
        self.sound.for_2d().add_noise(&mut splats.sound, noise)
    }

    async fn edit(&self, splats: &mut Self::Splats, plan: &EditPlan<Gaussian2d>) -> Result<(), CoreError> {
        self.sound.for_2d().edit(&mut splats.sound, plan).await
    }
}

/// Sees all that can be seen, and checks that it makes sense.
#[derive(Debug, Default)]
struct Witness {
    /// Losses reported, from the first step on.
    losses: Vec<f32>,
    /// The loss of each step's progress, and how many steps late it was.
    shown: Vec<(f32, u32)>,
    /// Steps of the checkpoints, and the rows that they hold.
    checkpoints: Vec<String>,
    /// Measures the quality at the multiples of this.
    measured_every: u32,
    /// Stops at the first step at or after this at which that is possible.
    stop_at: Option<u32>,
}

impl Observer for Witness {
    fn wants_quality(&mut self, progress: &Progress) -> bool {
        progress.step.is_multiple_of(self.measured_every)
    }

    fn on_step(&mut self, progress: &Progress) -> Control {
        let late = progress.step - progress.loss_step;
        assert!(late == 0 || !(progress.quality.is_some() || progress.edits.is_some() || progress.is_last()));
        self.shown.push((progress.loss, late));
        assert_eq!(self.shown.len(), progress.step as usize);
        if self.stop_at == Some(progress.step) { Control::Stop } else { Control::Continue }
    }

    fn on_losses(&mut self, first_step: u32, losses: &[f32]) {
        assert_eq!(first_step as usize, self.losses.len() + 1, "in order and each once");
        self.losses.extend_from_slice(losses);
        assert!(self.losses.len() <= self.shown.len(), "after its step");
    }

    fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
        matches!(progress.step, 5 | 10 | 33)
    }

    fn on_checkpoint(&mut self, checkpoint: &mut gs_io::Checkpoint<SavedState<'_>>) -> Result<(), Error> {
        let step = &checkpoint.metadata["step"];
        assert_eq!(self.losses.len().to_string(), *step, "all losses are known when a checkpoint is made");
        let last_row =
            checkpoint.metadata["metrics"].lines().rev().find_map(|line| line.strip_prefix("step = ")).unwrap();
        self.checkpoints.push(format!("{step}: {last_row}"));
        Ok(())
    }
}

/// All that is known of a fit at its end, but for times.
#[derive(Debug, PartialEq)]
struct Known {
    state: SplatsState,
    rows: Vec<Vec<String>>,
    losses: Vec<f32>,
    checkpoints: Vec<String>,
}

fn fit<R: Optimizer<Scene2d>>(rasterizer: &R, settings: FitSettings, stop_at: Option<u32>) -> (Known, Witness) {
    let mut log = MetricsLog::new(7);
    let mut witness = Witness { measured_every: 12, stop_at, ..Witness::default() };
    let mut trainer = Trainer::new(rasterizer, &small_target(), settings).block_on().unwrap();
    let outcome = trainer.run(&mut (&mut log, &mut witness)).block_on().unwrap();
    assert_eq!(outcome, if stop_at.is_some() { Outcome::Stopped } else { Outcome::Finished });
    assert_eq!(trainer.loss(), witness.losses.last().copied());
    for row in log.rows() {
        assert_eq!(row.loss, witness.losses[row.step as usize - 1], "the row of step {}", row.step);
    }
    let cells = |row: &str| row.split(',').enumerate().filter(|&(k, _)| k != 1).map(|(_, c)| c.to_owned()).collect();
    let known = Known {
        state: trainer.checkpoint().block_on().unwrap().state,
        rows: log.to_csv().lines().map(cells).collect(),
        losses: witness.losses.clone(),
        checkpoints: witness.checkpoints.clone(),
    };
    (known, witness)
}

#[test]
fn losses_that_come_late_make_no_difference() {
    for blend in [Blend::Sum, Blend::Over] {
        for stop_at in [None, Some(21)] {
            let (expected, witness) = fit(&rasterizer(), small_fit(blend), stop_at);
            let steps = if stop_at.is_some() { 24 } else { 42 };
            assert_eq!((expected.losses.len(), witness.shown.len()), (steps, steps));
            assert!(witness.shown.iter().all(|&(_, late)| late == 0));
            for by in [1, 4, 100] {
                let (found, witness) = fit(&Late { sound: rasterizer(), by }, small_fit(blend), stop_at);
                assert_eq!(found, expected, "{blend:?}, {by} steps late");
                let latest = witness.shown.iter().map(|shown| shown.1).max().unwrap();
                assert!((1..=by as u32).contains(&latest), "{latest} of {by} steps late");
                for (step, &(loss, late)) in witness.shown.iter().enumerate() {
                    assert_eq!(loss, expected.losses[step - late as usize]);
                }
            }
        }
    }
}

#[test]
fn a_fit_begins_again_at_the_same_step_however_late_its_losses_come() {
    let mut settings = small_fit(Blend::Over).with(|s| {
        s.iterations = 100;
        s.parameterization = Parameterization::ScaleRotation;
    });
    settings.adam.mean.learning_rate = 200.0;
    let (expected, _) = fit(&rasterizer(), settings.clone(), None);
    let begun_again = expected.rows.iter().filter(|row| !row[row.len() - 1].is_empty()).count();
    assert!(begun_again > 1, "besides the headings");
    for by in [1, 100] {
        assert_eq!(fit(&Late { sound: rasterizer(), by }, settings.clone(), None).0, expected, "{by} steps late");
    }
}

#[test]
fn wgpu_fits_repeat_themselves_in_every_row() {
    let run = || {
        let wgpu =
            WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
        fit(&wgpu, small_fit(Blend::Sum), None).0
    };
    assert_eq!(run(), run());
}

#[test]
fn a_divergence_is_that_of_its_step_however_late_it_is_seen() {
    fn diverge<R: Optimizer<Scene2d>>(rasterizer: &R) -> (u32, u32, u32) {
        let mut settings = small_fit(Blend::Sum).with(|s| s.rounds = Rounds::NEVER);
        settings.adam.color.learning_rate = 1e36;
        let mut trainer = Trainer::new(rasterizer, &small_target(), settings).block_on().unwrap();
        let mut seen = Vec::new();
        loop {
            match trainer.step_once().block_on().map(drop) {
                Ok(()) => seen.extend_from_slice(trainer.new_losses().1),
                Err(Error::Diverged { step, loss, suspect }) => {
                    assert!(!loss.is_finite() && suspect.is_some());
                    seen.extend_from_slice(trainer.new_losses().1);
                    assert!(seen.iter().all(|loss| loss.is_finite()) && seen.len() == step as usize - 1, "{seen:?}");
                    let steps_done = trainer.step();
                    // The state stays unusable: no step or checkpoint is made of it.
                    for again in [trainer.step_once().block_on().map(drop), trainer.checkpoint().block_on().map(drop)] {
                        let between = matches!(again, Err(Error::BetweenCheckpoints { .. }));
                        assert!(between || matches!(again, Err(Error::Diverged { step: s, .. }) if s == step));
                    }
                    return (step, loss.to_bits(), steps_done);
                }
                Err(error) => panic!("{error}"),
            }
        }
    }
    let (step, loss, done) = diverge(&rasterizer());
    assert_eq!(done, step, "seen at once");
    for by in [1, 3] {
        assert_eq!(diverge(&Late { sound: rasterizer(), by }), (step, loss, step + by as u32));
    }
}
