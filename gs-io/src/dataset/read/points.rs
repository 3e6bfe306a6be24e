//! The points of a data set: in its own world as its files have them, and in the frame of its views.

use std::collections::HashSet;

use glam::DVec3;

use crate::{WorldFrame, dataset::Point};

/// A point as a file has it, in the data set's world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WorldPoint {
    pub(crate) position: DVec3,
    pub(crate) color: [f32; 3],
}

/// The finite points, in a frame.
pub(crate) fn points_in(frame: &WorldFrame, points: Vec<WorldPoint>) -> Vec<Point> {
    let moved = |WorldPoint { position, color }| Point { position: frame.to_frame(position).as_vec3(), color };
    let is_finite = |point: &Point| point.position.is_finite() && point.color.iter().all(|c| c.is_finite());
    points.into_iter().map(moved).filter(is_finite).collect()
}

/// The points without those at the place of an earlier one, which some programs write for each image
/// that shows a point.
pub(crate) fn without_copies(mut points: Vec<Point>) -> Vec<Point> {
    let mut places = HashSet::with_capacity(points.len());
    // Adding 0 makes 0 of -0.
    points.retain(|point| places.insert((point.position + 0.0).to_array().map(f32::to_bits)));
    points
}
