//! Lists that are too long for a software driver's loops are errors there. GPUs have no such limit.

use glam::{Vec2, Vec3};
use gs_core::{Camera, Canvas, Gaussian2d, Gaussian3d, Scene3d, effects::Order};
use pollster::FutureExt as _;

use super::*;

/// Numbers between -½ and ½.
struct Numbers(u32);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (self.0 >> 8) as f32 / (1 << 24) as f32 - 0.5
    }
}

/// More entries than any kernel can loop over on Mesa's software driver.
const MANY: usize = 20_000;

/// `count` Gaussians in one tile, half a pixel wide and nearly transparent, so that the last ones
/// are visible.
fn in_one_tile(count: usize) -> (Scene2d, Canvas) {
    let mut numbers = Numbers(1);
    let gaussian = |_| Gaussian2d {
        mean: Vec2::new(8.0 + 15.0 * numbers.next(), 8.0 + 15.0 * numbers.next()),
        log_scale: Vec2::new(0.4, 0.5).map(f32::ln),
        rotation: 3.0 * numbers.next(),
        opacity_logit: -4.5,
        color: Vec3::new(numbers.next(), numbers.next(), numbers.next()),
    };
    ((0..count).map(gaussian).collect(), Canvas::new(16, 16))
}

fn cpu() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(2);
        s.level = None;
    }))
    .unwrap()
}

/// The relative difference of `found` from `expected`.
fn apart(found: &[f32], expected: &[f32]) -> f64 {
    let (mut squares, mut all) = (0.0, 0.0);
    for (found, expected) in found.iter().zip(expected) {
        squares += f64::from(found - expected).powi(2);
        all += f64::from(*expected).powi(2);
    }
    assert!(found.len() == expected.len() && all > 0.0, "there is nothing to compare");
    (squares / all).sqrt()
}

/// The image, and the gradients by means and colours.
fn outcome<R: Optimizer<Scene2d>>(
    r: &R,
    (scene, view): &(Scene2d, Canvas),
    settings: &RenderSettings,
) -> Result<[Vec<f32>; 3], Error> {
    let splats = r.upload(scene, Parameterization::ScaleRotation)?;
    let target = r.upload_target(&Image::filled(view.width, view.height, [0.3, 0.1, -0.2])?)?;
    let pass = r.forward(&splats, view, settings).block_on()?;
    let image = r.image(&pass).block_on()?.pixels().as_flattened().to_vec();
    let (_, gradients) = r.backward(&splats, pass, &target, &Loss::L2).block_on()?;
    let gradients = r.gradients(&splats, &gradients).block_on()?;
    let means = gradients.means.iter().flat_map(|mean| mean.to_array()).collect();
    Ok([image, means, gradients.colors.iter().flat_map(|color| color.to_array()).collect()])
}

/// Tolerance for rounding; the largest measured difference is 1.9e-6.
const APART: f64 = 1e-5;

fn same(found: [Vec<f32>; 3], expected: &[Vec<f32>; 3], what: &str) {
    for (k, (found, expected)) in found.iter().zip(expected).enumerate() {
        let apart = apart(found, expected);
        assert!(apart < APART, "{what}, {k}: {apart}");
    }
}

/// The limit that an error names: "… ends loops after 3276 of them …".
fn limit(error: &Error) -> usize {
    let text = error.to_string();
    assert!(text.contains(&MANY.to_string()) && text.contains("--backend cpu"), "{text}");
    let (_, rest) = text.split_once("ends loops after ").expect("the limit is named");
    rest.split_once(' ').unwrap().0.parse().unwrap()
}

