//! Number, size and shape of the Gaussians on the paper's disc and square, and at their edges.

use glam::Vec2;
use gs_core::{Gaussian2d, Scene2d, sigmoid};
use gs_train::{PAPER_DISC, PAPER_SIDE_PX, PAPER_SQUARE};

use crate::{result::median, study::Column};

/// Half the width of the zone around an edge, px. The disc's edge rises from 12 % to 88 % within
/// it.
const ZONE_PX: f32 = 4.0;

/// Gaussians of less opacity are not counted: they are about to be pruned.
const LEAST_OPACITY: f32 = 0.05;

/// Distance from the square's border, px; negative inside.
fn from_square(place: Vec2) -> f32 {
    let (low, high) = PAPER_SQUARE;
    let outside = (low - place).max(place - high);
    if outside.max_element() <= 0.0 { outside.max_element() } else { outside.max(Vec2::ZERO).length() }
}

/// Distance from the circle on which the disc covers half a pixel, px; negative inside.
fn from_disc(place: Vec2) -> f32 {
    place.distance(PAPER_DISC.0) - PAPER_DISC.1
}

/// The columns of `Measure::Shapes`.
pub(super) fn measure(scene: &Scene2d) -> Vec<(Column, f64)> {
    let counted: Vec<Gaussian2d> = scene.iter().filter(|g| sigmoid(g.opacity_logit) >= LEAST_OPACITY).collect();
    let within = |is_within: &dyn Fn(f32) -> bool, distance: fn(Vec2) -> f32| {
        counted.iter().filter(|g| is_within(distance(g.mean))).collect::<Vec<_>>()
    };
    let size = |of: &[&Gaussian2d]| median(of.iter().map(|g| f64::from((0.5 * g.log_scale.element_sum()).exp())));
    let stretch = |of: &[&Gaussian2d]| {
        median(of.iter().map(|g| f64::from((g.log_scale.max_element() - g.log_scale.min_element()).exp())))
    };
    let is_edge = |distance: f32| distance.abs() <= ZONE_PX;
    let density = |of: &[&Gaussian2d], distance: fn(Vec2) -> f32| {
        let pixels =
            (0..PAPER_SIDE_PX).flat_map(|y| (0..PAPER_SIDE_PX).map(move |x| Vec2::new(x as f32, y as f32) + 0.5));
        100.0 * of.len() as f64 / pixels.filter(|&pixel| is_edge(distance(pixel))).count() as f64
    };
    let mut columns = Vec::new();
    for (distance, [on, on_size, edge_density, edge_stretch, edge_size]) in
        [(from_square as fn(Vec2) -> f32, SQUARE), (from_disc, DISC)]
    {
        let shape = within(&|distance| distance <= ZONE_PX, distance);
        let edge = within(&is_edge, distance);
        columns.extend([(on, shape.len() as f64), (on_size, size(&shape)), (edge_density, density(&edge, distance))]);
        columns.extend([(edge_stretch, stretch(&edge)), (edge_size, size(&edge))]);
    }
    columns
}

const SQUARE: [Column; 5] = [
    Column::SquareCount,
    Column::SquareSize,
    Column::SquareEdgeDensity,
    Column::SquareEdgeStretch,
    Column::SquareEdgeSize,
];

const DISC: [Column; 5] =
    [Column::DiscCount, Column::DiscSize, Column::DiscEdgeDensity, Column::DiscEdgeStretch, Column::DiscEdgeSize];

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn gaussians_are_counted_where_they_stand() {
        let (low, high) = PAPER_SQUARE;
        let gaussian = |mean: Vec2, log_scale: Vec2, opacity_logit: f32| Gaussian2d {
            mean,
            log_scale,
            rotation: 0.0,
            opacity_logit,
            color: Vec3::ZERO,
        };
        let edge = Vec2::new(low.x, 0.5 * (low.y + high.y));
        let scene: Scene2d = [
            gaussian(edge, Vec2::new(2f32.ln(), 0.0), 0.0),
            gaussian(edge, Vec2::new(8f32.ln(), 0.0), 0.0),
            gaussian(edge, Vec2::ZERO, -9.0),
            gaussian(0.5 * (low + high), Vec2::ZERO, 0.0),
            gaussian(PAPER_DISC.0, Vec2::splat(3f32.ln()), 0.0),
        ]
        .into_iter()
        .collect();
        let measured = measure(&scene);
        let of = |column: Column| measured.iter().find(|(known, _)| *known == column).unwrap().1;
        assert_eq!((of(Column::SquareCount), of(Column::DiscCount)), (3.0, 1.0));
        assert!((of(Column::SquareEdgeStretch) - 5.0).abs() < 1e-6 && (of(Column::DiscSize) - 3.0).abs() < 1e-6);
        assert!(
            of(Column::SquareEdgeDensity) > 0.0
                && of(Column::DiscEdgeDensity) == 0.0
                && of(Column::DiscEdgeSize).is_nan()
        );
    }
}
