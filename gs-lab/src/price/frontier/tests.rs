//! Searches with real pictures and made-up times, so that no verdict depends on the machine.

use std::cell::Cell;

use super::{
    super::{Loaded, Renderer, machine::Candidate, noise::TimeComparison, picture_error::PictureError},
    Change, Frontier, Sweep,
    outcome::{Measured, Role},
    search,
};
use glam::{Vec2, Vec3};
use gs_conformance::oracle::Oracle;
use gs_core::{Accuracy, Blend, Canvas, Error, Gaussian2d, Image, RenderSettings, Scene2d};
use gs_cpu::{CpuRasterizer, CpuSettings};

const SECONDS: f64 = 0.3;

/// Overlapping discs whose tails the default's cut removes.
fn scene() -> Scene2d {
    let at = |i: u32| Gaussian2d {
        mean: Vec2::new((i * 37 % 64) as f32, (i * 23 % 48) as f32),
        log_scale: Vec2::new(1.2 + 0.01 * i as f32, 1.6),
        rotation: 0.1 * i as f32,
        opacity_logit: 0.02 * i as f32,
        color: Vec3::new(0.3, 0.02 * (i % 20) as f32, 0.5),
    };
    (0..60).map(at).collect()
}

/// A renderer with made-up times and an error of `off` in every picture.
struct Pretending {
    renderer: Loaded<Box<CpuRasterizer>, Scene2d>,
    /// Time added to all times, s.
    slower: f64,
    off: f32,
    calls: Cell<u32>,
}

impl Pretending {
    fn new(scene: &Scene2d, slower: f64, off: f32) -> Self {
        Self { renderer: loaded(scene), slower, off, calls: Cell::new(0) }
    }
}

impl Renderer<Canvas> for Pretending {
    /// Returns about 1 ms, less if less is drawn, and slightly different in each call.
    fn seconds(&self, _: &Canvas, settings: &RenderSettings) -> Result<f64, Error> {
        let call = self.calls.replace(self.calls.get() + 1);
        let accuracy = settings.accuracy;
        let drawn = |left_out: f32| 1.0 - 0.05 * f64::from(left_out.max(1e-9)).ln();
        let drawn = drawn(accuracy.alpha_cut) * drawn(accuracy.transmittance_min);
        Ok(1e-3 * drawn * (1.0 + 0.002 * f64::from(call % 7)) + self.slower)
    }

    fn image(&self, view: &Canvas, settings: &RenderSettings) -> Result<Image, Error> {
        let mut image = self.renderer.image(view, settings)?;
        image.pixels_mut()[100][1] += self.off;
        Ok(image)
    }
}

/// A renderer that does not support the settings for which the function returns true.
struct Choosy<R>(R, Refuses);

type Refuses = fn(&RenderSettings) -> bool;

impl<R> Choosy<R> {
    fn check(&self, settings: &RenderSettings) -> Result<(), Error> {
        if (self.1)(settings) {
            return Err(Error::Unsupported { backend: "choosy", effect: "what it does not like".to_owned() });
        }
        Ok(())
    }
}

impl<V, R: Renderer<V>> Renderer<V> for Choosy<R> {
    fn seconds(&self, view: &V, settings: &RenderSettings) -> Result<f64, Error> {
        self.check(settings)?;
        self.0.seconds(view, settings)
    }

    fn image(&self, view: &V, settings: &RenderSettings) -> Result<Image, Error> {
        self.check(settings)?;
        self.0.image(view, settings)
    }
}

fn loaded(scene: &Scene2d) -> Loaded<Box<CpuRasterizer>, Scene2d> {
    let settings = CpuSettings::default().with(|s| (s.threads, s.level) = (Some(1), None));
    Loaded::new(Box::new(CpuRasterizer::new(settings).unwrap()), scene).unwrap()
}

fn candidate<'a>(backend: &str, value: Option<&str>, renderer: impl Renderer<Canvas> + 'a) -> Candidate<'a, Canvas> {
    Candidate {
        backend: backend.to_owned(),
        name: "one thread".to_owned(),
        change: value.map(|value| Change { axis: "handicap".to_owned(), value: value.to_owned() }),
        renderer: Box::new(renderer),
    }
}

