//! Scenes whose required effects are known.

use glam::Vec3;

use super::*;
use crate::{
    effects::required::{RequiredEffects, Requirement},
    math::sh,
    scene::{Gaussian3d, Scene, logit},
};

/// A round Gaussian two units ahead of the origin, or farther.
fn ball(x: f32, z: f32) -> Gaussian3d {
    Gaussian3d {
        mean: Vec3::new(x, 0.0, z),
        log_scale: Vec3::splat(0.05f32.ln()),
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: logit(0.8),
        sh: vec![Vec3::splat(0.3)],
    }
}

fn scene(degree: u8, gaussians: impl IntoIterator<Item = Gaussian3d>) -> Scene3d {
    let mut scene = Scene3d { sh_degree: degree, ..Scene3d::default() };
    gaussians.into_iter().for_each(|g| scene.push(g.with_degree(degree)));
    scene
}

fn required(scene: &Scene3d, views: &[Camera], wanted: &RenderSettings) -> RequiredEffects {
    Effects::required(scene, views, wanted).unwrap()
}

fn ahead() -> Camera {
    Camera::looking_forward(64, 48, 0.9)
}

fn wanted(order: Order) -> RenderSettings {
    let mut settings = RenderSettings::blended(Blend::Over).on([1.0; 3]);
    settings.effects = Effects { order, sh_degree: 3, antialias: Antialias::Dilate, ..settings.effects };
    settings
}

/// Two round Gaussians at the middle of the image, the second farther by less than depths are exact
/// to where coordinates are some tens.
fn nearly_level(camera: &Camera) -> Scene3d {
    let to_world = |p: Vec3| camera.rotation.transpose() * (p - camera.translation);
    let at = |z: f32| Gaussian3d { mean: to_world(Vec3::new(0.0, 0.0, z)), ..ball(0.0, 2.0) };
    scene(0, [at(2.0), at(2.0 + 3e-5)])
}

fn order_of(scene: &Scene3d, order: Order) -> (Order, String) {
    let found = required(scene, &[ahead()], &wanted(order));
    (found.settings.effects.order, found.decisions[0].reason.clone())
}

#[test]
fn gaussians_side_by_side_need_no_order() {
    let apart = scene(0, [ball(-0.6, 3.0), ball(0.6, 2.0)]);
    assert_eq!(order_of(&apart, Order::Global).0, Order::Index);
    assert_eq!(order_of(&apart, Order::PerPixel).0, Order::Index);
}

#[test]
fn the_order_of_the_scene_will_do_if_it_is_that_of_depth() {
    let sorted = scene(0, [ball(0.0, 2.0), ball(0.02, 3.0)]);
    assert_eq!(order_of(&sorted, Order::Global).0, Order::Index);
    let reversed = scene(0, [ball(0.0, 3.0), ball(0.02, 2.0)]);
    let (order, reason) = order_of(&reversed, Order::Global);
    assert_eq!(order, Order::Global);
    assert_eq!(reason, "2 of 2 Gaussians are hidden out of the order of the scene in view 1");
    // The Gaussians are a whole unit apart in depth, so that one depth each decides the order at
    // every pixel.
    let (order, reason) = order_of(&reversed, Order::PerPixel);
    assert_eq!(order, Order::Global);
    assert!(
        reason.starts_with("one depth a Gaussian will do: none interpenetrate in this view; but 2 of 2"),
        "{reason}"
    );
}

#[test]
fn depths_that_another_rounding_would_exchange_are_out_of_order() {
    let found =
        |scene: &Scene3d, camera: &Camera, order| required(scene, &[*camera], &wanted(order)).settings.effects.order;
    let turned = Camera {
        rotation: glam::Mat3::from_axis_angle(Vec3::new(1.0, 2.0, 3.0).normalize(), 0.7),
        translation: Vec3::new(3.0, -5.0, 40.0),
        ..ahead()
    };
    assert_eq!(found(&nearly_level(&turned), &turned, Order::Global), Order::Global);
    assert_eq!(found(&nearly_level(&turned), &turned, Order::PerPixel), Order::PerPixel);
    // Depths that are computed from the same numbers are equal everywhere: those of equal means,
    // and for a camera that looks along an axis those of means that are equal along it.
    let twice = |camera: &Camera| {
        let first = nearly_level(camera).gaussian(0);
        scene(0, [first.clone(), first])
    };
    assert_eq!(found(&twice(&turned), &turned, Order::Global), Order::Index);
    assert_eq!(found(&scene(0, [ball(0.0, 2.0), ball(0.01, 2.0)]), &ahead(), Order::Global), Order::Index);
}

