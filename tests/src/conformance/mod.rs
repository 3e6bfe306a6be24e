//! The suite that any `Optimizer<Scene2d>` or `Optimizer<Scene3d>` can be put through: named cases,
//! each usable alone.
//!
//! A backend's own tests call [`conformance`] or [`conformance_3d`], or list [`cases`] or
//! [`cases_3d`] to see each by name. Cases that are generic over [`Subject`] apply to 2D and 3D
//! scenes. Every case compares with the oracle, with `f64` references, or with other results of the
//! backend. Every case fails with a [`Failure`] if the backend does not do what the case's
//! documentation says.
//!
//! ```
//! use gs_conformance::{Failure, conformance::conformance};
//! use gs_core::{Optimizer, Scene2d};
//!
//! fn my_backend_conforms(backend: &impl Optimizer<Scene2d>) -> Result<(), Failure> {
//!     for skipped in conformance(backend)? {
//!         eprintln!("{skipped}");
//!     }
//!     Ok(())
//! }
//! ```

mod checks;
mod depths_3d;
mod dropout_3d;
mod editing;
mod errors;
mod errors_3d;
mod gradients;
mod gradients_3d;
mod image_vjps;
mod images;
mod images_3d;
mod losses;
mod metamorphic;
mod metamorphic_3d;
mod optimizer;
mod state;
mod statistics;
mod targets;
mod training;
mod training_3d;

use std::fmt;

use self::checks::{is_refused, losses_of, place};
pub(crate) use self::{
    checks::{LOSSES, parameterizations},
    errors::refused,
};
use gs_core::{Optimizer, Scene2d, Scene3d};

pub use self::{
    checks::{CaseOutcome, check_gradients, check_image},
    depths_3d::{added_gradients_join_the_step, alphas_match, inverse_depths_match},
    dropout_3d::dropouts_match,
    editing::{changes_that_inherit_go_on, edits_carry_everything_along, refused_edits_change_nothing},
    errors::{bad_views_and_settings_are_errors, mismatches_are_errors, scenes_that_are_not_finite_are_refused},
    errors_3d::{bad_cameras_and_settings_are_errors, scenes_3d_that_are_not_finite_are_refused},
    gradients::{
        antialiased_gradients_match_2d, gradients_match, gradients_match_in_covariance_factors,
        gradients_match_through_canvases,
    },
    gradients_3d::{
        antialiased_gradients_match, gradients_match_3d, gradients_match_in_all_orders, sh_gradients_match,
    },
    image_vjps::image_vjps_match,
    images::{
        antialiased_images_match_2d, canvases_match, culled_are_counted, empty_scenes_show_the_background,
        images_match, other_accuracies_match, sizes_match,
    },
    images_3d::{
        accuracies_match_3d, antialiased_images_match, causes_are_counted, empty_space_shows_the_background,
        images_match_3d, orders_match, sh_match, sizes_match_3d,
    },
    losses::{every_call_sees_pending_steps, losses_are_reported_once_and_in_order},
    metamorphic::{crops_are_parts_of_the_image, halves_make_the_whole, order_does_not_matter_under_sum},
    metamorphic_3d::{
        indices_do_not_matter_by_depth, rigid_motions_change_nothing, scales_of_the_world_change_nothing,
    },
    optimizer::{adam_matches, covariance_factor_steps_match},
    state::{noise_moves_means_and_nothing_else, restored_splats_continue_bit_for_bit, scenes_come_back},
    statistics::{absolute_gradients_match, mean_gradients_match, pixel_errors_match, pixel_gradients_match},
    targets::{incomplete_targets_are_completed, weights_are_factors_of_the_loss},
    training::{
        first_steps_do_not_reuse_lists_of_renderings, fused_steps_match_separate_stages, solved_colors_are_the_best,
        statistics_are_the_positional_gradients, steps_decrease_the_loss,
    },
    training_3d::{
        only_participants_move, reused_lists_change_nothing_without_movement, scenes_3d_come_back, visible_are_counted,
    },
};
use crate::failure::Failure;
#[cfg(doc)]
use crate::subject::Subject;

