//! The time of each stage of a training step.
//!
//! With timestamps, all stages are one submission. Without them, the host submits each stage alone
//! and waits for it.

use gs_core::{
    Error, Loss, RenderSettings,
    profile::{Clock, Profile, Profiler, StageTime, still},
};
use web_time::Instant;

use crate::{
    WgpuRasterizer,
    blend::Differentiated,
    dispatch::Commands,
    gpu::Gpu,
    kind::Kind,
    shaders::{ROWS, TILE_COLUMNS, TILE_ROWS},
    splats::Splats,
    target::Target,
    tiles::Tiles,
    timestamps::Timestamps,
    workspace::Workspace,
};

gs_core::choices! {
    /// The stages in order; `scan` includes `sizes`.
    pub(crate) enum Stage {
        Project = "project",
        Scan = "scan",
        Bin = "bin",
        Sort = "sort",
        Ranges = "ranges",
        Blend = "blend",
        Loss = "loss",
        BlendBwd = "blend_bwd",
        ProjectBwd = "project_bwd",
        Adam = "adam",
    }
}

impl Stage {
    fn visits_pairs(self) -> bool {
        matches!(self, Self::Blend | Self::BlendBwd)
    }
}

/// The arguments of the stages.
struct Pass<'a, S: Kind> {
    rasterizer: &'a WgpuRasterizer,
    workspace: Workspace<S>,
    splats: &'a Splats<S>,
    target: &'a Target,
    loss: Loss,
    stages: Vec<Stage>,
}

impl<S: Kind> Pass<'_, S> {
    fn encode(&mut self, stage: Stage, commands: &mut Commands) -> Result<(), Error> {
        let Self { rasterizer, workspace, splats, target, loss, .. } = self;
        let gpu = &rasterizer.gpu;
        match stage {
            Stage::Project => workspace.encode_project(gpu, commands, splats, true),
            Stage::Scan => workspace.tiles.encode_offsets(gpu, commands),
            Stage::Bin => workspace.tiles.encode_bin(gpu, commands),
            Stage::Sort => workspace.tiles.encode_sort(gpu, commands),
            Stage::Ranges => workspace.tiles.encode_ranges(gpu, commands),
            Stage::Blend => workspace.tiles.encode_blend(gpu, commands),
            Stage::Loss => workspace.tiles.encode_loss(gpu, commands, target, *loss)?,
            Stage::BlendBwd => workspace.tiles.encode_blend_bwd(gpu, commands, Differentiated::Loss(target))?,
            Stage::ProjectBwd => workspace.encode_project_bwd(gpu, commands, splats)?,
            Stage::Adam => workspace.encode_adam(gpu, commands, splats),
        }
        Ok(())
    }

    /// Seconds of each stage by timestamps; `None` if these contradict the host's clock.
    async fn by_device(&mut self, timestamps: &Timestamps) -> Result<Option<Vec<f64>>, Error> {
        let gpu = &self.rasterizer.gpu;
        let mut commands = Commands::new(gpu);
        for index in 0..self.stages.len() {
            timestamps.mark(&mut commands, index as u32);
            self.encode(self.stages[index], &mut commands)?;
        }
        timestamps.mark(&mut commands, self.stages.len() as u32);
        timestamps.resolve(&mut commands);
        let start = Instant::now();
        let submission = commands.submit(gpu);
        gpu.done(&submission).await?;
        let host = start.elapsed().as_secs_f64();
        let laps = timestamps.laps(gpu).await?;
        Ok(agree(&laps, host).then_some(laps))
    }

    /// Seconds of each stage by the host's clock, each in a submission of its own.
    async fn by_host(&mut self) -> Result<Vec<f64>, Error> {
        let gpu = &self.rasterizer.gpu;
        let mut laps = Vec::with_capacity(self.stages.len());
        for index in 0..self.stages.len() {
            let mut commands = Commands::new(gpu);
            self.encode(self.stages[index], &mut commands)?;
            let start = Instant::now();
            let submission = commands.submit(gpu);
            gpu.done(&submission).await?;
            laps.push(start.elapsed().as_secs_f64());
        }
        Ok(laps)
    }

    /// Seconds of each repetition and stage. Uses the device's clock, unless a repetition
    /// contradicts the host's.
    async fn measure(
        &mut self,
        timestamps: Option<Timestamps>,
        repetitions: usize,
    ) -> Result<(Clock, Vec<Vec<f64>>), Error> {
        let why = match timestamps {
            None => "the adapter has no timestamps",
            Some(timestamps) => {
                let mut laps = Vec::with_capacity(repetitions);
                while laps.len() < repetitions
                    && let Some(found) = self.by_device(&timestamps).await?
                {
                    laps.push(found);
                }
                if laps.len() == repetitions {
                    return Ok((Clock::Device, laps));
                }
                "the adapter's timestamps contradict the host's clock"
            }
        };
        let mut laps = Vec::with_capacity(repetitions);
        while laps.len() < repetitions {
            laps.push(self.by_host().await?);
        }
        Ok((Clock::RoundTrip { why: why.to_owned() }, laps))
    }
}

