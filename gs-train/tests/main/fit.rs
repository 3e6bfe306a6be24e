//! Whole fits: repeatable, within their budget, steerable, and honest when they fail.

use pollster::FutureExt as _;
use std::sync::Arc;

use crate::fixture_2d::{rasterizer, small_fit, small_target};
use glam::{Vec2, Vec3};
use gs_core::{Blend, Gaussian2d, Image, Loss, Rasterizer, RenderSettings, SavedState, Scene, Scene2d, logit};
use gs_density::{Grow, Mcmc, Noise, Policy, Signal};
use gs_train::{
    ColorSolve, Control, Error, Fit, FitSettings, FitSummary, FitTarget, ImageQuality, Init, InitialCount, MetricsLog,
    Observer, Outcome, Preset, Progress, Rounds, Trainer, Tune, fit,
    init::{Periphery, Random},
    paper_target,
};

#[test]
fn equal_seeds_give_equal_scenes_and_watching_changes_nothing() {
    let (rasterizer, target) = (rasterizer(), small_target());
    for blend in [Blend::Sum, Blend::Over] {
        let run = |seed, observer: &mut dyn Observer| {
            fit(&rasterizer, &target, small_fit(blend).with(|s| s.seed = seed), observer).block_on().unwrap().scene
        };
        let scene = run(1, &mut ());
        assert!(scene == run(1, &mut ()), "{blend:?}: not repeatable");
        assert!(scene == run(1, &mut MetricsLog::new(1)), "{blend:?}: watching changes the fit");
        assert!(scene != run(2, &mut ()), "{blend:?}: the seed makes no difference");
    }
}

#[test]
fn growth_by_residual_meets_the_budget_exactly() {
    let (rasterizer, target) = (rasterizer(), small_target());
    for (gaussians, iterations) in [(1, 10), (7, 50), (61, 5), (200, 150)] {
        let settings = FitSettings::for_image(gaussians, target.size(), iterations);
        let fit = fit(&rasterizer, &target, settings, &mut ()).block_on().unwrap();
        assert_eq!(fit.scene.len(), gaussians as usize, "{iterations} iterations");
        assert_eq!(fit.summary.gaussians, gaussians);
        fit.scene.validate().unwrap();
    }
}

#[test]
fn a_missed_budget_is_reported_with_the_reason() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let shortfall = |policy: &str, iterations| {
        let settings = small_fit(Blend::Over).with(|s| {
            s.policy = Policy::from_name(policy).unwrap();
            s.iterations = iterations;
        });
        let summary = fit(&rasterizer, &target, settings, &mut ()).block_on().unwrap().summary;
        if let Some(shortfall) = &summary.shortfall {
            assert_eq!((shortfall.gaussians, shortfall.budget), (summary.gaussians, 60));
        }
        summary.shortfall
    };
    let slow = shortfall("mcmc", 42).unwrap();
    assert_eq!(slow.gaussians, 25, "{slow}");
    assert_eq!(
        slow.to_string(),
        "the run ends with 25 Gaussians of 60: policy `mcmc` turned the initial 20 into 25 in 3 rounds, 7.7 % more in each"
    );
    assert_eq!(shortfall("none", 42).unwrap().reason, "policy `none` adds no Gaussians");
    assert_eq!(shortfall("absolute", 5).unwrap().reason, "the run was too short for a round of density control");
    assert_eq!(shortfall("residual", 42), None);
}

