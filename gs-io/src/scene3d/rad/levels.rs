//! The levels of detail of a RAD, as a streamed SOG has them: cells, each with several levels.
//!
//! A cell is a Gaussian of the tree with all below it, of at most [`LEAVES`] leaves. To get from a level
//! to the next finer one, those Gaussians whose leaves are moved most are replaced by their children.

use std::{cmp::Reverse, collections::BinaryHeap, ops::Range, sync::Arc};

use gs_core::{Bounds, Gaussian3d, LodLevel, LodNode, Scene, Scene3d, sigmoid};
use rayon::prelude::*;

use super::{MAGIC, Meta, Which, contents, json};
use crate::{
    error::Error,
    scene3d::{
        Format3d, checked,
        source::Source,
        streamed::{InMemory, LEVELS, LodFile3d, Run},
    },
};

/// Most leaves of a cell. Smaller cells fit a view better, and unlike in a streamed SOG no merge stops at their borders;
/// but a cell has at least one Gaussian. Of 2⁸ to 2¹³, this had the highest mean PSNR: of two scenes, for three budgets.
const LEAVES: usize = 1 << 9;

/// Reads all levels of a file with a tree; `None` for one without.
pub(in crate::scene3d) fn levels(source: &Source<'_>) -> Result<Option<LodFile3d>, Error> {
    let (meta, _): (Meta, usize) = json(source, 0, MAGIC, "the head")?;
    if meta.lod_tree != Some(true) {
        return Ok(None);
    }
    let (file, children) = contents(source, Format3d::Rad, Which::All)?;
    let mut file = checked(file, source.path)?;
    file.bytes = file.bytes.saturating_add(source.bytes.len() as u64);
    let tree = Tree::of(std::mem::take(&mut file.scene), children);
    let cells: Vec<Cell> = tree.tops().into_par_iter().map(|top| tree.cell(top)).collect();
    let most = cells.iter().map(|cell| cell.levels.len()).max().ok_or_else(|| Error::empty(source.path))?;
    let (mut parts, mut runs, mut nodes, mut all) = (Vec::new(), Vec::new(), Vec::new(), Bounds::EMPTY);
    for Cell { bounds, levels } in cells {
        let (mut run, mut described) = (Vec::new(), Vec::new());
        for (scene, error) in levels {
            described.push(LodLevel { gaussians: scene.len(), error });
            run.push(Some(Run { file: parts.len(), offset: 0, count: scene.len() }));
            parts.push(scene);
        }
        // All cells have as many levels; further ones are the coarsest again.
        run.resize(most, run[run.len() - 1]);
        described.resize(most, described[described.len() - 1]);
        runs.push(run);
        nodes.push(LodNode::Leaf { bounds, levels: described });
        all = all.union(bounds);
    }
    let tree = LodNode::Inner { bounds: all, children: nodes };
    Ok(Some(LodFile3d::in_memory(source.path, runs, tree, Arc::new(InMemory { file, parts }))))
}

/// The leaves in whose place a Gaussian is. A Gaussian is a point of six coordinates: its mean, and its scales in order.
/// The distance of two such points is the transport distance (Wasserstein-2) of Gaussians whose axes are parallel.
#[derive(Debug, Clone, Copy, Default)]
struct Leaves {
    number: usize,
    /// Their opacities times areas.
    weight: f64,
    /// Weighted sum of their points.
    points: [f64; 6],
    /// Weighted sum of the squares of their points.
    squares: f64,
    /// Weighted sum of their squared distances from the Gaussian.
    moved: f64,
}

impl Leaves {
    fn add(&mut self, other: &Self) {
        self.number += other.number;
        self.weight += other.weight;
        self.squares += other.squares;
        self.points.iter_mut().zip(other.points).for_each(|(sum, point)| *sum += point);
    }
}

/// A tree of Gaussians.
struct Tree {
    scene: Scene3d,
    /// Those in whose place each Gaussian is; they come after it.
    children: Vec<Range<usize>>,
    leaves: Vec<Leaves>,
}

