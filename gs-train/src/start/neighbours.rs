//! Distances of points from their nearest neighbours: the size that Gaussians need to leave no
//! holes.

use std::collections::HashMap;

use glam::Vec3;
use rayon::prelude::*;
use rstar::{RTree, primitives::GeomWithData};

/// Number of neighbours. *Source:* 3DGS.
const NEIGHBOURS: usize = 3;

/// Share of a point's distance from the origin, and of one unit, up to which another point is a copy of
/// it, apart from rounding. It must not depend on the other points, most of which may be far away.
const COPY: f32 = 1e-5;

/// Most copies of a point and its neighbours that are passed over.
const MOST_PASSED: usize = 64;

/// An R*-tree, not a k-d tree, which is slow for points that share a coordinate, as those of a
/// scanner or a wall do.
type Tree = RTree<GeomWithData<[f32; 3], usize>>;

/// Root of the mean squared distance of each point to its three nearest neighbours (*source:*
/// 3DGS), `[N]`, or to fewer where there are fewer; `None` where there is no other point.
///
/// Copies of a point, which coincide with it or nearly so, are no neighbours of it, and count once as
/// neighbours of others. Points must be finite and below 1e15 in magnitude, so that squares do not
/// overflow.
pub(crate) fn neighbour_distances(points: &[Vec3]) -> Vec<Option<f32>> {
    let mut numbers = HashMap::with_capacity(points.len());
    // Adding 0 makes 0 of -0.
    let key = |point: &Vec3| (*point + 0.0).to_array().map(f32::to_bits);
    let mut distinct = Vec::with_capacity(points.len());
    for point in points {
        numbers.entry(key(point)).or_insert_with(|| {
            distinct.push(*point);
            distinct.len() - 1
        });
    }
    let tree: Tree =
        RTree::bulk_load(distinct.iter().enumerate().map(|(i, p)| GeomWithData::new(p.to_array(), i)).collect());
    let distances: Vec<Option<f32>> =
        (0..distinct.len()).into_par_iter().with_min_len(256).map(|i| distance(&tree, &distinct, i)).collect();
    points.iter().map(|point| distances[numbers[&key(point)]]).collect()
}

/// The distance of point `i`, where copies count once.
fn distance(tree: &Tree, points: &[Vec3], i: usize) -> Option<f32> {
    let point = points[i];
    let copy = COPY * (1.0 + point.length());
    let mut found: [Vec3; NEIGHBOURS] = Default::default();
    let mut count = 0;
    let others = tree.nearest_neighbor_iter(point.to_array()).filter(|other| other.data != i);
    for other in others.take(MOST_PASSED).map(|other| points[other.data]) {
        let is_copy = |known: &Vec3| known.distance(other) < copy;
        if !is_copy(&point) && !found[..count].iter().any(is_copy) {
            found[count] = other;
            count += 1;
        }
        if count == NEIGHBOURS {
            break;
        }
    }
    let squares = found[..count].iter().map(|other| f64::from(point.distance_squared(*other)));
    (count > 0).then(|| (squares.sum::<f64>() / count as f64).sqrt() as f32)
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
        assert!(neighbour_distances(&[Vec3::ONE; 5000]).iter().all(|d| d.is_none()));
        let wall: Vec<Vec3> = (0..5000).map(|i| Vec3::new(1.0, 0.0, i as f32)).collect();
        assert!(neighbour_distances(&wall).iter().all(|d| d.is_some_and(|d| (1.0..2.5).contains(&d))));
        let far = [Vec3::splat(1e15), Vec3::splat(-1e15)];
        assert!(neighbour_distances(&far).iter().all(|d| d.is_some_and(f32::is_finite)));
    }

    #[test]
    fn copies_change_nothing() {
        let hash = |i: usize, k: usize| ((i * 7919 + k * 104_729) % 1009) as f32 / 1009.0;
        let points: Vec<Vec3> = (0..300).map(|i| Vec3::new(hash(i, 1), hash(i, 5), (i % 7) as f32)).collect();
        let once = neighbour_distances(&points);
        for noise in [0.0, 1e-6] {
            let copies = points.iter().flat_map(|point| (0..5).map(move |k| *point + noise * k as f32));
            for (i, distance) in neighbour_distances(&copies.collect::<Vec<_>>()).into_iter().enumerate() {
                let expected = once[i / 5].unwrap();
                assert!((distance.unwrap() - expected).abs() < 2e-5 + noise, "{i}: {distance:?}, not {expected}");
            }
        }
    }

    #[test]
    fn far_points_do_not_make_copies_of_near_ones() {
        let hash = |i: usize, k: usize| ((i * 7919 + k * 104_729) % 1009) as f32 / 1009.0;
        let near: Vec<Vec3> = (0..300).map(|i| Vec3::new(hash(i, 1), hash(i, 5), (i % 7) as f32)).collect();
        let far = (0..900).map(|i| 1e4 * Vec3::new(hash(i, 2) - 0.5, hash(i, 3) - 0.5, 2.0));
        let all: Vec<Vec3> = near.iter().copied().chain(far).collect();
        assert_eq!(neighbour_distances(&all)[..300], neighbour_distances(&near));
    }
}