/// Whether the device's times are plausible for a wait of `host` seconds.
///
/// They must not be negative, and their sum at most 5 % above the host's time.
fn agree(laps: &[f64], host: f64) -> bool {
    let sum: f64 = laps.iter().sum();
    laps.iter().all(|&lap| lap >= 0.0) && sum > 0.0 && sum <= 1.05 * host
}

/// Number of pixel–Gaussian pairs that a blend kernel visits: all columns of each group of four
/// rows that an entry touches.
async fn pairs(gpu: &Gpu, tiles: &Tiles, entries: usize) -> Result<u64, Error> {
    if tiles.orders_by_pixel() {
        return Ok(entries as u64 * u64::from(TILE_ROWS * TILE_COLUMNS));
    }
    let entries: Vec<[u32; 2]> = gpu.read(&tiles.entries.buffer, entries).await?;
    Ok(entries.iter().map(|&[_, rows]| u64::from(rows_visited(rows)) * u64::from(TILE_COLUMNS)).sum())
}

/// Number of rows that a kernel visits for an entry with rows first | end << 16.
fn rows_visited(rows: u32) -> u32 {
    match (rows & 0xffff, rows >> 16) {
        (first, end) if first < end => end.next_multiple_of(ROWS) - first / ROWS * ROWS,
        _ => 0,
    }
}

impl WgpuRasterizer {
    /// [`Profiler::profile`] with these timestamps.
    async fn profile_by<S: Kind>(
        &self,
        timestamps: impl Fn(&Gpu, u32) -> Result<Option<Timestamps>, Error>,
        splats: &Splats<S>,
        (view, target): (&S::View, &Target),
        settings: &RenderSettings,
        loss: Loss,
        repetitions: usize,
    ) -> Result<Profile, Error> {
        S::check(view, settings)?;
        target.check_loss(loss)?;
        target.check_size(S::size(view))?;
        let (gpu, rates) = (&self.gpu, still());
        splats.settle(gpu).await?;
        let mut workspace = S::pool(&self.pools).take(gpu)?;
        workspace.set(gpu, splats, view, settings)?;
        let describe = |w: &Workspace<S>| w.describe(gpu, splats, Some(loss), Some(&rates));
        // From here on, the lists fit.
        let status = workspace.with_lists(gpu, splats, describe, |_, _| Ok(())).await?;
        workspace.write_step(gpu, &describe(&workspace));
        let stages = Stage::ALL.to_vec();
        let mut pass = Pass { rasterizer: self, workspace, splats, target, loss, stages };
        // Compiles the pipelines.
        pass.by_host().await?;
        let timestamps = timestamps(gpu, pass.stages.len() as u32 + 1)?;
        let (clock, laps) = pass.measure(timestamps, repetitions).await?;
        let Pass { workspace, stages, .. } = pass;
        let entries = status.entries as usize;
        let pairs = pairs(gpu, &workspace.tiles, entries).await?;
        let stage_time = |(index, stage): (usize, Stage)| StageTime {
            stage: stage.name(),
            seconds: laps.iter().map(|laps| laps[index]).collect(),
            pairs: if stage.visits_pairs() { pairs } else { 0 },
            replaces: &[],
        };
        let stages = stages.into_iter().enumerate().map(stage_time).collect();
        S::pool(&self.pools).give(workspace);
        Ok(Profile { stages, clock, pairs, entries })
    }
}

