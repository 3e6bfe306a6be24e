//! Density of Gaussians per pixel, and drawing of positions from it.

use glam::Vec2;
use rand::Rng as _;

use super::{HilbertOrder, Plane};
use crate::Rng;

/// Largest number of refinements of the weights' scale; each saturates the pixels that the one
/// before found too dense, and a handful suffice.
const MAX_CAP_PASSES: usize = 24;

/// Amount added to every pixel's weight, as a share of the mean weight, so that the mass that
/// capped pixels refuse has a place.
const FLOOR_SHARE: f32 = 1e-6;

/// Pixels along the curve that are summed at once; chunks without a draw need no second pass.
const CHUNK: usize = 64;

/// Expected number of Gaussians in each pixel, `[H, W]`, px⁻².
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct DensityMap {
    per_pixel: Plane,
    count: usize,
}

impl DensityMap {
    /// The density of `count` Gaussians in proportion to `weights`, capped at `max_per_pixel`.
    ///
    /// The excess of capped pixels goes to the others, in proportion. Where the image is too small
    /// for `count` under the cap, the density is uniform, above the cap. Weights that are negative
    /// or not finite count as 0; where all are 0 the density is uniform.
    pub(crate) fn from_weights(mut weights: Plane, count: usize, max_per_pixel: f32) -> Self {
        let pixels = weights.values.len();
        let wanted = count as f64;
        let cap = if max_per_pixel > 0.0 { max_per_pixel } else { f32::INFINITY };
        if f64::from(cap) * pixels as f64 <= wanted {
            weights.values.fill((wanted / pixels.max(1) as f64) as f32);
            return Self { per_pixel: weights, count };
        }
        let (mut sum, largest) = sanitise(&mut weights.values);
        if largest > 0.0 && !(1e-12..1e12).contains(&largest) {
            // Sums and products stay finite whatever the unit of the weights.
            weights.values.iter_mut().for_each(|w| *w /= largest);
            sum /= f64::from(largest);
        }
        let floor = if sum > 0.0 { (sum / pixels as f64) as f32 * FLOOR_SHARE } else { 1.0 };

        // Newton's method for Σ min(scale · (w + floor), cap) = count: the sum is concave and
        // piecewise linear in the scale, so the scale grows monotonically, and stops at the
        // solution once no further pixel saturates.
        let scale_for = |open_sum: f64, open: usize| {
            ((wanted - f64::from(cap) * (pixels - open) as f64) / (open_sum + f64::from(floor) * open as f64)) as f32
        };
        let mut scale = scale_for(sum, pixels);
        let mut open_before = pixels;
        for _ in 0..MAX_CAP_PASSES {
            let (open_sum, open) = sum_below(&weights.values, cap / scale - floor);
            if open == open_before || open == 0 {
                break;
            }
            open_before = open;
            scale = scale_for(open_sum, open);
        }
        weights.values.iter_mut().for_each(|w| *w = ((*w + floor) * scale).min(cap));
        Self { per_pixel: weights, count }
    }

    /// Expected number of Gaussians in each pixel, row-major.
    pub(crate) fn values(&self) -> &[f32] {
        &self.per_pixel.values
    }

    /// Size as (columns, rows).
    pub(crate) fn size(&self) -> (u32, u32) {
        self.per_pixel.size()
    }

    /// Density at a place of the plane, px⁻²; outside the image that of the nearest pixel.
    pub(crate) fn at(&self, place: Vec2) -> f32 {
        let Plane { width, height, ref values } = self.per_pixel;
        // `as` takes negative numbers and NaN to 0.
        let (x, y) = ((place.x as usize).min(width - 1), (place.y as usize).min(height - 1));
        values[y * width + x]
    }