/// A cell: its bounds in all levels, and its levels with their errors, the finest first.
struct Cell {
    bounds: Bounds,
    levels: Vec<(Scene3d, f32)>,
}

impl Tree {
    fn of(scene: Scene3d, children: Vec<Range<usize>>) -> Self {
        let mut leaves = vec![Leaves::default(); scene.len()];
        for i in (0..scene.len()).rev() {
            let (point, weight) = point(&scene.gaussian(i));
            let square = dot(&point, &point);
            let mut of = Leaves::default();
            children[i].clone().for_each(|child| of.add(&leaves[child]));
            leaves[i] = match children[i].is_empty() {
                true => Leaves {
                    number: 1,
                    weight,
                    points: point.map(|x| weight * x),
                    squares: weight * square,
                    moved: 0.0,
                },
                false => {
                    let moved = of.squares - 2.0 * dot(&of.points, &point) + of.weight * square;
                    Leaves { moved: moved.max(0.0), ..of }
                }
            };
        }
        Self { scene, children, leaves }
    }

    /// The highest Gaussian of each cell.
    fn tops(&self) -> Vec<usize> {
        let (mut tops, mut is_inside) = (Vec::new(), vec![false; self.scene.len()]);
        for (i, children) in self.children.iter().enumerate() {
            let is_top = !is_inside[i] && self.leaves[i].number <= LEAVES;
            if is_top {
                tops.push(i);
            }
            if is_top || is_inside[i] {
                is_inside[children.clone()].fill(true);
            }
        }
        tops
    }

    fn cell(&self, top: usize) -> Cell {
        // Those of a level that have children, by the bits of what their leaves moved, which are in its order; and those
        // that have none.
        let (mut inner, mut ends) = (BinaryHeap::new(), Vec::new());
        let put = |i: usize, inner: &mut BinaryHeap<_>, ends: &mut Vec<usize>| match self.children[i].is_empty() {
            true => ends.push(i),
            false => inner.push((self.leaves[i].moved.to_bits(), Reverse(i))),
        };
        put(top, &mut inner, &mut ends);
        let (mut levels, mut bounds) = (Vec::new(), Bounds::EMPTY);
        let mut before = Vec::new();
        for level in (0..LEVELS).rev() {
            let most = (self.leaves[top].number >> level).max(1);
            while let Some(&(_, Reverse(i))) = inner.peek() {
                if inner.len() + ends.len() - 1 + self.children[i].len() > most {
                    break;
                }
                inner.pop();
                self.children[i].clone().for_each(|child| put(child, &mut inner, &mut ends));
            }
            let mut numbers: Vec<usize> = inner.iter().map(|&(_, Reverse(i))| i).chain(ends.iter().copied()).collect();
            numbers.sort_unstable();
            if numbers == before {
                continue;
            }
            let scene: Scene3d = numbers.iter().map(|&i| self.scene.gaussian(i)).collect();
            bounds = (0..scene.len()).map(|i| Bounds::of(&scene.gaussian(i))).fold(bounds, Bounds::union);
            let moved: f64 = inner.iter().map(|(_, Reverse(i))| self.leaves[*i].moved).sum();
            levels.push((scene, (moved / self.leaves[top].weight).sqrt() as f32));
            before = numbers;
        }
        levels.reverse();
        Cell { bounds, levels }
    }
}

/// A Gaussian as a point, and its weight, opacity times area.
fn point(gaussian: &Gaussian3d) -> ([f64; 6], f64) {
    // Sums of larger ones would be infinite.
    let mut scales = gaussian.log_scale.to_array().map(|log| f64::from(log).clamp(-60.0, 60.0).exp());
    scales.sort_unstable_by(f64::total_cmp);
    let [x, y, z] = gaussian.mean.as_dvec3().to_array();
    let [a, b, c] = scales;
    ([x, y, z, a, b, c], f64::from(sigmoid(gaussian.opacity_logit)).max(1e-9) * b * c)
}

fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