impl<S: Kind> Profiler<S> for WgpuRasterizer {
    async fn profile(
        &self,
        splats: &mut Splats<S>,
        view: &S::View,
        target: &Target,
        settings: &RenderSettings,
        loss: Loss,
        repetitions: usize,
    ) -> Result<Profile, Error> {
        S::prepare(&self.gpu, splats, None).await?;
        self.profile_by(Timestamps::new, splats, (view, target), settings, loss, repetitions).await
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{Blend, Canvas, Gaussian2d, Image, Parameterization, Rasterizer, Scene2d};
    use pollster::FutureExt as _;

    use super::*;
    use crate::WgpuSettings;

    #[test]
    fn implausible_timestamps_are_rejected() {
        let laps = [1e-3; 10];
        let sum: f64 = laps.iter().sum();
        assert!(agree(&laps, sum) && agree(&laps, 2.0 * sum));
        assert!(!agree(&laps, 0.9 * sum), "more than the host's time");
        assert!(!agree(&[0.0; 10], sum), "all zero");
        let mut backwards = laps;
        backwards[3] = -1e-6;
        assert!(!agree(&backwards, sum), "negative");
        backwards[3] = f64::NAN;
        assert!(!agree(&backwards, sum));
    }

    #[test]
    fn rows_are_visited_in_groups_of_four() {
        for (first, end, visited) in [(0, 0, 0), (0, 1, 4), (3, 5, 8), (4, 8, 4), (2, 8, 8), (0, 16, 16), (15, 16, 4)] {
            assert_eq!(rows_visited(first | end << 16), visited, "{first} to {end}");
        }
    }

    #[test]
    fn wgpu_pairs_count_the_rows_that_entries_touch() {
        let wgpu =
            WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
        let at = |x: f32| Gaussian2d {
            mean: Vec2::new(x, 5.0),
            log_scale: Vec2::ZERO,
            rotation: 0.0,
            opacity_logit: f32::INFINITY,
            color: Vec3::ONE,
        };
        // The first touches two columns of tiles, the other one.
        let scene: Scene2d = [at(16.0), at(26.0)].into_iter().collect();
        let splats = &mut wgpu.upload(&scene, Parameterization::CovarianceFactor).unwrap();
        let target = wgpu.for_2d().upload_target(&Image::filled(32, 10, [0.5; 3]).unwrap()).unwrap();
        let settings = RenderSettings::blended(Blend::Sum);
        let profile = wgpu.profile(splats, &Canvas::new(32, 10), &target, &settings, Loss::L2, 1).block_on().unwrap();
        assert_eq!(profile.entries, 3);
        // σ = 1 px: the cut's ellipse reaches 3.3 px, from row 2 to row 7, in two groups of four.
        assert_eq!(profile.pairs, 3 * 16 * 8);
        for stage in &profile.stages {
            let expected = if ["blend", "blend_bwd"].contains(&stage.stage) { profile.pairs } else { 0 };
            assert_eq!(stage.pairs, expected, "{}", stage.stage);
        }
    }

    #[test]
    fn wgpu_clocks_measure_the_same_stages_and_move_nothing() {
        let wgpu =
            WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
        let gaussian = |i: u32| Gaussian2d {
            mean: Vec2::new((i * 37 % 96) as f32, (i * 91 % 64) as f32),
            log_scale: Vec2::new(1.5, 0.5),
            rotation: i as f32,
            opacity_logit: f32::INFINITY,
            color: Vec3::splat(0.1),
        };
        let scene: Scene2d = (0..300).map(gaussian).collect();
        let splats = wgpu.upload(&scene, Parameterization::ScaleRotation).unwrap();
        let target = wgpu.for_2d().upload_target(&Image::filled(96, 64, [0.5; 3]).unwrap()).unwrap();
        let (view, settings) = (Canvas::new(96, 64), RenderSettings::blended(Blend::Sum));
        let none = |_: &Gpu, _: u32| Ok(None);
        let names = |profile: &Profile| profile.stages.iter().map(|s| s.stage).collect::<Vec<_>>();
        for loss in [Loss::L2, Loss::PAPER] {
            let by_host = wgpu.profile_by(none, &splats, (&view, &target), &settings, loss, 3).block_on().unwrap();
            assert!(matches!(&by_host.clock, Clock::RoundTrip { why } if why.contains("no timestamps")));
            assert!(by_host.stages.iter().all(|s| s.seconds.len() == 3 && s.seconds.iter().all(|&s| s > 0.0)));
            let by_device =
                wgpu.profile_by(Timestamps::new, &splats, (&view, &target), &settings, loss, 3).block_on().unwrap();
            if wgpu.gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
                assert_eq!(by_device.clock, Clock::Device);
            }
            assert_eq!(names(&by_device), names(&by_host));
            assert_eq!((by_device.pairs, by_device.entries), (by_host.pairs, by_host.entries));
            assert!(by_device.stages.iter().all(|s| s.seconds.len() == 3));
        }
        let after = wgpu.download(&splats).block_on().unwrap();
        assert_eq!(after, scene);
    }
}
