//! Parts of space, by which Gaussians are chosen.

use glam::{Vec2, Vec3};

/// A part of space. What lies on its boundary belongs to it.
#[derive(Debug, Clone, PartialEq)]
pub enum Region {
    /// A box along the axes between two corners, world units. Where a coordinate of `min` is larger than that
    /// of `max`, it is empty.
    Box {
        /// The smallest coordinates.
        min: Vec3,
        /// The largest coordinates.
        max: Vec3,
    },
    /// A ball.
    Sphere {
        /// The centre, world units.
        center: Vec3,
        /// The radius, world units.
        radius: f32,
    },
    /// One side of a plane: n · p ≥ d.
    HalfSpace {
        /// The normal n, which points into the region; of any length.
        normal: Vec3,
        /// The smallest product d.
        offset: f32,
    },
    /// Everything above and below a polygon: a place belongs to it if its x and z lie in the polygon, by the
    /// even–odd rule. World axes are x right, y down, z forward, so this is a map seen from above.
    Prism {
        /// The corners (x, z), world units, in order around the polygon.
        corners: Vec<Vec2>,
    },
}

impl Region {
    /// Whether a place belongs to it; one that is NaN does not.
    pub fn contains(&self, place: Vec3) -> bool {
        match self {
            Self::Box { min, max } => place.cmpge(*min).all() && place.cmple(*max).all(),
            Self::Sphere { center, radius } => place.distance(*center) <= *radius,
            Self::HalfSpace { normal, offset } => normal.dot(place) >= *offset,
            Self::Prism { corners } => is_inside(corners, Vec2::new(place.x, place.z)),
        }
    }
}

/// Whether a ray from the place towards +x crosses the polygon's edges an odd number of times, or the place is on one.
fn is_inside(corners: &[Vec2], place: Vec2) -> bool {
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    let mut inside = false;
    for (&a, &b) in edges {
        let (along, to) = (b - a, place - a);
        let on_line = along.perp_dot(to) == 0.0;
        if on_line && place.cmpge(a.min(b)).all() && place.cmple(a.max(b)).all() {
            return true;
        }
        if (a.y > place.y) != (b.y > place.y) && place.x < a.x + along.x * (to.y / along.y) {
            inside = !inside;
        }
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_contain_their_boundary_and_nothing_that_is_nan() {
        let region_and_edge = [
            (Region::Box { min: Vec3::NEG_ONE, max: Vec3::ONE }, Vec3::new(1.0, -1.0, 0.5)),
            (Region::Sphere { center: Vec3::X, radius: 2.0 }, Vec3::new(3.0, 0.0, 0.0)),
            (Region::HalfSpace { normal: Vec3::new(0.0, 2.0, 0.0), offset: 1.0 }, Vec3::new(9.0, 0.5, -4.0)),
            (
                Region::Prism { corners: vec![Vec2::ZERO, Vec2::new(4.0, 0.0), Vec2::new(0.0, 4.0)] },
                Vec3::new(2.0, 77.0, 2.0),
            ),
        ];
        for (region, edge) in region_and_edge {
            assert!(region.contains(edge), "{region:?}");
            let outward = match region {
                Region::HalfSpace { .. } => Vec3::NEG_Y,
                _ => Vec3::new(1.0, -1.0, 1.0),
            };
            assert!(!region.contains(edge + 0.01 * outward), "{region:?}");
            assert!(region.contains(edge - 0.01 * outward), "{region:?}");
            assert!(!region.contains(Vec3::NAN), "{region:?}");
        }
    }

    #[test]
    fn a_polygon_may_be_hollow() {
        let shape = [(0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (3.0, 2.0), (0.0, 6.0)];
        let region = Region::Prism { corners: shape.map(Vec2::from).to_vec() };
        let inside = |x: f32, z: f32| region.contains(Vec3::new(x, 0.0, z));
        assert!(inside(0.5, 5.0) && inside(5.8, 5.0) && inside(3.0, 1.9));
        assert!(!inside(3.0, 2.1) && !inside(3.0, 5.0) && !inside(-0.1, 1.0) && !inside(7.0, 0.0));
        assert!(!Region::Prism { corners: Vec::new() }.contains(Vec3::ZERO));
    }
}
