//! Levels of detail of a finished 3D scene: merged Gaussians in place of many, with a measured error.
//!
//! [`spatial_order`] puts a scene's Gaussians in the order of a binary tree of cells, of which
//! [`halves`] says where they are split. [`levels`] merges the Gaussians of a cell: pair after pair, the
//! cheapest first, until as many are left as each level may have. Cells are independent, so callers
//! compute them in parallel, and only the cells at work need memory.

mod merging;

use std::ops::Range;

use glam::Vec3;
use gs_core::{Gaussian3d, Scene, Scene3d};

use self::merging::Merging;
use crate::merged;

/// Fewer Gaussians in place of those of a cell.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Level {
    /// The Gaussians.
    pub scene: Scene3d,
    /// How far the merges moved what is drawn, world units: the root of the mean squared transport
    /// distance (Wasserstein-2) of the cell's Gaussians from those in whose place they are, with opacity
    /// times area as weights.
    pub error: f32,
    /// For each Gaussian, the numbers of those in whose place it is, in the level before, or in the cell.
    pub groups: Vec<Vec<u32>>,
}

/// The numbers of Gaussians in the order of a binary tree: [`halves`] of the order are on both sides of a
/// plane across the longest side of their bounds, until a part has at most `most` Gaussians, 1 or more.
/// Takes O(N log N) on all threads of rayon's pool; the order does not depend on their number.
pub fn spatial_order(means: &[Vec3], most: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..means.len() as u32).collect();
    sort(means, most.max(1), &mut order);
    order
}

/// The two parts of a range of [`spatial_order`]; `None` where it is a cell.
pub fn halves(range: &Range<usize>, most: usize) -> Option<[Range<usize>; 2]> {
    let middle = range.start + range.len() / 2;
    (range.len() > most.max(1)).then_some([range.start..middle, middle..range.end])
}

fn sort(means: &[Vec3], most: usize, order: &mut [u32]) {
    let Some([left, _]) = halves(&(0..order.len()), most) else { return };
    let mean = |i: &u32| means[*i as usize];
    let low = order.iter().map(mean).fold(Vec3::INFINITY, Vec3::min);
    let high = order.iter().map(mean).fold(Vec3::NEG_INFINITY, Vec3::max);
    let axis = (high - low).max_position();
    // Equal coordinates are told apart by number, so that there is one order.
    order.select_nth_unstable_by(left.end, |a, b| mean(a)[axis].total_cmp(&mean(b)[axis]).then(a.cmp(b)));
    let (left, right) = order.split_at_mut(left.end);
    rayon::join(|| sort(means, most, left), || sort(means, most, right));
}

/// Levels of these Gaussians of a scene, which should be neighbours and at most some thousands. `counts`
/// are the numbers of Gaussians of the levels, falling, each at least 1. Takes O(n log n).
///
/// Merges keep mean, covariance, and mean colour, and opacity times area up to an opacity of 0.99
/// ([`merged`]). Those come first that move little, of little weight, of equal colours. Where they cannot be
/// merged, as without a rotation, that with the largest weight stays.
pub fn levels(scene: &Scene3d, members: &[u32], counts: &[usize]) -> Vec<Level> {
    let empty = || Scene3d { sh_degree: scene.sh_degree, ..Scene3d::default() };
    let mut all = empty();
    members.iter().for_each(|&i| all.push(scene.gaussian(i as usize)));
    let mut merging = Merging::of(&all);
    let mut levels: Vec<Level> = Vec::with_capacity(counts.len());
    for &count in counts {
        let before = levels.last().map_or(&all, |level| &level.scene);
        let mut fewer = empty();
        let groups = merging.until(count.max(1));
        for group in &groups {
            fewer.push(one_of(group.iter().map(|&i| before.gaussian(i as usize)).collect()));
        }
        levels.push(Level { scene: fewer, error: merging.error() as f32, groups });
    }
    levels
}