#[test]
fn a_missed_budget_under_a_custom_policy_is_explained_by_its_growth() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let shortfall = |policy: Policy| {
        let settings = small_fit(Blend::Over).with(|s| s.iterations = 42);
        let trainer = Trainer::new(&rasterizer, &target, settings).block_on().unwrap();
        let mut trainer = trainer.controlled_by(Arc::new(policy));
        assert_eq!(trainer.shortfall(), None, "the run is not finished");
        trainer.run(&mut ()).block_on().unwrap();
        let (image, culled) = trainer.render().block_on().unwrap();
        let summary = FitSummary::new(&trainer, &image, culled).block_on().unwrap();
        assert_eq!(summary.shortfall, trainer.shortfall());
        summary.shortfall.map(|shortfall| shortfall.to_string())
    };
    assert_eq!(
        shortfall(Policy::Mcmc(Mcmc::default())).unwrap(),
        "the run ends with 25 Gaussians of 60: the custom policy turned the initial 20 into 25 in 3 rounds, 7.7 % more in each"
    );
    let none = shortfall(Policy::None).unwrap();
    assert_eq!(none, "the run ends with 20 Gaussians of 60: the custom policy added no Gaussians in 3 rounds");
}

#[test]
fn a_fit_is_judged_by_the_picture_that_is_written_of_it() {
    let target = small_target().rounded_to_8_bits();
    let Fit { image, summary, scene, .. } =
        fit(&rasterizer(), &target, FitSettings::for_image(200, (48, 40), 150), &mut ()).block_on().unwrap();
    let written = ImageQuality::between(&image.rounded_to_8_bits(), &target).unwrap();
    let FitSummary { psnr, ssim, ms_ssim, l1, .. } = summary;
    assert_eq!((psnr, ssim, ms_ssim, l1), (written.psnr, written.ssim, written.ms_ssim, written.l1));
    assert!((psnr - summary.psnr_float).abs() > 1e-3, "{psnr} and {}", summary.psnr_float);
    // The loss is that of the scene, which another trainer finds, too.
    let again = Trainer::from_scene(
        &rasterizer(),
        &target,
        &scene,
        summary.settings.with(|s| s.color_solve = ColorSolve::default()),
    )
    .block_on()
    .unwrap()
    .summary()
    .block_on()
    .unwrap()
    .loss
    .unwrap();
    assert!((again / summary.loss.unwrap() - 1.0).abs() < 1e-3, "{again} {:?}", summary.loss);
    let float = 10f64.powf(-summary.psnr_float / 10.0);
    assert!((f64::from(again) / float - 1.0).abs() < 0.05, "{again} {float}");
}

#[test]
fn a_picture_of_one_colour_is_exact_and_details_on_it_nearly() {
    let psnr = |target: &Image| {
        let settings = FitSettings::for_image(60, target.size(), 100).before_flat_color(target);
        fit(&rasterizer(), target, settings, &mut ()).block_on().unwrap().summary.psnr
    };
    for color in [[1.0; 3], [0.0; 3], [0.2, 0.4, 0.8]] {
        assert_eq!(psnr(&Image::filled(60, 44, color).unwrap()), f64::INFINITY, "{color:?}");
    }
    let spot = |x: u32, y: u32| if (30..35).contains(&x) && (20..24).contains(&y) { [0.2, 0.0, 0.8] } else { [1.0; 3] };
    let spotted = psnr(&Image::from_fn(60, 44, spot).unwrap());
    assert!(spotted > 55.0, "{spotted}");
}

/// Faint stripes on the left, strong squares on the right.
fn faint_and_strong() -> Image {
    let strong = |x: u32, y: u32| ((x / 2) * (y / 2)) % 7;
    let value = |x: u32, y: u32| match x < 48 {
        true => 0.5 + 0.04 * (0.9 * x as f32 + 0.4 * y as f32).sin(),
        false => 0.1 + 0.8 * strong(x, y) as f32 / 6.0,
    };
    Image::from_fn(96, 64, |x, y| [value(x, y); 3]).unwrap()
}

