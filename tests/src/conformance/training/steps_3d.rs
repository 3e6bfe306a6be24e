//! Cases of 3D training: views that change from step to step, and Gaussians out of view.

use gs_core::{
    Binning, Camera, EditPlan, Loss, MeanNoise, Optimizer, Parameterization, Participants, Penalty, Scene, Scene3d,
    TrainStep,
    adam::Group,
    edit::AfterEdit,
    effects::{Blend, Statistics},
};
use pollster::FutureExt as _;

use crate::conformance::{
    losses_of,
    training::{compare_parameters, distinct, step},
};
use crate::{
    adam_reference::AdamReference,
    failure::Failure,
    oracle::Oracle,
    scenes::{Draw, Kind3d},
    subject::Subject,
    tolerance::FUSED_SHARE,
};

/// Upload and download keep all bits of scenes of every SH degree.
pub(crate) fn scenes_3d_come_back<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for seed in 2600..2604 {
        let scene = Draw::for_3d(Kind3d::Opaque, Blend::Over, 37, (40, 30), seed).scene;
        let splats = rasterizer.upload(&scene, Parameterization::ScaleRotation)?;
        Failure::unless(rasterizer.len(&splats) == 37, || format!("{} of 37 Gaussians", rasterizer.len(&splats)))?;
        let back = rasterizer.download(&splats).block_on()?;
        Failure::unless(back == scene, || format!("degree {}: the downloaded scene differs", scene.sh_degree))?;
        let restored = rasterizer.download(&rasterizer.restore(&rasterizer.save(&splats).block_on()?)?).block_on()?;
        Failure::unless(restored == scene, || format!("degree {}: the restored scene differs", scene.sh_degree))?;
        let empty =
            rasterizer.download(&rasterizer.upload(&scene.emptied(), Parameterization::ScaleRotation)?).block_on()?;
        Failure::unless(empty == scene.emptied(), || "an empty scene differs after download".to_owned())?;
    }
    Ok(())
}

/// A camera with another near plane.
fn beyond(view: Camera, near: f32) -> Camera {
    Camera { near, ..view }
}

/// Gaussians out of view move by their moments with [`Participants::All`]. With
/// [`Participants::Visible`], they do not change, step counts included.
pub(crate) fn only_participants_move<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for participants in [Participants::All, Participants::Visible] {
        let mut draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 14, (30, 24), 2613);
        let target = rasterizer.upload_target(&draw.target()?)?;
        let mut rates = distinct::<Scene3d>(1e-3);
        rates.participants = participants;
        let mut splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
        let mut reference = AdamReference::new(draw.scene.rows());
        let whole = draw.view;
        for (steps, near) in (1..).zip([whole.near, 5.0, whole.near, 5.0]) {
            draw.view = beyond(whole, near);
            let drawn =
                Oracle::new(draw.view, draw.settings)?.render(&rasterizer.download(&splats).block_on()?.rows()).drawn;
            let seen: Vec<usize> = (0..drawn.len()).filter(|&g| drawn[g]).collect();
            let count = seen.len();
            Failure::unless(near < 1.0 || (3..12).contains(&count), || format!("{count} of 14 are beyond {near}"))?;
            let gradients = step(rasterizer, &mut splats, &draw, &target, &rates)?;
            match participants {
                Participants::All => reference.step(&gradients, &rates),
                Participants::Visible => reference.step_some(&seen, &gradients, &rates),
            }
            let found = rasterizer.download(&splats).block_on()?.rows();
            compare_parameters::<Scene3d>(&reference.scene, &found, &rates, steps)
                .map_err(|failure| failure.at(format!("{participants:?}, step {steps}")))?;
        }
        let counts = rasterizer.save(&splats).block_on()?.integers("steps")?;
        let expected: Vec<u32> = (0..14).map(|g| reference.moments(g).2 as u32).collect();
        Failure::unless(counts == expected, || format!("{participants:?}: step counts {counts:?}, not {expected:?}"))?;
    }
    Ok(())
}

