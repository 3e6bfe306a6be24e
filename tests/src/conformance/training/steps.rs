//! Cases of whole training steps: losses, statistics, and solving for colours.

use glam::Vec2;
use gs_core::{
    Adam, Binning, Canvas, Loss, Optimizer, Parameterization, Scene, Scene2d, TargetImage, TrainStep,
    adam::Group,
    effects::{Blend, Statistics},
};
use pollster::FutureExt as _;

use crate::conformance::{LOSSES, losses_of, parameterizations, training::weights_of};
use crate::{
    adam_reference::rate_of,
    failure::Failure,
    oracle::{Oracle, OracleScene, best_colors},
    scenes::{Draw, Kind2d},
    subject::Subject,
    tolerance::{FUSED_SHARE, LEAST_SQUARES, STATISTICS_SHARE, WEIGHTED_SLOPE},
};

const PARAMETERIZATIONS: [Parameterization; 2] = [Parameterization::ScaleRotation, Parameterization::CovarianceFactor];

/// Ten small steps each decrease the loss of the oracle. The reported loss is the one before the
/// step.
pub(crate) fn steps_decrease_the_loss<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    let group = Group::constant(3e-3);
    let groups = S::adam().with(|s| {
        s.mean = group;
        s.scale = group;
        s.rotation = group;
    });
    let rates = groups
        .with(|s| {
            s.opacity = group;
            s.color = group;
            s.color_rest = group;
        })
        .at(0.0);
    for parameterization in parameterizations::<S, R>(rasterizer)? {
        for blend in [Blend::Sum, Blend::Over] {
            for loss in LOSSES {
                let draw = S::overlapping(blend, 12, (26, 22), 1403);
                let image = draw.target()?;
                let oracle = Oracle::new(draw.view, draw.settings)?;
                let target = rasterizer.upload_target(&image)?;
                let mut splats = rasterizer.upload(&draw.scene, parameterization)?;
                let step = TrainStep { settings: &draw.settings, loss, rates: &rates, binning: Binning::Fresh };
                let place = || format!("{parameterization:?}, {blend:?}, {loss:?}");
                let mut last = f64::INFINITY;
                for steps in 0..10 {
                    let scene = rasterizer.download(&splats).block_on()?.rows();
                    let now = oracle.loss(&scene, &image, &loss)?;
                    Failure::unless(now < last, || {
                        format!("{}: step {steps} changed the loss from {last} to {now}", place())
                    })?;
                    rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on()?;
                    let reported = losses_of(rasterizer, &mut splats)?;
                    let right = matches!(reported[..], [reported] if (f64::from(reported) - now).abs() < 1e-3 * now);
                    Failure::unless(right, || format!("{}: `losses` reports {reported:?}, not {now}", place()))?;
                    last = now;
                }
            }
        }
    }
    Ok(())
}

/// A step with [`Binning::Reuse`] does not use lists of an earlier rendering, as Gaussians may have
/// moved since. It has the same bits as a step after saving and restoring.
pub(crate) fn first_steps_do_not_reuse_lists_of_renderings<R: Optimizer<Scene2d>>(
    rasterizer: &R,
) -> Result<(), Failure> {
    // Further than the extent of most Gaussians.
    let rates = Adam::default().with(|s| s.mean = Group::constant(8.0)).at(0.0);
    for blend in [Blend::Sum, Blend::Over] {
        let draw = Draw::new(Kind2d::Typical, blend, 20, (70, 50), 1603);
        let target = rasterizer.upload_target(&draw.target()?)?;
        let mut rendered = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
        let pass = rasterizer.forward(&rendered, &draw.view, &draw.settings).block_on()?;
        let (_, gradients) = rasterizer.backward(&rendered, pass, &target, &Loss::L2).block_on()?;
        rasterizer.step(&mut rendered, &gradients, &rates).block_on()?;
        // Dropping the gradients releases the lists.
        drop(gradients);
        let mut restored = rasterizer.restore(&rasterizer.save(&rendered).block_on()?)?;
        let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Reuse };
        let after = |splats: &mut R::Splats| -> Result<_, Failure> {
            rasterizer.train_step(splats, &draw.view, &target, &step).block_on()?;
            Ok((losses_of(rasterizer, splats)?, rasterizer.save(splats).block_on()?))
        };
        let (found, expected) = (after(&mut rendered)?, after(&mut restored)?);
        let place = || format!("{blend:?}: the loss is {:?} instead of {:?}", found.0, expected.0);
        Failure::unless(found == expected, place)?;
    }
    Ok(())
}

