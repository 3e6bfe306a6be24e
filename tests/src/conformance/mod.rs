//! The suite that any `Rasterizer<PlanarScene>` or `Rasterizer<SpatialScene>` can be put through: named cases, each usable alone.
//!
//! A backend's own tests call [`conformance`] or [`spatial_conformance`], or list [`cases`] or [`spatial_cases`] to see each by name.
//! Cases that are generic over [`Subject`] are the same for both kinds of scenes. Every case compares with the oracle, with `f64`
//! references, or with what the backend itself said before; none needs to know how the backend works.
//!
//! ```
//! use gs_conformance::{Failure, conformance::conformance};
//! use gs_core::{PlanarScene, Rasterizer};
//!
//! fn my_backend_conforms(backend: &impl Rasterizer<PlanarScene>) -> Result<(), Failure> {
//!     for skipped in conformance(backend)? {
//!         eprintln!("{skipped}");
//!     }
//!     Ok(())
//! }
//! ```

mod editing;
mod errors;
mod gradients;
mod images;
mod losses;
mod metamorphic;
mod optimiser;
mod spatial_errors;
mod spatial_frames;
mod spatial_gradients;
mod spatial_images;
mod spatial_metamorphic;
mod spatial_training;
mod state;
mod statistics;
mod training;

use std::fmt;

pub(crate) use self::errors::refused;
use gs_core::{
    Binning, Blend, Chart, CloudState, Error, Image, Loss, PlanarScene, Rasterizer, SpatialScene, TrainStep, Wait,
};

pub use self::{
    editing::{changes_that_inherit_go_on, edits_carry_everything_along, refused_edits_change_nothing},
    errors::{bad_views_and_settings_are_errors, mismatches_are_errors, scenes_that_are_not_finite_are_refused},
    gradients::{gradients_match, gradients_match_in_local_frames, gradients_match_through_canvases},
    images::{
        canvases_match, culled_are_counted, empty_scenes_show_the_background, images_match, other_accuracies_match,
        sizes_match,
    },
    losses::{losses_are_told_once_and_in_order, steps_under_way_are_seen_by_everything},
    metamorphic::{crops_are_parts_of_the_image, halves_make_the_whole, order_does_not_matter_under_sum},
    optimiser::{adam_matches, local_frame_steps_match},
    spatial_errors::{bad_cameras_and_settings_are_errors, spatial_scenes_that_are_not_finite_are_refused},
    spatial_frames::{gradients_match_in_spatial_frames, spatial_frame_steps_match, spatial_frames_come_back},
    spatial_gradients::{
        antialiased_gradients_match, gradients_match_in_all_orders, harmonics_gradients_match, spatial_gradients_match,
    },
    spatial_images::{
        antialiased_images_match, causes_are_counted, empty_space_shows_the_background, harmonics_match, orders_match,
        spatial_accuracies_match, spatial_images_match, spatial_sizes_match,
    },
    spatial_metamorphic::{
        indices_do_not_matter_by_depth, rigid_motions_change_nothing, scales_of_the_world_change_nothing,
    },
    spatial_training::{
        only_participants_move, reused_lists_are_good_for_what_stands_still, spatial_scenes_come_back,
        visible_are_counted,
    },
    state::{restored_clouds_continue_bit_for_bit, scenes_come_back, shifts_move_means_and_nothing_else},
    statistics::{absolute_gradients_match, mean_gradients_match, pixel_errors_match},
    training::{
        first_steps_owe_nothing_to_renderings, fused_steps_match_their_stages, solved_colors_are_the_best,
        statistics_are_the_positional_gradients, steps_decrease_the_loss,
    },
};
use crate::{
    failure::Failure,
    oracle::{Gradients, Oracle},
    scenes::Draw,
    subject::Subject,
    tolerance::{Agreement, compare_gradients, compare_images, compare_loss},
};

/// The losses that are tested.
pub(crate) const LOSSES: [Loss; 3] = [Loss::L2, Loss::L1, Loss::PAPER];

/// A named case.
#[derive(Debug)]
pub struct Case<R> {
    /// Its name: the function's.
    pub name: &'static str,
    /// Runs it.
    pub run: fn(&R) -> Result<Outcome, Failure>,
}

/// What came of a case that did not fail.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// The backend does what it must.
    Passed,
    /// The backend refuses, as it may, all that the case would have looked at: what.
    Skipped(String),
}

/// Cases that can only pass or fail say nothing.
impl From<()> for Outcome {
    fn from((): ()) -> Self {
        Self::Passed
    }
}

