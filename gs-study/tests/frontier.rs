//! The frontier of accuracy against time, on scenes so small that times mean nothing: what is measured, what is said of it, and that whoever is
//! wrong or slow is seen to be.

use std::{rc::Rc, time::Duration};

use glam::{Vec2, Vec3};
use gs_core::{Blend, Canvas, Chart, Error, Image, PlanarGaussian, PlanarScene, Rasterizer, RenderSettings};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_study::frontier::{
    Budget, Change, Chosen, Comparison, Contender, Field, Frontier, Loaded, Pace, Renderer, Role, figure, search,
    to_csv, to_text,
};

const PACE: Pace = Pace { seconds: 0.3, combinations: 4 };

/// Overlapping discs whose tails the default's cut takes away.
fn scene() -> PlanarScene {
    let at = |i: u32| PlanarGaussian {
        mean: Vec2::new((i * 37 % 64) as f32, (i * 23 % 48) as f32),
        log_scale: Vec2::new(1.2 + 0.01 * i as f32, 1.6),
        rotation: 0.1 * i as f32,
        opacity_logit: 0.02 * i as f32,
        color: Vec3::new(0.3, 0.02 * (i % 20) as f32, 0.5),
    };
    (0..60).map(at).collect()
}

/// A renderer that takes longer, and whose every picture is off.
struct Handicapped<R>(R, Duration, f32);

impl<V, R: Renderer<V>> Renderer<V> for Handicapped<R> {
    fn seconds(&self, view: &V, settings: &RenderSettings) -> Result<f64, Error> {
        Ok(self.0.seconds(view, settings)? + self.1.as_secs_f64())
    }

    fn image(&self, view: &V, settings: &RenderSettings) -> Result<Image, Error> {
        let mut image = self.0.image(view, settings)?;
        image.pixels_mut()[100][1] += self.2;
        Ok(image)
    }
}

fn field(scene: &PlanarScene, blend: Blend) -> Field<'_, PlanarScene> {
    let contender = |value: Option<&str>, slower: Duration, off: f32| {
        let rasterizer = CpuRasterizer::new(CpuSettings { threads: Some(1), level: None }).unwrap();
        let cloud = Rc::new(rasterizer.planar().upload(scene, Chart::ScaleRotation).unwrap());
        Contender {
            backend: "cpu".to_owned(),
            name: "one thread".to_owned(),
            change: value.map(|value| Change { axis: "handicap".to_owned(), value: value.to_owned() }),
            renderer: Box::new(Handicapped(Loaded::<CpuRasterizer, PlanarScene> { rasterizer, cloud }, slower, off)),
        }
    };
    let (none, long) = (Duration::ZERO, Duration::from_millis(20));
    let contenders =
        vec![contender(None, none, 0.0), contender(Some("slow"), long, 0.0), contender(Some("wrong"), none, 0.25)];
    Field { scene, contenders, shown: RenderSettings::blended(blend) }
}

fn found(blend: Blend) -> Frontier {
    let scene = scene();
    search(&field(&scene, blend), &[Canvas::new(64, 48)], PACE, &mut |_| ()).unwrap()
}

fn row<'f>(frontier: &'f Frontier, name: &str) -> &'f gs_study::frontier::Measured {
    let row = frontier.rows.iter().find(|row| row.name() == name);
    row.unwrap_or_else(|| panic!("no row {name}"))
}

#[test]
fn errors_and_times_are_those_of_the_settings() {
    for blend in [Blend::Sum, Blend::Over] {
        let frontier = found(blend);
        assert!(frontier.uncertainty < 1e-5, "{}", frontier.uncertainty);
        // All, where the machine has the time.
        assert!((200..=64 * 48).contains(&frontier.sampled), "{}", frontier.sampled);
        let [exact, default, coarse] =
            ["no cut-offs", "default", "alpha cut 1/32"].map(|name| row(&frontier, name).error);
        assert!(exact.max < 1e-5 && exact.psnr() > 110.0, "{exact:?}");
        assert!(default.max > 1e-3 && default.max < 0.05, "{default:?}");
        assert!(coarse.max > 2.0 * default.max && coarse.share_visible > default.share_visible, "{coarse:?}");
        let wrong = row(&frontier, "handicap wrong");
        assert!((wrong.error.max - 0.25).abs() < 0.02, "{:?}", wrong.error);
        let slow = row(&frontier, "handicap slow");
        assert_eq!(slow.comparison, Comparison::Slower);
        assert!(slow.times().median > 0.02);
        assert!(!slow.on_frontier && !wrong.on_frontier);
        assert!(frontier.rows.iter().all(|row| row.seconds.len() >= 3), "too few rounds");
        assert_eq!(frontier.rows.iter().filter(|row| row.role == Role::Again).count(), 1);
    }
}

#[test]
fn each_step_of_the_frontier_is_more_exact_than_quicker_ones() {
    let frontier = found(Blend::Over);
    let steps = frontier.steps();
    assert!(!steps.is_empty());
    for (i, step) in steps.iter().enumerate() {
        let noise = frontier.noise_of("cpu");
        for quicker in &steps[..i] {
            let is_quicker = noise.compare(quicker.times().median, step.times().median) == Comparison::Faster;
            assert!(!is_quicker || quicker.error.max.max(1e-5) > step.error.max, "{} {}", quicker.name(), step.name());
        }
    }
}

#[test]
fn all_forms_of_the_result_have_all_rows() {
    let frontier = found(Blend::Sum);
    let (csv, text) = (to_csv(&frontier), to_text(&frontier));
    assert_eq!(csv.lines().count(), 1 + frontier.rows.len());
    for row in &frontier.rows {
        assert!(text.contains(&row.name()), "{}", row.name());
    }
    let svg = figure(&frontier, "a scene").svg_file().unwrap();
    for expected in ["a scene", "cpu: frontier", "default", "3DGS", "largest error"] {
        assert!(svg.contains(expected), "{expected}");
    }
}

#[test]
fn a_budget_is_kept_on_other_views_too_or_said_to_be_out_of_reach() {
    let scene = scene();
    let field = field(&scene, Blend::Over);
    let view = Canvas::new(64, 48);
    let frontier = search(&field, &[view], PACE, &mut |_| ()).unwrap();
    let unseen = [view.resized(40, 30), view.showing(Vec2::new(8.0, 8.0), Vec2::new(32.0, 24.0))];
    let choose = |budget: Budget| budget.choose(&field, &frontier, &unseen, 0.05).unwrap();
    let Chosen::Kept(choice) = choose(Budget::MaxError(2e-3)) else { panic!("out of reach") };
    assert!(choice.verification.error.max <= 2e-3 && choice.verification.views == 2);
    let row = &frontier.rows[choice.row];
    assert!(row.error.max <= 2e-3 && row.on_frontier);
    let Chosen::Kept(choice) = choose(Budget::MaxSeconds(10.0)) else { panic!("out of reach") };
    assert!(frontier.rows[choice.row].error.max < 1e-4, "ten seconds are enough for the most exact");
    let Chosen::OutOfReach(best) = choose(Budget::MaxError(1e-12)) else { panic!("rounding is more") };
    assert!(best > 1e-12 && best < 1e-5);
    assert!(matches!(choose(Budget::MaxSeconds(1e-9)), Chosen::OutOfReach(_)));
}

#[test]
fn nothing_to_look_at_is_an_error() {
    let scene = scene();
    assert!(search(&field(&scene, Blend::Sum), &[], PACE, &mut |_| ()).is_err());
}
