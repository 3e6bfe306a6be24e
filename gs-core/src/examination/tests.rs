//! Every finding is made where it should be and nowhere else, and a repair touches nothing that can
//! be drawn.

use glam::{Vec2, Vec3};

use super::*;
use crate::{
    effects::Blend,
    math::perspective::{Ellipsoid, Perspective},
    scene::{Gaussian2d, Gaussian3d, Scene, Scene2d, Scene3d},
    settings::RenderSettings,
    view::Camera,
};

fn scene_3d(x: f32) -> Gaussian3d {
    Gaussian3d {
        mean: Vec3::new(x, 1.0, 2.0),
        log_scale: Vec3::new(-1.0, -2.0, -9.0),
        rotation: [2.0, 0.0, 0.5, 0.0],
        opacity_logit: 0.5,
        sh: vec![Vec3::splat(0.25); 4],
    }
}

fn scene_2d(x: f32) -> Gaussian2d {
    Gaussian2d {
        mean: Vec2::new(x, 1.0),
        log_scale: Vec2::new(1.0, -1.0),
        rotation: 0.3,
        opacity_logit: f32::INFINITY,
        color: Vec3::splat(0.5),
    }
}

/// Ten sound Gaussians of degree 1, and between them a spoilt one, which is the fifth.
fn with_spoilt(spoil: impl Fn(&mut Gaussian3d)) -> Scene3d {
    let mut scene = Scene3d { sh_degree: 1, ..Default::default() };
    for i in 0..10 {
        if i == 4 {
            let mut spoilt = scene_3d(3.5);
            spoil(&mut spoilt);
            scene.push(spoilt);
        }
        scene.push(scene_3d(i as f32));
    }
    scene
}

#[test]
fn a_sound_scene_has_nothing_and_stays_bit_for_bit() {
    let scene = with_spoilt(|g| g.opacity_logit = f32::INFINITY);
    let examination = examine(&scene).unwrap();
    assert_eq!((examination.gaussians, examination.broken()), (11, 0));
    assert_eq!(examination.cases, []);
    let mut repaired = scene.clone();
    assert_eq!(repair(&mut repaired).unwrap(), Repair::default());
    assert_eq!(repaired, scene);
}

#[test]
fn each_fault_is_found_in_3d() {
    type Spoil = fn(&mut Gaussian3d);
    let cases: [(Finding, Spoil); 18] = [
        (Finding::MeanNotFinite, |g| g.mean.y = f32::NEG_INFINITY),
        (Finding::ScaleNotFinite, |g| g.log_scale.z = f32::NAN),
        (Finding::ScaleNotFinite, |g| g.log_scale.z = 89.0),
        (Finding::RotationNotFinite, |g| g.rotation[3] = f32::NAN),
        (Finding::OpacityNotANumber, |g| g.opacity_logit = f32::NAN),
        (Finding::ColorNotFinite, |g| g.sh[3].x = f32::NAN),
        (Finding::ColorNotFinite, |g| g.sh[0].y = f32::INFINITY),
        (Finding::NoRotation, |g| g.rotation = [0.0, -0.0, 1e-4, 0.0]),
        (Finding::ZeroScale, |g| g.log_scale.y = f32::NEG_INFINITY),
        (Finding::Vanishing, |g| g.log_scale = Vec3::splat(-20.0)),
        (Finding::Enormous, |g| g.log_scale = Vec3::new(44.5, 44.4, -2.0)),
        (Finding::Needle, |g| g.log_scale = Vec3::new(-1.0, 6.0, -2.0)),
        (Finding::Transparent, |g| g.opacity_logit = -6.0),
        (Finding::Transparent, |g| g.opacity_logit = f32::NEG_INFINITY),
        (Finding::OpacityOutOfRange, |g| g.opacity_logit = 1e4),
        (Finding::ExtremeColor, |g| g.sh[2].z = -2e3),
        (Finding::Outlier, |g| g.mean.z = 1e5),
        (Finding::Duplicate, |g| *g = Gaussian3d { opacity_logit: 2.0, sh: vec![Vec3::ZERO; 4], ..scene_3d(3.0) }),
    ];
    for (finding, spoil) in cases {
        let scene = with_spoilt(spoil);
        let examination = examine(&scene).unwrap();
        assert_eq!(examination.cases, [Case { finding, count: 1, first: 4 }], "{finding:?}");
        assert_eq!(examination.broken() > 0, finding.is_broken(), "{finding:?}");
        let mut repaired = scene.clone();
        let Repair { removed, widened } = repair(&mut repaired).unwrap();
        let remedy = finding.remedy();
        assert_eq!((removed, widened), (usize::from(remedy == Remedy::Remove), usize::from(remedy == Remedy::Widen)));
        assert_eq!(repaired.len(), 11 - removed);
        assert!(examine(&repaired).unwrap().broken() == 0 && repaired.validate().is_ok(), "{finding:?}");
        for index in (0..11).filter(|&index| index != 4) {
            let after = if index > 4 { index - removed } else { index };
            assert_eq!(repaired.gaussian(after), scene.gaussian(index), "{finding:?}");
        }
        if remedy == Remedy::Leave {
            assert_eq!(repaired, scene, "{finding:?}");
        }
    }
}