/// A case in which nothing was looked at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Skipped {
    /// Its name.
    pub case: &'static str,
    /// What the backend refuses.
    pub refused: String,
}

impl fmt::Display for Skipped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "case {}: skipped, as the backend refuses {}", self.case, self.refused)
    }
}

macro_rules! named {
    ($($case:ident: $function:expr),* $(,)?) => {
        vec![$(Case { name: stringify!($case), run: |rasterizer| Ok($function(rasterizer)?.into()) }),*]
    };
}

/// All cases for planar scenes.
pub fn cases<R: Rasterizer<PlanarScene>>() -> Vec<Case<R>> {
    named![
        images_match: images_match::<R>,
        sizes_match: sizes_match::<R>,
        canvases_match: canvases_match::<R>,
        other_accuracies_match: other_accuracies_match::<R>,
        empty_scenes_show_the_background: empty_scenes_show_the_background::<R>,
        culled_are_counted: culled_are_counted::<R>,
        gradients_match: gradients_match::<R>,
        gradients_match_through_canvases: gradients_match_through_canvases::<R>,
        gradients_match_in_local_frames: gradients_match_in_local_frames::<R>,
        scenes_come_back: scenes_come_back::<R>,
        restored_clouds_continue_bit_for_bit: restored_clouds_continue_bit_for_bit::<PlanarScene, R>,
        steps_decrease_the_loss: steps_decrease_the_loss::<PlanarScene, R>,
        adam_matches: adam_matches::<PlanarScene, R>,
        local_frame_steps_match: local_frame_steps_match::<R>,
        fused_steps_match_their_stages: fused_steps_match_their_stages::<PlanarScene, R>,
        first_steps_owe_nothing_to_renderings: first_steps_owe_nothing_to_renderings::<R>,
        losses_are_told_once_and_in_order: losses_are_told_once_and_in_order::<PlanarScene, R>,
        steps_under_way_are_seen_by_everything: steps_under_way_are_seen_by_everything::<PlanarScene, R>,
        statistics_are_the_positional_gradients: statistics_are_the_positional_gradients::<R>,
        absolute_gradients_match: absolute_gradients_match::<PlanarScene, R>,
        pixel_errors_match: pixel_errors_match::<PlanarScene, R>,
        shifts_move_means_and_nothing_else: shifts_move_means_and_nothing_else::<PlanarScene, R>,
        solved_colors_are_the_best: solved_colors_are_the_best::<R>,
        edits_carry_everything_along: edits_carry_everything_along::<PlanarScene, R>,
        changes_that_inherit_go_on: changes_that_inherit_go_on::<PlanarScene, R>,
        refused_edits_change_nothing: refused_edits_change_nothing::<PlanarScene, R>,
        scenes_that_are_not_finite_are_refused: scenes_that_are_not_finite_are_refused::<R>,
        bad_views_and_settings_are_errors: bad_views_and_settings_are_errors::<R>,
        mismatches_are_errors: mismatches_are_errors::<PlanarScene, R>,
        order_does_not_matter_under_sum: order_does_not_matter_under_sum::<PlanarScene, R>,
        halves_make_the_whole: halves_make_the_whole::<R>,
        crops_are_parts_of_the_image: crops_are_parts_of_the_image::<R>,
    ]
}

