//! Levels of detail: which level of each cell of a scene a view draws.

use std::{cmp::Reverse, collections::BinaryHeap};

use glam::{Vec2, Vec3};

use crate::{error::Error, scene::Gaussian3d, view::Camera};

/// A box along the axes, world units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// The smallest coordinates.
    pub min: Vec3,
    /// The largest coordinates.
    pub max: Vec3,
}

impl Bounds {
    /// The empty box, whose [`union`](Self::union) with another box is the other box.
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The box around a Gaussian's ellipsoid of one standard deviation.
    pub fn of(gaussian: &Gaussian3d) -> Self {
        let covariance = gaussian.covariance().unwrap_or_default();
        // The squares of large scales are infinite, and bounds are finite.
        let root = |variance: f32| if variance.is_finite() { variance.sqrt() } else { f32::MAX };
        let reach = Vec3::new(covariance.x_axis.x, covariance.y_axis.y, covariance.z_axis.z).map(root);
        let finite = |corner: Vec3| corner.clamp(Vec3::MIN, Vec3::MAX);
        Self { min: finite(gaussian.mean - reach), max: finite(gaussian.mean + reach) }
    }

    /// The smallest box around both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Whether the other box is inside.
    pub fn contains(&self, other: &Self) -> bool {
        self.min.cmple(other.min).all() && self.max.cmpge(other.max).all()
    }

    /// The distance of a point from the box, 0 inside, world units.
    pub fn distance(&self, point: Vec3) -> f32 {
        (self.min - point).max(point - self.max).max(Vec3::ZERO).length()
    }

    /// Whether a camera may see something of the box.
    pub fn is_in_sight(&self, camera: &Camera) -> bool {
        px_per_world(camera, self) > 0.0
    }

    fn corners(&self) -> [Vec3; 8] {
        std::array::from_fn(|k| {
            let pick = |axis: usize| if k >> axis & 1 == 0 { self.min[axis] } else { self.max[axis] };
            Vec3::new(pick(0), pick(1), pick(2))
        })
    }
}

/// A level of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LodLevel {
    /// Number of its Gaussians.
    pub gaussians: usize,
    /// How far the drawn scene is displaced by this level in place of the finest, world units.
    pub error: f32,
}

/// A node of a tree of cells, each of which has levels of detail.
#[derive(Debug, Clone, PartialEq)]
pub enum LodNode {
    /// A node with children, whose bounds are inside its own.
    Inner {
        /// The bounds of all its cells.
        bounds: Bounds,
        /// The children.
        children: Vec<LodNode>,
    },
    /// A cell.
    Leaf {
        /// The bounds of its Gaussians in all levels.
        bounds: Bounds,
        /// Its levels, the finest first; at least one.
        levels: Vec<LodLevel>,
    },
}

/// A level for each cell.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LodCut {
    /// The index of each cell's level, in the order of the tree.
    pub levels: Vec<usize>,
    /// Number of Gaussians in these levels.
    pub gaussians: usize,
    /// The largest projected error of a cell in sight, px.
    pub error_px: f32,
}

impl LodNode {
    /// The `error_px` of [`Self::cut`] for pictures that should look like the finest level, px.
    pub const USUAL_ERROR_PX: f32 = 1.0;

    /// The `error_px` of each [`step`](Self::step), px. The first is large, so that a coarse picture comes soon.
    pub const STEPS_PX: [f32; 3] = [16.0, 4.0, Self::USUAL_ERROR_PX];

    /// The box around all Gaussians.
    pub fn bounds(&self) -> &Bounds {
        match self {
            Self::Inner { bounds, .. } | Self::Leaf { bounds, .. } => bounds,
        }
    }

    /// The bounds and levels of all cells, in the order of the tree.
    pub fn cells(&self) -> Vec<(&Bounds, &[LodLevel])> {
        match self {
            Self::Inner { children, .. } => children.iter().flat_map(Self::cells).collect(),
            Self::Leaf { bounds, levels } => vec![(bounds, levels)],
        }
    }

