//! The SH degree that a scene requires: over all directions by a bound, in given views by the
//! colours seen there.

use glam::Vec3;

use super::in_views;
use crate::{
    constants::HALF_DISPLAY_STEP,
    counted,
    effects::{Blend, required::overlap::Shown},
    math::{perspective::Perspective, sh},
    scene::{Scene3d, sigmoid},
    settings::RenderSettings,
    view::Camera,
};

/// Part of the half step that is reserved for rounding errors of rendering.
const ROUNDING: f32 = 1e-5;

/// How leaving out SH coefficients changes colours.
#[derive(Debug, Clone, Copy, Default)]
struct Change {
    /// Largest change.
    most: f32,
    /// Number of Gaussians that change by more than the tolerance.
    beyond: usize,
}

/// Changes of colour where nothing above degree 0, 1 or 2 is evaluated.
type Changes = [Change; 3];

/// Adds one Gaussian's changes; `found` is its change by the degree that is kept.
fn note(changes: &mut Changes, found: impl Fn(u8) -> f32, tolerance: f32) {
    for (degree, change) in (0..).zip(changes) {
        let found = found(degree);
        change.most = change.most.max(found);
        // NaN is beyond.
        change.beyond += usize::from(!(found <= tolerance));
    }
}

/// Bounds on the changes over all directions.
fn changes_in_any_view(scene: &Scene3d, settings: &RenderSettings, tolerance: f32) -> Changes {
    let mut changes = Changes::default();
    let kept = sh::coefficients(settings.effects.sh_degree.min(scene.sh_degree));
    for (of_one, &logit) in scene.sh.chunks_exact(scene.sh_len()).zip(&scene.opacity_logits) {
        if settings.effects.blend == Blend::Sum || sigmoid(logit) >= settings.accuracy.alpha_cut {
            note(&mut changes, |degree| sh::change_bound(degree, &of_one[..kept]), tolerance);
        }
    }
    changes
}

/// What is known about the required degree, view by view.
pub(super) struct ShDegree<'a> {
    scene: &'a Scene3d,
    settings: &'a RenderSettings,
    /// Highest degree that is evaluated.
    highest: u8,
    tolerance: f32,
    everywhere: Changes,
    /// Changes in the views so far, where they may need a lower degree than all directions
    /// together.
    in_views: Option<Changes>,
    /// Why the views need the same degree.
    needed: Option<String>,
}

impl<'a> ShDegree<'a> {
    pub(super) fn of(scene: &'a Scene3d, views: &[Camera], settings: &'a RenderSettings) -> Self {
        let highest = settings.effects.sh_degree.min(scene.sh_degree);
        // Sums may show a Gaussian's colour more than once.
        let tolerance = match settings.effects.blend {
            Blend::Sum => 0.0,
            Blend::Over => HALF_DISPLAY_STEP - ROUNDING,
        };
        let everywhere = changes_in_any_view(scene, settings, tolerance);
        let mut found = Self { scene, settings, highest, tolerance, everywhere, in_views: None, needed: None };
        let may_need_less = !views.is_empty() && settings.effects.blend == Blend::Over;
        if may_need_less && found.least(&everywhere) > 0 {
            found.in_views = Some(Changes::default());
        }
        found
    }

    /// Whether further views make no difference.
    pub(super) fn is_settled(&self) -> bool {
        self.in_views.is_none() || self.needed.is_some()
    }

    /// Takes a view into account.
    pub(super) fn look(&mut self, number: usize, camera: &Camera, shown: &Shown) {
        if self.is_settled() {
            return;
        }
        let here = self.changes_in(camera, shown);
        let below = usize::from(self.least(&self.everywhere)) - 1;
        if here[below].beyond > 0 {
            self.needed = Some(without(&here[below], &format!("in view {number}")));
        }
        for (all, here) in self.in_views.iter_mut().flatten().zip(here) {
            *all = Change { most: all.most.max(here.most), beyond: all.beyond + here.beyond };
        }
    }

    /// Changes in the directions of one view.
    fn changes_in(&self, camera: &Camera, shown: &Shown) -> Changes {
        let Self { scene, settings, highest, tolerance, .. } = *self;
        let mut changes = Changes::default();
        let perspective = Perspective::new(camera, settings);
        for drawn in &shown.drawn {
            let of_one = &scene.sh[drawn.index * scene.sh_len()..][..scene.sh_len()];
            let direction = perspective.direction(scene.means[drawn.index]);
            let color = |degree: u8| Vec3::from_array(sh::color(degree.min(highest), direction, of_one));
            let whole = color(highest);
            note(&mut changes, |degree| (color(degree) - whole).abs().max_element(), tolerance);
        }
        changes
    }

    /// The least degree that is enough.
    fn least(&self, changes: &Changes) -> u8 {
        let does = |degree: &u8| *degree == self.highest || changes[usize::from(*degree)].beyond == 0;
        (0..=self.highest).find(does).unwrap_or(self.highest)
    }

    /// Why a degree is enough.
    fn does(&self, degree: u8, changes: &Changes, seen: &str) -> String {
        match changes.get(usize::from(degree)) {
            _ if degree == self.settings.effects.sh_degree => "the settings have no higher one".to_owned(),
            _ if degree == self.scene.sh_degree => "the scene has no higher one".to_owned(),
            Some(Change { most, .. }) if *most > 0.0 => {
                format!("higher coefficients change no pixel by more than {most:.5} {seen}")
            }
            _ => "higher coefficients are 0".to_owned(),
        }
    }

    /// The least degree that is enough in these views, all of which have been looked at, and the
    /// reason.
    pub(super) fn decided(self, views: &[Camera]) -> (u8, String) {
        let found = self.least(&self.everywhere);
        let Some(below) = usize::from(found).checked_sub(1) else {
            return (0, self.does(0, &self.everywhere, "in any view"));
        };
        match (self.needed.clone(), self.in_views) {
            (Some(needed), _) => (found, needed),
            (None, Some(changes)) => {
                let found = self.least(&changes);
                (found, self.does(found, &changes, &in_views(views)))
            }
            (None, None) => (found, without(&self.everywhere[below], "in some direction")),
        }
    }
}

/// Why a degree is too low.
fn without(less: &Change, seen: &str) -> String {
    let gaussians = counted(less.beyond, "Gaussian");
    format!("without it, the colours of {gaussians} change by up to {:.4} {seen}", less.most)
}