/// The first Gaussians of a scene, as many as [`AdamRates::fixed`] says, keep parameters, moments, step counts
/// and statistics in steps, under noise and in an edit that lowers opacities. The others move as ever.
pub(crate) fn fixed_gaussians_stay<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    const FIXED: usize = 5;
    let mut draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 14, (30, 24), 2617);
    draw.settings.effects.statistics = Statistics::MeanGradient;
    let target = rasterizer.upload_target(&draw.target()?)?;
    let mut rates = distinct::<Scene3d>(1e-3);
    rates.penalty = Penalty { opacity: 0.01, scale: 0.01 };
    rates.fixed = FIXED as u32;
    let scene = &draw.scene;
    let mut splats = rasterizer.upload(scene, Parameterization::ScaleRotation)?;
    let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let check = |splats: &R::Splats, after: &str| -> Result<(), Failure> {
        let (found, state) = (rasterizer.download(splats).block_on()?, rasterizer.save(splats).block_on()?);
        let moved: Vec<usize> = (0..scene.len()).filter(|&g| found.gaussian(g) != scene.gaussian(g)).collect();
        let expected: Vec<usize> = (FIXED..scene.len()).collect();
        Failure::unless(moved == expected, || format!("{after}: {moved:?} moved, not {expected:?}"))?;
        let (columns, moments) = state.matrix("moment1")?;
        let stayed = moments[..FIXED * columns].iter().all(|moment| *moment == 0.0);
        let counts = [state.integers("steps")?, state.integers("visible")?];
        let counted = counts.iter().all(|counts| counts[..FIXED] == [0; FIXED] && counts[FIXED..].contains(&2));
        Failure::unless(stayed && counted, || format!("{after}: moments of fixed Gaussians, or counts {counts:?}"))
    };
    for _ in 0..2 {
        rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on()?;
    }
    check(&splats, "two steps")?;
    rasterizer.add_noise(&mut splats, &MeanNoise { scale: 1e25, seed: 1, step: 2, fixed: rates.fixed })?;
    check(&splats, "noise")?;
    let ceiling = EditPlan { opacity_ceiling: Some(1e-3), statistics: AfterEdit::Keep, ..EditPlan::default() };
    rasterizer.edit(&mut splats, &ceiling.behind(rates.fixed)).block_on()?;
    check(&splats, "a ceiling")
}

/// A step may reuse lists: nothing changes if the Gaussians did not move, or if the camera is
/// another one, for which the lists are invalid.
pub(crate) fn reused_lists_change_nothing_without_movement<R: Optimizer<Scene3d>>(
    rasterizer: &R,
) -> Result<(), Failure> {
    let still = Group::constant(0.0);
    let groups = Scene3d::adam().with(|s| {
        s.mean = still;
        s.scale = still;
        s.rotation = still;
        s.opacity = still;
    });
    let rates = groups
        .with(|s| {
            s.color = still;
            s.color_rest = still;
        })
        .at(0.0);
    let draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 20, (40, 30), 2623);
    let target = rasterizer.upload_target(&draw.target()?)?;
    let mut elsewhere = draw.view;
    elsewhere.translation += glam::Vec3::new(0.6, -0.4, 0.3);
    for views in [[draw.view, draw.view], [draw.view, elsewhere]] {
        let run = |binning| -> Result<(Vec<f32>, Vec<f32>), Failure> {
            let mut splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
            for (view, binning) in views.iter().zip([Binning::Fresh, binning]) {
                let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning };
                rasterizer.train_step(&mut splats, view, &target, &step).block_on()?;
            }
            let losses = losses_of(rasterizer, &mut splats)?;
            Ok((losses, rasterizer.save(&splats).block_on()?.matrix("moment1")?.1.to_vec()))
        };
        let ((losses, moments), (again, others)) = (run(Binning::Fresh)?, run(Binning::Reuse)?);
        let near = |a: &[f32], b: &[f32], share: f32| {
            let largest = a.iter().fold(0.0f32, |m, v| m.max(v.abs()));
            largest > 0.0 && a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= share * largest)
        };
        let same = near(&losses, &again, FUSED_SHARE as f32) && near(&moments, &others, FUSED_SHARE as f32);
        Failure::unless(same, || format!("losses {losses:?} with new lists, {again:?} with reused ones"))?;
    }
    Ok(())
}

/// `visible` counts the steps in which a Gaussian was in view.
pub(crate) fn visible_are_counted<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    let mut draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 14, (30, 24), 2633);
    draw.settings.effects.statistics = Statistics::MeanGradient;
    let still = Group::constant(0.0);
    let groups = Scene3d::adam().with(|s| {
        s.mean = still;
        s.scale = still;
        s.rotation = still;
        s.opacity = still;
    });
    let rates = groups
        .with(|s| {
            s.color = still;
            s.color_rest = still;
        })
        .at(0.0);
    let target = rasterizer.upload_target(&draw.target()?)?;
    let mut splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
    let mut expected = vec![0; draw.scene.len()];
    for near in [draw.view.near, 5.5, 3.5] {
        let view = beyond(draw.view, near);
        let drawn = Oracle::new(view, draw.settings)?.render(&draw.scene.rows()).drawn;
        expected.iter_mut().zip(drawn).for_each(|(count, drawn)| *count += u32::from(drawn));
        let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
        rasterizer.train_step(&mut splats, &view, &target, &step).block_on()?;
    }
    let found = rasterizer.statistics(&splats).block_on()?.visible;
    let distinct = (1..=3).all(|count| expected.contains(&count));
    Failure::unless(distinct, || format!("the scene does not have all counts: {expected:?}"))?;
    Failure::unless(found == expected, || format!("in view in {found:?} of 3 steps, not {expected:?}"))
}
