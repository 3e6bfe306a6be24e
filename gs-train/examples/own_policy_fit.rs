//! A fit whose density control is your own: large Gaussians that move much grow.
//!
//! `cargo run --release -p gs-train --example own_policy_fit`
#![allow(clippy::print_stdout)]

use std::{error::Error, sync::Arc};

use gs_core::{EditPlan, Gaussian2d, effects::Statistics};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_density::{Actions, DensityPolicy, Needs, Observation, Rng, Round, WhenFlat};
use gs_train::{FitSettings, Trainer, paper_target};
use pollster::FutureExt as _;

/// The percentage that grows in each round.
struct RestlessMass(f32);

impl DensityPolicy for RestlessMass {
    fn plan(&self, seen: &Observation<'_>, rng: &mut Rng) -> Result<EditPlan<Gaussian2d>, gs_core::Error> {
        // The frame of all growing policies: it prunes, resets opacities and keeps within the budget.
        let round = Round::open(&Actions::default(), seen)?;
        let mass = |i: usize| seen.statistics.mean_signal(i) * seen.scene.log_scales[i].element_sum().exp();
        let ranking = round.rank_by(mass, WhenFlat::Nothing);
        Ok(round.grow(ranking.top_percent(self.0), rng))
    }

    /// What training collects for `seen.statistics`.
    fn needs(&self) -> Needs {
        Needs { statistics: Statistics::MeanGradient, ..Needs::default() }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let cpu = CpuRasterizer::new(CpuSettings::default())?;
    // 8 % of the 600 Gaussians at the start, and 17 rounds in which the top 20 % grow.
    let settings = FitSettings::standard(600);
    let target = paper_target();
    let mut trainer = Trainer::new(&cpu, &target, settings).block_on()?.controlled_by(Arc::new(RestlessMass(20.0)));
    trainer.run(&mut ()).block_on()?;
    let (image, _) = trainer.render().block_on()?;
    println!("{} Gaussians of at most 600: {:.2} dB", trainer.count(), gs_core::metrics::psnr(&image, &target)?);
    Ok(())
}