#[test]
fn a_fit_tuned_for_ssim_gains_it_and_costs_psnr() {
    let target = faint_and_strong();
    let summary = |tune| {
        let settings = FitSettings::for_image(250, target.size(), 100).with(|s| s.tune = tune);
        fit(&rasterizer(), &target, settings, &mut ()).block_on().unwrap().summary
    };
    let [plain, tuned] = [Tune::Psnr, Tune::Ssim].map(summary);
    assert!(tuned.ssim > plain.ssim + 0.02, "{} {}", plain.ssim, tuned.ssim);
    assert!(tuned.psnr < plain.psnr, "{} {}", plain.psnr, tuned.psnr);

    let dssim = FitSettings::default().with(|s| (s.tune, s.loss) = (Tune::Ssim, Loss::PAPER));
    let error = dssim.validate().unwrap_err().to_string();
    assert!(error.contains("tune") && error.contains("l1-dssim"), "{error}");
}

#[test]
fn a_fit_spends_its_gaussians_where_pixels_count() {
    let target = faint_and_strong();
    let weights: Vec<f32> = (0..96 * 64).map(|i| if i % 96 < 48 { 0.0 } else { 1.0 }).collect();
    let settings = FitSettings::for_image(250, target.size(), 100);
    let squares = |target: FitTarget<'_>| -> f64 {
        let found = fit(&rasterizer(), target, settings.clone(), &mut ()).block_on().unwrap().image;
        let pixels = found.pixels().iter().zip(target.image.pixels()).zip(&weights);
        pixels.filter(|(_, weight)| **weight > 0.0).map(|((c, y), _)| f64::from(c[0] - y[0]).powi(2)).sum()
    };
    let plain = squares(FitTarget::from(&target));
    let weighted = squares(FitTarget { image: &target, weights: Some(&weights) });
    assert!(weighted < 0.9 * plain, "{plain} {weighted}");
    let of_weights = FitTarget { image: &target, weights: Some(&weights) };
    let cpu = rasterizer();
    let checkpoint =
        Trainer::new(&cpu, of_weights, settings.clone()).block_on().unwrap().checkpoint().block_on().unwrap();
    assert!(matches!(Trainer::resume(&cpu, &target, checkpoint.clone()), Err(Error::WrongTarget { .. })));
    Trainer::resume(&cpu, of_weights, checkpoint).unwrap();
    let under_dssim = settings.clone().with(|s| s.loss = Loss::PAPER);
    assert!(Trainer::new(&cpu, of_weights, under_dssim).block_on().is_err());
    let short = FitTarget { image: &target, weights: Some(&weights[1..]) };
    assert!(fit(&rasterizer(), short, settings.clone(), &mut ()).block_on().is_err());
}

#[test]
fn every_policy_fits_within_its_budget() {
    let (rasterizer, target) = (rasterizer(), small_target());
    for blend in [Blend::Sum, Blend::Over] {
        let psnr =
            |settings: FitSettings| fit(&rasterizer, &target, settings, &mut ()).block_on().unwrap().summary.psnr;
        let before = psnr(small_fit(blend).with(|s| s.iterations = 0));
        for name in Policy::NAMES {
            let policy = Policy::from_name(name).unwrap();
            let settings = small_fit(blend).with(|s| s.policy = policy);
            if settings.validate().is_err() {
                assert!(["fastgs", "taming", "improved-gs", "steep-gs", "mrnf"].contains(&name), "{name}");
                continue;
            }
            let fit = fit(&rasterizer, &target, settings.clone(), &mut ()).block_on().unwrap();
            fit.scene.validate().unwrap();
            assert!(fit.scene.len() <= settings.gaussians as usize, "{blend:?} {name}: {}", fit.scene.len());
            if ["residual", "image-gs"].contains(&name) {
                assert_eq!(fit.scene.len(), settings.gaussians as usize, "{blend:?} {name}");
            }
            let psnr = fit.summary.psnr;
            assert!(psnr > before, "{blend:?} {name}: {before} dB became {psnr} dB");
        }
    }
}