#[test]
fn gaussians_through_each_other_need_the_depth_at_each_pixel() {
    let slanted = |angle: f32| Gaussian3d {
        log_scale: Vec3::new(0.3f32.ln(), 0.05f32.ln(), 0.01f32.ln()),
        rotation: [(angle / 2.0).cos(), 0.0, (angle / 2.0).sin(), 0.0],
        ..ball(0.0, 2.0)
    };
    let crossed = scene(0, [slanted(0.6), slanted(-0.6)]);
    let (order, reason) = order_of(&crossed, Order::PerPixel);
    assert_eq!(
        (order, reason.as_str()),
        (Order::PerPixel, "2 of 2 Gaussians interpenetrate others in depth in view 1")
    );
    // In a sum no Gaussian hides another.
    let mut sum = wanted(Order::PerPixel);
    sum.effects.blend = Blend::Sum;
    assert_eq!(required(&crossed, &[ahead()], &sum).settings.effects.order, Order::Index);
    // Nothing is known without a view.
    let blind = required(&crossed, &[], &wanted(Order::PerPixel));
    assert_eq!(blind.settings.effects.order, Order::PerPixel);
}

fn with_coefficient(k: usize, value: f32) -> Scene3d {
    let mut gaussian = ball(0.0, 2.0);
    gaussian.sh.resize(16, Vec3::ZERO);
    gaussian.sh[k].y = value;
    scene(3, [ball(0.3, 2.0), gaussian])
}

fn degree_of(scene: &Scene3d, views: &[Camera]) -> (RequiredEffects, u8) {
    let found = required(scene, views, &wanted(Order::Global));
    let degree = found.settings.effects.sh_degree;
    (found, degree)
}

#[test]
fn sh_are_required_by_what_they_change() {
    for (k, value, expected) in [(1, 0.0, 0), (2, 1e-3, 0), (2, 0.1, 1), (5, 2e-3, 0), (5, 0.1, 2), (15, 0.1, 3)] {
        let (found, degree) = degree_of(&with_coefficient(k, value), &[]);
        assert_eq!(degree, expected, "coefficient {k} of {value}: {}", found.decisions[2].reason);
    }
    let (found, _) = degree_of(&with_coefficient(2, 1e-3), &[]);
    assert_eq!(found.decisions[2].answer, Requirement::NotRequired);
    assert_eq!(found.decisions[2].reason, "higher coefficients change no pixel by more than 0.00049 in any view");
    let (found, _) = degree_of(&with_coefficient(5, 0.1), &[]);
    assert_eq!(found.decisions[2].answer, Requirement::InPart);
    assert_eq!(
        found.decisions[2].reason,
        "without it, the colours of 1 Gaussian change by up to 0.0631 in some direction"
    );
}

#[test]
fn sh_that_a_view_does_not_show_are_not_required() {
    // −C x: ahead, x is 0.
    let sideways = with_coefficient(3, 0.1);
    assert_eq!(degree_of(&sideways, &[]).1, 1);
    let (found, degree) = degree_of(&sideways, &[ahead()]);
    assert_eq!((degree, found.decisions[2].answer), (0, Requirement::NotRequired), "{}", found.decisions[2].reason);
    // Sums are more than one share each.
    let mut sum = wanted(Order::Index);
    sum.effects.blend = Blend::Sum;
    assert_eq!(required(&sideways, &[ahead()], &sum).settings.effects.sh_degree, 1);
    assert_eq!(required(&with_coefficient(3, 0.0), &[ahead()], &sum).settings.effects.sh_degree, 0);
}

