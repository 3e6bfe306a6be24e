//! The suite that any `Rasterizer<PlanarScene>` can be put through: named cases, each usable alone.
//!
//! A backend's own tests call [`conformance`], or list [`cases`] to see each by name. Every case compares with the oracle, with `f64`
//! references, or with what the backend itself said before; none needs to know how the backend works.
//!
//! ```
//! use gs_conformance::{Failure, conformance::conformance};
//! use gs_core::{PlanarScene, Rasterizer};
//!
//! fn my_backend_conforms(backend: &impl Rasterizer<PlanarScene>) -> Result<(), Failure> {
//!     conformance(backend)
//! }
//! ```

mod editing;
mod errors;
mod gradients;
mod images;
mod losses;
mod metamorphic;
mod optimiser;
mod state;
mod statistics;
mod training;

use gs_core::{Chart, Image, Loss, PlanarScene, Rasterizer, Wait};

pub use self::{
    editing::{edits_carry_everything_along, refused_edits_change_nothing},
    errors::{bad_views_and_settings_are_errors, mismatches_are_errors, scenes_that_are_not_finite_are_refused},
    gradients::{gradients_match, gradients_match_in_local_frames, gradients_match_through_canvases},
    images::{
        canvases_match, culled_are_counted, empty_scenes_show_the_background, images_match, other_accuracies_match,
        sizes_match,
    },
    losses::{losses_are_told_once_and_in_order, steps_under_way_are_seen_by_everything},
    metamorphic::{crops_are_parts_of_the_image, halves_make_the_whole, order_does_not_matter_under_sum},
    optimiser::{adam_matches, local_frame_steps_match},
    state::{restored_clouds_continue_bit_for_bit, scenes_come_back, shifts_move_means_and_nothing_else},
    statistics::{absolute_gradients_match, pixel_errors_match},
    training::{
        fused_steps_match_their_stages, solved_colors_are_the_best, statistics_are_the_positional_gradients,
        steps_decrease_the_loss,
    },
};
use crate::{
    failure::Failure,
    oracle::{Gradients, Oracle, OracleScene},
    scenes::Draw,
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
    pub run: fn(&R) -> Result<(), Failure>,
}

/// All cases of the suite.
pub fn cases<R: Rasterizer<PlanarScene>>() -> Vec<Case<R>> {
    macro_rules! named {
        ($($case:ident),* $(,)?) => { vec![$(Case { name: stringify!($case), run: $case::<R> }),*] };
    }
    named![
        images_match,
        sizes_match,
        canvases_match,
        other_accuracies_match,
        empty_scenes_show_the_background,
        culled_are_counted,
        gradients_match,
        gradients_match_through_canvases,
        gradients_match_in_local_frames,
        scenes_come_back,
        restored_clouds_continue_bit_for_bit,
        steps_decrease_the_loss,
        adam_matches,
        local_frame_steps_match,
        fused_steps_match_their_stages,
        losses_are_told_once_and_in_order,
        steps_under_way_are_seen_by_everything,
        statistics_are_the_positional_gradients,
        absolute_gradients_match,
        pixel_errors_match,
        shifts_move_means_and_nothing_else,
        solved_colors_are_the_best,
        edits_carry_everything_along,
        refused_edits_change_nothing,
        scenes_that_are_not_finite_are_refused,
        bad_views_and_settings_are_errors,
        mismatches_are_errors,
        order_does_not_matter_under_sum,
        halves_make_the_whole,
        crops_are_parts_of_the_image,
    ]
}

/// Runs all cases.
///
/// # Errors
/// [`Failure::Several`] of [`Failure::Case`]s: all that fail.
pub fn conformance<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<(), Failure> {
    let failures: Vec<Failure> = cases::<R>()
        .into_iter()
        .filter_map(|case| {
            let cause = (case.run)(rasterizer).err()?;
            Some(Failure::Case { case: case.name, cause: Box::new(cause) })
        })
        .collect();
    if failures.is_empty() { Ok(()) } else { Err(Failure::Several(failures)) }
}

/// Renders a drawing and holds its image against the oracle's.
///
/// # Errors
/// [`Failure`] where they differ, or the backend or the comparison fails.
pub fn check_image<R: Rasterizer<PlanarScene>>(rasterizer: &R, draw: &Draw) -> Result<Agreement, Failure> {
    let expected = Oracle::new(draw.view, draw.settings)?.render(&OracleScene::from(&draw.scene));
    let found = rasterizer.render(&draw.scene, &draw.view, &draw.settings)?;
    compare_images(&expected, &found).map_err(|failure| failure.at(place(draw)))
}

/// Differentiates a drawing and holds loss and gradients against the oracle's, at the parameters that the backend itself says the
/// cloud has.
///
/// # Errors
/// [`Failure`] where they differ, or the backend or the comparison fails.
pub fn check_gradients<R: Rasterizer<PlanarScene>>(
    rasterizer: &R,
    draw: &Draw,
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

/// One backward pass of a fresh cloud.
struct Backward {
    /// The parameters as the backend gives them back.
    scene: PlanarScene,
    loss: f32,
    gradients: PlanarScene,
}

impl Backward {
    fn of<R: Rasterizer<PlanarScene>>(
        rasterizer: &R,
        draw: &Draw,
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

    fn expected(&self, draw: &Draw, target: &Image, loss: &Loss) -> Result<Gradients, Failure> {
        Ok(Oracle::new(draw.view, draw.settings)?.gradients(&OracleScene::from(&self.scene), target, loss)?)
    }
}

/// The losses of all training steps of a cloud that have not been asked for.
fn losses_of<R: Rasterizer<PlanarScene>>(rasterizer: &R, cloud: &mut R::Cloud) -> Result<Vec<f32>, Failure> {
    let mut losses = Vec::new();
    rasterizer.losses(cloud, Wait::All, &mut losses)?;
    Ok(losses)
}

/// Where in a case something happened.
fn place(draw: &Draw) -> String {
    let (view, effects) = (&draw.view, &draw.settings.effects);
    let count = draw.scene.means.len();
    let part = format!("{} + {}", view.origin, view.extent);
    format!("{count} {:?} on {}x{} ({part}), {:?}", draw.kind, view.width, view.height, effects.blend)
}