#[test]
fn lists_up_to_the_limit_match_the_cpu_and_longer_ones_fail() {
    let long = in_one_tile(MANY);
    for blend in [Blend::Sum, Blend::Over] {
        let settings = RenderSettings::blended(blend).on([0.1, 0.2, 0.3]);
        for (kernels, r) in rasterizers() {
            let most = match outcome(r, &long, &settings) {
                Ok(found) => {
                    assert_ne!(r.adapter().kind, "CPU", "{kernels:?}: loops may have ended early, silently");
                    same(found, &outcome(&cpu(), &long, &settings).unwrap(), &format!("{kernels:?}, {blend:?}"));
                    continue;
                }
                Err(error) => limit(&error),
            };
            let longest = in_one_tile(most);
            let found = outcome(r, &longest, &settings).unwrap();
            same(found, &outcome(&cpu(), &longest, &settings).unwrap(), &format!("{kernels:?}, {blend:?}, {most}"));
            assert!(outcome(r, &in_one_tile(most + 1), &settings).is_err(), "{kernels:?}: {most} is not the limit");
        }
    }
}

/// Pending steps after it do not change anything, either.
#[test]
fn a_step_with_a_longer_list_changes_nothing() {
    let (scene, view) = in_one_tile(MANY);
    let aside = view.showing(Vec2::new(100.0, 0.0), Vec2::splat(16.0));
    let rates = rates();
    let settings = RenderSettings::blended(Blend::Over);
    for (kernels, r) in rasterizers().iter().filter(|(_, r)| r.adapter().kind == "CPU") {
        let target = r.for_2d().upload_target(&Image::filled(16, 16, [0.3, 0.1, 0.2]).unwrap()).unwrap();
        let mut splats = r.upload(&scene, Parameterization::ScaleRotation).unwrap();
        let before = r.save(&splats).block_on().unwrap();
        let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
        r.train_step(&mut splats, &view, &target, &step).block_on().unwrap();
        r.train_step(&mut splats, &aside, &target, &step).block_on().unwrap();
        let mut losses = Vec::new();
        limit(&r.losses(&mut splats, Wait::All, &mut losses).block_on().unwrap_err());
        assert!(
            losses.is_empty() && r.save(&splats).block_on().unwrap() == before,
            "{kernels:?}: the splats have changed"
        );

        // Training goes on with short lists.
        r.train_step(&mut splats, &aside, &target, &step).block_on().unwrap();
        r.losses(&mut splats, Wait::All, &mut losses).block_on().unwrap();
        assert_eq!(losses.len(), 1, "{kernels:?}");
    }
}

/// Lists may be longer with a sort at each pixel: queues are made 256 entries at a time, so the
/// limit is much larger.
#[test]
fn lists_may_be_longer_with_a_sort_at_each_pixel() {
    const MANY: usize = 70_000;
    let view = Camera::looking_forward(16, 16, 1.0);
    let mut scene = Scene3d::default();
    let mut numbers = Numbers(1);
    for _ in 0..MANY {
        let z = 6.0 + 2.0 * numbers.next();
        let size = z / view.focal.x;
        scene.push(Gaussian3d {
            mean: Vec3::new(numbers.next() * 15.0 * size, numbers.next() * 15.0 * size, z),
            log_scale: Vec3::new(0.4 * size, 0.5 * size, 0.0005).map(f32::ln),
            rotation: [1.0, 0.02 * numbers.next(), 0.02 * numbers.next(), 0.0],
            opacity_logit: -4.5,
            sh: vec![Vec3::new(numbers.next(), numbers.next(), numbers.next())],
        });
    }
    let image = |r: &dyn Fn(&RenderSettings) -> Image, order: Order| {
        let mut settings = RenderSettings::blended(Blend::Over);
        settings.effects.order = order;
        r(&settings).pixels().as_flattened().to_vec()
    };
    let (_, r) = &rasterizers()[0];
    let found = image(&|settings| r.render(&scene, &view, settings).block_on().unwrap(), Order::PerPixel);
    let on_cpu = |settings: &RenderSettings| cpu().render(&scene, &view, settings).block_on().unwrap();
    let expected = image(&on_cpu, Order::PerPixel);
    let of_others = apart(&image(&on_cpu, Order::Global), &expected);
    assert!(of_others > 3.0 * APART, "the order makes no difference: {of_others}");
    let apart = apart(&found, &expected);
    assert!(apart < APART, "{apart}");
}
