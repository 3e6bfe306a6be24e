//! Lloyd's relaxation: moves positions so that they lie evenly in their density.

use glam::Vec2;
use rayon::prelude::*;

use super::DensityMap;

/// Blocks per position into which the plane is cut: enough for a centroid, and few enough to be
/// fast.
const BLOCKS_PER_POSITION: usize = 40;

/// A square of pixels that goes to one position as a whole.
struct Block {
    centroid: Vec2,
    mass: f32,
}

impl DensityMap {
    /// Moves every position to the centroid of the part of the plane that is nearest to it, `steps`
    /// times (*source:* Lloyd 1982).
    ///
    /// Positions stay in order; they must lie in the image. The centroids are those of the squared
    /// density: positions at the centroids of a mass ρ² have the density ρ (Gersho's conjecture:
    /// centroids of a mass m have the density √m in 2D), so dense regions stay dense. The plane is
    /// cut into square blocks, some 40 for each position, and each block belongs to its nearest
    /// position as a whole.
    pub(crate) fn relax(&self, positions: &mut [Vec2], steps: u32) {
        if positions.is_empty() || steps == 0 {
            return;
        }
        let blocks = self.blocks(positions.len());
        for _ in 0..steps {
            let nearest = NearestPosition::new(self.size(), positions);
            let owners: Vec<usize> =
                blocks.par_iter().with_min_len(1024).map(|block| nearest.to(block.centroid)).collect();
            let mut sums = vec![(Vec2::ZERO, 0.0f32); positions.len()];
            for (block, &owner) in blocks.iter().zip(&owners) {
                let (moment, mass) = &mut sums[owner];
                *moment += block.centroid * block.mass;
                *mass += block.mass;
            }
            for (position, (moment, mass)) in positions.iter_mut().zip(sums) {
                if mass > 0.0 {
                    *position = moment / mass;
                }
            }
        }
    }

    /// The plane in square blocks, row by row.
    fn blocks(&self, positions: usize) -> Vec<Block> {
        let (width, height) = (self.size().0 as usize, self.size().1 as usize);
        let pixels_per_block = (width * height) as f32 / (positions * BLOCKS_PER_POSITION) as f32;
        let side = pixels_per_block.sqrt().ceil().max(1.0) as usize;
        // Relative to the densest possible, so that squares neither vanish nor overflow.
        let unit = 1.0 / self.values().iter().fold(f32::MIN_POSITIVE, |a, &b| a.max(b));
        let mut blocks = Vec::with_capacity(width.div_ceil(side) * height.div_ceil(side));
        for top in (0..height).step_by(side) {
            for left in (0..width).step_by(side) {
                let mut moment = Vec2::ZERO;
                let mut mass = 0.0;
                for y in top..(top + side).min(height) {
                    let row = &self.values()[y * width..][left..(left + side).min(width)];
                    for (x, &density) in row.iter().enumerate() {
                        let m = (density * unit) * (density * unit);
                        moment += Vec2::new((left + x) as f32 + 0.5, y as f32 + 0.5) * m;
                        mass += m;
                    }
                }
                if mass > 0.0 {
                    blocks.push(Block { centroid: moment / mass, mass });
                }
            }
        }
        blocks
    }
}

/// Finds the nearest of many positions: a grid of cells with about one position in each.
struct NearestPosition {
    cell_px: f32,
    columns: usize,
    rows: usize,
    /// `positions[starts[c]..starts[c + 1]]` lie in cell c.
    starts: Vec<u32>,
    positions: Vec<(Vec2, u32)>,
}

impl NearestPosition {
    fn new((width, height): (u32, u32), positions: &[Vec2]) -> Self {
        let cell_px = (width as f32 * height as f32 / positions.len() as f32).sqrt().max(1.0);
        let columns = (width as f32 / cell_px).ceil() as usize;
        let rows = (height as f32 / cell_px).ceil() as usize;
        let mut grid = Self { cell_px, columns, rows, starts: Vec::new(), positions: Vec::new() };
        let cells: Vec<usize> = positions.iter().map(|&p| grid.cell(p)).map(|(x, y)| y * columns + x).collect();
        grid.starts = vec![0; columns * rows + 1];
        for &cell in &cells {
            grid.starts[cell + 1] += 1;
        }
        for cell in 0..columns * rows {
            grid.starts[cell + 1] += grid.starts[cell];
        }
        let mut next = grid.starts.clone();
        grid.positions = vec![(Vec2::ZERO, 0); positions.len()];
        for (index, (&position, &cell)) in positions.iter().zip(&cells).enumerate() {
            grid.positions[next[cell] as usize] = (position, index as u32);
            next[cell] += 1;
        }
        grid
    }