    /// Draws a position, px, for each of the Gaussians that the map was made for, distributed as the
    /// density and spread evenly.
    ///
    /// The mass along `order` is cut into `count` equal strata, and one position is drawn in each,
    /// at the cost of one random number. The positions are in that order, so neighbours in it are
    /// neighbours in the image.
    ///
    /// # Panics
    /// Where `order` is of another size than the map.
    pub(crate) fn stratified(&self, order: &HilbertOrder, rng: &mut Rng) -> Vec<Vec2> {
        assert_eq!(order.size(), self.size(), "an order of another size than the density map");
        let mut positions = Vec::with_capacity(self.count);
        if self.per_pixel.values.is_empty() || self.count == 0 {
            return positions;
        }
        let values = &self.per_pixel.values;
        let width = self.per_pixel.width as u32;
        let chunks: Vec<f32> = order.pixels().chunks(CHUNK).map(|chunk| mass_along(values, chunk)).collect();
        let stratum = chunks.iter().map(|&mass| f64::from(mass)).sum::<f64>() / self.count as f64;

        let mut draw = Draw::new(rng);
        let mut reached = 0.0f64;
        let mut next = draw.stratum * stratum;
        for (pixels, &mass) in order.pixels().chunks(CHUNK).zip(&chunks) {
            let end = reached + f64::from(mass);
            if end > next {
                // In a chunk where a stratum's draw lies, pixel by pixel; its last pixel takes what
                // rounding leaves.
                let last = pixels.len() - 1;
                for (i, &pixel) in pixels.iter().enumerate() {
                    reached = if i == last { end } else { reached + f64::from(values[pixel as usize]) };
                    while reached > next && positions.len() < self.count {
                        positions.push(draw.place(pixel, width));
                        draw = Draw::new(rng);
                        next = (positions.len() as f64 + draw.stratum) * stratum;
                    }
                }
            }
            reached = end;
        }
        // The last draw can lie beyond the last pixel by rounding.
        let last = order.pixels()[values.len() - 1];
        while positions.len() < self.count {
            positions.push(draw.place(last, width));
            draw = Draw::new(rng);
        }
        positions
    }
}