#[test]
fn each_fault_is_found_in_2d() {
    type Spoil = fn(&mut Gaussian2d);
    let cases: [(Finding, Spoil); 9] = [
        (Finding::MeanNotFinite, |g| g.mean.x = f32::NAN),
        (Finding::ScaleNotFinite, |g| g.log_scale.y = f32::INFINITY),
        (Finding::RotationNotFinite, |g| g.rotation = f32::INFINITY),
        (Finding::ColorNotFinite, |g| g.color.z = f32::NAN),
        (Finding::OpacityNotANumber, |g| g.opacity_logit = f32::NAN),
        (Finding::ZeroScale, |g| g.log_scale.x = f32::NEG_INFINITY),
        (Finding::Vanishing, |g| g.log_scale = Vec2::new(-4.0, -3.5)),
        (Finding::Needle, |g| g.log_scale = Vec2::new(7.0, -0.5)),
        (Finding::Duplicate, |g| *g = Gaussian2d { color: Vec3::ONE, ..scene_2d(1.0) }),
    ];
    for (finding, spoil) in cases {
        let mut gaussians: Vec<Gaussian2d> = (0..5).map(|i| scene_2d(i as f32)).collect();
        spoil(&mut gaussians[2]);
        let scene: Scene2d = gaussians.into_iter().collect();
        assert_eq!(examine(&scene).unwrap().cases, [Case { finding, count: 1, first: 2 }]);
        let mut repaired = scene.clone();
        repair(&mut repaired).unwrap();
        repaired.validate().unwrap();
        assert!(examine(&repaired).unwrap().broken() == 0);
    }
}

/// A Gaussian whose variance overflows may still be drawn, and stays; one whose scale overflows
/// cannot.
#[test]
fn a_distant_gaussian_that_is_drawn_stays_however_large() {
    let camera = Camera::looking_forward(64, 48, 1.0);
    let perspective = Perspective::new(&camera, &RenderSettings::blended(Blend::Over));
    let drawn = |log_scale: f32| {
        let log_scale = Vec3::new(log_scale, log_scale, 0.0);
        let g = Gaussian3d { mean: Vec3::new(0.0, 0.0, 2e12), log_scale, ..scene_3d(0.0) };
        let Gaussian3d { mean, rotation, opacity_logit, .. } = g;
        let is_drawn = perspective.project(&Ellipsoid { mean, log_scale, rotation, opacity_logit }).is_ok();
        let mut scene = Scene3d { sh_degree: 1, ..Default::default() };
        scene.push(g);
        let findings: Vec<Finding> = examine(&scene).unwrap().cases.iter().map(|case| case.finding).collect();
        repair(&mut scene).unwrap();
        (is_drawn, findings, scene.len())
    };
    assert_eq!(drawn(30.0), (true, vec![], 1));
    assert_eq!(drawn(44.5), (true, vec![Finding::Enormous], 1));
    assert_eq!(drawn(88.8), (false, vec![Finding::ScaleNotFinite], 0));
}