/// A named case.
#[derive(Debug)]
pub struct Case<R> {
    /// The name of the case's function.
    pub name: &'static str,
    /// Runs the case.
    pub run: fn(&R) -> Result<CaseOutcome, Failure>,
}

/// A skipped case.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Skipped {
    /// The case's name.
    pub case: &'static str,
    /// The features that the backend refuses.
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

/// All cases for 2D scenes.
pub fn cases<R: Optimizer<Scene2d>>() -> Vec<Case<R>> {
    named![
        images_match: images_match::<R>,
        antialiased_images_match_2d: antialiased_images_match_2d::<R>,
        sizes_match: sizes_match::<R>,
        canvases_match: canvases_match::<R>,
        other_accuracies_match: other_accuracies_match::<R>,
        empty_scenes_show_the_background: empty_scenes_show_the_background::<R>,
        culled_are_counted: culled_are_counted::<R>,
        gradients_match: gradients_match::<R>,
        antialiased_gradients_match_2d: antialiased_gradients_match_2d::<R>,
        gradients_match_through_canvases: gradients_match_through_canvases::<R>,
        gradients_match_in_covariance_factors: gradients_match_in_covariance_factors::<R>,
        image_vjps_match: image_vjps_match::<Scene2d, R>,
        scenes_come_back: scenes_come_back::<R>,
        restored_splats_continue_bit_for_bit: restored_splats_continue_bit_for_bit::<Scene2d, R>,
        steps_decrease_the_loss: steps_decrease_the_loss::<Scene2d, R>,
        adam_matches: adam_matches::<Scene2d, R>,
        covariance_factor_steps_match: covariance_factor_steps_match::<R>,
        fused_steps_match_separate_stages: fused_steps_match_separate_stages::<Scene2d, R>,
        first_steps_do_not_reuse_lists_of_renderings: first_steps_do_not_reuse_lists_of_renderings::<R>,
        losses_are_reported_once_and_in_order: losses_are_reported_once_and_in_order::<Scene2d, R>,
        every_call_sees_pending_steps: every_call_sees_pending_steps::<Scene2d, R>,
        statistics_are_the_positional_gradients: statistics_are_the_positional_gradients::<R>,
        absolute_gradients_match: absolute_gradients_match::<Scene2d, R>,
        pixel_gradients_match: pixel_gradients_match::<Scene2d, R>,
        pixel_errors_match: pixel_errors_match::<Scene2d, R>,
        noise_moves_means_and_nothing_else: noise_moves_means_and_nothing_else::<Scene2d, R>,
        incomplete_targets_are_completed: incomplete_targets_are_completed::<Scene2d, R>,
        weights_are_factors_of_the_loss: weights_are_factors_of_the_loss::<Scene2d, R>,
        solved_colors_are_the_best: solved_colors_are_the_best::<R>,
        edits_carry_everything_along: edits_carry_everything_along::<Scene2d, R>,
        changes_that_inherit_go_on: changes_that_inherit_go_on::<Scene2d, R>,
        refused_edits_change_nothing: refused_edits_change_nothing::<Scene2d, R>,
        scenes_that_are_not_finite_are_refused: scenes_that_are_not_finite_are_refused::<R>,
        bad_views_and_settings_are_errors: bad_views_and_settings_are_errors::<R>,
        mismatches_are_errors: mismatches_are_errors::<Scene2d, R>,
        order_does_not_matter_under_sum: order_does_not_matter_under_sum::<Scene2d, R>,
        halves_make_the_whole: halves_make_the_whole::<R>,
        crops_are_parts_of_the_image: crops_are_parts_of_the_image::<R>,
    ]
}

