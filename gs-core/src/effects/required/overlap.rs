//! Whether a cheaper order is the same as the wanted one wherever Gaussians lie on the same pixels
//! of a view.
//!
//! Pixels are examined in tiles. In each tile, the Gaussians whose boxes reach into it are visited
//! in the cheaper order, each with the range of its sorting key in the wanted order: for depths per
//! pixel, which are linear across a Gaussian, the range over the part of its box in the tile; for
//! one depth per Gaussian, that depth. While no range begins before the end of an earlier one, the
//! two orders agree at each of the tile's pixels.
//!
//! Backends round depths differently, so every range is extended by the possible rounding errors,
//! and two Gaussians whose ranges touch are out of order, unless their depths are computed from the
//! same numbers and so are equal everywhere.

use glam::Vec2;

use crate::{
    constants::NARROW_PX,
    effects::Order,
    math::perspective::{Ellipsoid, Perspective},
    scene::{Scene, Scene3d},
    settings::RenderSettings,
    view::Camera,
};

/// Side of a tile, px.
const TILE: u32 = 16;

/// Largest number of pairs of a Gaussian and a tile that are examined: 256 MB of them.
const MOST_PAIRS: usize = 1 << 26;

/// Rounding error of a depth, relative to the numbers that it is computed from.
const DEPTH_ROUNDING: f32 = 8.0 * f32::EPSILON;

/// Rounding error of a box's border, relative to the numbers that it is computed from: WGSL allows
/// exp and division some units in the last place.
const BORDER_ROUNDING: f32 = 64.0 * f32::EPSILON;

/// Absolute part of the rounding error of a box's border, px.
const BORDER_SLACK: f32 = 2e-3;

/// Relative rounding error of α at the cut.
const CUT_ROUNDING: f32 = 1e-4;

/// A Gaussian that a view may show.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drawn {
    pub(super) index: usize,
    mean: Vec2,
    /// Pixels in the box of its cut's ellipse: first and end.
    columns: [u32; 2],
    rows: [u32; 2],
    /// World units, and world units per px.
    depth: f32,
    slope: Vec2,
    /// Rounding error of the depth.
    depth_rounding: f32,
    /// Bits of the coordinates of the mean from which the depth is computed.
    depth_terms: [u32; 3],
    /// Whether the Gaussian is narrower than a pixel before it is widened.
    pub(super) narrow: bool,
}

/// The part of a scene that a view shows.
pub(super) struct Shown {
    /// The Gaussians drawn, by index.
    pub(super) drawn: Vec<Drawn>,
    size: (u32, u32),
}

impl Shown {
    /// What a camera shows; nothing where the camera is not possible.
    pub(super) fn of(scene: &Scene3d, camera: &Camera, settings: &RenderSettings) -> Self {
        let size = (camera.width, camera.height);
        let mut drawn = Vec::new();
        if camera.validate().is_ok() {
            let mut settings = *settings;
            settings.accuracy.alpha_cut *= 1.0 - CUT_ROUNDING;
            let through = Through { camera, settings: &settings, perspective: Perspective::new(camera, &settings) };
            drawn.extend((0..scene.len()).filter_map(|index| Drawn::of(scene, index, &through)));
        }
        Self { drawn, size }
    }

    /// Number of Gaussians whose place in the two orders may differ at some pixel; `None` where
    /// there are too many pairs to examine.
    pub(super) fn out_of_order(&self, wanted: Order, cheaper: Order) -> Option<usize> {
        let mut sequence: Vec<u32> = (0..self.drawn.len() as u32).collect();
        if cheaper == Order::Global {
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
            let mut mark =
                |pair: Option<[u32; 2]>| pair.into_iter().flatten().for_each(|at| is_out[at as usize] = true);
            let (mut by_depth, mut by_pixel) = (Farthest::default(), Farthest::default());
            for &place in &lists[first..end] {
                let drawn = &self.drawn[place as usize];
                let terms = Among::Terms(drawn.depth_terms);
                if wanted == Order::PerPixel {
                    let flat = (drawn.slope == Vec2::ZERO).then_some(Among::Flat);
                    mark(by_pixel.next(drawn.depths_in(corner), flat.unwrap_or(Among::None(place)), place));
                    // Rounding must not change the cheaper order either.
                    mark(by_depth.next(drawn.depths(), flat.unwrap_or(terms), place));
                } else {
                    mark(by_depth.next(drawn.depths(), terms, place));
                }
            }
            first = end;
        }
        Some(is_out.into_iter().filter(|&out| out).count())
    }
}

/// Group of Gaussians whose order is fixed, however near they are. Equal values are in one group.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Among {
    /// Gaussians whose depth is computed from the same numbers, so that their indices decide.
    Terms([u32; 3]),
    /// Gaussians whose depth is the same at all pixels, so that both orders use the same number.
    Flat,
    /// A group of this Gaussian alone.
    None(u32),
}

/// End of a range, its group and its Gaussian.
type End = (f32, Among, u32);

/// The farthest ends so far of two Gaussians from different groups.
#[derive(Debug, Default)]
struct Farthest {
    first: Option<End>,
    /// The farthest end from another group than the first.
    second: Option<End>,
}

