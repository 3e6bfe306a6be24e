//! A density policy of your own in a study: Gaussians that move much and are large grow. It is
//! compared with forced growth and with no growth.
//!
//! `cargo run --release -p gs-lab --example own_policy`

use std::{error::Error, sync::Arc};

use gs_core::{EditPlan, Gaussian2d, effects::Statistics};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_density::{Actions, DensityPolicy, Needs, Observation, Rng, Round, WhenFlat};
use gs_jobs::WorkSettings;
use gs_lab::{Existing, Places, Plan, Results, Study, StudyFolder, conduct, report, study::Arm};

struct RestlessMass(f32);

impl DensityPolicy for RestlessMass {
    fn plan(&self, seen: &Observation<'_>, rng: &mut Rng) -> Result<EditPlan<Gaussian2d>, gs_core::Error> {
        let round = Round::open(&Actions::default(), seen)?;
        let mass = |i: usize| seen.statistics.mean_signal(i) * seen.scene.log_scales[i].element_sum().exp();
        let ranking = round.rank_by(mass, WhenFlat::Nothing);
        Ok(round.grow(ranking.top_percent(self.0), rng))
    }
    fn needs(&self) -> Needs {
        Needs { statistics: Statistics::MeanGradient, ..Needs::default() }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut study = Study::from_toml(include_str!("own_policy.toml"), "own_policy.toml")?;
    study.arms.push(Arm::with_policy("restless-mass", "restless mass, top 10 %", Arc::new(RestlessMass(10.0))));
    let cpu = CpuRasterizer::new(CpuSettings::default())?;
    let plan = Plan::new(study, &Places::default(), format!("cpu {}", cpu.simd_level()))?;
    let folder = StudyFolder::prepare("gs-out/own-policy".as_ref(), &plan, Existing::Resume)?;
    conduct(&plan, &[&cpu], &folder, &WorkSettings::default(), &())?;
    let results = Results::read(&plan, &folder)?;
    Ok(report::write(&results, &folder, "cargo run --release -p gs-lab --example own_policy")?)
}
