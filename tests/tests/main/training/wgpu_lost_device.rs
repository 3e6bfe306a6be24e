//! A GPU that is lost under way ends the fit with an error; its last checkpoint is as it was, and
//! goes on elsewhere.

use pollster::FutureExt as _;
use std::{fs, path::PathBuf};

use super::fixture_2d::{rasterizer, small_fit, small_target};
use gs_core::{Blend, SavedState};
use gs_io::{Checkpoint, read_checkpoint, write_checkpoint};
use gs_train::{Control, Error, FitSettings, Observer, Outcome, Progress, Trainer};
use gs_wgpu::{WgpuRasterizer, WgpuSettings};

/// Stores a checkpoint every 8 steps, and loses the device after a step.
struct LoseAfter<'a> {
    rasterizer: &'a WgpuRasterizer,
    step: u32,
    file: PathBuf,
    /// The content of the checkpoint file.
    stored: Vec<u8>,
}

impl Observer for LoseAfter<'_> {
    fn on_step(&mut self, progress: &Progress) -> Control {
        if progress.step == self.step {
            self.rasterizer.lose_device();
        }
        Control::Continue
    }

    fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
        progress.step.is_multiple_of(8)
    }

    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), Error> {
        write_checkpoint(&self.file, checkpoint)?;
        self.stored = fs::read(&self.file).unwrap();
        Ok(())
    }
}

#[track_caller]
fn is_of_backend<T>(result: Result<T, Error>) {
    match result.map(drop) {
        Err(Error::Core(gs_core::Error::Backend { backend: "wgpu", message })) => assert!(message.contains("lost")),
        other => panic!("{other:?}"),
    }
}

/// Loses the device after this many of 42 steps, and goes on with the checkpoint of `stored_at` on
/// the CPU.
fn lose_and_go_on(settings: FitSettings, after: u32, stored_at: u32) {
    let target = small_target();
    let wgpu = WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("checkpoint.safetensors");
    let mut observer = LoseAfter { rasterizer: &wgpu, step: after, file: file.clone(), stored: Vec::new() };
    let mut trainer = Trainer::new(&wgpu, &target, settings.clone()).block_on().unwrap();
    is_of_backend(trainer.run(&mut observer).block_on());
    assert_eq!(trainer.step(), after);
    // All further calls fail, and none panics.
    is_of_backend(trainer.step_once().block_on());
    is_of_backend(trainer.scene().block_on());
    is_of_backend(trainer.render().block_on());
    is_of_backend(Trainer::new(&wgpu, &target, settings.clone()).block_on());
    if trainer.can_checkpoint() {
        is_of_backend(trainer.checkpoint().block_on());
    }

    assert!(fs::read(&file).unwrap() == observer.stored, "the last checkpoint is as it was");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "and alone");
    let cpu = rasterizer();
    let mut resumed = Trainer::resume(&cpu, &target, read_checkpoint(&file).unwrap()).unwrap();
    assert_eq!(resumed.step(), stored_at);
    assert_eq!(resumed.run(&mut ()).block_on().unwrap(), Outcome::Finished);
    let mut whole = Trainer::new(&cpu, &target, settings).block_on().unwrap();
    whole.run(&mut ()).block_on().unwrap();
    let (resumed, whole) = (resumed.quality().block_on().unwrap().psnr, whole.quality().block_on().unwrap().psnr);
    // Between fresh lists the backends' tiles decide what a moving Gaussian still reaches, so the
    // ends differ a little.
    assert!((resumed - whole).abs() < 2.0, "{resumed} dB, and {whole} dB where nothing was lost");
}

#[test]
fn a_lost_device_leaves_the_last_checkpoint() {
    // Between two steps that share their lists, and before one that makes them anew.
    lose_and_go_on(small_fit(Blend::Sum), 22, 16);
    lose_and_go_on(small_fit(Blend::Over), 24, 16);
}
