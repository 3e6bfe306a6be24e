//! Which Gaussians a streamed SOG has in which chunk, which follows from the numbers of its parts alone.

use std::{ops::Range, path::Path};

use gs_core::Bounds;

use super::{
    layout::Layout,
    meta::{LEVELS, LodMeta, Node, Run, VERSION, WORLD},
};
use crate::{
    error::Error,
    scene3d::{Encoded3d, Format3d, options::ToWrite, sog},
};

/// Gaussians of a chunk above which no further cell is added.
const CHUNK: usize = 1 << 18;

/// Most Gaussians of a cell. Smaller cells fit a view better, but more merges stop at their borders.
pub(in crate::scene3d) const CELL: usize = 1 << 13;

/// A cell of the tree.
#[derive(Debug)]
pub(in crate::scene3d) struct Cell {
    /// The part of the scene that it is in.
    pub(super) part: usize,
    /// Its Gaussians in the [`gs_density::spatial_order`] of the part.
    pub(in crate::scene3d) members: Range<usize>,
    /// Its run in each level.
    pub(in crate::scene3d) runs: Vec<Run>,
}

/// The chunks of a scene in any number of parts, of any number of Gaussians. Each part has a tree of its own, and one
/// above them joins them.
#[derive(Debug)]
pub(in crate::scene3d) struct Plan {
    pub(in crate::scene3d) cells: Vec<Cell>,
    /// Names of the chunks, in the order of the files in `lod-meta.json`; those of the finest level begin with `0_`.
    pub(super) chunks: Vec<String>,
}

impl Plan {
    /// `parts` are the numbers of Gaussians of the parts. Those without any have no cells.
    pub(in crate::scene3d) fn of(parts: &[usize]) -> Self {
        let mut plan = Self { cells: Vec::new(), chunks: Vec::new() };
        let with_some = parts.iter().enumerate().filter(|(_, gaussians)| **gaussians > 0);
        with_some.for_each(|(part, gaussians)| plan.add_cells(part, 0..*gaussians));
        let largest = plan.cells.iter().map(|cell| cell.members.len()).max().unwrap_or(1);
        let levels = LEVELS.min(1 + largest.ilog2() as usize);
        // The chunk of each level that is not full: its index, and how many Gaussians it has.
        let mut open = vec![None; levels];
        let mut numbers = vec![0; levels];
        for cell in &mut plan.cells {
            for (level, open) in open.iter_mut().enumerate() {
                let (file, offset) = open.unwrap_or_else(|| {
                    plan.chunks.push(format!("{level}_{}", numbers[level]));
                    numbers[level] += 1;
                    (plan.chunks.len() - 1, 0)
                });
                let count = (cell.members.len() >> level).max(1);
                cell.runs.push(Run { file, offset, count });
                *open = Some((file, offset + count)).filter(|(_, filled)| *filled < CHUNK);
            }
        }
        plan
    }

    fn add_cells(&mut self, part: usize, range: Range<usize>) {
        match gs_density::halves(&range, CELL) {
            Some(halves) => halves.into_iter().for_each(|half| self.add_cells(part, half)),
            None => self.cells.push(Cell { part, members: range, runs: Vec::new() }),
        }
    }

    /// The cells of each part that has some, in order.
    pub(super) fn parts(&self) -> impl Iterator<Item = &[Cell]> {
        self.cells.chunk_by(|a, b| a.part == b.part)
    }

    /// The lengths of the runs of a chunk.
    fn runs(&self, file: usize) -> Vec<usize> {
        self.cells.iter().flat_map(|cell| &cell.runs).filter(|run| run.file == file).map(|run| run.count).collect()
    }

    /// The description of the scene, whose cells are `leaves`.
    fn meta(&self, leaves: Vec<Node>) -> LodMeta {
        let levels = self.cells.first().map_or(0, |cell| cell.runs.len());
        let count = |level: usize| self.cells.iter().map(|cell| cell.runs[level].count as u64).sum();
        let counts: Vec<u64> = (0..levels).map(count).collect();
        let leaves = &mut leaves.into_iter();
        let of_part = |cells: &[Cell]| above(0..cells.last().map_or(0, |cell| cell.members.end), leaves);
        let of_parts = self.parts().map(of_part).collect();
        LodMeta {
            version: Some(VERSION),
            asset: serde_json::json!({ "generator": concat!("gs ", env!("CARGO_PKG_VERSION")) }),
            count: Some(counts.iter().sum()),
            counts: Some(counts),
            lod_levels: levels,
            lod_errors: true,
            error_unit: Some(WORLD.to_owned()),
            environment: None,
            filenames: self.chunks.iter().map(|chunk| format!("{chunk}/{}", sog::META)).collect(),
            tree: joined(of_parts),
        }
    }
}

impl Layout for Plan {
    fn plan(&self) -> &Plan {
        self
    }

    fn names(&self, chunk: &str, sh_degree: u8) -> Vec<String> {
        [&sog::META].into_iter().chain(sog::image_names(sh_degree)).map(|name| format!("{chunk}/{name}")).collect()
    }

    fn encode(&self, file: usize, to: &ToWrite<'_>) -> Result<Encoded3d, Error> {
        sog::encode_runs(&ToWrite { format: Format3d::SogFolder, ..*to }, &self.runs(file))
    }

    fn describe(&self, path: &Path, cells: Vec<Node>) -> Result<Vec<u8>, Error> {
        serde_json::to_vec(&self.meta(cells)).map_err(|error| Error::write(path, error.into()))
    }
}

/// The node of a range, made of the next cells.
fn above(range: Range<usize>, leaves: &mut impl Iterator<Item = Node>) -> Node {
    let Some(halves) = gs_density::halves(&range, CELL) else { return leaves.next().expect("a node for each cell") };
    let [left, right] = halves.map(|half| above(half, leaves));
    parent(left, right)
}

/// The node of several, in a tree that halves them; there is at least one.
fn joined(mut nodes: Vec<Node>) -> Node {
    let later = nodes.split_off(nodes.len().div_ceil(2));
    match later.is_empty() {
        true => nodes.swap_remove(0),
        false => parent(joined(nodes), joined(later)),
    }
}

fn parent(left: Node, right: Node) -> Node {
    Node {
        bound: Bounds::from(&left.bound).union((&right.bound).into()).into(),
        children: Some(vec![Some(left), Some(right)]),
        lods: None,
        errors: None,
    }
}
