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

mod camera_gradients;
mod checks;
mod editing;
mod errors;
mod errors_3d;
mod gradients;
mod gradients_3d;
mod image_vjps;
mod rendering;
mod state;
mod statistics;
mod training;

use std::fmt;

use gs_core::{Optimizer, Scene2d, Scene3d};

pub use self::checks::{CaseOutcome, check_gradients, check_image};
use self::checks::{is_refused, losses_of, place};
pub(crate) use self::{
    checks::{LOSSES, parameterizations},
    errors::refused,
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

/// The named cases of modules.
macro_rules! named {
    ($($module:ident { $($case:ident<$($of:ty),+>),* $(,)? })*) => {
        vec![$($(Case {
            name: stringify!($case),
            run: |rasterizer| Ok($module::$case::<$($of),+>(rasterizer)?.into()),
        }),*),*]
    };
}

/// All cases for 2D scenes.
pub fn cases<R: Optimizer<Scene2d>>() -> Vec<Case<R>> {
    named![
        rendering {
            images_match<R>,
            antialiased_images_match_2d<R>,
            sizes_match<R>,
            canvases_match<R>,
            other_accuracies_match<R>,
            empty_scenes_show_the_background<R>,
            culled_are_counted<R>,
            order_does_not_matter_under_sum<Scene2d, R>,
            halves_make_the_whole<R>,
            crops_are_parts_of_the_image<R>,
        }
        gradients {
            gradients_match<R>,
            antialiased_gradients_match_2d<R>,
            gradients_match_through_canvases<R>,
            gradients_match_in_covariance_factors<R>,
        }
        image_vjps {
            image_vjps_match<Scene2d, R>,
        }
        state {
            scenes_come_back<R>,
            restored_splats_continue_bit_for_bit<Scene2d, R>,
            noise_moves_means_and_nothing_else<Scene2d, R>,
        }
        training {
            steps_decrease_the_loss<Scene2d, R>,
            adam_matches<Scene2d, R>,
            covariance_factor_steps_match<R>,
            fused_steps_match_separate_stages<Scene2d, R>,
            first_steps_do_not_reuse_lists_of_renderings<R>,
            losses_are_reported_once_and_in_order<Scene2d, R>,
            every_call_sees_pending_steps<Scene2d, R>,
            statistics_are_the_positional_gradients<R>,
            incomplete_targets_are_completed<Scene2d, R>,
            weights_are_factors_of_the_loss<Scene2d, R>,
            solved_colors_are_the_best<R>,
        }
        statistics {
            absolute_gradients_match<Scene2d, R>,
            pixel_gradients_match<Scene2d, R>,
            pixel_errors_match<Scene2d, R>,
        }
        editing {
            edits_carry_everything_along<Scene2d, R>,
            changes_that_inherit_go_on<Scene2d, R>,
            refused_edits_change_nothing<Scene2d, R>,
        }
        errors {
            scenes_that_are_not_finite_are_refused<R>,
            bad_views_and_settings_are_errors<R>,
            mismatches_are_errors<Scene2d, R>,
        }
    ]
}

/// All cases for 3D scenes.
pub fn cases_3d<R: Optimizer<Scene3d>>() -> Vec<Case<R>> {
    named![
        rendering {
            images_match_3d<R>,
            orders_match<R>,
            antialiased_images_match<R>,
            sh_match<R>,
            sizes_match_3d<R>,
            accuracies_match_3d<R>,
            empty_space_shows_the_background<R>,
            causes_are_counted<R>,
            inverse_depths_match<R>,
            alphas_match<R>,
            dropouts_match<R>,
            order_does_not_matter_under_sum<Scene3d, R>,
            indices_do_not_matter_by_depth<R>,
            rigid_motions_change_nothing<R>,
            scales_of_the_world_change_nothing<R>,
        }
        gradients_3d {
            gradients_match_3d<R>,
            gradients_match_in_all_orders<R>,
            antialiased_gradients_match<R>,
            sh_gradients_match<R>,
        }
        camera_gradients {
            camera_gradients_match<R>,
            camera_gradients_of_steps_match<R>,
        }
        image_vjps {
            image_vjps_match<Scene3d, R>,
        }
        training {
            scenes_3d_come_back<R>,
            steps_decrease_the_loss<Scene3d, R>,
            adam_matches<Scene3d, R>,
            only_participants_move<R>,
            fixed_gaussians_stay<R>,
            fused_steps_match_separate_stages<Scene3d, R>,
            reused_lists_change_nothing_without_movement<R>,
            losses_are_reported_once_and_in_order<Scene3d, R>,
            every_call_sees_pending_steps<Scene3d, R>,
            visible_are_counted<R>,
            incomplete_targets_are_completed<Scene3d, R>,
            weights_are_factors_of_the_loss<Scene3d, R>,
        }
        state {
            restored_splats_continue_bit_for_bit<Scene3d, R>,
            noise_moves_means_and_nothing_else<Scene3d, R>,
        }
        statistics {
            mean_gradients_match<Scene3d, R>,
            absolute_gradients_match<Scene3d, R>,
            pixel_gradients_match<Scene3d, R>,
            pixel_errors_match<Scene3d, R>,
        }
        editing {
            edits_carry_everything_along<Scene3d, R>,
            changes_that_inherit_go_on<Scene3d, R>,
            refused_edits_change_nothing<Scene3d, R>,
        }
        errors_3d {
            scenes_3d_that_are_not_finite_are_refused<R>,
            bad_cameras_and_settings_are_errors<R>,
        }
        errors {
            mismatches_are_errors<Scene3d, R>,
        }
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