    /// Chooses a level of each cell for a view, or for several views together.
    ///
    /// All cells begin with their coarsest levels. Then the cell with the largest projected error becomes
    /// finer, until no error is above `error_px` or the next finer level would exceed `budget` Gaussians.
    /// Cells out of sight have no error.
    ///
    /// A larger budget never has a larger error. The budget is exceeded only if the coarsest levels alone
    /// exceed it. Levels that have no fewer Gaussians than a finer one are not used.
    ///
    /// # Errors
    /// [`Error::Setting`] for a budget of 0 or an `error_px` that isn't at least 0.
    pub fn cut(&self, cameras: &[Camera], budget: usize, error_px: f32) -> Result<LodCut, Error> {
        Error::within("the budget of Gaussians", budget, 1.., "at least 1")?;
        Error::within("the projected error", error_px, 0.0.., "at least 0 px")?;
        let cells = self.cells();
        // The levels of each cell that may be chosen, the finest first; the last is chosen.
        let mut choices: Vec<Vec<Choice>> =
            cells.iter().map(|(bounds, levels)| choices(cameras, bounds, levels)).collect();
        let last = |cell: &Vec<Choice>| cell.last().copied().unwrap_or_default();
        let mut gaussians: usize = choices.iter().map(|cell| last(cell).gaussians).sum();
        // Errors are not negative, so their bits are in the same order. Of equal errors, the first cell is next.
        let entry = |cell: usize, error_px: f32| (error_px.to_bits(), Reverse(cell));
        let mut largest: BinaryHeap<_> =
            choices.iter().enumerate().map(|(k, cell)| entry(k, last(cell).error_px)).collect();
        while let Some((error, Reverse(k))) = largest.pop() {
            if !(f32::from_bits(error) > error_px) {
                break;
            }
            let [.., finer, now] = choices[k][..] else { continue };
            if gaussians - now.gaussians + finer.gaussians > budget {
                break;
            }
            gaussians += finer.gaussians - now.gaussians;
            choices[k].pop();
            largest.push(entry(k, finer.error_px));
        }
        let levels = choices.iter().map(|cell| last(cell).level).collect();
        let error_px = choices.iter().map(|cell| last(cell).error_px).fold(0.0, f32::max);
        Ok(LodCut { levels, gaussians, error_px })
    }

    /// Chooses the levels to read in a step on the way to the [`cut`](Self::cut) of a camera.
    ///
    /// The steps begin with the levels `shown`, or with nothing, and have the errors of
    /// [`STEPS_PX`](Self::STEPS_PX). A cell that is shown finer than the camera needs gets its last level at
    /// once. Other cells never get coarser on the way, so that the budget holds in each step.
    ///
    /// # Errors
    /// Those of [`cut`](Self::cut).
    ///
    /// # Panics
    /// If there is no step of this index, or `shown` has fewer levels than there are cells.
    pub fn step(
        &self,
        shown: Option<&[usize]>,
        camera: &Camera,
        budget: usize,
        index: usize,
    ) -> Result<Vec<usize>, Error> {
        let cut = |error_px| Ok::<_, Error>(self.cut(&[*camera], budget, error_px)?.levels);
        let (mut levels, end) = (cut(Self::STEPS_PX[index])?, cut(Self::USUAL_ERROR_PX)?);
        for (cell, level) in levels.iter_mut().enumerate() {
            let before = shown.map_or(usize::MAX, |shown| shown[cell]);
            *level = if before <= end[cell] { end[cell] } else { before.min(*level) };
        }
        Ok(levels)
    }
}

/// A level of a cell that may be chosen.
#[derive(Debug, Clone, Copy, Default)]
struct Choice {
    level: usize,
    gaussians: usize,
    error_px: f32,
}

/// The levels with fewer Gaussians than all finer ones. Their errors do not fall.
fn choices(cameras: &[Camera], bounds: &Bounds, levels: &[LodLevel]) -> Vec<Choice> {
    let scale = cameras.iter().map(|camera| px_per_world(camera, bounds)).fold(0.0, f32::max);
    let mut choices: Vec<Choice> = Vec::with_capacity(levels.len());
    let mut error_px = 0.0_f32;
    for (level, &LodLevel { gaussians, error }) in levels.iter().enumerate() {
        if choices.last().is_none_or(|finer| gaussians < finer.gaussians) {
            error_px = error_px.max(error * scale);
            choices.push(Choice { level, gaussians, error_px });
        }
    }
    choices
}

