//! Tests of every initialiser: exact counts, finite scenes that equal random numbers repeat, and
//! the placement it is named for.

use glam::Vec2;
use gs_core::Scene;
use rand::SeedableRng;

use super::*;

fn all() -> [Init; 3] {
    [Init::Random(Random::default()), Init::Periphery(Periphery::default()), Init::Gradient(Guided::default())]
}

fn rng() -> Rng {
    Rng::seed_from_u64(7)
}

/// Dark, with a bright vertical band from column 40 to 56.
fn band() -> Image {
    Image::from_fn(96, 64, |x, _| if (40..56).contains(&x) { [0.9, 0.8, 0.1] } else { [0.2; 3] }).unwrap()
}

#[test]
fn scenes_have_exactly_the_count_and_are_finite_at_any_size() {
    for (width, height) in [(1, 1), (1, 9), (40, 3), (32, 32)] {
        let target = Image::from_fn(width, height, |x, y| [0.1 * x as f32, 0.5, 0.02 * y as f32]).unwrap();
        for init in all() {
            init.validate().unwrap();
            for count in [0, 1, 2, 37, 400] {
                for blend in [Blend::Sum, Blend::Over] {
                    let scene = init.scene(&target, count, blend, &mut rng());
                    assert_eq!(scene.len(), count, "{init:?} on {width}x{height}");
                    scene.validate().unwrap();
                    assert_eq!(scene.has_opacity(), blend == Blend::Over && count > 0);
                    let inside = |m: &Vec2| m.cmpge(Vec2::ZERO).all() && m.x <= width as f32 && m.y <= height as f32;
                    assert!(scene.means.iter().all(inside), "{init:?} on {width}x{height}");
                }
            }
        }
    }
}

#[test]
fn equal_random_numbers_give_equal_scenes() {
    for init in all() {
        let scene = |seed| init.scene(&band(), 50, Blend::Sum, &mut Rng::seed_from_u64(seed));
        assert_eq!(scene(3), scene(3), "{init:?}");
        assert_ne!(scene(3), scene(4), "{init:?}");
    }
}

#[test]
fn the_papers_start_is_large_and_its_cold_start_keeps_to_the_border() {
    let random = Init::Random(Random::default()).scene(&band(), 20, Blend::Over, &mut rng());
    assert!(random.log_scales.iter().all(|s| (s.exp() - 15.0).abs().max_element() < 1e-3));
    let cold = Init::Periphery(Periphery::default()).scene(&band(), 40, Blend::Over, &mut rng());
    let to_border = |m: &Vec2| m.x.min(m.y).min(96.0 - m.x).min(64.0 - m.y);
    assert!(cold.means.iter().all(|m| (to_border(m) - 0.5).abs() < 1e-3));
    for side in [Vec2::new(48.0, 0.5), Vec2::new(48.0, 63.5), Vec2::new(0.5, 32.0), Vec2::new(95.5, 32.0)] {
        assert!(cold.means.iter().any(|m| m.distance(side) < 10.0), "none near {side}");
    }
}

#[test]
fn a_guided_start_follows_the_image() {
    let near_edges = |m: &&Vec2| (m.x - 40.0).abs() < 5.0 || (m.x - 56.0).abs() < 5.0;
    let by_gradient = Init::default().scene(&band(), 100, Blend::Sum, &mut rng());
    let at_edges = by_gradient.means.iter().filter(near_edges).count();
    assert!(at_edges >= 85, "{at_edges} of 100 at the two edges");
    let upright = by_gradient.iter().filter(|g| (g.log_scale.x - g.log_scale.y).exp() > 2.0);
    let upright: Vec<f32> = upright.map(|g| g.rotation.abs()).collect();
    assert!(upright.len() >= 70 && upright.iter().all(|a| (a - std::f32::consts::FRAC_PI_2).abs() < 0.1));
}

#[test]
fn a_summed_start_is_near_a_flat_target() {
    let target = Image::filled(60, 60, [0.4, 0.6, 0.8]).unwrap();
    let scene = Init::default().scene(&target, 100, Blend::Sum, &mut rng());
    let at = Vec2::splat(30.0);
    let sum: Vec3 =
        scene.iter().map(|g| g.color * (-0.5 * (g.factor().inverse() * (at - g.mean)).length_squared()).exp()).sum();
    assert!((sum - Vec3::new(0.4, 0.6, 0.8)).abs().max_element() < 0.2, "{sum}");
}

#[test]
fn under_over_the_smallest_stand_in_front() {
    let scene = Init::default().scene(&band(), 100, Blend::Over, &mut rng());
    assert!(scene.log_scales.windows(2).all(|w| w[0].element_sum() <= w[1].element_sum()));
}

#[test]
fn settings_survive_serialisation_and_unknown_ones_are_refused() {
    for init in all() {
        let text = serde_json::to_string(&init).unwrap();
        assert_eq!(serde_json::from_str::<Init>(&text).unwrap(), init, "{text}");
    }
    let short = serde_json::from_str::<Init>(r#"{"kind": "random", "scale-px": 9, "colors": "target"}"#).unwrap();
    assert_eq!(short, Init::Random(Random { scale_px: 9.0, colors: Colors::Target, ..Random::default() }));
    assert!(serde_json::from_str::<Init>(r#"{"kind": "random", "size": 9}"#).is_err());
    assert!(serde_json::from_str::<Init>(r#"{"kind": "magic"}"#).is_err());
}

#[test]
fn impossible_settings_are_refused() {
    for bad in [
        Init::Random(Random { scale_px: 0.0, ..Random::default() }),
        Init::Periphery(Periphery { opacity: 1.0, ..Periphery::default() }),
        Init::Gradient(Guided { sigma_factor: f32::NAN, ..Guided::default() }),
        Init::Gradient(Guided { uniform_fraction: 1.5, ..Guided::default() }),
        Init::Gradient(Guided { max_aspect: 0.5, ..Guided::default() }),
    ] {
        assert!(matches!(bad.validate(), Err(Error::Setting { .. })), "{bad:?}");
    }
}