#[test]
fn a_governed_fit_ends_with_exactly_its_budget() {
    let (rasterizer, target) = (rasterizer(), small_target());
    for name in Policy::NAMES {
        let policy = Policy::from_name(name).unwrap();
        let settings = small_fit(Blend::Over).with(|s| {
            s.policy = policy;
            s.exactly = true;
        });
        if settings.validate().is_err() {
            continue; // for 3D only
        }
        let fit = fit(&rasterizer, &target, settings.clone(), &mut ()).block_on().unwrap();
        assert_eq!(fit.scene.len(), settings.gaussians as usize, "{name}");
    }
}

#[test]
fn noise_moves_transparent_gaussians_and_only_with_a_strength() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let run = |noise, blend| {
        let faint = |i: usize| Gaussian2d {
            mean: Vec2::new(4.0 + 8.0 * (i % 6) as f32, 5.0 + 10.0 * (i / 6) as f32),
            log_scale: Vec2::new(1.5, 1.0),
            rotation: 0.3 * i as f32,
            opacity_logit: if blend == Blend::Over { logit(0.006) } else { f32::INFINITY },
            color: Vec3::splat(0.5),
        };
        let scene: Scene2d = (0..24).map(faint).collect();
        let policy = Policy::Mcmc(Mcmc::default().with(|s| s.noise = noise));
        let settings = small_fit(blend).with(|s| s.policy = policy);
        let mut trainer = Trainer::from_scene(&rasterizer, &target, &scene, settings).block_on().unwrap();
        trainer.run(&mut ()).block_on().unwrap();
        trainer.scene().block_on().unwrap()
    };
    let noise = Noise::default();
    assert!(run(noise, Blend::Over) != run(Noise::NONE, Blend::Over), "noise makes no difference");
    assert!(run(noise, Blend::Over) == run(noise, Blend::Over), "noise is not repeatable");
    assert!(run(noise, Blend::Sum) == run(Noise::NONE, Blend::Sum), "noise without opacities");
}

#[test]
fn noise_is_that_of_the_policy_in_charge() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let init = Init::Random(Random::default().with(|s| {
        s.opacity = 0.006;
        s.scale_px = 5.0;
    }));
    let still = small_fit(Blend::Over).with(|s| {
        s.init = init;
        s.policy = Policy::None;
        s.rounds = Rounds::NEVER;
    });
    let noisy = still.clone().with(|s| s.policy = Policy::Mcmc(Mcmc::default()));
    let run = |settings: &FitSettings, other: Option<&FitSettings>| {
        let mut trainer = Trainer::new(&rasterizer, &target, settings.clone()).block_on().unwrap();
        if let Some(other) = other {
            trainer = trainer.controlled_by(Arc::new(other.policy.clone()));
        }
        trainer.run(&mut ()).block_on().unwrap();
        trainer.scene().block_on().unwrap()
    };
    assert!(run(&noisy, None) != run(&still, None), "noise makes no difference");
    assert_eq!(run(&still, Some(&noisy)), run(&noisy, None));
    assert_eq!(run(&noisy, Some(&still)), run(&still, None));
}

#[test]
fn no_steps_leave_the_initial_scene() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let settings = small_fit(Blend::Sum).with(|s| s.iterations = 0);
    let fit = fit(&rasterizer, &target, settings, &mut ()).block_on().unwrap();
    assert_eq!((fit.outcome, fit.scene.len()), (Outcome::Finished, 20));
    assert!(fit.summary.loss.is_some_and(|loss| loss > 0.0), "that of the scene, though no step was made");
}

#[test]
fn an_image_of_one_pixel_can_be_fitted() {
    let target = Image::filled(1, 1, [0.25, 0.5, 0.75]).unwrap();
    for preset in Preset::ALL {
        let settings = preset.settings(3, target.size()).with(|s| s.iterations = 60);
        let settings = settings.with(|s| s.initial = InitialCount::Fixed(1));
        let fit = fit(&rasterizer(), &target, settings, &mut ()).block_on().unwrap();
        assert!(fit.summary.psnr > 20.0, "{preset}: {} dB", fit.summary.psnr);
        assert_eq!(fit.summary.ms_ssim, None);
    }
}

