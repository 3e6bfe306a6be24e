//! 2D hard cases by theme.

mod common;
mod images;
mod opacities;
mod optimizer;
mod refusals;
mod shapes;

use gs_core::Scene2d;

use super::case::Case;

/// All 2D cases.
pub fn corpus_2d() -> Vec<Case<Scene2d>> {
    [shapes::cases(), opacities::cases(), images::cases(), optimizer::cases(), refusals::cases()]
        .into_iter()
        .flatten()
        .collect()
}
