//! The similarity of the world that takes points, and directions, to others.

use glam::{DAffine3, DMat3, DQuat, DVec3, DVec4};

/// Most steps of the power iteration.
const POWERS: usize = 5_000;

/// A turn, a change of scale and a shift of the world: x ↦ `to` + `scale` · `rotation` · (x − `from`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// The turn, a unit quaternion.
    pub rotation: DQuat,
    /// Factor of lengths.
    pub scale: f64,
    /// The point that goes to [`Self::to`]: the mean of the points that the similarity was found from.
    pub from: DVec3,
    /// The mean of the points that they are to go to.
    pub to: DVec3,
}

impl Similarity {
    /// The similarity with the least squares for these pairs of points (where a point is, where it is to go, and
    /// the weight of the pair, at least 0).
    ///
    /// `turns` are further observations of the turn: the sum of w · b aᵀ over directions a that are to become b,
    /// with weights in squared units of the points that they go to; [`DMat3::ZERO`] without any.
    ///
    /// The scale is 1 where the points are all at one place. `None` without a weight above 0, where neither points
    /// nor `turns` determine the turn, and where a number is not finite.
    ///
    /// *Source:* Horn 1987, *Closed-form solution of absolute orientation using unit quaternions*.
    pub fn between(pairs: &[(DVec3, DVec3, f64)], turns: DMat3) -> Option<Self> {
        let total: f64 = pairs.iter().map(|(.., weight)| weight).sum();
        let mean =
            |of: fn(&(DVec3, DVec3, f64)) -> DVec3| pairs.iter().map(|pair| of(pair) * pair.2).sum::<DVec3>() / total;
        let (from, to) = (mean(|pair| pair.0), mean(|pair| pair.1));
        let covariance = pairs.iter().fold(turns, |sum, (a, b, weight)| {
            let (a, b) = (*a - from, (*b - to) * *weight);
            sum + DMat3::from_cols(b * a.x, b * a.y, b * a.z)
        });
        let rotation = best_rotation(covariance);
        let [along, spread] = pairs.iter().fold([0.0; 2], |[along, spread], (a, b, weight)| {
            let (a, b) = (rotation * (*a - from), *b - to);
            [along + weight * a.dot(b), spread + weight * a.length_squared()]
        });
        let scale = if spread > 0.0 { along / spread } else { 1.0 };
        let is_valid = total > 0.0 && scale.is_finite() && rotation.is_finite() && to.is_finite();
        is_valid.then_some(Self { rotation, scale, from, to })
    }

    /// Where a point goes.
    #[must_use]
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.to + self.scale * (self.rotation * (point - self.from))
    }

    /// The same as an affine map.
    #[must_use]
    pub fn to_affine(&self) -> DAffine3 {
        let shift = self.apply(DVec3::ZERO);
        DAffine3::from_scale_rotation_translation(DVec3::splat(self.scale), self.rotation, shift)
    }
}

/// The rotation R for which the trace of Rᵀ `covariance` is largest.
fn best_rotation(covariance: DMat3) -> DQuat {
    let s = covariance.to_cols_array_2d();
    let trace = s[0][0] + s[1][1] + s[2][2];
    let between = |a: usize, b: usize| s[a][b] + s[b][a];
    let (x, y, z) = (s[1][2] - s[2][1], s[2][0] - s[0][2], s[0][1] - s[1][0]);
    let rows = [
        DVec4::new(trace, x, y, z),
        DVec4::new(x, 2.0 * s[0][0] - trace, between(0, 1), between(0, 2)),
        DVec4::new(y, between(0, 1), 2.0 * s[1][1] - trace, between(1, 2)),
        DVec4::new(z, between(0, 2), between(1, 2), 2.0 * s[2][2] - trace),
    ];
    // Above the size of every eigenvalue, so that the largest is found.
    let shift = rows.iter().map(|row| row.abs().element_sum()).fold(0.0, f64::max);
    let mut q = DVec4::new(1.0, 0.1, 0.2, 0.3).normalize();
    for _ in 0..POWERS {
        let next = (DVec4::from_array(rows.map(|row| row.dot(q))) + q * shift).normalize();
        if next == q {
            break;
        }
        q = next;
    }
    DQuat::from_xyzw(q.y, q.z, q.w, q.x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(i: usize) -> DVec3 {
        let i = i as f64;
        DVec3::new(i, (2.0 * i).sin(), 2.0 * (3.0 * i).cos())
    }

    #[test]
    fn a_similarity_is_found_from_points() {
        let wanted = Similarity {
            rotation: DQuat::from_euler(glam::EulerRot::XYZ, 2.0, -0.7, 1.1),
            scale: 3.0,
            from: DVec3::X,
            to: DVec3::new(4.0, 5.0, 6.0),
        };
        let mut pairs: Vec<_> = (0..6).map(|i| (point(i), wanted.apply(point(i)), 0.5 + i as f64)).collect();
        // A pair without weight does not count.
        pairs.push((point(7), DVec3::ZERO, 0.0));
        let found = Similarity::between(&pairs, DMat3::ZERO).unwrap();
        assert!(found.rotation.angle_between(wanted.rotation) < 1e-7 && (found.scale - 3.0).abs() < 1e-9, "{found:?}");
        assert!(found.apply(DVec3::Z).distance(wanted.apply(DVec3::Z)) < 1e-8, "{found:?}");
        assert!(found.to_affine().transform_point3(DVec3::Y).distance(found.apply(DVec3::Y)) < 1e-9);
    }

    #[test]
    fn points_on_a_line_or_in_one_place_need_directions() {
        let turn = DQuat::from_rotation_x(1.0);
        let place = [(DVec3::Y, DVec3::Z, 1.0); 2];
        let found = Similarity::between(&place, DMat3::from_quat(turn)).unwrap();
        assert!(found.rotation.angle_between(turn) < 1e-7 && found.scale == 1.0, "{found:?}");
        let pairs: Vec<_> = (0..4).map(|i| (DVec3::X * f64::from(i), DVec3::X * f64::from(i), 1.0)).collect();
        let turns = DMat3::from_quat(turn) * 0.1;
        let found = Similarity::between(&pairs, turns).unwrap();
        assert!(found.rotation.angle_between(turn) < 1e-7, "{found:?}");
    }

    #[test]
    fn degenerate_pairs_determine_no_similarity() {
        let none = |pairs: &[(DVec3, DVec3, f64)]| Similarity::between(pairs, DMat3::IDENTITY).is_none();
        assert!(none(&[]) && none(&[(DVec3::X, DVec3::Y, 0.0); 3]));
        assert!(none(&[(DVec3::X, DVec3::Y, 1.0), (DVec3::NAN, DVec3::Y, 1.0)]));
    }
}
