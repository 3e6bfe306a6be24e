//! Accuracy: every SIMD level of the CPU backend draws what the oracle draws; the oracle's fast and full renderings agree; and the effect of the
//! default cut-offs.

use gs_conformance::{
    Failure,
    conformance::{check_gradients, check_image},
    data,
    oracle::{Oracle, OracleView},
    scenes::{Draw, Kind2d, Kind3d},
    subject::Subject,
    tolerance::Agreement,
};
use gs_core::Rasterizer as _;
use gs_core::{
    Accuracy, Blend, Cut, Loss, Optimizer, Parameterization, RenderSettings, Scene2d, Scene3d,
    constants::HALF_DISPLAY_STEP,
    effects::{Antialias, Order},
};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
use pollster::FutureExt as _;

const BLENDS: [Blend; 2] = [Blend::Sum, Blend::Over];

fn cpu(level: SimdLevel) -> CpuRasterizer {
    let settings = CpuSettings::default().with(|s| {
        s.threads = Some(2);
        s.level = Some(level);
    });
    CpuRasterizer::new(settings).unwrap()
}

fn scene_2d(blend: Blend, seed: u64) -> Draw {
    Draw::new(Kind2d::Typical, blend, 30, (40, 30), seed)
}

fn scene_3d(blend: Blend, order: Order, seed: u64) -> Draw<Scene3d> {
    let mut draw = Draw::for_3d(Kind3d::Typical, blend, 30, (40, 30), seed);
    draw.settings.effects.order = order;
    draw
}

/// Compares image and gradients with the oracle. Drawings with nothing to compare do not count.
fn check<S: Subject>(cpu: &CpuRasterizer, draw: &Draw<S>) -> usize
where
    CpuRasterizer: Optimizer<S>,
{
    let judge = |result: Result<Agreement, Failure>| match result {
        Ok(_) => 1,
        Err(Failure::Nothing(_)) => 0,
        Err(failure) => panic!("{:?}: {failure}", draw.settings.accuracy),
    };
    judge(check_image(cpu, draw)) + judge(check_gradients(cpu, draw, &Loss::L2, Parameterization::ScaleRotation))
}

#[test]
fn every_simd_level_draws_what_the_oracle_draws() {
    let mut compared = 0;
    for level in SimdLevel::available() {
        let cpu = cpu(level);
        for blend in BLENDS {
            compared += check(&cpu, &scene_2d(blend, 31));
            compared += check(&cpu, &scene_3d(blend, Order::Global, 32));
        }
        compared += check(&cpu, &scene_3d(Blend::Over, Order::PerPixel, 33));
    }
    assert!(compared > 6 * SimdLevel::available().len(), "only {compared} comparisons");
}

#[test]
fn the_recurrence_along_many_rows_is_accurate() {
    let mut draw = scene_2d(Blend::Sum, 5);
    // Large Gaussians, which have many rows.
    draw.scene.log_scales.iter_mut().for_each(|s| *s += glam::Vec2::splat(2.5));
    let view = gs_core::Canvas::new(40, 300);
    let draw = draw.through(view);
    let exact = Oracle::new(draw.view, draw.settings).unwrap().render(&draw.scene.rows()).image();
    let cpu = cpu(SimdLevel::best());
    let image = cpu.for_2d().render(&draw.scene, &draw.view, &draw.settings).block_on().unwrap();
    let error = gs_core::metrics::mean_absolute_error(&image, &exact).unwrap();
    assert!(error < 1e-5, "{error:e}");
}

/// Compares every pixel of the oracle's two renderings.
fn same_colors<S: Subject>(draw: &Draw<S>) {
    let oracle = Oracle::new(draw.view, draw.settings).unwrap();
    let rows = draw.scene.rows();
    let rendering = oracle.render(&rows);
    let (width, height) = draw.view.size();
    let pixels: Vec<[u32; 2]> = (0..height).flat_map(|y| (0..width).map(move |x| [x, y])).collect();
    let colors = oracle.colors_at(&oracle.project(&rows), &pixels);
    let mut lit = 0;
    for (found, expected) in colors.iter().zip(&rendering.pixels) {
        for k in 0..3 {
            assert!((found[k] - expected[k]).abs() < 1e-12, "{:?}: {found:?} {expected:?}", draw.settings);
        }
        lit += usize::from(expected.iter().any(|&v| v > 0.01));
    }
    assert!(lit > 50, "an empty picture compares nothing");
}

