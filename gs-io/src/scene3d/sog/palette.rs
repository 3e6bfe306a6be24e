//! A palette of SH coefficients: vectors that stand for those of many Gaussians.
//!
//! Bisecting k-means: the cluster with the largest sum of squared distances is split in two, until
//! there are enough. Each Gaussian is visited once a level, so 2¹⁶ clusters take 16 visits, not 2¹⁶
//! distances.

use std::collections::BinaryHeap;

use glam::Vec3;
use gs_core::{Scene, Scene3d};

/// Rounds of 2-means in a split.
const ROUNDS: usize = 4;

/// Clusters of the SH coefficients above degree 0.
#[derive(Debug)]
pub(super) struct Clusters {
    /// Coefficients of each cluster in sequence.
    pub(super) centroids: Vec<Vec3>,
    /// The cluster of each Gaussian.
    pub(super) labels: Vec<u16>,
}

/// A cluster that may be split; ordered by its squared distances, then by its place.
#[derive(Debug, PartialEq)]
struct Cluster {
    error: f64,
    start: usize,
    end: usize,
}

impl Eq for Cluster {}

impl Ord for Cluster {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.error.total_cmp(&other.error).then(other.start.cmp(&self.start))
    }
}

impl PartialOrd for Cluster {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Clusters {
    /// At most `most` clusters, a power of two; as many as there are Gaussians, rounded down to a
    /// power of two, if that is less.
    pub(super) fn of(scene: &Scene3d, most: usize) -> Self {
        let rows = Rows { sh: &scene.sh, len: scene.sh_len() };
        let wanted = most.min(1 << scene.len().max(1).ilog2());
        let mut members: Vec<u32> = (0..scene.len() as u32).collect();
        let mut heap = BinaryHeap::from([rows.cluster(&members, 0, members.len())]);
        let mut done = Vec::new();
        while heap.len() + done.len() < wanted {
            let Some(cluster) = heap.pop() else { break };
            let Cluster { start, end, .. } = cluster;
            match rows.split(&mut members[start..end]) {
                0 => done.push(cluster),
                left => {
                    heap.push(rows.cluster(&members, start, start + left));
                    heap.push(rows.cluster(&members, start + left, end));
                }
            }
        }
        let mut clusters: Vec<Cluster> = heap.into_iter().chain(done).collect();
        clusters.sort_by_key(|cluster| cluster.start);
        let mut labels = vec![0; scene.len()];
        let mut centroids = Vec::new();
        for (label, cluster) in clusters.iter().enumerate() {
            let inside = &members[cluster.start..cluster.end];
            inside.iter().for_each(|&i| labels[i as usize] = label as u16);
            centroids.extend(rows.mean(inside));
        }
        Self { centroids, labels }
    }
}

/// The coefficients above degree 0 of all Gaussians.
#[derive(Debug, Clone, Copy)]
struct Rows<'a> {
    sh: &'a [Vec3],
    len: usize,
}

impl<'a> Rows<'a> {
    fn get(&self, i: u32) -> &'a [Vec3] {
        &self.sh[i as usize * self.len + 1..(i as usize + 1) * self.len]
    }

    fn mean(&self, members: &[u32]) -> Vec<Vec3> {
        let mut sums = vec![Vec3::ZERO; self.len - 1];
        // In blocks, so that sums of many Gaussians keep their low bits.
        for block in members.chunks(1024) {
            let mut part = vec![Vec3::ZERO; self.len - 1];
            block.iter().for_each(|&i| part.iter_mut().zip(self.get(i)).for_each(|(sum, &c)| *sum += c));
            sums.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
        sums.into_iter().map(|sum| sum / members.len().max(1) as f32).collect()
    }

    fn cluster(&self, members: &[u32], start: usize, end: usize) -> Cluster {
        let inside = &members[start..end];
        let mean = self.mean(inside);
        let error = inside.iter().map(|&i| f64::from(distance2(self.get(i), &mean))).sum();
        Cluster { error, start, end }
    }

    /// Orders the members of a cluster by the halves of 2-means and returns the size of the first;
    /// 0 if all are alike.
    fn split(&self, members: &mut [u32]) -> usize {
        let mean = self.mean(members);
        let mut spread = vec![Vec3::ZERO; mean.len()];
        for &i in &*members {
            spread.iter_mut().zip(self.get(i).iter().zip(&mean)).for_each(|(s, (&c, &m))| *s += (c - m) * (c - m));
        }
        let all = spread.iter().flat_map(|s| s.to_array());
        let (widest, variance) = all.enumerate().fold((0, 0.0), |best, (k, s)| if s > best.1 { (k, s) } else { best });
        let deviation = (variance / members.len().max(1) as f32).sqrt();
        if !(deviation > 0.0) {
            return 0;
        }
        let (mut low, mut high) = (mean.clone(), mean);
        low[widest / 3][widest % 3] -= deviation;
        high[widest / 3][widest % 3] += deviation;
        let mut left = 0;
        for _ in 0..ROUNDS {
            left = 0;
            for k in 0..members.len() {
                let row = self.get(members[k]);
                if distance2(row, &low) <= distance2(row, &high) {
                    members.swap(left, k);
                    left += 1;
                }
            }
            if left == 0 || left == members.len() {
                return 0;
            }
            (low, high) = (self.mean(&members[..left]), self.mean(&members[left..]));
        }
        left
    }
}

fn distance2(a: &[Vec3], b: &[Vec3]) -> f32 {
    a.iter().zip(b).map(|(&a, &b)| (a - b).length_squared()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(values: impl Iterator<Item = f32>) -> Scene3d {
        let mut scene = Scene3d { sh_degree: 1, ..Scene3d::default() };
        for value in values {
            scene.means.push(Vec3::ZERO);
            scene.sh.extend([Vec3::ZERO, Vec3::splat(value), Vec3::ZERO, Vec3::Y * value]);
        }
        scene
    }

    #[test]
    fn gaussians_that_are_alike_share_a_row() {
        let scene = scene((0..64).map(|k| (k % 4) as f32));
        let clusters = Clusters::of(&scene, 16);
        assert_eq!(clusters.centroids.len(), 4 * 3);
        for i in 0..64 {
            let row = &clusters.centroids[3 * usize::from(clusters.labels[i])..][..3];
            assert_eq!(row, &scene.sh[4 * i + 1..4 * i + 4]);
        }
    }

    #[test]
    fn there_are_no_more_rows_than_wanted() {
        let spread = scene((0..1000).map(|k| (k as f32).sin()));
        let clusters = Clusters::of(&spread, 256);
        assert_eq!(clusters.centroids.len(), 256 * 3);
        let error = |i: usize| {
            let row = &clusters.centroids[3 * usize::from(clusters.labels[i])..][..3];
            distance2(row, &spread.sh[4 * i + 1..4 * i + 4])
        };
        assert!((0..1000).map(error).fold(0.0, f32::max) < 0.001);
        assert_eq!(Clusters::of(&scene([0.5].into_iter()), 256).centroids.len(), 3);
    }
}