#[test]
fn the_log_has_every_edit_and_the_end_of_the_fit() {
    let (rasterizer, target) = (rasterizer(), small_target());
    let mut log = MetricsLog::new(7);
    let fit = fit(&rasterizer, &target, small_fit(Blend::Sum), &mut log).block_on().unwrap();
    let steps: Vec<u32> = log.rows().iter().map(|r| r.step).collect();
    assert_eq!(steps, [1, 7, 10, 14, 20, 21, 28, 30, 35, 42]);
    let mut edits = gs_core::edit::EditCounts::default();
    log.rows().iter().for_each(|r| edits.accumulate(&r.edits));
    assert_eq!(edits, fit.summary.edits);
    assert_eq!(20 + edits.added() - edits.pruned(), 60);
    let last = log.rows().last().unwrap();
    assert_eq!((last.count, last.step), (fit.summary.gaussians, fit.summary.iterations));
    let (psnr, first_psnr) = (last.psnr.unwrap(), log.rows()[0].psnr.unwrap());
    assert!((psnr - fit.summary.psnr).abs() < 1e-3, "{psnr} {}", fit.summary.psnr);
    assert!((last.l1.unwrap() - fit.summary.l1).abs() < 1e-6);
    assert!(psnr > first_psnr + 3.0);
    let csv = log.to_csv();
    assert_eq!(csv.lines().count(), 11);
    let columns: Vec<usize> = csv.lines().map(|l| l.split(',').count()).collect();
    assert!(columns.iter().all(|&c| c == columns[0]), "{csv}");
}

#[test]
fn the_quality_is_measured_in_few_rows_and_for_the_log_alone() {
    /// Measures the quality after every step.
    struct Curious;
    impl Observer for Curious {
        fn wants_quality(&mut self, _: &Progress) -> bool {
            true
        }
    }
    let (rasterizer, target) = (rasterizer(), small_target());
    let settings = small_fit(Blend::Sum).with(|s| s.iterations = 230);
    let mut log = MetricsLog::for_steps(settings.iterations);
    let mut watched = log.clone();
    fit(&rasterizer, &target, settings.clone(), &mut log).block_on().unwrap();
    fit(&rasterizer, &target, settings, &mut (&mut watched, Curious)).block_on().unwrap();
    let measured = |log: &MetricsLog| -> Vec<u32> {
        log.rows().iter().filter(|r| r.psnr.is_some() && r.l1.is_some()).map(|r| r.step).collect()
    };
    assert_eq!(measured(&log), [1].into_iter().chain((10..=230).step_by(10)).collect::<Vec<_>>());
    assert_eq!(measured(&watched), measured(&log));
    assert_eq!(log.rows().len(), 116, "the first and every second step; rounds fall on those");
}

#[test]
fn an_observer_stops_a_run_and_sees_the_checkpoints_it_wants() {
    #[derive(Default)]
    struct Watch {
        checkpoints: Vec<String>,
        edits: u32,
    }
    impl Observer for Watch {
        fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
            progress.step == 5
        }
        fn on_checkpoint(&mut self, checkpoint: &mut gs_io::Checkpoint<SavedState<'_>>) -> Result<(), Error> {
            self.checkpoints.push(checkpoint.metadata["step"].clone());
            Ok(())
        }
        fn on_step(&mut self, progress: &Progress) -> Control {
            self.edits += progress.edits.map_or(0, |counts| counts.added());
            if progress.step >= 13 { Control::Stop } else { Control::Continue }
        }
    }
    let mut watch = Watch::default();
    let fit = fit(&rasterizer(), &small_target(), small_fit(Blend::Sum), &mut watch).block_on().unwrap();
    assert_eq!((fit.outcome, fit.summary.iterations), (Outcome::Stopped, 16));
    assert_eq!(watch.checkpoints, ["8"]);
    assert!(watch.edits > 0 && watch.edits == fit.summary.edits.added());
}