/// All cases for 3D scenes.
pub fn cases_3d<R: Optimizer<Scene3d>>() -> Vec<Case<R>> {
    named![
        images_match_3d: images_match_3d::<R>,
        orders_match: orders_match::<R>,
        antialiased_images_match: antialiased_images_match::<R>,
        sh_match: sh_match::<R>,
        sizes_match_3d: sizes_match_3d::<R>,
        accuracies_match_3d: accuracies_match_3d::<R>,
        empty_space_shows_the_background: empty_space_shows_the_background::<R>,
        causes_are_counted: causes_are_counted::<R>,
        gradients_match_3d: gradients_match_3d::<R>,
        gradients_match_in_all_orders: gradients_match_in_all_orders::<R>,
        antialiased_gradients_match: antialiased_gradients_match::<R>,
        sh_gradients_match: sh_gradients_match::<R>,
        image_vjps_match: image_vjps_match::<Scene3d, R>,
        inverse_depths_match: inverse_depths_match::<R>,
        alphas_match: alphas_match::<R>,
        dropouts_match: dropouts_match::<R>,
        scenes_3d_come_back: scenes_3d_come_back::<R>,
        restored_splats_continue_bit_for_bit: restored_splats_continue_bit_for_bit::<Scene3d, R>,
        steps_decrease_the_loss: steps_decrease_the_loss::<Scene3d, R>,
        adam_matches: adam_matches::<Scene3d, R>,
        only_participants_move: only_participants_move::<R>,
        fused_steps_match_separate_stages: fused_steps_match_separate_stages::<Scene3d, R>,
        added_gradients_join_the_step: added_gradients_join_the_step::<R>,
        reused_lists_change_nothing_without_movement: reused_lists_change_nothing_without_movement::<R>,
        losses_are_reported_once_and_in_order: losses_are_reported_once_and_in_order::<Scene3d, R>,
        every_call_sees_pending_steps: every_call_sees_pending_steps::<Scene3d, R>,
        mean_gradients_match: mean_gradients_match::<Scene3d, R>,
        absolute_gradients_match: absolute_gradients_match::<Scene3d, R>,
        pixel_gradients_match: pixel_gradients_match::<Scene3d, R>,
        pixel_errors_match: pixel_errors_match::<Scene3d, R>,
        visible_are_counted: visible_are_counted::<R>,
        noise_moves_means_and_nothing_else: noise_moves_means_and_nothing_else::<Scene3d, R>,
        incomplete_targets_are_completed: incomplete_targets_are_completed::<Scene3d, R>,
        weights_are_factors_of_the_loss: weights_are_factors_of_the_loss::<Scene3d, R>,
        edits_carry_everything_along: edits_carry_everything_along::<Scene3d, R>,
        changes_that_inherit_go_on: changes_that_inherit_go_on::<Scene3d, R>,
        refused_edits_change_nothing: refused_edits_change_nothing::<Scene3d, R>,
        scenes_3d_that_are_not_finite_are_refused: scenes_3d_that_are_not_finite_are_refused::<R>,
        bad_cameras_and_settings_are_errors: bad_cameras_and_settings_are_errors::<R>,
        mismatches_are_errors: mismatches_are_errors::<Scene3d, R>,
        order_does_not_matter_under_sum: order_does_not_matter_under_sum::<Scene3d, R>,
        indices_do_not_matter_by_depth: indices_do_not_matter_by_depth::<R>,
        rigid_motions_change_nothing: rigid_motions_change_nothing::<R>,
        scales_of_the_world_change_nothing: scales_of_the_world_change_nothing::<R>,
    ]
}

/// Runs all cases for 2D scenes, and returns the skipped ones.
///
/// # Errors
/// [`Failure::Several`] with a [`Failure::Case`] for each case that fails.
pub fn conformance<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<Vec<Skipped>, Failure> {
    run_all(rasterizer, cases::<R>())
}

/// Runs all cases for 3D scenes, and returns the skipped ones.
///
/// # Errors
/// [`Failure::Several`] with a [`Failure::Case`] for each case that fails.
pub fn conformance_3d<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<Vec<Skipped>, Failure> {
    run_all(rasterizer, cases_3d::<R>())
}

fn run_all<R>(rasterizer: &R, cases: Vec<Case<R>>) -> Result<Vec<Skipped>, Failure> {
    let (mut skipped, mut failures) = (Vec::new(), Vec::new());
    for Case { name: case, run } in cases {
        match run(rasterizer) {
            Ok(CaseOutcome::Passed) => {}
            Ok(CaseOutcome::Skipped(refused)) => skipped.push(Skipped { case, refused }),
            Err(cause) => failures.push(Failure::Case { case, cause: Box::new(cause) }),
        }
    }
    if failures.is_empty() { Ok(skipped) } else { Err(Failure::Several(failures)) }
}