#[test]
fn the_bound_holds_in_every_direction_and_is_reached() {
    let mut worst = 0.0f32;
    let mut sh = vec![Vec3::ZERO; 16];
    for (k, c) in sh.iter_mut().enumerate().skip(9) {
        c.x = if k == 12 { 1.0 } else { 0.0 };
    }
    let bound = sh::change_bound(2, &sh);
    for step in 0..=100 {
        let z = step as f32 / 50.0 - 1.0;
        let d = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
        worst = worst.max((sh::color(3, d, &sh)[0] - sh::color(2, d, &sh)[0]).abs());
    }
    // Y of degree 3 and order 0 is greatest at the poles, where all others of its degree are 0;
    // below ½ the colour is clamped.
    assert!(worst <= bound && worst > 0.999 * bound, "{worst} {bound}");
    assert_eq!(sh::change_bound(3, &sh), 0.0);
}

#[test]
fn antialiasing_stays_wherever_something_is_drawn() {
    let verdict = |scene: &Scene3d| {
        let found = required(scene, &[ahead()], &wanted(Order::Global));
        (found.settings.effects.antialias, found.decisions[3].reason.clone())
    };
    let wide = scene(0, [ball(0.0, 2.0)]);
    assert_eq!(verdict(&wide), (Antialias::Dilate, "it widens every Gaussian".to_owned()));
    let far = scene(0, [ball(0.0, 2.0), ball(0.0, 9.0)]);
    assert_eq!(verdict(&far), (Antialias::Dilate, "1 Gaussian is narrower than a pixel in view 1".to_owned()));
    let behind = scene(0, [ball(0.0, -2.0)]);
    assert_eq!(verdict(&behind), (Antialias::None, "nothing is drawn in this view".to_owned()));
}

#[test]
fn antialiasing_stays_where_nothing_is_drawn_because_of_it() {
    // A twentieth of a pixel wide, at a pixel's centre: Mip leaves a fortieth of its opacity, which
    // is less than the cut.
    let tiny = |z: f32| {
        let size = z / ahead().focal.x;
        let mean = Vec3::new(0.5 * size, 0.5 * size, z);
        Gaussian3d { mean, log_scale: Vec3::splat((0.05 * size).ln()), opacity_logit: logit(0.1), ..ball(0.0, z) }
    };
    let hidden = scene(0, [tiny(10.0), tiny(9.0)]);
    let found = |antialias| {
        let mut wanted = wanted(Order::Global);
        wanted.effects.antialias = antialias;
        let found = required(&hidden, &[ahead()], &wanted);
        (found.settings.effects.antialias, found.settings.effects.order, found.decisions[3].reason.clone())
    };
    let (antialias, order, reason) = found(Antialias::Mip);
    assert_eq!((antialias, order), (Antialias::Mip, Order::Index), "{reason}");
    assert_eq!(reason, "without it 2 Gaussians are drawn in view 1");
    // Where they are drawn, their order counts: the nearer one comes last.
    assert_eq!(found(Antialias::None).1, Order::Global);
}

#[test]
fn black_is_no_background() {
    let on = |color: [f32; 3]| required(&scene(0, [ball(0.0, 2.0)]), &[], &wanted(Order::Index).on(color));
    assert_eq!(on([0.0; 3]).decisions[4].answer, Requirement::NotRequired);
    let white = on([1.0; 3]);
    assert_eq!((white.decisions[4].answer, white.settings.background), (Requirement::Required, [1.0; 3]));
    assert!(white.decisions[4].reason.starts_with("1,1,1 shows"));
}

#[test]
fn impossible_views_show_nothing() {
    let broken = Camera { focal: glam::Vec2::ZERO, ..ahead() };
    let found = required(&scene(0, [ball(0.0, 2.0)]), &[broken], &wanted(Order::PerPixel));
    assert_eq!(found.settings.effects.order, Order::Index);
}
