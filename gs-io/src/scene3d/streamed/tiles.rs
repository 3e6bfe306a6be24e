//! 3D Tiles 1.1, the format of CesiumJS for scenes on the globe: the cells of a streamed SOG as `.glb`.
//!
//! `tileset.json` has the tree. The tile of a cell has its finest level; a tile above has a coarser level of all of its
//! cells, in place of which (`REPLACE`) its tiles are shown where they are near. The levels are every second one of a
//! streamed SOG, so that a tile has about as many Gaussians as a cell, and the tiles have a third more Gaussians than
//! the scene. Tiles above the coarsest level have no content.
//!
//! Errors are those of the levels in scene units, times 16: CesiumJS shows a tile where its error is at most 16 px
//! (`maximumScreenSpaceError`), which is the error of 1 px at which other commands choose levels. A tile without content
//! has the diagonal of its box as error.
//!
//! A `.glb` has y up, and CesiumJS turns it to z up, which is up in tiles: with the axes of scenes here, a place (x, y, z)
//! becomes (−x, −z, −y).
//!
//! *Source:* OGC 22-025r4, 3D Tiles 1.1; `3DTILES_content_gltf`, because CesiumJS looks there for Gaussians.

use std::{ops::Range, path::Path};

use glam::{DAffine3, DMat3, DMat4, DVec3};
use gs_core::{Bounds, LodNode};
use serde_json::{Value, json};

use super::{
    layout::Layout,
    meta::{LEVELS, Node, Run},
    plan::{CELL, Cell, Plan},
};
use crate::{
    WorldFrame,
    earth::Earth,
    error::Error,
    scene3d::{ConversionLoss, Encoded3d, WriteOptions3d, gltf, options::ToWrite},
};

/// The error, px, below which CesiumJS does not refine a tile by default.
const CESIUM_ERROR_PX: f32 = 16.0;

/// From scenes to tiles, and back: (x, y, z) to (−x, −z, −y).
const AXES: DMat3 = DMat3::from_cols(DVec3::NEG_X, DVec3::NEG_Z, DVec3::NEG_Y);

/// A tree of tiles.
pub(super) struct Tileset {
    plan: Plan,
    root: Tile,
    frame: WorldFrame,
    earth: Option<Earth>,
}

/// A tile with the cells below it.
struct Tile {
    /// The index of its chunk, if it has content.
    file: Option<usize>,
    cells: Range<usize>,
    children: Vec<Tile>,
}

impl Tileset {
    /// `gaussians` are the numbers of Gaussians of the scene's parts, of which at least one has some.
    pub(super) fn of(gaussians: &[usize], path: &Path, options: &WriteOptions3d) -> Result<Self, Error> {
        let unknown = |code| {
            let hint = "use 4978 (ECEF), or UTM: 32601 to 32660, 32701 to 32760, 25828 to 25838; or leave the code out";
            Error::unsupported(path, format!("a tileset in coordinates of EPSG:{code}"), hint)
        };
        let earth = options.epsg.map(|code| Earth::of(code).ok_or_else(|| unknown(code))).transpose()?;
        let mut plan = Plan { cells: Vec::new(), chunks: Vec::new() };
        let with_some = gaussians.iter().enumerate().filter(|(_, gaussians)| **gaussians > 0);
        let mut roots: Vec<Tile> = with_some.map(|(part, gaussians)| root(&mut plan, part, 0..*gaussians)).collect();
        let root = match roots.len() {
            1 => roots.remove(0),
            _ => Tile { file: None, cells: 0..plan.cells.len(), children: roots },
        };
        Ok(Self { plan, root, frame: options.trained_with.frame, earth })
    }

    /// The JSON of a tile, its box, and its error.
    fn json(&self, tile: &Tile, cells: &[Node]) -> (Value, Bounds, f32) {
        let bounds = cells[tile.cells.clone()].iter().map(|cell| Bounds::from(&cell.bound));
        let bounds = bounds.fold(Bounds::EMPTY, Bounds::union);
        let [low, high] = [bounds.min, bounds.max].map(|corner| AXES * corner.as_dvec3());
        let (center, half) = ((low + high) / 2.0, (low - high).abs() / 2.0);
        let [x, y, z] = DMat3::from_diagonal(half).to_cols_array_2d();
        let volume = [center.to_array(), x, y, z].concat();
        let errors = |file: usize| {
            let of_cell = move |cell: usize| {
                let run = self.plan.cells[cell].runs.iter().position(|run| run.file == file)?;
                cells[cell].errors.as_ref()?.get(run).copied()
            };
            tile.cells.clone().filter_map(of_cell).fold(0.0, f32::max)
        };
        let children: Vec<_> = tile.children.iter().map(|child| self.json(child, cells)).collect();
        let own = tile.file.map(|file| CESIUM_ERROR_PX / LodNode::USUAL_ERROR_PX * errors(file));
        let own = own.unwrap_or_else(|| diagonal(&bounds));
        let error = children.iter().map(|(.., error)| *error).fold(own, f32::max);
        let mut json = json!({
            "boundingVolume": { "box": volume },
            "geometricError": error,
        });
        if let Some(file) = tile.file {
            json["content"] = json!({ "uri": name(&self.plan.chunks[file]) });
        }
        if !children.is_empty() {
            json["children"] = children.into_iter().map(|(json, ..)| json).collect();
        }
        (json, bounds, error)
    }
}