/// Mass of up to [`CHUNK`] pixels, in four independent sums.
fn mass_along(values: &[f32], pixels: &[u32]) -> f32 {
    let mut sums = [0.0f32; 4];
    let (quads, rest) = pixels.as_chunks::<4>();
    for quad in quads {
        for k in 0..4 {
            sums[k] += values[quad[k] as usize];
        }
    }
    rest.iter().for_each(|&pixel| sums[0] += values[pixel as usize]);
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// Three uniform numbers in 0..1, from one of 64 bits.
struct Draw {
    /// Position within the stratum.
    stratum: f64,
    /// Position within the pixel.
    within: Vec2,
}

impl Draw {
    fn new(rng: &mut Rng) -> Self {
        let bits = rng.next_u64();
        let field = |shift: u32, width: u32| ((bits >> shift) & ((1 << width) - 1)) as f32 / (1u64 << width) as f32;
        Self { stratum: f64::from(field(40, 24)), within: Vec2::new(field(20, 20), field(0, 20)) }
    }

    fn place(&self, pixel: u32, width: u32) -> Vec2 {
        Vec2::new((pixel % width) as f32, (pixel / width) as f32) + self.within
    }
}

/// Replaces what is negative or not finite by 0; returns the sum and the largest of what remains.
fn sanitise(values: &mut [f32]) -> (f64, f32) {
    let mut sum = 0.0f64;
    let mut largest = [0.0f32; 16];
    for block in values.chunks_mut(512) {
        let mut sums = [0.0f32; 16];
        let (chunks, rest) = block.as_chunks_mut::<16>();
        for chunk in chunks {
            for k in 0..16 {
                chunk[k] = if chunk[k] > 0.0 && chunk[k] < f32::INFINITY { chunk[k] } else { 0.0 };
                sums[k] += chunk[k];
                largest[k] = if chunk[k] > largest[k] { chunk[k] } else { largest[k] };
            }
        }
        for v in rest {
            *v = if *v > 0.0 && *v < f32::INFINITY { *v } else { 0.0 };
            sums[0] += *v;
            largest[0] = largest[0].max(*v);
        }
        sum += sums.iter().map(|&v| f64::from(v)).sum::<f64>();
    }
    (sum, largest.into_iter().fold(0.0, f32::max))
}

/// Sum and number of the values below `limit`, in lanes that the compiler can vectorise; 512 values
/// at a time in `f32`, beyond in `f64`.
fn sum_below(values: &[f32], limit: f32) -> (f64, usize) {
    let mut sum = 0.0f64;
    let mut count = 0usize;
    for block in values.chunks(512) {
        let mut sums = [0.0f32; 16];
        let mut counts = [0u32; 16];
        let (chunks, rest) = block.as_chunks::<16>();
        for chunk in chunks {
            for k in 0..16 {
                let below = chunk[k] < limit;
                sums[k] += if below { chunk[k] } else { 0.0 };
                counts[k] += u32::from(below);
            }
        }
        for &v in rest {
            sums[0] += if v < limit { v } else { 0.0 };
            counts[0] += u32::from(v < limit);
        }
        sum += f64::from(sums.iter().sum::<f32>());
        count += counts.iter().sum::<u32>() as usize;
    }
    (sum, count)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    fn rng(seed: u64) -> Rng {
        Rng::seed_from_u64(seed)
    }

    fn two_regions(left: f32, right: f32) -> Plane {
        Plane::from_rows(64, 48, |_, row| {
            row[..32].fill(left);
            row[32..].fill(right);
        })
    }

    #[test]
    fn samples_follow_the_density() {
        let map = DensityMap::from_weights(two_regions(1.0, 3.0), 400, 10.0);
        let order = HilbertOrder::new(64, 48);
        let positions = map.stratified(&order, &mut rng(1));
        assert_eq!(positions.len(), 400);
        let left = positions.iter().filter(|p| p.x < 32.0).count();
        // Independent draws would deviate by 9; strata along the curve by one for each time it
        // crosses the border.
        assert!(left.abs_diff(100) <= 8, "{left} of 400 in the region that should have 100");
        // χ² over 12 blocks of equal expectation in the denser half: far below what independent
        // draws give (11 degrees of freedom).
        let mut blocks = [0.0f32; 12];
        for p in positions.iter().filter(|p| p.x >= 32.0) {
            blocks[(p.y as usize / 16) * 4 + (p.x as usize - 32) / 8] += 1.0;
        }
        let chi2: f32 = blocks.iter().map(|b| (b - 25.0) * (b - 25.0) / 25.0).sum();
        assert!(chi2 < 6.0, "χ² = {chi2}, {blocks:?}");
    }

    #[test]
    fn the_cap_holds_and_the_excess_is_redistributed() {
        let weights = Plane::from_rows(40, 40, |y, row| {
            row.fill(1.0);
            if y < 2 {
                row.fill(1e4);
            }
        });
        let map = DensityMap::from_weights(weights, 200, 0.3);
        let total: f64 = map.values().iter().map(|&v| f64::from(v)).sum();
        assert!(map.values().iter().all(|&v| v <= 0.3));
        assert!((total - 200.0).abs() < 0.01, "{total}");
        assert!((map.at(Vec2::new(3.0, 1.0)) - 0.3).abs() < 1e-6);
        // 80 pixels hold 24; the other 1520 share 176.
        assert!((map.at(Vec2::new(3.0, 20.0)) - 176.0 / 1520.0).abs() < 1e-4);
    }

    #[test]
    fn excess_over_the_cap_may_go_to_pixels_of_no_weight() {
        let weights = Plane::from_rows(20, 20, |y, row| row.fill(if y == 0 { 1.0 } else { 0.0 }));
        let map = DensityMap::from_weights(weights, 100, 0.3);
        let total: f64 = map.values().iter().map(|&v| f64::from(v)).sum();
        assert!((total - 100.0).abs() < 0.01, "{total}");
        assert!(map.values().iter().all(|&v| v <= 0.3));
    }

    #[test]
    fn degenerate_weights_give_a_uniform_density() {
        for weight in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            let map = DensityMap::from_weights(Plane::from_rows(8, 8, |_, row| row.fill(weight)), 16, 0.3);
            assert!(map.values().iter().all(|&v| (v - 0.25).abs() < 1e-6), "{weight}: {:?}", map.at(Vec2::ZERO));
        }
        for weight in [1e-30, 1e30] {
            let map = DensityMap::from_weights(Plane::from_rows(8, 8, |_, row| row.fill(weight)), 16, 0.3);
            assert!(map.values().iter().all(|&v| (v - 0.25).abs() < 1e-4), "{weight}: {:?}", map.at(Vec2::ZERO));
        }
    }

    #[test]
    fn counts_are_exact_and_positions_inside_whatever_the_size() {
        for (w, h, count) in [(1, 1, 1), (1, 1, 7), (1, 1, 0), (3, 5, 100), (50, 20, 999), (7, 1, 3)] {
            let weights =
                Plane::from_rows(w, h, |y, row| row.iter_mut().enumerate().for_each(|(x, v)| *v = (x * y) as f32));
            let map = DensityMap::from_weights(weights, count, 0.3);
            let positions = map.stratified(&HilbertOrder::new(w, h), &mut rng(3));
            assert_eq!(positions.len(), count);
            assert!(positions.iter().all(|p| p.x >= 0.0 && p.x <= w as f32 && p.y >= 0.0 && p.y <= h as f32));
        }
    }

    #[test]
    fn equal_random_numbers_give_equal_positions() {
        let map = DensityMap::from_weights(two_regions(1.0, 2.0), 50, 0.3);
        let order = HilbertOrder::new(64, 48);
        let draw = |seed| map.stratified(&order, &mut rng(seed));
        assert_eq!(draw(5), draw(5));
        assert_ne!(draw(5), draw(6));
    }
}
