//! The surfaces of a city: rectangles with a pattern.

use glam::{Vec2, Vec3, vec2, vec3};
use rand::RngExt;

use super::{BLOCK_M, City, STREET_M};
use gs_density::Rng;

/// Metres of ground around the outermost streets.
const OUTSKIRTS_M: f32 = 100.0;

/// Distance of windows, m, and the share of it that a window takes.
const WINDOW_M: Vec2 = vec2(2.6, 3.2);
const WINDOW_SHARE: Vec2 = vec2(0.55, 0.6);

/// Height and radius of trees, m.
const TREE_M: f32 = 7.0;

/// A rectangle with a pattern.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Surface {
    /// A corner, m; y points down.
    pub(super) corner: Vec3,
    /// The edges from there, m.
    pub(super) edges: [Vec3; 2],
    pattern: Pattern,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Pattern {
    /// Streets between blocks of grass and pavement.
    Ground,
    /// A wall with windows.
    Wall(Vec3),
    /// A roof with a border.
    Roof(Vec3),
    /// Leaves.
    Leaves,
}

/// What a surface looks like at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Appearance {
    pub(super) color: Vec3,
    /// Share of the light that is reflected as by a mirror, 0 to 1.
    pub(super) gloss: f32,
}

impl Surface {
    pub(super) fn area(&self) -> f32 {
        self.edges[0].cross(self.edges[1]).length()
    }

    pub(super) fn normal(&self) -> Vec3 {
        self.edges[0].cross(self.edges[1]).normalize()
    }

    /// The appearance at a point that is given by its shares of both edges.
    pub(super) fn at(&self, share: Vec2) -> Appearance {
        let metres = share * vec2(self.edges[0].length(), self.edges[1].length());
        let dull = |color| Appearance { color, gloss: 0.0 };
        match self.pattern {
            Pattern::Ground => {
                let place = self.corner + self.edges[0] * share.x + self.edges[1] * share.y;
                dull(ground(vec2(place.x, place.z)))
            }
            Pattern::Wall(color) => {
                let in_cell = (metres / WINDOW_M).fract();
                let from_edge = (in_cell - 0.5).abs() * 2.0;
                match from_edge.cmplt(WINDOW_SHARE).all() {
                    true => Appearance { color: vec3(0.14, 0.19, 0.26), gloss: 0.5 },
                    false => dull(color * (0.94 + 0.12 * noise(metres * 1.3))),
                }
            }
            Pattern::Roof(color) => {
                let border = metres.min(vec2(self.edges[0].length(), self.edges[1].length()) - metres).min_element();
                let lighter = if border < 0.8 { 1.25 } else { 0.85 + 0.3 * noise(metres * 0.5) };
                dull(color * lighter)
            }
            Pattern::Leaves => dull(vec3(0.16, 0.33, 0.12) * (0.6 + 0.8 * noise(metres * 2.0))),
        }
    }
}

/// The colour of the ground at (x, z), m: asphalt with a broken line, pavement, grass.
fn ground(place: Vec2) -> Vec3 {
    let pitch = BLOCK_M + STREET_M;
    // 0 at the middle of a street.
    let from_street = (place / pitch - (place / pitch).round()) * pitch;
    let across = from_street.abs().min_element();
    let along = if from_street.x.abs() < from_street.y.abs() { place.y } else { place.x };
    let grain = 0.85 + 0.3 * noise(place * 0.7);
    let rough = 0.9 + 0.2 * noise(place * 3.1);
    if across < 0.25 && along.rem_euclid(8.0) < 4.0 {
        Vec3::splat(0.85)
    } else if across < 0.5 * STREET_M - 2.0 {
        vec3(0.24, 0.24, 0.26) * rough
    } else if across < 0.5 * STREET_M + 1.5 {
        vec3(0.58, 0.56, 0.53) * rough
    } else {
        vec3(0.34, 0.42, 0.22) * grain * rough
    }
}

/// Smooth noise, 0 to 1, that varies over a length of 1.
fn noise(place: Vec2) -> f32 {
    let corner = place.floor();
    let t = place - corner;
    let t = t * t * (Vec2::splat(3.0) - 2.0 * t);
    let at = |x: f32, y: f32| {
        let [x, y] = [(corner.x + x) as i32 as u32, (corner.y + y) as i32 as u32];
        let mixed = (x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77)).wrapping_mul(0xc2b2_ae3d);
        ((mixed ^ (mixed >> 15)).wrapping_mul(0x27d4_eb2f) >> 8) as f32 / (1 << 24) as f32
    };
    let rows = [at(0.0, 0.0) * (1.0 - t.x) + at(1.0, 0.0) * t.x, at(0.0, 1.0) * (1.0 - t.x) + at(1.0, 1.0) * t.x];
    rows[0] * (1.0 - t.y) + rows[1] * t.y
}

