//! Which Gaussians lie on the same pixels of a view, and whether they come there in the order of a cheaper kind of sorting.
//!
//! Pixels are looked at in tiles. In each, the Gaussians whose boxes reach into it are gone through as the cheaper order has them, with the
//! range of the keys that the wanted order sorts them by: of pixels' depths, which are linear across a Gaussian, that over the part of its box
//! that is in the tile; of one depth a Gaussian, that depth. While no range begins before the end of an earlier one, the two orders agree at
//! each of the tile's pixels.

use glam::Vec2;

use crate::{
    constants::NARROW_PX,
    effects::Order,
    perspective::{Ellipsoid, Perspective},
    scene::{Scene, SpatialScene},
    settings::RenderSettings,
    view::Camera,
};

/// Side of a tile, px.
const TILE: u32 = 16;

/// Most pairs of a Gaussian and a tile that are looked at: 256 MB of them.
const MOST_PAIRS: usize = 1 << 26;

/// By how much, relative to the numbers that it is computed from, a pixel's depth may differ from what it should be.
const DEPTH_ROUNDING: f32 = 8.0 * f32::EPSILON;

/// A Gaussian of which a view may show something.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drawn {
    pub(super) index: usize,
    mean: Vec2,
    /// The pixels that the box of its cut's ellipse holds: first, and end.
    columns: [u32; 2],
    rows: [u32; 2],
    /// World units, and by px.
    depth: f32,
    slope: Vec2,
    /// Whether it is narrower than a pixel before it is widened.
    pub(super) narrow: bool,
}

/// What a view shows of a scene.
pub(super) struct Shown {
    /// By index.
    pub(super) drawn: Vec<Drawn>,
    size: (u32, u32),
}

impl Shown {
    /// Through a camera; nothing, where the camera is not possible.
    pub(super) fn of(scene: &SpatialScene, camera: &Camera, settings: &RenderSettings) -> Self {
        let size = (camera.width, camera.height);
        let mut drawn = Vec::new();
        if camera.validate().is_ok() {
            let perspective = Perspective::new(camera, settings);
            drawn.extend((0..scene.len()).filter_map(|index| Drawn::of(scene, index, &perspective, size, settings)));
        }
        Self { drawn, size }
    }

    /// How many Gaussians come, at some pixel, otherwise than `cheaper` would have them if `wanted` decides; `None` where there are too many
    /// pairs to look at.
    pub(super) fn out_of_order(&self, wanted: Order, cheaper: Order) -> Option<usize> {
        let mut sequence: Vec<u32> = (0..self.drawn.len() as u32).collect();
        if cheaper == Order::TileDepth {
            // Stable, so that ties stay by index.
            sequence.sort_by(|&a, &b| self.drawn[a as usize].depth.total_cmp(&self.drawn[b as usize].depth));
        }
        let across = self.size.0.div_ceil(TILE);
        let tiles = across as usize * self.size.1.div_ceil(TILE) as usize;
        let mut ends = vec![0usize; tiles];
        let mut pairs = 0;
        for drawn in &self.drawn {
            for tile in drawn.tiles(across) {
                ends[tile] += 1;
                pairs += 1;
            }
            if pairs > MOST_PAIRS {
                return None;
            }
        }
        let mut next = 0;
        for end in &mut ends {
            next += std::mem::replace(end, next);
        }
        let mut lists = vec![0u32; pairs];
        for &place in &sequence {
            for tile in self.drawn[place as usize].tiles(across) {
                lists[ends[tile]] = place;
                ends[tile] += 1;
            }
        }
        let mut is_out = vec![false; self.drawn.len()];
        let mut first = 0;
        for (tile, end) in ends.into_iter().enumerate() {
            let corner = [tile as u32 % across * TILE, tile as u32 / across * TILE];
            // The farthest so far, ties by index, and who that is.
            let mut farthest: Option<(f32, usize, u32)> = None;
            for &place in &lists[first..end] {
                let drawn = &self.drawn[place as usize];
                let [near, far] = match wanted {
                    Order::PixelDepth => drawn.depths_in(corner),
                    Order::TileDepth | Order::Index => [drawn.depth; 2],
                };
                match farthest {
                    Some((depth, index, other)) if (depth, index) > (near, drawn.index) => {
                        is_out[place as usize] = true;
                        is_out[other as usize] = true;
                    }
                    _ => {}
                }
                if farthest.is_none_or(|(depth, index, _)| (far, drawn.index) > (depth, index)) {
                    farthest = Some((far, drawn.index, place));
                }
            }
            first = end;
        }
        Some(is_out.into_iter().filter(|&out| out).count())
    }
}

impl Drawn {
    fn of(
        scene: &SpatialScene,
        index: usize,
        perspective: &Perspective,
        (width, height): (u32, u32),
        settings: &RenderSettings,
    ) -> Option<Self> {
        let ellipsoid = Ellipsoid {
            mean: scene.means[index],
            log_scale: scene.log_scales[index],
            rotation: scene.rotations[index],
            opacity_logit: scene.opacity_logits[index],
        };
        let p = perspective.project(&ellipsoid).ok()?;
        let reach = 2.0 * (p.opacity / settings.accuracy.alpha_cut).ln();
        let [xx, xy, yy] = p.covariance;
        let columns = pixels(p.mean.x, (reach * xx).sqrt(), width)?;
        let rows = pixels(p.mean.y, (reach * yy).sqrt(), height)?;
        // The smaller eigenvalue, by way of the larger, so that it does not cancel in needles.
        let larger = 0.5 * (xx + yy) + (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        let variance = p.determinant / larger - settings.effects.antialias.dilation();
        Some(Self {
            index,
            mean: p.mean,
            columns,
            rows,
            depth: p.depth,
            slope: p.depth_slope,
            narrow: variance < NARROW_PX * NARROW_PX,
        })
    }

    /// The tiles that its box reaches into.
    fn tiles(&self, across: u32) -> impl Iterator<Item = usize> {
        let [columns, rows] = [self.columns, self.rows].map(|[first, end]| first / TILE..(end - 1) / TILE + 1);
        rows.flat_map(move |row| columns.clone().map(move |column| (row * across + column) as usize))
    }

    /// The least and the greatest depth at those pixels of its box that are in the tile with this corner.
    fn depths_in(&self, corner: [u32; 2]) -> [f32; 2] {
        let within = |[first, end]: [u32; 2], corner: u32| {
            let (low, high) = (first.max(corner), end.min(corner + TILE) - 1);
            (0.5 * (low + high) as f32 + 0.5, 0.5 * (high - low) as f32)
        };
        let ((x, half_x), (y, half_y)) = (within(self.columns, corner[0]), within(self.rows, corner[1]));
        let away = Vec2::new(x, y) - self.mean;
        let half = Vec2::new(half_x, half_y).dot(self.slope.abs());
        let size = self.depth.abs() + away.abs().dot(self.slope.abs()) + half;
        let half = half + if self.slope == Vec2::ZERO { 0.0 } else { size * DEPTH_ROUNDING };
        let middle = self.depth + self.slope.dot(away);
        [middle - half, middle + half]
    }
}

/// The pixels whose centres lie within `half` of the mean, a little more for roundings; `None` where there are none.
fn pixels(mean: f32, half: f32, side: u32) -> Option<[u32; 2]> {
    const SLACK: f32 = 2e-3;
    let first = (mean - half - 0.5 - SLACK).ceil().clamp(0.0, side as f32);
    let end = ((mean + half - 0.5 + SLACK).floor() + 1.0).clamp(0.0, side as f32);
    (first < end).then_some([first as u32, end as u32])
}