/// How many pixels a world unit takes at most in this box; 0 where the box is out of sight.
fn px_per_world(camera: &Camera, bounds: &Bounds) -> f32 {
    let corners = bounds.corners().map(|corner| camera.to_camera(corner));
    let (size, [cx, cy]) = ([camera.width as f32, camera.height as f32], camera.center.to_array());
    // A point is right of the left border if fx x + cx z >= 0, and so on.
    let sides: [&dyn Fn(&Vec3) -> f32; 5] = [
        &|p| p.z - camera.near,
        &|p| camera.focal.x * p.x + cx * p.z,
        &|p| (size[0] - cx) * p.z - camera.focal.x * p.x,
        &|p| camera.focal.y * p.y + cy * p.z,
        &|p| (size[1] - cy) * p.z - camera.focal.y * p.y,
    ];
    if sides.iter().any(|side| corners.iter().all(|corner| side(corner) < 0.0)) {
        return 0.0;
    }
    let depth = corners.iter().map(|corner| corner.z).fold(f32::INFINITY, f32::min);
    let depth = if depth.is_finite() { depth.max(camera.near) } else { camera.near };
    // A displacement across the ray moves by more than f / z at the border of the picture.
    let border = camera.center.abs().max((Vec2::from(size) - camera.center).abs()) / camera.focal;
    let slope = |corner: &Vec3| {
        if corner.z > camera.near { (corner.truncate() / corner.z).abs().min(border) } else { border }
    };
    let steepest = corners.iter().map(|corner| slope(corner).length_squared()).fold(0.0, f32::max);
    camera.focal.max_element() / depth * (1.0 + steepest).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from 0 to 1, always the same (Marsaglia's xorshift).
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f32 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 40) as f32 / (1 << 24) as f32
        }

        fn point(&mut self, size: f32) -> Vec3 {
            (Vec3::new(self.next(), self.next(), self.next()) - 0.5) * size
        }
    }

    /// A tree of cells with any numbers and errors, even such as a file of another program may have.
    fn tree(random: &mut Random, depth: u32) -> LodNode {
        if depth > 0 && random.next() > 0.1 {
            let children = vec![tree(random, depth - 1), tree(random, depth - 1)];
            let bounds = children.iter().map(|child| *child.bounds()).fold(Bounds::EMPTY, Bounds::union);
            return LodNode::Inner { bounds, children };
        }
        let corner = random.point(20.0);
        let bounds = Bounds { min: corner, max: corner + random.point(2.0).abs() };
        let count = 1 + (4.0 * random.next()) as usize;
        let level = |_| LodLevel { gaussians: (1000.0 * random.next()) as usize, error: random.next() };
        LodNode::Leaf { bounds, levels: (0..count).map(level).collect() }
    }

    fn cases() -> impl Iterator<Item = (LodNode, Camera)> {
        let mut random = Random(0x9e37_79b9_7f4a_7c15);
        (0..60).map(move |_| {
            let lens = Camera::looking_forward(640, 480, 1.0);
            let camera = lens.looking_at(random.point(30.0), random.point(5.0), Vec3::Y).unwrap();
            (tree(&mut random, 6), camera)
        })
    }

    #[test]
    fn a_cut_has_one_level_per_cell_within_a_possible_budget() {
        for (tree, camera) in cases() {
            let cells = tree.cells();
            let least: usize = cells.iter().map(|(_, levels)| levels.iter().map(|l| l.gaussians).min().unwrap()).sum();
            for budget in [1, least.max(1), least + 1, 2 * least + 500, usize::MAX] {
                let cut = tree.cut(&[camera], budget, 1.0).unwrap();
                assert_eq!(cut.levels.len(), cells.len());
                let counts = cells.iter().zip(&cut.levels).map(|((_, levels), &level)| levels[level].gaussians);
                assert_eq!(counts.sum::<usize>(), cut.gaussians);
                assert!(cut.gaussians <= budget.max(least), "{} of {budget}, {least}", cut.gaussians);
            }
        }
    }

    #[test]
    fn a_larger_budget_never_has_a_larger_error_or_a_coarser_cell() {
        for (tree, camera) in cases() {
            let cuts: Vec<_> = (0..40).map(|k| tree.cut(&[camera], 1 + 300 * k, 0.0).unwrap()).collect();
            for pair in cuts.windows(2) {
                assert!(pair[1].error_px <= pair[0].error_px);
                assert!(pair[1].levels.iter().zip(&pair[0].levels).all(|(more, less)| more <= less));
            }
            // The finest levels, unless a coarser one has as few errors.
            let best = tree.cut(&[camera], usize::MAX, 0.0).unwrap();
            let cells = tree.cells();
            let finest = cells.iter().map(|(bounds, levels)| levels[0].error * px_per_world(&camera, bounds));
            assert!(best.error_px <= finest.fold(0.0, f32::max));
        }
    }

    #[test]
    fn steps_end_at_the_cut_and_never_get_coarser_or_exceed_the_budget() {
        let cases: Vec<_> = cases().collect();
        for ((tree, camera), (_, before)) in cases.iter().zip(cases.iter().skip(1)) {
            let budget = tree.cut(&[], 1, 1.0).unwrap().gaussians + 800;
            let cut = |camera: &Camera, px| tree.cut(&[*camera], budget, px).unwrap();
            let (start, end) = (cut(before, 1.0).levels, cut(camera, 1.0));
            let gaussians = |levels: &[usize]| -> usize {
                tree.cells().iter().zip(levels).map(|((_, cell), &level)| cell[level].gaussians).sum()
            };
            let mut shown = start;
            for index in 0..LodNode::STEPS_PX.len() {
                let next = tree.step(Some(&shown), camera, budget, index).unwrap();
                assert!(gaussians(&next) <= budget);
                let is_finer =
                    next.iter().zip(&shown).zip(&end.levels).all(|((next, shown), end)| next <= shown.max(end));
                assert!(is_finer, "{shown:?} to {next:?}, in the end {:?}", end.levels);
                shown = next;
            }
            assert_eq!(shown, end.levels);
            assert_eq!(tree.step(None, camera, budget, 0).unwrap(), cut(camera, LodNode::STEPS_PX[0]).levels);
        }
    }

    #[test]
    fn cells_become_finer_until_their_errors_are_small_enough() {
        for (tree, camera) in cases() {
            let all = tree.cut(&[camera], usize::MAX, 0.0).unwrap();
            let cut = tree.cut(&[camera], usize::MAX, 5.0).unwrap();
            assert!(cut.error_px <= all.error_px.max(5.0) && cut.gaussians <= all.gaussians);
        }
    }

    #[test]
    fn near_cells_are_finest_and_cells_out_of_sight_coarsest() {
        let levels = vec![
            LodLevel { gaussians: 100, error: 0.0 },
            LodLevel { gaussians: 50, error: 0.01 },
            LodLevel { gaussians: 10, error: 0.1 },
        ];
        let at = |z: f32| {
            let bounds = Bounds { min: Vec3::new(0.0, 0.0, z), max: Vec3::new(0.0, 0.0, z + 1.0) };
            LodNode::Leaf { bounds, levels: levels.clone() }
        };
        let children = vec![at(-9.0), at(1.0), at(20.0), at(900.0)];
        let bounds = Bounds { min: Vec3::splat(-9.0), max: Vec3::splat(901.0) };
        let tree = LodNode::Inner { bounds, children };
        let mut camera = Camera::looking_forward(200, 200, 1.0);
        camera.focal = glam::Vec2::splat(200.0);
        // A world unit takes 200, 10 and 0.2 px.
        let cut = |budget| tree.cut(&[camera], budget, 1.0).unwrap();
        assert_eq!((cut(1000).levels, cut(1000).gaussians, cut(1000).error_px), (vec![2, 0, 2, 2], 130, 1.0));
        assert_eq!((cut(129).levels, cut(129).error_px), (vec![2, 1, 2, 2], 2.0));
        assert_eq!((cut(39).levels, cut(39).gaussians), (vec![2, 2, 2, 2], 40));
    }

    #[test]
    fn impossible_demands_are_errors() {
        let (tree, camera) = cases().next().unwrap();
        assert!(tree.cut(&[camera], 0, 1.0).unwrap_err().to_string().contains("budget"));
        assert!(tree.cut(&[camera], 1, f32::NAN).unwrap_err().to_string().contains("error"));
    }
}