impl Layout for Tileset {
    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn names(&self, chunk: &str, _: u8) -> Vec<String> {
        vec![name(chunk)]
    }

    fn encode(&self, _: usize, to: &ToWrite<'_>) -> Result<Encoded3d, Error> {
        let mut encoded = gltf::encode_spz(to)?;
        let is_lost = self.earth.is_none() && !self.frame.is_world();
        encoded.written.losses.extend(is_lost.then_some(ConversionLoss::Frame(self.frame)));
        Ok(encoded)
    }

    fn describe(&self, path: &Path, cells: Vec<Node>) -> Result<Vec<u8>, Error> {
        let (mut root, bounds, error) = self.json(&self.root, &cells);
        root["refine"] = json!("REPLACE");
        if let Some(earth) = &self.earth {
            let center = self.frame.to_world(middle(&cells));
            if !earth.contains(center) {
                let what = format!("a tileset around {center}, which is no place in the system of its EPSG code,");
                return Err(Error::unsupported(path, what, "use the code of the data set's coordinates, or none"));
            }
            let to_world = self.frame.to(&WorldFrame::WORLD) * DAffine3::from_mat3(AXES);
            root["transform"] = json!(DMat4::from(earth.near(center) * to_world).to_cols_array());
        }
        let extensions = gltf::TILE_EXTENSIONS;
        let tileset = json!({
            "asset": { "version": "1.1", "generator": concat!("gs ", env!("CARGO_PKG_VERSION")) },
            "extensionsUsed": ["3DTILES_content_gltf"],
            "extensions": {
                "3DTILES_content_gltf": { "extensionsUsed": extensions, "extensionsRequired": extensions }
            },
            "geometricError": error.max(diagonal(&bounds)),
            "root": root,
        });
        Ok(tileset.to_string().into_bytes())
    }
}

/// The file of a chunk.
fn name(chunk: &str) -> String {
    format!("{chunk}.glb")
}

fn diagonal(bounds: &Bounds) -> f32 {
    bounds.max.distance(bounds.min)
}

/// The median of the middles of cells, which a few Gaussians far away do not move.
fn middle(cells: &[Node]) -> DVec3 {
    let boxes = || cells.iter().map(|cell| Bounds::from(&cell.bound));
    let middles = |axis: usize| boxes().map(move |bounds| bounds.min.as_dvec3().midpoint(bounds.max.as_dvec3())[axis]);
    DVec3::from([0, 1, 2].map(|axis| {
        let mut sorted: Vec<f64> = middles(axis).collect();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    }))
}

/// The tile of a part of the scene, whose cells and chunks are added to the plan.
fn root(plan: &mut Plan, part: usize, range: Range<usize>) -> Tile {
    let cells = plan.cells.len();
    let (height, mut tiles) = tiles(plan, part, range);
    if tiles.len() == 1 { tiles.remove(0) } else { tile(plan, height, cells, tiles) }
}

/// The tiles of a range, and how many levels are above the finest: a single tile where these are even.
fn tiles(plan: &mut Plan, part: usize, range: Range<usize>) -> (usize, Vec<Tile>) {
    let first = plan.cells.len();
    let (height, children) = match gs_density::halves(&range, CELL) {
        None => {
            plan.cells.push(Cell { part, members: range, runs: Vec::new() });
            (0, Vec::new())
        }
        Some(halves) => {
            let [(left, mut tiles), (right, more)] = halves.map(|half| self::tiles(plan, part, half));
            tiles.extend(more);
            (1 + left.max(right), tiles)
        }
    };
    if height % 2 == 0 { (height, vec![tile(plan, height, first, children)]) } else { (height, children) }
}

/// A tile with the cells from this one on.
fn tile(plan: &mut Plan, height: usize, first: usize, children: Vec<Tile>) -> Tile {
    let (file, mut offset) = (plan.chunks.len(), 0);
    let has_content = height < LEVELS;
    if has_content {
        plan.chunks.push(format!("{height}_{file}"));
        for cell in &mut plan.cells[first..] {
            let count = (cell.members.len() >> height).max(1);
            cell.runs.push(Run { file, offset, count });
            offset += count;
        }
    }
    Tile { file: has_content.then_some(file), cells: first..plan.cells.len(), children }
}
