//! 3D hard cases by theme.

mod cameras;
mod colors;
mod common;
mod orders;
mod shapes;

use gs_core::Scene3d;

use super::case::Case;

/// All 3D cases.
pub fn corpus_3d() -> Vec<Case<Scene3d>> {
    [shapes::cases(), cameras::cases(), orders::cases(), colors::cases()].into_iter().flatten().collect()
}
