//! Which guard is noticed by what, on which backends.

#![cfg_attr(not(guards = "can-be-off"), allow(dead_code, reason = "guards are switched off in another build"))]

use gs_conformance::corpus::{corpus_2d, corpus_3d, poison_slots_2d, poison_slots_3d, run};
use gs_core::{Rasterizer, Scene2d, Scene3d, guards::Guard};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_wgpu::{Kernels, WgpuRasterizer, WgpuSettings};

use super::checks::Check;

/// A backend, and the kernels of one of which there are several.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum On {
    Cpu,
    /// gs-wgpu with kernels for any adapter.
    Portable,
}

/// What fails without a guard.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Notice {
    /// A case of the corpus.
    Case(&'static str),
    /// A record of the corpus' poison.
    Poison(&'static str),
    /// A check of this test.
    Check(Check),
}

/// What notices that a guard is off.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Noticed {
    pub(crate) guard: Guard,
    pub(crate) by: Notice,
    pub(crate) on: &'static [On],
}

/// With all guards on, as one thread: what threads would do in images of this size is wait for each other.
pub(crate) fn cpu() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings { threads: Some(1), level: None }).unwrap()
}

fn wgpu(kernels: Kernels) -> Option<WgpuRasterizer> {
    WgpuRasterizer::new(WgpuSettings { kernels: Some(kernels), ..WgpuSettings::default() }).ok()
}

impl Notice {
    /// Its name in the table of guards.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Case(name) | Self::Poison(name) => name,
            Self::Check(check) => check.name(),
        }
    }

    /// Puts a backend through it, made anew, because shaders are compiled once.
    ///
    /// # Errors
    /// What is not as it must be.
    pub(crate) fn run(self, on: On) -> Result<(), String> {
        match on {
            On::Cpu => self.run_on(&cpu()),
            On::Portable => wgpu(Kernels::Portable).map_or(Ok(()), |rasterizer| self.run_on(&rasterizer)),
        }
    }

    fn run_on<R: Rasterizer<Scene2d> + Rasterizer<Scene3d>>(self, rasterizer: &R) -> Result<(), String> {
        let records = match self {
            Self::Check(check) => return check.run(rasterizer).map_err(|failure| failure.to_string()),
            Self::Case(name) => {
                let scene_2d = corpus_2d().into_iter().filter(|case| case.name == name);
                let mut records: Vec<_> = scene_2d.map(|case| run(rasterizer, &case)).collect();
                let scene_3d = corpus_3d().into_iter().filter(|case| case.name == name);
                records.extend(scene_3d.map(|case| run(rasterizer, &case)));
                records
            }
            Self::Poison(name) => {
                let mut records = poison_slots_2d(rasterizer, |record| record == name);
                records.extend(poison_slots_3d(rasterizer, |record| record == name));
                records
            }
        };
        assert!(!records.is_empty(), "there is no {self:?}");
        records.into_iter().try_for_each(|record| record.outcome.map(drop).map_err(|failure| failure.to_string()))
    }
}

/// A row: a guard, what notices it, and where.
const fn by(guard: Guard, by: Notice, on: &'static [On]) -> Noticed {
    Noticed { guard, by, on }
}

use Notice::{Case, Poison};
use On::{Cpu, Portable};

const EVERYWHERE: &[On] = &[Cpu, Portable];

/// What notices each guard.
pub(crate) const NOTICED: &[Noticed] = &[
    by(Guard::FiniteParameters, Poison("poison, over: opacity_logit 0"), EVERYWHERE),
    by(Guard::FiniteParameters, Poison("poison, by mean depth: log_scale 0"), EVERYWHERE),
    by(Guard::FiniteProjection, Case("larger than the image, sum"), EVERYWHERE),
    by(Guard::FiniteColor, Poison("poison, sum: color 0"), EVERYWHERE),
    by(Guard::FiniteColor, Poison("poison, by mean depth: sh 0"), EVERYWHERE),
    by(Guard::NearPlane, Case("on the camera, behind it"), EVERYWHERE),
    by(Guard::QuaternionNorm, Case("a zero, a tiny quaternion"), EVERYWHERE),
    by(Guard::QuaternionShrink, Case("a huge quaternion"), EVERYWHERE),
    by(Guard::Determinant, Case("scale → 0 in one axis, sum"), EVERYWHERE),
    by(Guard::Determinant, Case("scale → 0 in one axis, not antialiased"), EVERYWHERE),
    by(Guard::Transparent, Case("opacity logits ±∞, ±88, ±89, ±10⁴, over"), EVERYWHERE),
    by(Guard::JacobianClamp, Case("at the edge of the field of view"), EVERYWHERE),
    by(Guard::SafeSquares, Case("viewing direction whose length underflows"), EVERYWHERE),
    by(Guard::ZeroDirection, Case("viewing direction of length zero"), EVERYWHERE),
    by(Guard::SingularFactor, Notice::Check(Check::SingularFrames), &[Cpu]),
    by(Guard::AlphaMax, Case("α above the clamp, over"), EVERYWHERE),
    by(Guard::Full, Case("12 on one pixel, nearly opaque, over"), EVERYWHERE),
    by(Guard::ExponentRange, Case("scale → 0 in all axes, over"), &[Cpu, Portable]),
    by(Guard::Restart, Case("needles of aspect 10⁶ at every angle, sum"), &[Cpu]),
    by(Guard::GrowthLessOne, Case("a wide Gaussian down a tall image, sum"), &[Cpu]),
    by(Guard::MaxResidual, Case("Adam with gradients of 10^38, sum"), EVERYWHERE),
    by(Guard::SsimMax, Case("constant image of 10^30 in SSIM, sum"), EVERYWHERE),
    by(Guard::SsimVariances, Notice::Check(Check::SsimOfConstants), EVERYWHERE),
    by(Guard::MaxDerivative, Notice::Check(Check::SecondMoments), EVERYWHERE),
    by(Guard::MaxXi, Notice::Check(Check::StepsWithinReach), EVERYWHERE),
    by(Guard::MaxEta, Case("steps of e⁴ in scale, sum"), EVERYWHERE),
    by(Guard::VanishingMoment, Notice::Check(Check::MomentsVanish), EVERYWHERE),
    by(Guard::Epsilon, Notice::Check(Check::EpsilonOfZero), EVERYWHERE),
    by(Guard::ScaleBounds, Case("larger than the image, sum"), EVERYWHERE),
    by(Guard::FlatTurn, Notice::Check(Check::FlatFrames), &[Cpu]),
    by(Guard::PruneNotFinite, Notice::Check(Check::FitsEndFinite), &[Cpu]),
    by(Guard::FreshStart, Notice::Check(Check::FitsEndNoWorse), &[Cpu]),
    by(Guard::FiniteScore, Notice::Check(Check::InfiniteScores), &[Cpu]),
    by(Guard::FiniteLoss, Notice::Check(Check::InfiniteLosses), &[Cpu]),
];
