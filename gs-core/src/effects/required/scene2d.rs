//! Effects that a 2D scene requires: no depth order and no SH; for the rest see the
//! [module](super).

use super::{Decision, RequiresEffects, background};
use crate::{
    constants::NARROW_PX,
    effects::{Antialias, Blend, Effect},
    scene::{Scene, Scene2d},
    settings::RenderSettings,
    view::Canvas,
    words::there_are,
};

impl RequiresEffects for Scene2d {
    fn decide(&self, views: &[Canvas], settings: &RenderSettings) -> [Decision; Effect::ALL.len()] {
        Effect::ALL.map(|effect| decide(self, effect, views, settings))
    }
}

fn decide(scene: &Scene2d, effect: Effect, views: &[Canvas], settings: &RenderSettings) -> Decision {
    let effects = &settings.effects;
    let off = effect.off(effects);
    match effect {
        Effect::Order => (off, "a 2D scene has no depth".to_owned()),
        Effect::ShDegree => (off, "a 2D Gaussian has one colour".to_owned()),
        Effect::Blend => match effects.blend {
            Blend::Sum => (off, "Gaussians are added up".to_owned()),
            Blend::Over if scene.is_empty() => (*effects, "the scene is empty".to_owned()),
            Blend::Over => (*effects, "one Gaussian may hide another".to_owned()),
        },
        Effect::Antialias => match (effects.antialias, narrow(scene, views)) {
            (Antialias::None, None) => (off, "the settings have none".to_owned()),
            (Antialias::None, Some(narrow)) => (off, format!("the settings have none, though {narrow}")),
            (_, None) => (*effects, "it widens every Gaussian".to_owned()),
            (_, Some(narrow)) => (*effects, narrow),
        },
        Effect::Background => background(settings),
    }
}

/// Number of Gaussians narrower than a pixel, in words, in the first view that has some.
fn narrow(scene: &Scene2d, views: &[Canvas]) -> Option<String> {
    views.iter().enumerate().find_map(|(number, canvas)| {
        let scale = canvas.scale().min_element();
        let width = |log_scale: &glam::Vec2| scale * log_scale.min_element().exp();
        let narrow = scene.log_scales.iter().filter(|log_scale| width(log_scale) < NARROW_PX).count();
        (narrow > 0).then(|| format!("{} narrower than a pixel in view {}", there_are(narrow, "Gaussian"), number + 1))
    })
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};

    use super::*;
    use crate::{
        effects::{Effects, Order, required::Requirement},
        scene::Gaussian2d,
    };

    fn scene() -> Scene2d {
        let gaussian = |x: f32| Gaussian2d {
            mean: Vec2::new(x, 8.0),
            log_scale: Vec2::new(1.0, 0.0),
            rotation: 0.4,
            opacity_logit: 0.0,
            color: Vec3::splat(0.5),
        };
        [gaussian(3.0), gaussian(9.0)].into_iter().collect()
    }

    #[test]
    fn a_2d_scene_has_no_depth_and_no_sh() {
        let mut wanted = RenderSettings::blended(Blend::Over).on([1.0; 3]);
        wanted.effects.order = Order::PerPixel;
        wanted.effects.sh_degree = 3;
        wanted.effects.antialias = Antialias::Mip;
        let found = Effects::required(&scene(), &[Canvas::new(16, 16)], &wanted).unwrap();
        let answers: Vec<Requirement> = found.decisions.iter().map(|verdict| verdict.answer).collect();
        use Requirement::{NotRequired, Required};
        assert_eq!(answers, [NotRequired, Required, NotRequired, Required, Required]);
        let expected = Effects { order: Order::Index, sh_degree: 0, ..wanted.effects };
        assert_eq!(found.settings, RenderSettings { effects: expected, ..wanted });
    }

    #[test]
    fn gaussians_become_narrow_where_the_picture_is_small() {
        let reason = |canvas: Canvas| {
            let wanted = RenderSettings::blended(Blend::Sum);
            Effects::required(&scene(), &[canvas], &wanted).unwrap().decisions[3].reason.clone()
        };
        assert_eq!(reason(Canvas::new(16, 16)), "the settings have none");
        let small = reason(Canvas::new(16, 16).resized(4, 4));
        assert!(small.contains("2 Gaussians are narrower than a pixel in view 1"), "{small}");
    }
}