fn sweep(scene: &Scene2d, blend: Blend) -> Sweep<'_, Canvas> {
    let handicapped = |value: Option<&str>, slower, off| candidate("cpu", value, Pretending::new(scene, slower, off));
    let candidates =
        vec![handicapped(None, 0.0, 0.0), handicapped(Some("slow"), 0.02, 0.0), handicapped(Some("wrong"), 0.0, 0.25)];
    Sweep { candidates, shown: RenderSettings::blended(blend) }
}

fn found(blend: Blend) -> Frontier {
    let scene = scene();
    search(&sweep(&scene, blend), &[Canvas::new(64, 48)], SECONDS, &mut |_| ()).unwrap()
}

fn row<'f>(frontier: &'f Frontier, name: &str) -> &'f Measured {
    let row = frontier.rows.iter().find(|row| row.name() == name);
    row.unwrap_or_else(|| panic!("no row {name}"))
}

#[test]
fn errors_and_times_are_those_of_the_settings() {
    for blend in [Blend::Sum, Blend::Over] {
        let frontier = found(blend);
        let [fine, default, coarse] =
            ["alpha cut 1/4096", "default", "alpha cut 1/32"].map(|name| row(&frontier, name).error);
        assert!(fine.max > 0.0 && fine.max < default.max, "{fine:?}");
        assert!(default.max > 1e-3 && default.max < 0.05, "{default:?}");
        assert!(coarse.max > 2.0 * default.max && coarse.share_visible > default.share_visible, "{coarse:?}");
        let wrong = row(&frontier, "handicap wrong");
        assert!((wrong.error.max - 0.25).abs() < 0.02, "{:?}", wrong.error);
        let slow = row(&frontier, "handicap slow");
        assert_eq!(slow.comparison, TimeComparison::Slower);
        assert!(slow.median() > 0.02);
        assert!(!slow.on_frontier && !wrong.on_frontier);
        assert!(frontier.rows.iter().all(|row| row.seconds.samples.len() >= 3), "too few rounds");
        assert_eq!(frontier.rows.iter().filter(|row| row.role == Role::Again).count(), 1);
    }
}

#[test]
fn all_backends_are_compared_with_the_first_without_cut_offs() {
    let scene = scene();
    let candidates = vec![
        candidate("one", None, Pretending::new(&scene, 0.0, 0.0)),
        candidate("other", None, Pretending::new(&scene, 0.0, 0.25)),
    ];
    let sweep = Sweep { candidates, shown: RenderSettings::blended(Blend::Over) };
    let frontier = search(&sweep, &[Canvas::new(64, 48)], SECONDS, &mut |_| ()).unwrap();
    assert_eq!(frontier.reference, "one");
    let error = |backend: &str| {
        let is_own = |row: &&Measured| row.role == Role::Tightest && row.backend == backend;
        frontier.rows.iter().find(is_own).unwrap().error.max
    };
    assert_eq!(error("one"), 0.0);
    assert!((error("other") - 0.25).abs() < 1e-5, "{}", error("other"));
    let text = frontier.to_string();
    let has_reference = |line: &&str| line.contains("reference") && line.contains("no cut-offs");
    assert_eq!(text.lines().filter(has_reference).count(), 1, "{text}");
    assert!(text.contains("a rendering without cut-offs by one."), "{text}");
}

#[test]
fn a_search_says_before_it_starts_how_much_it_will_measure() {
    let (scene, mut lines) = (scene(), Vec::new());
    let frontier = search(&sweep(&scene, Blend::Sum), &[Canvas::new(64, 48)], SECONDS, &mut |line| {
        lines.push(line.to_owned());
    });
    let settings = frontier.unwrap().rows.len();
    let expected = format!("measuring {settings} settings in {} or more renderings of about ", 10 * settings);
    assert!(lines[0].starts_with(&expected) && lines[0].contains(" ms: about "), "{lines:?}");
}