/// All surfaces of a city.
pub(super) fn surfaces(city: &City, rng: &mut Rng) -> Vec<Surface> {
    let pitch = BLOCK_M + STREET_M;
    let side = city.blocks as f32 * pitch;
    let whole = side + 2.0 * OUTSKIRTS_M;
    let corner = vec3(-OUTSKIRTS_M, 0.0, -OUTSKIRTS_M);
    // The normal points up, which is −y.
    let mut all = vec![Surface { corner, edges: [Vec3::X * whole, Vec3::Z * whole], pattern: Pattern::Ground }];
    let lot = 0.5 * BLOCK_M;
    for block in 0..city.blocks.pow(2) {
        let [column, row] = [block % city.blocks, block / city.blocks].map(|index| index as f32);
        for quarter in 0..4 {
            let [right, far] = [quarter % 2, quarter / 2].map(|half| half as f32 * lot);
            let corner = vec2(column * pitch + 0.5 * STREET_M + right, row * pitch + 0.5 * STREET_M + far);
            if rng.random_range(0.0..1.0) < 0.2 {
                park(&mut all, corner, lot, rng);
            } else {
                building(&mut all, corner, lot, rng);
            }
        }
    }
    all
}

/// A building on a lot: four walls and a roof.
fn building(all: &mut Vec<Surface>, lot: Vec2, side: f32, rng: &mut Rng) {
    let size = vec2(rng.random_range(0.5..0.85), rng.random_range(0.5..0.85)) * side;
    let corner = lot + 0.5 * (Vec2::splat(side) - size);
    let height = 5.0 + 30.0 * rng.random_range(0.0f32..1.0).powi(2);
    let mut color =
        || rng.random_range(0.35..0.75) * vec3(1.0, rng.random_range(0.75..1.0), rng.random_range(0.55..1.0));
    let (wall, roof) = (color(), color());
    let at = |x: f32, z: f32| vec3(corner.x + x * size.x, 0.0, corner.y + z * size.y);
    let up = -Vec3::Y * height;
    // Around the building, so that all normals point outwards.
    for (from, to) in [
        (at(0.0, 0.0), at(1.0, 0.0)),
        (at(1.0, 0.0), at(1.0, 1.0)),
        (at(1.0, 1.0), at(0.0, 1.0)),
        (at(0.0, 1.0), at(0.0, 0.0)),
    ] {
        all.push(Surface { corner: from, edges: [to - from, up], pattern: Pattern::Wall(wall) });
    }
    let edges = [Vec3::X * size.x, Vec3::Z * size.y];
    all.push(Surface { corner: at(0.0, 0.0) + up, edges, pattern: Pattern::Roof(roof) });
}

/// Trees on a lot: three rectangles each, at right angles.
fn park(all: &mut Vec<Surface>, lot: Vec2, side: f32, rng: &mut Rng) {
    for _ in 0..5 {
        let place = lot + vec2(rng.random_range(0.15..0.85), rng.random_range(0.15..0.85)) * side;
        let size = TREE_M * rng.random_range(0.6..1.2);
        let middle = vec3(place.x, -0.6 * size, place.y);
        for [a, b] in [[Vec3::X, Vec3::Z], [Vec3::X, -Vec3::Y], [Vec3::Z, -Vec3::Y]] {
            let corner = middle - 0.4 * size * (a + b);
            all.push(Surface { corner, edges: [0.8 * size * a, 0.8 * size * b], pattern: Pattern::Leaves });
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_ground_faces_up_and_walls_face_away_from_their_building() {
        use super::*;
        use rand::SeedableRng;

        let city = City { blocks: 2, gaussians: 1, seed: 0 };
        let all = surfaces(&city, &mut Rng::seed_from_u64(3));
        assert!(all[0].normal().abs_diff_eq(-Vec3::Y, 1e-6), "{:?}", all[0].normal());
        let buildings = all.windows(5).filter(|five| matches!(five[4].pattern, Pattern::Roof(_)));
        let mut count = 0;
        for five in buildings {
            let [walls @ .., roof] = five else { unreachable!() };
            let middle = roof.corner + 0.5 * (roof.edges[0] + roof.edges[1]);
            let outwards = walls.iter().all(|wall| wall.normal().dot(wall.corner - middle) > 0.0);
            assert!(outwards && roof.normal().abs_diff_eq(-Vec3::Y, 1e-6), "{five:?}");
            count += 1;
        }
        assert!((8..16).contains(&count), "{count} of 16 lots are built on");
    }

    #[test]
    fn noise_is_smooth_and_between_0_and_1() {
        use super::*;

        for i in 0..500 {
            let place = vec2(i as f32 * 0.37 - 50.0, 20.0 - i as f32 * 0.11);
            let [a, b] = [noise(place), noise(place + 1e-3)];
            assert!((0.0..=1.0).contains(&a) && (a - b).abs() < 0.01, "{place}: {a}, {b}");
        }
    }
}