/// `train_step` equals `forward`, `backward` and `step` over five steps, in every parameterization,
/// blend and loss, also through a canvas of another scale.
pub(crate) fn fused_steps_match_separate_stages<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    // With this ε, a step is in proportion to a gradient that is mere rounding.
    let rates = S::adam().with(|s| s.epsilon = 1e-3).at(0.0);
    let parameterizations = parameterizations::<S, R>(rasterizer)?;
    let last = parameterizations.last().map(|&parameterization| (parameterization, (43, 31)));
    for (parameterization, size) in
        parameterizations.iter().map(|&parameterization| (parameterization, (30, 24))).chain(last)
    {
        for blend in [Blend::Sum, Blend::Over] {
            let weighted = LOSSES.into_iter().filter(|loss| loss.is_pointwise()).map(|loss| (loss, true));
            for (loss, is_weighted) in LOSSES.map(|loss| (loss, false)).into_iter().chain(weighted) {
                let draw = S::typical(blend, 20, (30, 24), 1503).on([0.2, 0.4, 0.1]);
                let view = S::resized(&draw.view, size);
                let draw = draw.through(view);
                let image = draw.target()?;
                let weights = is_weighted.then(|| weights_of(&image));
                let target = TargetImage { weights: weights.as_deref(), ..TargetImage::from(&image) };
                let target = rasterizer.upload_target(target)?;
                let step = TrainStep { settings: &draw.settings, loss, rates: &rates, binning: Binning::Fresh };
                let mut fused = rasterizer.upload(&draw.scene, parameterization)?;
                let mut staged = rasterizer.upload(&draw.scene, parameterization)?;
                let place = format!("{parameterization:?}, {blend:?}, {loss:?}, weighted {is_weighted}");
                for _ in 0..5 {
                    rasterizer.train_step(&mut fused, &draw.view, &target, &step).block_on()?;
                }
                let fused_losses = losses_of(rasterizer, &mut fused)?;
                let count = fused_losses.len();
                Failure::unless(count == 5, || format!("{place}: {count} losses of 5 steps"))?;
                for (steps, a) in (1..).zip(fused_losses) {
                    let pass = rasterizer.forward(&staged, &draw.view, &draw.settings).block_on()?;
                    let (b, gradients) = rasterizer.backward(&staged, pass, &target, &loss).block_on()?;
                    rasterizer.step(&mut staged, &gradients, &rates).block_on()?;
                    let close = (a - b).abs() <= FUSED_SHARE as f32 * b;
                    Failure::unless(close, || format!("{place}, step {steps}: the loss is {a} fused, {b} in stages"))?;
                }
                let [a, b] = [&fused, &staged].map(|splats| rasterizer.download(splats));
                let (a, b) = (a.block_on()?.rows(), b.block_on()?.rows());
                let start = draw.scene.rows();
                Failure::unless(a.gaussians.len() == 20, || format!("{place}: {} Gaussians", a.gaussians.len()))?;
                Failure::unless(a != start, || format!("{place}: five steps moved nothing"))?;
                for (g, (a, b)) in a.gaussians.iter().zip(&b.gaussians).enumerate() {
                    for i in (0..b.len()).filter(|&i| b[i].is_finite()) {
                        // In covariance factors a step in the mean is as long as the Gaussian, up
                        // to 6 px.
                        let moved =
                            5.0 * f64::from(rate_of(i, b.len(), &rates).learning_rate) * if i < 2 { 6.0 } else { 2.0 };
                        let tolerance = FUSED_SHARE * moved + 4.0 * f64::from(f32::EPSILON) * b[i].abs();
                        let name = S::parameter_name(i);
                        Failure::unless((a[i] - b[i]).abs() <= tolerance, || {
                            format!("{place}: {name} of Gaussian {g} is {} fused, {} in stages", a[i], b[i])
                        })?;
                    }
                }
            }
        }
    }
    Ok(())
}