#[test]
fn each_step_of_the_frontier_is_more_exact_than_quicker_ones() {
    let frontier = found(Blend::Over);
    let steps: Vec<_> = frontier.rows.iter().filter(|row| row.on_frontier).collect();
    assert!(!steps.is_empty());
    for (i, step) in steps.iter().enumerate() {
        let noise = frontier.noise[0].noise;
        for quicker in &steps[..i] {
            let is_quicker = noise.compare(quicker.median(), step.median()) == TimeComparison::Faster;
            assert!(!is_quicker || quicker.error.max.max(1e-5) > step.error.max, "{} {}", quicker.name(), step.name());
        }
    }
}

#[test]
fn all_forms_of_the_result_have_all_rows() {
    let frontier = found(Blend::Sum);
    let text = frontier.to_string();
    for row in &frontier.rows {
        assert!(text.contains(&row.name()), "{}", row.name());
    }
    let svg = frontier.svg("a scene");
    for expected in ["a scene", "cpu: best trade-offs", "cpu: other settings", "cpu: as in 3DGS", "largest error"] {
        assert!(svg.contains(expected), "{expected}");
    }
}

/// Settings that a backend does not support, alone or without cut-offs, are listed, and
/// the search goes on.
#[test]
fn unsupported_settings_are_listed_and_the_search_goes_on() {
    let scene = scene();
    let shown = RenderSettings::blended(Blend::Over);
    let refusals: [(Refuses, &str, &str); 2] = [
        (|settings| settings.accuracy.alpha_cut < 1e-5, "no cut-offs", "cpu"),
        (|settings| settings.accuracy.alpha_cut == 1.0 / 32.0, "alpha cut 1/32", "choosy"),
    ];
    for (refuses, expected, reference) in refusals {
        let candidates = vec![
            candidate("choosy", None, Choosy(Pretending::new(&scene, 0.0, 0.0), refuses)),
            candidate("cpu", None, Pretending::new(&scene, 0.0, 0.0)),
        ];
        let sweep = Sweep { candidates, shown };
        let frontier = search(&sweep, &[Canvas::new(64, 48)], SECONDS, &mut |_| ()).unwrap();
        assert_eq!(frontier.reference, reference);
        let refused: Vec<&str> = frontier.refused.iter().map(|refused| refused.what.as_str()).collect();
        assert!(refused.iter().any(|what| what.contains(expected)), "{expected}: {refused:?}");
        assert!(frontier.rows.iter().any(|row| row.backend == "choosy" && row.on_frontier));
        assert!(frontier.to_string().contains("not supported"));
    }
}

/// The reference picture differs from that of the 64-bit oracle only by rounding.
#[test]
fn a_rendering_without_cut_offs_matches_the_oracle() {
    let (scene, view) = (scene(), Canvas::new(64, 48));
    for blend in [Blend::Sum, Blend::Over] {
        let settings = RenderSettings::blended(blend).with(|s| s.accuracy = Accuracy::TIGHTEST);
        let shown = loaded(&scene).image(&view, &settings).unwrap();
        let expected = Oracle::new(view, settings).unwrap().render(&(&scene).into()).image();
        let error = PictureError::between(&shown, &expected).unwrap();
        assert!(error.max < 1e-5, "{error:?}");
    }
}

/// A picture with NaN or ∞ at any pixel has an infinite error.
#[test]
fn a_picture_with_nan_or_infinity_has_an_infinite_error() {
    let whole = Image::filled(64, 48, [0.5; 3]).unwrap();
    for broken in [f32::NAN, f32::INFINITY] {
        for at in [0, 1234, 64 * 48 - 1] {
            let mut picture = whole.clone();
            picture.pixels_mut()[at][2] = broken;
            let error = PictureError::between(&picture, &whole).unwrap();
            assert_eq!((error.max, error.mean), (f64::INFINITY, f64::INFINITY), "{broken} at {at}");
        }
    }
}

#[test]
fn nothing_to_look_at_is_an_error() {
    let scene = scene();
    assert!(search(&sweep(&scene, Blend::Sum), &[], SECONDS, &mut |_| ()).is_err());
}

#[test]
fn rendering_time_is_positive_and_finite() {
    let scene = scene();
    let seconds = loaded(&scene).seconds(&Canvas::new(64, 48), &RenderSettings::blended(Blend::Sum)).unwrap();
    assert!(seconds > 0.0 && seconds.is_finite(), "{seconds}");
}
