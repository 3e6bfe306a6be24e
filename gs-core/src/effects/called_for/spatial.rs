//! What a spatial scene calls for, as the [module](super) has it.

use glam::Vec3;

use super::{CallsForEffects, Narrow, background, overlap::Shown};
use crate::{
    constants::HALF_DISPLAY_STEP,
    effects::{Antialias, Blend, Effect, Effects, Order},
    perspective::Perspective,
    scene::{SpatialScene, sigmoid},
    settings::RenderSettings,
    sh,
    view::Camera,
};

/// What is kept of the half step for the roundings of rendering.
const ROUNDING: f32 = 1e-5;

impl CallsForEffects for SpatialScene {
    fn decide(&self, effect: Effect, views: &[Camera], settings: &RenderSettings) -> (Effects, String) {
        let effects = settings.effects;
        match effect {
            Effect::Order => order(self, views, settings),
            Effect::Blend => match effects.blend {
                Blend::Sum => (effects, "Gaussians are added up, as is asked for".to_owned()),
                Blend::Over => (effects, "one Gaussian may hide another".to_owned()),
            },
            Effect::ShDegree => {
                let (degree, reason) = degree(self, views, settings);
                (Effects { sh_degree: degree, ..effects }, reason)
            }
            Effect::Antialias => antialias(self, views, settings),
            Effect::Background => background(settings),
        }
    }

    fn narrow(&self, camera: &Camera, settings: &RenderSettings) -> Narrow {
        let shown = Shown::of(self, camera, settings).drawn;
        Narrow { narrow: shown.iter().filter(|drawn| drawn.narrow).count(), shown: shown.len() }
    }
}

fn order(scene: &SpatialScene, views: &[Camera], settings: &RenderSettings) -> (Effects, String) {
    let effects = settings.effects;
    let off = Effect::Order.off(&effects);
    if effects.order == Order::Index {
        return (off, "none is asked for but the scene's own".to_owned());
    }
    if effects.blend == Blend::Sum {
        return (off, "sums do not depend on it".to_owned());
    }
    if views.is_empty() {
        return (effects, "without a view, nobody knows who hides whom".to_owned());
    }
    let mut left = effects;
    let mut reason = String::new();
    while let Some(cheaper) = Effect::Order.cheaper(&left) {
        let (what, so) = match left.order {
            Order::PixelDepth => {
                ("interpenetrate others in depth", "one depth a Gaussian will do: none interpenetrate")
            }
            _ => (
                "are hidden out of the order of the scene",
                "no depth order: nothing hides what the scene has before it",
            ),
        };
        for (number, camera) in views.iter().enumerate() {
            let shown = Shown::of(scene, camera, settings);
            let drawn = shown.drawn.len();
            match shown.out_of_order(left.order, cheaper.order) {
                Some(0) => {}
                Some(count) => {
                    let found = format!("{count} of {drawn} Gaussians {what} in view {}", number + 1);
                    return (left, if reason.is_empty() { found } else { format!("{reason}; but {found}") });
                }
                None => return (left, format!("{drawn} Gaussians overlap too much in view {} to tell", number + 1)),
            }
        }
        reason = format!("{so} {}", in_views(views));
        left = cheaper;
    }
    (left, reason)
}

/// The views, in words.
fn in_views(views: &[Camera]) -> String {
    match views {
        [] => "in any view".to_owned(),
        [_] => "in this view".to_owned(),
        _ => format!("in these {} views", views.len()),
    }
}

/// By how much leaving out harmonics changes colours.
#[derive(Debug, Clone, Copy, Default)]
struct Change {
    /// At most.
    most: f32,
    /// How many Gaussians change by more than they may.
    beyond: usize,
}

/// By how much the colours change, of all Gaussians that may be drawn, where nothing above degree 0, 1 or 2 is evaluated.
type Changes = [Change; 3];

/// Adds one Gaussian's, by the degree that is kept.
fn note(changes: &mut Changes, found: impl Fn(u8) -> f32, tolerance: f32) {
    for (degree, change) in (0..).zip(changes) {
        let found = found(degree);
        change.most = change.most.max(found);
        // NaN is beyond.
        change.beyond += usize::from(!(found <= tolerance));
    }
}