#[test]
fn a_loss_that_is_not_finite_ends_the_run_and_names_a_suspect() {
    let mut settings = small_fit(Blend::Sum).with(|s| s.rounds = Rounds::NEVER);
    settings.adam.color.learning_rate = 1e38;
    let Err(Error::Diverged { step, loss, suspect }) =
        fit(&rasterizer(), &small_target(), settings, &mut ()).block_on().map(drop)
    else {
        panic!("the run did not diverge");
    };
    assert!(!loss.is_finite() && (1..=42).contains(&step));
    let suspect = suspect.expect("there are Gaussians");
    let (_, color) = suspect.parameters.iter().find(|(name, _)| *name == "colour").unwrap();
    assert!(color.iter().any(|v| !v.is_finite() || v.abs() > 1e30), "{suspect}");
}

#[test]
fn a_target_that_is_not_finite_is_refused() {
    let mut target = small_target();
    target.pixels_mut()[49][2] = f32::NAN;
    let error = Trainer::new(&rasterizer(), &target, small_fit(Blend::Sum)).block_on().unwrap_err().to_string();
    assert!(error.contains("(NaN) in column 1 of row 1"), "{error}");
}

#[test]
fn gaussians_that_reach_nothing_do_not_move() {
    // The paper's cold start (§3.4.1): Gaussians on the periphery that have its colour and do not
    // reach the shapes. The background is black, so that the rendering of the periphery equals the
    // target to the last bit.
    let rasterizer = rasterizer();
    let init = Init::Periphery(Periphery::default().with(|s| s.scale_px = 1.0));
    let mut settings = FitSettings::paper().with(|s| {
        s.init = init;
        s.initial = InitialCount::Fixed(40);
        s.iterations = 50;
        s.rounds = Rounds::until(10, 40);
        s.policy = Policy::Grow(Grow::percentile(Signal::MeanGradient));
        s.loss = Loss::L2;
    });
    settings.render = RenderSettings::blended(Blend::Over);
    let mut rng = <gs_density::Rng as rand::SeedableRng>::seed_from_u64(1);
    let mut target = paper_target();
    let within = 10..118;
    for (i, pixel) in target.pixels_mut().iter_mut().enumerate() {
        let is_seen = within.contains(&(i % 128)) && within.contains(&(i / 128));
        *pixel = pixel.map(|v| if is_seen { 1.0 - v } else { 0.0 });
    }
    let mut scene = settings.init.scene(&target, 40, Blend::Over, &mut rng);
    scene.colors.fill([0.0; 3].into());
    let mut trainer = Trainer::from_scene(&rasterizer, &target, &scene, settings).block_on().unwrap();
    let mut losses = Vec::new();
    while !trainer.is_finished() {
        trainer.step_once().block_on().unwrap();
        losses.extend_from_slice(trainer.new_losses().1);
    }
    assert_eq!(losses.len(), 50);
    assert!(losses.iter().all(|&l| l == losses[0] && l > 0.0), "{losses:?}");
    assert_eq!(trainer.scene().block_on().unwrap().means, scene.means);
    assert_eq!((trainer.count(), trainer.edits().added()), (40, 0));
}

#[test]
fn the_papers_experiment_reaches_its_count() {
    let rasterizer = rasterizer();
    let settings = FitSettings::paper();
    let render = settings.render;
    let fit = fit(&rasterizer, &paper_target(), settings, &mut ()).block_on().unwrap();
    assert!((500..=600).contains(&fit.summary.gaussians), "{} Gaussians", fit.summary.gaussians);
    assert!(fit.summary.psnr >= 40.0, "{} dB", fit.summary.psnr);
    let again = rasterizer.render(&fit.scene, &gs_core::Canvas::new(128, 128), &render).block_on().unwrap();
    assert_eq!(again, fit.image);
}