/// One Gaussian in place of several: that with the largest weight where they cannot be merged.
fn one_of(mut parts: Vec<Gaussian3d>) -> Gaussian3d {
    if parts.len() == 1 {
        return parts.swap_remove(0);
    }
    let mut weighted: Vec<_> = parts.into_iter().map(|part| (merging::weight(&part), part)).collect();
    weighted.sort_by(|a, b| b.0.total_cmp(&a.0));
    let weighted: Vec<_> = weighted.into_iter().map(|(weight, part)| (part, weight)).collect();
    merged(&weighted).unwrap_or_else(|| weighted[0].0.clone())
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs_core::sigmoid;

    /// Gaussians of an undulating surface, in any order, with numbers that differ.
    fn surface(count: usize) -> Scene3d {
        let gaussian = |i: usize| {
            let t = (i * 7919 % count) as f32;
            let (x, y) = (t % 40.0, t / 40.0);
            Gaussian3d {
                mean: Vec3::new(x, y, (0.3 * x).sin() + (0.2 * y).cos()),
                log_scale: Vec3::new(-0.3, -0.5 + 0.2 * (t * 1.3).sin(), -3.0),
                rotation: [1.0, 0.1 * (t * 0.7).sin(), 0.1 * (t * 0.4).cos(), 0.2],
                opacity_logit: 1.0 + (t * 2.1).sin(),
                sh: (0..4).map(|k| Vec3::splat((t * 0.01 + k as f32).sin())).collect(),
            }
        };
        (0..count).map(gaussian).collect()
    }

    /// The cells of a range.
    fn cells(range: Range<usize>, most: usize) -> Vec<Range<usize>> {
        match halves(&range, most) {
            Some(parts) => parts.into_iter().flat_map(|part| cells(part, most)).collect(),
            None => Vec::from([range]),
        }
    }

    #[test]
    fn the_order_is_that_of_a_tree_for_any_number_of_threads() {
        let scene = surface(3000);
        let order = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| spatial_order(&scene.means, 100))
        };
        let one = order(1);
        assert_eq!(one, order(5));
        let mut all = one.clone();
        all.sort_unstable();
        assert!(all.iter().enumerate().all(|(i, &number)| i as u32 == number));
        // Cells of a surface of 40 by 75 with about 94 Gaussians are far smaller than it.
        for cell in cells(0..3000, 100) {
            assert!(cell.len() > 50 && cell.len() <= 100);
            let means = || one[cell.clone()].iter().map(|&i| scene.means[i as usize]);
            let size = means().fold(Vec3::NEG_INFINITY, Vec3::max) - means().fold(Vec3::INFINITY, Vec3::min);
            assert!(size.max_element() < 20.0, "{size}");
        }
    }

    #[test]
    fn levels_have_the_wanted_counts_and_errors_that_do_not_fall() {
        let scene = surface(1000);
        let members: Vec<u32> = (0..1000).collect();
        let counts = [1000, 500, 250, 60, 7, 1];
        let made = levels(&scene, &members, &counts);
        assert_eq!(made.iter().map(|level| level.scene.len()).collect::<Vec<_>>(), counts);
        assert_eq!((&made[0].scene, made[0].error), (&scene, 0.0));
        assert!(made.windows(2).all(|pair| pair[0].error < pair[1].error));
        // Half of the Gaussians move by less than the distance of neighbours, one by about the size of all.
        assert!(made[1].error < 1.0, "{}", made[1].error);
        assert!(made[5].error > 8.0 && made[5].error < 30.0, "{}", made[5].error);
        for (level, before) in made.iter().zip([1000].iter().chain(&counts)) {
            level.scene.validate().unwrap();
            let mut all = level.groups.concat();
            all.sort_unstable();
            assert!(level.groups.len() == level.scene.len() && all.into_iter().eq(0..*before as u32));
        }
        assert_eq!(made, levels(&scene, &members, &counts));
    }

    #[test]
    fn merges_keep_moments_and_what_is_covered() {
        let scene = surface(300);
        let level = &levels(&scene, &(0..300).collect::<Vec<_>>(), &[150])[0];
        let sums = |scene: &Scene3d| {
            let (mut covered, mut mean, mut color) = (0.0, glam::DVec3::ZERO, 0.0);
            for i in 0..scene.len() {
                let gaussian = scene.gaussian(i);
                let weight = merging::weight(&gaussian);
                covered += weight;
                mean += gaussian.mean.as_dvec3() * weight;
                color += f64::from(gaussian.sh[3].x) * weight;
            }
            (covered, mean / covered, color / covered)
        };
        let ((covered, mean, color), (after, mean_after, color_after)) = (sums(&scene), sums(&level.scene));
        assert!(level.scene.opacity_logits.iter().all(|&logit| sigmoid(logit) <= 0.9901));
        // Opacities are cut at 0.99, so that a little is lost where Gaussians overlap.
        assert!(after <= covered * 1.0001 && after > 0.8 * covered, "{covered} {after}");
        assert!(mean.distance(mean_after) < 0.5 && (color - color_after).abs() < 0.05, "{mean} {mean_after}");
    }

    #[test]
    fn duplicates_are_merged_first_and_without_error() {
        let mut scene = surface(64);
        (0..32).for_each(|i| scene.push(scene.gaussian(i)));
        let level = &levels(&scene, &(0..96).collect::<Vec<_>>(), &[64])[0];
        assert!(level.error < 1e-3, "{}", level.error);
        assert!((0..64).all(|i| scene.means[i].distance(level.scene.means[i]) < 1e-4));
    }

    #[test]
    fn gaussians_in_one_place_or_without_a_rotation_are_no_trouble() {
        let mut scene = surface(40);
        scene.means.iter_mut().for_each(|mean| *mean = Vec3::ONE);
        (scene.rotations[3], scene.opacity_logits[5]) = ([0.0; 4], f32::NEG_INFINITY);
        scene.log_scales[7] = Vec3::splat(-80.0);
        let made = levels(&scene, &(0..40).collect::<Vec<_>>(), &[20, 3, 1]);
        assert_eq!(made.iter().map(|level| level.scene.len()).collect::<Vec<_>>(), [20, 3, 1]);
        assert!(made.iter().all(|level| level.error.is_finite()));
        assert_eq!(levels(&scene, &[2], &[1])[0].scene.len(), 1);
    }
}
