//! The tree of a scene: each Gaussian that is not in the scene stands in place of several others.
//!
//! It is made in rounds. The Gaussians of a round are divided into the cells of a streamed SOG, and those of a cell are
//! merged as for its levels. What is left, at most a 64th, is the next round, whose cells have other borders.

use std::{borrow::Cow, ops::Range};

use gs_core::{Gaussian3d, Scene, Scene3d};
use gs_density::Level;
use rayon::prelude::*;

use crate::scene3d::streamed::{CELL, Plan};

/// Every so many levels of a streamed SOG is one of the tree: a level has a quarter of the Gaussians of the one before,
/// so that a file has at most a third more Gaussians than its scene.
const STEP: usize = 2;

/// A scene and what stands in place of its Gaussians.
pub(super) struct Tree<'a> {
    scene: &'a Scene3d,
    /// Gaussians in place of others. Their numbers follow those of the scene.
    pub(super) merged: Scene3d,
    /// For each of them, the numbers of those in whose place it is, and where in the order they begin.
    children: Vec<(Vec<u32>, u32)>,
    /// The numbers of all Gaussians, in the order of the file.
    pub(super) order: Vec<u32>,
}

impl<'a> Tree<'a> {
    /// The tree of a scene with at least one Gaussian, and at most 2³¹.
    pub(super) fn of(scene: &'a Scene3d) -> Self {
        let empty = || Scene3d { sh_degree: scene.sh_degree, ..Scene3d::default() };
        let mut tree = Self { scene, merged: empty(), children: Vec::new(), order: Vec::new() };
        // What the cells of each round have merged.
        let mut rounds: Vec<Vec<Range<usize>>> = Vec::new();
        let mut left: Vec<u32> = (0..scene.len() as u32).collect();
        let mut gaussians = Cow::Borrowed(scene);
        while left.len() > 1 {
            let order = gs_density::spatial_order(&gaussians.means, CELL);
            let (mut next, mut next_left, mut round) = (empty(), Vec::new(), Vec::new());
            // Enough cells for all threads; they need memory until the last of them is done.
            for batch in Plan::of(&[left.len()]).cells.chunks(2 * rayon::current_num_threads()) {
                let made: Vec<Vec<Level>> = batch
                    .par_iter()
                    .map(|cell| {
                        let counts = cell.runs.iter().rev().step_by(STEP).map(|run| run.count);
                        gs_density::levels(&gaussians, &order[cell.members.clone()], &counts.rev().collect::<Vec<_>>())
                    })
                    .collect();
                for (cell, levels) in batch.iter().zip(made) {
                    let first = tree.children.len();
                    let mut before: Vec<u32> = order[cell.members.clone()].iter().map(|&i| left[i as usize]).collect();
                    for level in &levels {
                        before = (0..level.groups.len()).map(|k| tree.node(level, k, &before)).collect();
                    }
                    round.push(first..tree.children.len());
                    next_left.extend(before);
                    levels.into_iter().next_back().into_iter().for_each(|level| next.append(level.scene));
                }
            }
            rounds.push(round);
            (left, gaussians) = (next_left, Cow::Owned(next));
        }
        // From the coarsest round to the finest, cell by cell: what is near and of a size is in one chunk.
        tree.order = left;
        for number in rounds.into_iter().rev().flatten().flat_map(Iterator::rev) {
            let (children, start) = &mut tree.children[number];
            *start = tree.order.len() as u32;
            tree.order.extend(children.iter());
        }
        tree
    }

    /// The number of Gaussian `k` of a level, made of those with the numbers `before`.
    fn node(&mut self, level: &Level, k: usize, before: &[u32]) -> u32 {
        if let [one] = level.groups[k][..] {
            return before[one as usize];
        }
        self.merged.push(level.scene.gaussian(k));
        self.children.push((level.groups[k].iter().map(|&i| before[i as usize]).collect(), 0));
        (self.scene.len() + self.merged.len() - 1) as u32
    }

    /// The place in [`Self::merged`] of a Gaussian that is not in the scene.
    fn place(&self, number: u32) -> Option<usize> {
        (number as usize).checked_sub(self.scene.len())
    }

    pub(super) fn gaussian(&self, number: u32) -> Gaussian3d {
        self.place(number).map_or_else(|| self.scene.gaussian(number as usize), |place| self.merged.gaussian(place))
    }

    /// How many Gaussians it stands in place of, and where in the order they begin.
    pub(super) fn children(&self, number: u32) -> (u16, u32) {
        self.place(number).map_or((0, 0), |place| {
            let (children, start) = &self.children[place];
            (children.len() as u16, *start)
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn each_gaussian_but_the_first_is_the_child_of_one_before_it() {
        let gaussian = |i: usize| Gaussian3d {
            mean: Vec3::new((i % 100) as f32, (i / 100) as f32, (i as f32 * 0.37).sin()),
            log_scale: Vec3::new(-0.5, -0.7, -3.0),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 1.0,
            sh: vec![Vec3::splat((i as f32 * 0.11).cos())],
        };
        // One cell, and several.
        for count in [1, 2, 3, 70, 20_000] {
            let scene: Scene3d = (0..count).map(gaussian).collect();
            let tree = Tree::of(&scene);
            let mut numbers = tree.order.clone();
            numbers.sort_unstable();
            assert!(numbers.into_iter().eq(0..(count + tree.merged.len()) as u32));
            assert!(count < 70 || 3 * tree.merged.len() < count + 30, "{} for {count}", tree.merged.len());
            let mut next = vec![1];
            for (place, &number) in tree.order.iter().enumerate() {
                let (children, start) = tree.children(number);
                assert_eq!(children > 0, number as usize >= count);
                if children > 0 {
                    assert!(children > 1 && start as usize > place);
                    next.push(start);
                    next.push(start + u32::from(children));
                }
            }
            // The ranges of children are next to each other, and together are all but the first.
            next.push(tree.order.len() as u32);
            next.sort_unstable();
            assert!(next.as_chunks::<2>().0.iter().all(|[end, start]| end == start), "{count}");
        }
    }
}