/// The statistics sum ‖(∂L/∂u · W/2, ∂L/∂v · H/2)‖, u and v in pixels of the canvas, over the steps
/// in which a Gaussian is drawn, in separate and fused steps; nothing without statistics.
pub(crate) fn statistics_are_the_positional_gradients<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let still = Group::constant(1e-4);
    let rates = Adam::default().with(|s| {
        s.mean = still;
        s.scale = still;
        s.rotation = still;
        s.opacity = still;
        s.color = still;
    });
    let rates = rates.at(0.0);
    let own = Canvas::new(30, 24);
    let zoomed = Canvas::new(44, 20).showing(Vec2::new(4.0, 2.0), Vec2::new(22.0, 20.0));
    for blend in [Blend::Sum, Blend::Over] {
        for view in [own, zoomed] {
            let mut draw = Draw::new(Kind2d::Overlapping, blend, 10, (30, 24), 1600).through(view);
            draw.scene.push(gs_core::Gaussian2d { mean: Vec2::new(-500.0, 3.0), ..draw.scene.gaussian(0) });
            draw.settings.effects.statistics = Statistics::MeanGradient;
            let target = rasterizer.upload_target(&draw.target()?)?;
            let mut splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
            let mut expected = [0.0; 11];
            // Pixels of the canvas per unit of the plane; normalised device units per pixel.
            let pixels = view.scale().as_dvec2();
            let half = [f64::from(view.width) / 2.0, f64::from(view.height) / 2.0];
            for steps in 0..4 {
                let pass = rasterizer.forward(&splats, &view, &draw.settings).block_on()?;
                let (_, gradients) = rasterizer.backward(&splats, pass, &target, &Loss::L2).block_on()?;
                let rows = rasterizer.gradients(&splats, &gradients).block_on()?.rows_of_gradients();
                for (sum, row) in expected.iter_mut().zip(&rows) {
                    *sum += (row[0] / pixels.x * half[0]).hypot(row[1] / pixels.y * half[1]);
                }
                if steps % 2 == 0 {
                    rasterizer.step(&mut splats, &gradients, &rates).block_on()?;
                } else {
                    let settings = &draw.settings;
                    let step = TrainStep { settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
                    rasterizer.train_step(&mut splats, &view, &target, &step).block_on()?;
                }
            }
            let found = rasterizer.statistics(&splats).block_on()?;
            let place = format!("{blend:?}, {}x{} px", view.width, view.height);
            let visible: Vec<u32> = (0..11).map(|i| if i < 10 { 4 } else { 0 }).collect();
            Failure::unless(found.visible == visible, || format!("{place}: drawn in {:?} of 4 steps", found.visible))?;
            for (g, (a, &b)) in expected.iter().zip(&found.signal_sum).enumerate() {
                let close = (a - f64::from(b)).abs() <= STATISTICS_SHARE * a;
                Failure::unless(close && (*a > 0.0 || g == 10), || {
                    format!("{place}: Gaussian {g} has a gradient sum of {b} instead of {a}")
                })?;
            }

            draw.settings.effects.statistics = Statistics::None;
            let mut splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
            let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
            rasterizer.train_step(&mut splats, &view, &target, &step).block_on()?;
            let none = rasterizer.statistics(&splats).block_on()?.signal_sum == vec![0.0; 11];
            Failure::unless(none, || format!("{place}: statistics that were not enabled"))?;
        }
    }
    Ok(())
}

/// `solve_colors` approaches the least-squares solution, and changes nothing else; where pixels have
/// weights, it leaves no gradient of the weighted loss by the colours.
pub(crate) fn solved_colors_are_the_best<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for parameterization in PARAMETERIZATIONS {
        for (kind, count, size) in
            [(Kind2d::Typical, 16, (24, 18)), (Kind2d::Overlapping, 5, (20, 20)), (Kind2d::Tiny, 30, (9, 7))]
        {
            let mut draw = Draw::new(kind, Blend::Sum, count, size, 1700).on([0.3, 0.1, 0.2]);
            let image = draw.target()?;
            let target = rasterizer.upload_target(&image)?;
            let mut splats = rasterizer.upload(&draw.scene, parameterization)?;
            let before = rasterizer.download(&splats).block_on()?;
            rasterizer.solve_colors(&mut splats, &draw.view, &target, &draw.settings, 60).block_on()?;
            let after = rasterizer.download(&splats).block_on()?;
            let only_colors = Scene2d { colors: before.colors.clone(), ..after.clone() } == before;
            Failure::unless(only_colors, || "solving for colours changed something else".to_owned())?;

            let weights = weights_of(&image);
            let weighted = TargetImage { weights: Some(&weights), ..TargetImage::from(&image) };
            let weighted = rasterizer.upload_target(weighted)?;
            let slope = |splats: &R::Splats| -> Result<f32, Failure> {
                let pass = rasterizer.forward(splats, &draw.view, &draw.settings).block_on()?;
                let (_, gradients) = rasterizer.backward(splats, pass, &weighted, &Loss::L2).block_on()?;
                let by_colors = rasterizer.gradients(splats, &gradients).block_on()?.colors;
                Ok(by_colors.iter().map(|v| v.length_squared()).sum::<f32>().sqrt())
            };
            let otherwise = slope(&splats)?;
            rasterizer.solve_colors(&mut splats, &draw.view, &weighted, &draw.settings, 60).block_on()?;
            let left = slope(&splats)?;
            Failure::unless(left <= WEIGHTED_SLOPE * otherwise, || {
                format!(
                    "{parameterization:?}, {kind:?}: the weighted loss has a slope of {left:e} by the colours, {otherwise:e} with those of the loss without weights"
                )
            })?;

            draw.scene = before;
            let oracle = Oracle::new(draw.view, draw.settings)?;
            let start = OracleScene::from(&draw.scene);
            let best = oracle.loss(&best_colors(&oracle, &start, &image)?, &image, &Loss::L2)?;
            let [first, found] =
                [&start, &OracleScene::from(&after)].map(|scene| oracle.loss(scene, &image, &Loss::L2));
            let (first, found) = (first?, found?);
            let bound = best * (1.0 + LEAST_SQUARES[0]) + LEAST_SQUARES[1];
            Failure::unless(first > 1.05 * bound && found <= bound, || {
                format!(
                    "{parameterization:?}, {kind:?}: solving changed the loss from {first:e} to {found:e}, but {best:e} is possible"
                )
            })?;
        }
    }
    Ok(())
}