/// All cases for spatial scenes.
pub fn spatial_cases<R: Rasterizer<SpatialScene>>() -> Vec<Case<R>> {
    named![
        spatial_images_match: spatial_images_match::<R>,
        orders_match: orders_match::<R>,
        antialiased_images_match: antialiased_images_match::<R>,
        harmonics_match: harmonics_match::<R>,
        spatial_sizes_match: spatial_sizes_match::<R>,
        spatial_accuracies_match: spatial_accuracies_match::<R>,
        empty_space_shows_the_background: empty_space_shows_the_background::<R>,
        causes_are_counted: causes_are_counted::<R>,
        spatial_gradients_match: spatial_gradients_match::<R>,
        gradients_match_in_all_orders: gradients_match_in_all_orders::<R>,
        antialiased_gradients_match: antialiased_gradients_match::<R>,
        harmonics_gradients_match: harmonics_gradients_match::<R>,
        gradients_match_in_spatial_frames: gradients_match_in_spatial_frames::<R>,
        spatial_scenes_come_back: spatial_scenes_come_back::<R>,
        spatial_frames_come_back: spatial_frames_come_back::<R>,
        restored_clouds_continue_bit_for_bit: restored_clouds_continue_bit_for_bit::<SpatialScene, R>,
        steps_decrease_the_loss: steps_decrease_the_loss::<SpatialScene, R>,
        adam_matches: adam_matches::<SpatialScene, R>,
        spatial_frame_steps_match: spatial_frame_steps_match::<R>,
        only_participants_move: only_participants_move::<R>,
        fused_steps_match_their_stages: fused_steps_match_their_stages::<SpatialScene, R>,
        reused_lists_are_good_for_what_stands_still: reused_lists_are_good_for_what_stands_still::<R>,
        losses_are_told_once_and_in_order: losses_are_told_once_and_in_order::<SpatialScene, R>,
        steps_under_way_are_seen_by_everything: steps_under_way_are_seen_by_everything::<SpatialScene, R>,
        mean_gradients_match: mean_gradients_match::<SpatialScene, R>,
        absolute_gradients_match: absolute_gradients_match::<SpatialScene, R>,
        pixel_errors_match: pixel_errors_match::<SpatialScene, R>,
        visible_are_counted: visible_are_counted::<R>,
        shifts_move_means_and_nothing_else: shifts_move_means_and_nothing_else::<SpatialScene, R>,
        edits_carry_everything_along: edits_carry_everything_along::<SpatialScene, R>,
        changes_that_inherit_go_on: changes_that_inherit_go_on::<SpatialScene, R>,
        refused_edits_change_nothing: refused_edits_change_nothing::<SpatialScene, R>,
        spatial_scenes_that_are_not_finite_are_refused: spatial_scenes_that_are_not_finite_are_refused::<R>,
        bad_cameras_and_settings_are_errors: bad_cameras_and_settings_are_errors::<R>,
        mismatches_are_errors: mismatches_are_errors::<SpatialScene, R>,
        order_does_not_matter_under_sum: order_does_not_matter_under_sum::<SpatialScene, R>,
        indices_do_not_matter_by_depth: indices_do_not_matter_by_depth::<R>,
        rigid_motions_change_nothing: rigid_motions_change_nothing::<R>,
        scales_of_the_world_change_nothing: scales_of_the_world_change_nothing::<R>,
    ]
}

/// Runs all cases for planar scenes, and says which were skipped: none where the backend offers everything.
///
/// # Errors
/// [`Failure::Several`] of [`Failure::Case`]s: all that fail.
pub fn conformance<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<Vec<Skipped>, Failure> {
    run_all(rasterizer, cases::<R>())
}

/// Runs all cases for spatial scenes, and says which were skipped: none where the backend offers everything.
///
/// # Errors
/// [`Failure::Several`] of [`Failure::Case`]s: all that fail.
pub fn spatial_conformance<R: Rasterizer<SpatialScene>>(rasterizer: &R) -> Result<Vec<Skipped>, Failure> {
    run_all(rasterizer, spatial_cases::<R>())
}

fn run_all<R>(rasterizer: &R, cases: Vec<Case<R>>) -> Result<Vec<Skipped>, Failure> {
    let (mut skipped, mut failures) = (Vec::new(), Vec::new());
    for Case { name: case, run } in cases {
        match run(rasterizer) {
            Ok(Outcome::Passed) => {}
            Ok(Outcome::Skipped(refused)) => skipped.push(Skipped { case, refused }),
            Err(cause) => failures.push(Failure::Case { case, cause: Box::new(cause) }),
        }
    }
    if failures.is_empty() { Ok(skipped) } else { Err(Failure::Several(failures)) }
}

/// Renders a drawing and holds its image against the oracle's.
///
/// # Errors
/// [`Failure`] where they differ, or the backend or the comparison fails.
pub fn check_image<S: Subject, R: Rasterizer<S>>(rasterizer: &R, draw: &Draw<S>) -> Result<Agreement, Failure> {
    let expected = Oracle::new(draw.view, draw.settings)?.render(&draw.scene.rows());
    let found = rasterizer.render(&draw.scene, &draw.view, &draw.settings)?;
    compare_images(&expected, &found).map_err(|failure| failure.at(place(draw)))
}

