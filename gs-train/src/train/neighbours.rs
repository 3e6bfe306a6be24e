//! Distances of points from their nearest neighbours: the size that Gaussians need to leave no
//! holes.

use glam::Vec3;
use rayon::prelude::*;
use rstar::{RTree, primitives::GeomWithData};

/// Number of neighbours. *Source:* 3DGS.
const NEIGHBOURS: usize = 3;

/// Root of the mean squared distance of each point to its three nearest neighbours (*source:*
/// 3DGS), `[N]`, or to fewer where there are fewer; `None` where there is no other point. Points
/// must be finite and below 1e15 in magnitude, so that squares do not overflow.
pub(super) fn neighbour_distances(points: &[Vec3]) -> Vec<Option<f32>> {
    let entries = points.iter().enumerate().map(|(i, p)| GeomWithData::new(p.to_array(), i)).collect();
    // An R*-tree, not a k-d tree, which is slow for points that share a coordinate, as those of a
    // scanner or a wall do.
    let tree: RTree<GeomWithData<[f32; 3], usize>> = RTree::bulk_load(entries);
    points
        .par_iter()
        .with_min_len(256)
        .enumerate()
        .map(|(i, point)| {
            let others = tree.nearest_neighbor_iter(point.to_array()).filter(|other| other.data != i);
            let squares = others.take(NEIGHBOURS).map(|other| f64::from(point.distance_squared(points[other.data])));
            let (count, sum) = squares.fold((0, 0.0), |(count, sum), square| (count + 1, sum + square));
            (count > 0).then(|| (sum / f64::from(count)).sqrt() as f32)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_trying_all_pairs() {
        let hash = |i: usize, k: usize| ((i * 7919 + k * 104_729) % 1009) as f32 / 1009.0;
        let points: Vec<Vec3> = (0..400).map(|i| Vec3::new(hash(i, 1), hash(i, 5), (i % 7) as f32)).collect();
        for (i, found) in neighbour_distances(&points).into_iter().enumerate() {
            let mut squares: Vec<f32> =
                (0..points.len()).filter(|&j| j != i).map(|j| points[i].distance_squared(points[j])).collect();
            squares.sort_by(f32::total_cmp);
            let expected = (squares[..3].iter().sum::<f32>() / 3.0).sqrt();
            assert!((found.unwrap() - expected).abs() < 1e-5, "{i}: {found:?}, not {expected}");
        }
    }

    #[test]
    fn few_equal_and_aligned_points_are_no_trouble() {
        assert!(neighbour_distances(&[]).is_empty());
        assert_eq!(neighbour_distances(&[Vec3::ONE]), [None]);
        assert_eq!(neighbour_distances(&[Vec3::ZERO, Vec3::X]), [Some(1.0), Some(1.0)]);
        assert!(neighbour_distances(&[Vec3::ONE; 5000]).iter().all(|d| *d == Some(0.0)));
        let wall: Vec<Vec3> = (0..5000).map(|i| Vec3::new(1.0, 0.0, i as f32)).collect();
        assert!(neighbour_distances(&wall).iter().all(|d| d.is_some_and(|d| (1.0..2.5).contains(&d))));
        let far = [Vec3::splat(1e15), Vec3::splat(-1e15)];
        assert!(neighbour_distances(&far).iter().all(|d| d.is_some_and(f32::is_finite)));
    }
}