impl Farthest {
    /// Adds the next Gaussian's range; returns the two Gaussians that may swap, if any.
    fn next(&mut self, [near, far]: [f32; 2], among: Among, place: u32) -> Option<[u32; 2]> {
        let before = [self.first, self.second].into_iter().flatten().find(|end| end.1 != among);
        let end = Some((far, among, place));
        match self.first {
            Some((farthest, other, _)) if other == among => {
                if far > farthest {
                    self.first = end;
                }
            }
            Some((farthest, ..)) if far > farthest => (self.first, self.second) = (end, self.first),
            Some(_) if self.second.is_none_or(|(second, ..)| far > second) => self.second = end,
            Some(_) => {}
            None => self.first = end,
        }
        before.filter(|&(farthest, ..)| farthest >= near).map(|(.., other)| [other, place])
    }
}

/// A view of the scene with its settings.
struct Through<'a> {
    camera: &'a Camera,
    settings: &'a RenderSettings,
    perspective: Perspective,
}

impl Drawn {
    fn of(scene: &Scene3d, index: usize, through: &Through<'_>) -> Option<Self> {
        let Through { camera, settings, perspective } = through;
        let ellipsoid = Ellipsoid {
            mean: scene.means[index],
            log_scale: scene.log_scales[index],
            rotation: scene.rotations[index],
            opacity_logit: scene.opacity_logits[index],
        };
        let p = perspective.project(&ellipsoid).ok()?;
        let reach = 2.0 * (p.opacity / settings.accuracy.alpha_cut).ln();
        let [xx, xy, yy] = p.covariance;
        let columns = pixels(p.mean.x, (reach * xx).sqrt(), camera.width)?;
        let rows = pixels(p.mean.y, (reach * yy).sqrt(), camera.height)?;
        // The smaller eigenvalue, by way of the larger, so that it does not cancel in needles.
        let larger = 0.5 * (xx + yy) + (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        let variance = p.determinant / larger - settings.effects.antialias.dilation();
        let (axis, mean) = (camera.rotation.row(2), ellipsoid.mean);
        let terms = (axis * mean).abs().element_sum() + camera.translation.z.abs();
        Some(Self {
            index,
            mean: p.mean,
            columns,
            rows,
            depth: p.depth,
            slope: p.depth_slope,
            depth_rounding: terms * DEPTH_ROUNDING,
            depth_terms: [0, 1, 2].map(|i| if axis[i] == 0.0 { 0 } else { mean[i].to_bits() }),
            narrow: variance < NARROW_PX * NARROW_PX,
        })
    }

    /// Tiles that its box reaches into.
    fn tiles(&self, across: u32) -> impl Iterator<Item = usize> {
        let [columns, rows] = [self.columns, self.rows].map(|[first, end]| first / TILE..(end - 1) / TILE + 1);
        rows.flat_map(move |row| columns.clone().map(move |column| (row * across + column) as usize))
    }

    /// Least and greatest depth of its mean, with rounding.
    fn depths(&self) -> [f32; 2] {
        [self.depth - self.depth_rounding, self.depth + self.depth_rounding]
    }

    /// Least and greatest depth at the pixels of its box in the tile with this corner.
    fn depths_in(&self, corner: [u32; 2]) -> [f32; 2] {
        let within = |[first, end]: [u32; 2], corner: u32| {
            let (low, high) = (first.max(corner), end.min(corner + TILE) - 1);
            (0.5 * (low + high) as f32 + 0.5, 0.5 * (high - low) as f32)
        };
        let ((x, half_x), (y, half_y)) = (within(self.columns, corner[0]), within(self.rows, corner[1]));
        let away = Vec2::new(x, y) - self.mean;
        let half = Vec2::new(half_x, half_y).dot(self.slope.abs());
        let half = half + self.depth_rounding + (away.abs().dot(self.slope.abs()) + half) * DEPTH_ROUNDING;
        let middle = self.depth + self.slope.dot(away);
        [middle - half, middle + half]
    }
}

/// Pixels whose centres lie within `half` of the mean, extended for rounding: first and end. `None`
/// where there are none.
fn pixels(mean: f32, half: f32, side: u32) -> Option<[u32; 2]> {
    let slack = BORDER_SLACK + (mean.abs() + half) * BORDER_ROUNDING;
    let first = (mean - half - 0.5 - slack).ceil().clamp(0.0, side as f32);
    let end = ((mean + half - 0.5 + slack).floor() + 1.0).clamp(0.0, side as f32);
    (first < end).then_some([first as u32, end as u32])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_border_is_as_uncertain_as_the_numbers_that_it_is_made_of() {
        assert_eq!(pixels(8.0, 2.5 - 0.01, 16), Some([6, 10]));
        assert_eq!(pixels(8.0, 2.5 - 0.001, 16), Some([5, 11]), "its pixels' centres are 2.5 px away");
        // A Gaussian of a million px, whose border misses the first centre by less than the
        // distance between neighbouring `f32` there.
        assert_eq!(pixels(-1e6, 1e6 + 0.25, 16).map(|[first, _]| first), Some(0));
        assert_eq!(pixels(-1e6, 1e6 - 1e3, 16), None);
    }

    #[test]
    fn the_farthest_of_others_is_remembered_behind_the_farthest() {
        let [one, other] = [Among::Terms([1; 3]), Among::Terms([2; 3])];
        let mut farthest = Farthest::default();
        assert_eq!(farthest.next([1.0, 3.0], one, 0), None);
        assert_eq!(farthest.next([4.0, 4.0], other, 1), None);
        assert_eq!(farthest.next([4.0, 5.0], other, 2), None, "its like");
        assert_eq!(farthest.next([2.5, 2.6], other, 3), Some([0, 3]), "not its like, and as far as 3");
        assert_eq!(farthest.next([4.5, 4.5], one, 4), Some([2, 4]));
        assert_eq!(farthest.next([6.0, 6.0], one, 5), None);
    }
}