#[test]
fn the_oracles_two_renderings_agree() {
    let tightest = Accuracy::TIGHTEST;
    let smooth = Accuracy::default().with(|s| s.cut = Cut::Smooth);
    for accuracy in [Accuracy::default(), Accuracy::THREE_DGS, tightest, smooth] {
        for blend in BLENDS {
            let mut draw: Draw<Scene2d> = scene_2d(blend, 3).on([0.1, 0.4, 0.2]);
            draw.settings.accuracy = accuracy;
            same_colors(&draw);
            for order in [Order::Index, Order::Global, Order::PerPixel] {
                let mut draw = scene_3d(blend, order, 4);
                draw.settings.accuracy = accuracy;
                same_colors(&draw);
            }
        }
    }
}

/// Cut-offs with a total effect below half a display step, unlike the default's. No pixel may count
/// as full: the Gaussian that would fill it does not contribute, so that up to 1/(1 − α) times the
/// minimum transmittance is missing.
const INVISIBLE: Accuracy = {
    let mut accuracy = Accuracy::TIGHTEST;
    accuracy.alpha_cut = 1.0 / 8192.0;
    accuracy
};

/// The largest differences by cut-offs at these pixels in the oracle: the default's, and
/// [`INVISIBLE`].
fn cut_off<S: Subject>(scene: &S, view: S::View, settings: RenderSettings, pixels: &[[u32; 2]]) -> [f64; 2] {
    let rows = scene.rows();
    let colors = |accuracy: Accuracy| {
        let oracle = Oracle::new(view, settings.with(|s| s.accuracy = accuracy)).unwrap();
        oracle.colors_at(&oracle.project(&rows), pixels)
    };
    let exact = colors(Accuracy::TIGHTEST);
    [Accuracy::default(), INVISIBLE].map(|accuracy| {
        let pairs = colors(accuracy).into_iter().zip(&exact);
        pairs.flat_map(|(a, b)| (0..3).map(move |k| (a[k] - b[k]).abs())).fold(0.0, f64::max)
    })
}

fn every_pixel((width, height): (u32, u32), step: usize) -> Vec<[u32; 2]> {
    (0..height).step_by(step).flat_map(|y| (0..width).step_by(step).map(move |x| [x, y])).collect()
}

#[test]
fn a_cut_of_an_8192nd_changes_no_pixel_by_half_a_display_step() {
    let (mut usual, mut fine) = (0.0f64, 0.0f64);
    let mut note = |[default, invisible]: [f64; 2]| {
        usual = usual.max(default);
        fine = fine.max(invisible);
    };
    // Under `Sum`, the cuts of n overlapping Gaussians add up, so no cut is invisible in every
    // scene.
    for (seed, blend) in [(11, Blend::Sum), (12, Blend::Over)] {
        let draw = scene_2d(blend, seed);
        note(cut_off(&draw.scene, draw.view, draw.settings, &every_pixel(draw.view.size(), 1)));
        let draw = scene_3d(blend, Order::Global, seed);
        note(cut_off(&draw.scene, draw.view, draw.settings, &every_pixel(draw.view.size(), 1)));
    }
    for name in ["kacytran_iter7000_point_cloud.ply", "biker.compressed.ply", "victor_model.splat"] {
        let Some(path) = data::find(&format!("splats/{name}")) else { continue };
        let scene = gs_io::read_3d(path).unwrap().scene;
        let mut settings = RenderSettings::blended(Blend::Over);
        settings.effects.order = Order::Global;
        settings.effects.antialias = Antialias::Dilate;
        settings.effects.sh_degree = scene.sh_degree;
        let view = gs_core::view::Bulk::of(&scene).unwrap().overview(320, 240, 1.0, glam::Vec3::NEG_Y).unwrap();
        let [default, invisible] = cut_off(&scene, view, settings, &every_pixel((320, 240), 24));
        eprintln!("{name}: the default's cut-offs change a pixel by {default:.1e}, the finer ones by {invisible:.1e}");
        note([default, invisible]);
    }
    assert!(fine < f64::from(HALF_DISPLAY_STEP), "{fine:e}");
    assert!(
        usual > f64::from(HALF_DISPLAY_STEP),
        "the default cut is invisible now, {usual:e}: update its documentation"
    );
}