/// Differentiates a drawing and holds loss and gradients against the oracle's, at the parameters that the backend itself says the
/// cloud has.
///
/// # Errors
/// [`Failure`] where they differ, or the backend or the comparison fails.
pub fn check_gradients<S: Subject, R: Rasterizer<S>>(
    rasterizer: &R,
    draw: &Draw<S>,
    loss: &Loss,
    chart: Chart,
) -> Result<Agreement, Failure> {
    let target = draw.target()?;
    let backward = Backward::of(rasterizer, draw, &target, loss, chart)?;
    let expected = backward.expected(draw, &target, loss)?;
    let in_place = |failure: Failure| failure.at(format!("{}, {loss:?}, {chart:?}", place(draw)));
    let agreement = compare_loss(&expected, backward.loss).map_err(in_place)?;
    Ok(agreement.and(compare_gradients(&expected, &backward.gradients).map_err(in_place)?))
}

/// Whether the backend refuses a drawing's effects, which it may for some: as [`Error::Unsupported`], in a training step as in a forward pass,
/// and with nothing done.
fn is_refused<S: Subject, R: Rasterizer<S>>(rasterizer: &R, draw: &Draw<S>) -> Result<bool, Failure> {
    let mut cloud = rasterizer.upload(&draw.scene, Chart::ScaleRotation)?;
    match rasterizer.forward(&cloud, &draw.view, &draw.settings) {
        Err(Error::Unsupported { .. }) => {}
        other => return Ok(other.map(|_| false)?),
    }
    let before = rasterizer.save(&cloud)?;
    let target = rasterizer.upload_target(&draw.target()?)?;
    let rates = S::adam().at(0.0);
    let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let refused = rasterizer.train_step(&mut cloud, &draw.view, &target, &step);
    let right = matches!(refused, Err(Error::Unsupported { .. })) && rasterizer.save(&cloud)? == before;
    Failure::unless(right, || format!("{}: refused in a forward pass, but not in a step", place(draw)))?;
    Ok(true)
}

/// Those of a kind's charts that the backend offers: the first, and all that it does not refuse as [`Error::Unsupported`] when a scene is
/// uploaded. What it refuses it must not restore either.
pub(crate) fn charts<S: Subject, R: Rasterizer<S>>(rasterizer: &R) -> Result<Vec<Chart>, Failure> {
    let empty = S::typical(Blend::Over, 1, (8, 8), 1).scene.emptied();
    let mut offered = Vec::new();
    for &chart in S::CHARTS {
        match rasterizer.upload(&empty, chart) {
            Err(Error::Unsupported { .. }) if chart != S::CHARTS[0] => {
                let state = CloudState { chart, ..rasterizer.save(&rasterizer.upload(&empty, S::CHARTS[0])?)? };
                let refused = matches!(rasterizer.restore(&state), Err(Error::Unsupported { .. }));
                Failure::unless(refused, || format!("{chart:?} is refused for a scene, but not for a saved state"))?;
            }
            cloud => {
                cloud?;
                offered.push(chart);
            }
        }
    }
    Ok(offered)
}

/// One backward pass of a fresh cloud.
struct Backward<S> {
    /// The parameters as the backend gives them back.
    scene: S,
    loss: f32,
    gradients: S,
}

impl<S: Subject> Backward<S> {
    fn of<R: Rasterizer<S>>(
        rasterizer: &R,
        draw: &Draw<S>,
        target: &Image,
        loss: &Loss,
        chart: Chart,
    ) -> Result<Self, Failure> {
        let cloud = rasterizer.upload(&draw.scene, chart)?;
        let uploaded = rasterizer.upload_target(target)?;
        let frame = rasterizer.forward(&cloud, &draw.view, &draw.settings)?;
        let (loss, gradients) = rasterizer.backward(&cloud, frame, &uploaded, loss)?;
        let gradients = rasterizer.download_gradients(&cloud, &gradients)?;
        Ok(Self { scene: rasterizer.download(&cloud)?, loss, gradients })
    }

    fn expected(&self, draw: &Draw<S>, target: &Image, loss: &Loss) -> Result<Gradients, Failure> {
        Ok(Oracle::new(draw.view, draw.settings)?.gradients(&self.scene.rows(), target, loss)?)
    }
}

/// The losses of all training steps of a cloud that have not been asked for.
fn losses_of<S: Subject, R: Rasterizer<S>>(rasterizer: &R, cloud: &mut R::Cloud) -> Result<Vec<f32>, Failure> {
    let mut losses = Vec::new();
    rasterizer.losses(cloud, Wait::All, &mut losses)?;
    Ok(losses)
}

/// Where in a case something happened.
fn place<S: Subject>(draw: &Draw<S>) -> String {
    format!("{} {:?} through {:?}, {:?}", draw.scene.len(), draw.kind, draw.view, draw.settings.effects)
}