/// Over all directions.
fn changes_in_any_view(scene: &SpatialScene, settings: &RenderSettings, tolerance: f32) -> Changes {
    let mut changes = Changes::default();
    let kept = sh::coefficients(settings.effects.sh_degree.min(scene.sh_degree));
    for (of_one, &logit) in scene.sh.chunks_exact(scene.sh_len()).zip(&scene.opacity_logits) {
        if settings.effects.blend == Blend::Sum || sigmoid(logit) >= settings.accuracy.alpha_cut {
            note(&mut changes, |degree| sh::change_bound(degree, &of_one[..kept]), tolerance);
        }
    }
    changes
}

/// In the direction from which a view sees each.
fn changes_in(scene: &SpatialScene, camera: &Camera, settings: &RenderSettings, tolerance: f32) -> Changes {
    let mut changes = Changes::default();
    let highest = settings.effects.sh_degree.min(scene.sh_degree);
    let perspective = Perspective::new(camera, settings);
    for drawn in Shown::of(scene, camera, settings).drawn {
        let of_one = &scene.sh[drawn.index * scene.sh_len()..][..scene.sh_len()];
        let direction = perspective.direction(scene.means[drawn.index]);
        let color = |degree: u8| Vec3::from_array(sh::color(degree.min(highest), direction, of_one));
        let whole = color(highest);
        note(&mut changes, |degree| (color(degree) - whole).abs().max_element(), tolerance);
    }
    changes
}

/// The least degree that does, and why.
fn degree(scene: &SpatialScene, views: &[Camera], settings: &RenderSettings) -> (u8, String) {
    let highest = settings.effects.sh_degree.min(scene.sh_degree);
    // Sums may show a Gaussian's colour more than once.
    let tolerance = match settings.effects.blend {
        Blend::Sum => 0.0,
        Blend::Over => HALF_DISPLAY_STEP - ROUNDING,
    };
    let least = |changes: &Changes| {
        let does = |degree: &u8| *degree == highest || changes[usize::from(*degree)].beyond == 0;
        (0..=highest).find(does).unwrap_or(highest)
    };
    let does = |degree: u8, changes: &Changes, seen: &str| match changes.get(usize::from(degree)) {
        _ if degree == settings.effects.sh_degree => "no higher one is asked for".to_owned(),
        _ if degree == scene.sh_degree => "the scene has no higher one".to_owned(),
        Some(Change { most, .. }) if *most > 0.0 => {
            format!("higher coefficients change no pixel by more than {most:.5} {seen}")
        }
        _ => "higher coefficients are 0".to_owned(),
    };
    let does_not = |less: &Change, seen: &str| {
        let beyond = less.beyond;
        format!("without it, the colours of {beyond} Gaussians change by up to {:.4} {seen}", less.most)
    };

    let everywhere = changes_in_any_view(scene, settings, tolerance);
    let found = least(&everywhere);
    let Some(below) = usize::from(found).checked_sub(1) else { return (0, does(0, &everywhere, "in any view")) };
    if views.is_empty() || settings.effects.blend == Blend::Sum {
        return (found, does_not(&everywhere[below], "in some direction"));
    }
    let mut in_all = Changes::default();
    for (number, camera) in views.iter().enumerate() {
        let here = changes_in(scene, camera, settings, tolerance);
        if here[below].beyond > 0 {
            return (found, does_not(&here[below], &format!("in view {}", number + 1)));
        }
        for (all, here) in in_all.iter_mut().zip(here) {
            *all = Change { most: all.most.max(here.most), beyond: all.beyond + here.beyond };
        }
    }
    let found = least(&in_all);
    (found, does(found, &in_all, &in_views(views)))
}

fn antialias(scene: &SpatialScene, views: &[Camera], settings: &RenderSettings) -> (Effects, String) {
    let effects = settings.effects;
    let mut drawn = 0;
    for (number, camera) in views.iter().enumerate() {
        let Narrow { narrow, shown } = scene.narrow(camera, settings);
        drawn += shown;
        if narrow > 0 {
            let narrow = format!("{narrow} Gaussians are narrower than a pixel in view {}", number + 1);
            return match effects.antialias {
                Antialias::None => (effects, format!("none is asked for, though {narrow}")),
                _ => (effects, narrow),
            };
        }
    }
    match effects.antialias {
        Antialias::None => (effects, "none is asked for".to_owned()),
        _ if drawn == 0 && !views.is_empty() => {
            (Effect::Antialias.off(&effects), format!("nothing is drawn {}", in_views(views)))
        }
        _ => (effects, "it widens every Gaussian, as is asked for".to_owned()),
    }
}

#[cfg(test)]
mod tests;