    fn cell(&self, place: Vec2) -> (usize, usize) {
        let cell = place / self.cell_px;
        ((cell.x as usize).min(self.columns - 1), (cell.y as usize).min(self.rows - 1))
    }

    /// Index of the position nearest to `place`: rings of cells around it are searched until none
    /// further out can be nearer.
    fn to(&self, place: Vec2) -> usize {
        let (column, row) = self.cell(place);
        let mut best = (f32::INFINITY, 0);
        for ring in 0..self.columns.max(self.rows) {
            // Whatever is in this ring or beyond is at least ring − 1 cells away.
            let reach = (ring as f32 - 1.0).max(0.0) * self.cell_px;
            if best.0 < reach * reach {
                break;
            }
            let (top, bottom) = (row.saturating_sub(ring), (row + ring).min(self.rows - 1));
            let (left, right) = (column.saturating_sub(ring), (column + ring).min(self.columns - 1));
            for y in top..=bottom {
                if y.abs_diff(row) == ring {
                    self.search(y, left, right, place, &mut best);
                } else {
                    if column >= ring {
                        self.search(y, column - ring, column - ring, place, &mut best);
                    }
                    if column + ring < self.columns {
                        self.search(y, column + ring, column + ring, place, &mut best);
                    }
                }
            }
        }
        best.1 as usize
    }

    /// Improves `best`, (squared distance, index), by the positions in cells `left..=right` of a
    /// row.
    fn search(&self, row: usize, left: usize, right: usize, place: Vec2, best: &mut (f32, u32)) {
        let first = self.starts[row * self.columns + left] as usize;
        let end = self.starts[row * self.columns + right + 1] as usize;
        for &(position, index) in &self.positions[first..end] {
            let distance = position.distance_squared(place);
            if distance < best.0 {
                *best = (distance, index);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::{
        Rng,
        seed::{HilbertOrder, Plane},
    };

    fn map(count: usize) -> DensityMap {
        let weights = Plane::from_rows(90, 60, |_, row| {
            row[..45].fill(1.0);
            row[45..].fill(4.0);
        });
        DensityMap::from_weights(weights, count, 0.3)
    }

    /// Distance of every position to its nearest neighbour, times the root of the density there:
    /// 1.07 in a honeycomb.
    fn spacings(map: &DensityMap, positions: &[Vec2]) -> Vec<f32> {
        let distance = |i: usize| {
            let others = positions.iter().enumerate().filter(|(j, _)| *j != i);
            others.map(|(_, p)| p.distance(positions[i])).fold(f32::INFINITY, f32::min)
        };
        (0..positions.len()).map(|i| distance(i) * map.at(positions[i]).sqrt()).collect()
    }

    #[test]
    fn relaxed_positions_lie_more_evenly_and_keep_their_density() {
        let map = map(150);
        let mut positions = map.stratified(&HilbertOrder::new(90, 60), &mut Rng::seed_from_u64(4));
        let closest = |positions: &[Vec2]| {
            let mut spacings = spacings(&map, positions);
            spacings.sort_by(f32::total_cmp);
            spacings[positions.len() / 10]
        };
        let before = closest(&positions);
        map.relax(&mut positions, 6);
        let after = closest(&positions);
        assert!(after > 1.5 * before, "closest tenth: {before} before, {after} after");
        let dense = positions.iter().filter(|p| p.x >= 45.0).count();
        assert!(dense.abs_diff(120) <= 6, "{dense} of 150 where 120 should be");
        assert!(positions.iter().all(|p| p.x > 0.0 && p.x < 90.0 && p.y > 0.0 && p.y < 60.0));
    }

    #[test]
    fn the_grid_finds_what_a_search_of_all_finds() {
        let map = map(70);
        let positions = map.stratified(&HilbertOrder::new(90, 60), &mut Rng::seed_from_u64(9));
        let nearest = NearestPosition::new((90, 60), &positions);
        for y in 0..60 {
            for x in 0..90 {
                let place = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let best = positions.iter().map(|p| p.distance_squared(place)).fold(f32::INFINITY, f32::min);
                assert_eq!(positions[nearest.to(place)].distance_squared(place), best);
            }
        }
    }

    #[test]
    fn one_position_goes_to_the_centroid() {
        let map = DensityMap::from_weights(Plane::from_rows(8, 4, |_, row| row.fill(1.0)), 1, 0.3);
        let mut positions = [Vec2::new(0.2, 0.3)];
        map.relax(&mut positions, 1);
        assert!(positions[0].abs_diff_eq(Vec2::new(4.0, 2.0), 1e-4), "{}", positions[0]);
    }
}