#[test]
fn a_gaussian_may_have_several_faults_and_goes_once() {
    let scene = with_spoilt(|g| {
        g.mean = Vec3::NAN;
        g.rotation = [0.0; 4];
        g.log_scale.x = f32::NEG_INFINITY;
    });
    let examination = examine(&scene).unwrap();
    let found: Vec<Finding> = examination.cases.iter().map(|case| case.finding).collect();
    assert_eq!(found, [Finding::MeanNotFinite, Finding::NoRotation, Finding::ZeroScale]);
    assert_eq!((examination.removed, examination.widened), (vec![4], vec![]));
}

#[test]
fn arrays_that_do_not_fit_are_refused_and_an_empty_scene_is_sound() {
    let mut scene = with_spoilt(|_| ());
    scene.sh.pop();
    assert!(matches!(examine(&scene), Err(Error::Length { what: "sh", .. })));
    assert!(matches!(repair(&mut scene), Err(Error::Length { .. })));
    assert!(examine(&Scene3d::default()).unwrap().broken() == 0);
    assert!(examine(&Scene2d::default()).unwrap().broken() == 0);
}

#[test]
fn a_repair_keeps_that_opacities_are_stored() {
    let mut scene: Scene2d =
        [scene_2d(0.0), Gaussian2d { opacity_logit: f32::NAN, ..scene_2d(1.0) }].into_iter().collect();
    repair(&mut scene).unwrap();
    assert_eq!(scene.opacity_logits, [f32::INFINITY]);
}

#[test]
fn the_smallest_scale_is_that_of_the_smallest_number() {
    assert_eq!(SMALLEST_LOG_SCALE, f64::from(f32::MIN_POSITIVE).ln() as f32);
}

#[test]
fn scales_and_opacities_without_logarithm_and_logit_are_suspected() {
    let findings = |scale: fn(f32) -> f32, opacity: fn(f32) -> f32| {
        let mut scene = Scene3d { sh_degree: 1, ..Default::default() };
        for i in 0..40 {
            let t = i as f32 / 40.0;
            let log_scale = Vec3::new(0.01 + 0.1 * t, 0.02, 0.005 + 0.01 * t).map(scale);
            scene.push(Gaussian3d { log_scale, opacity_logit: opacity(0.05 + 0.9 * t), ..scene_3d(5.0 * t) });
        }
        let examination = examine(&scene).unwrap();
        assert!(examination.broken() == 0 && examination.cases.iter().all(|case| case.count == 40));
        examination.cases.iter().map(|case| case.finding).collect::<Vec<_>>()
    };
    let logit = |opacity: f32| (opacity / (1.0 - opacity)).ln();
    assert_eq!(findings(f32::ln, logit), []);
    assert_eq!(findings(|scale| scale, logit), [Finding::ActivatedScale]);
    assert_eq!(findings(f32::ln, |opacity| opacity), [Finding::ActivatedOpacity]);
    assert_eq!(findings(|s| s, |o| o), [Finding::ActivatedScale, Finding::ActivatedOpacity]);
}

#[test]
fn whether_scales_are_suspected_depends_on_no_unit() {
    // Sizes from e⁻⁴ to e⁻¹·⁵ at places up to 2.5 from the middle.
    let is_suspected = |unit: f32, stored: fn(f32) -> f32| {
        let mut scene = Scene3d { sh_degree: 1, ..Default::default() };
        for i in 0..200 {
            let share = |k: i32| (i * k % 200) as f32 / 200.0;
            let log_scale = Vec3::new(share(1), share(7), share(13)).map(|t| stored(unit * (2.5 * t - 4.0).exp()));
            let mean = unit * (5.0 * Vec3::new(share(3), share(11), share(17)) - 2.5);
            scene.push(Gaussian3d { mean, log_scale, ..scene_3d(0.0) });
        }
        examine(&scene).unwrap().cases.iter().any(|case| case.finding == Finding::ActivatedScale && case.count == 200)
    };
    for unit in [1e-5, 0.001, 0.1, 1.0, 30.0, 1000.0, 1e6] {
        assert!(!is_suspected(unit, f32::ln), "logarithms in units of 1/{unit}");
        assert!(is_suspected(unit, |size| size), "sizes in units of 1/{unit}");
    }
}
