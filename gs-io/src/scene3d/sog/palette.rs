//! A palette of SH coefficients: vectors that stand for those of many Gaussians.
//!
//! Bisecting k-means: the clusters with the largest sums of squared distances are split in two, until
//! there are enough. Each Gaussian is visited once a level, so 2¹⁶ clusters take 16 visits, not 2¹⁶
//! distances. The members of a cluster are neighbours in memory, and a sample of them decides where a
//! large cluster is split.

use glam::{DVec4, Vec3, Vec4};
use gs_core::{Scene, Scene3d};
use rayon::prelude::*;

/// Most rounds of 2-means in a split.
const ROUNDS: usize = 4;

/// Most members that decide where a cluster is split, unless all of these are alike.
const SAMPLE: usize = 4096;

/// Rows that are added up in `f32`; longer sums would lose their low bits.
const BLOCK: usize = 1024;

/// The numbers of a Gaussian's coefficients above degree 0, in V vectors; zeros after the last.
type Row<const V: usize> = [Vec4; V];

/// Clusters of the SH coefficients above degree 0.
#[derive(Debug)]
pub(super) struct Clusters {
    /// Coefficients of each cluster in sequence.
    pub(super) centroids: Vec<Vec3>,
    /// The cluster of each Gaussian.
    pub(super) labels: Vec<u16>,
}

impl Clusters {
    /// At most `most` clusters, a power of two; as many as there are Gaussians, rounded down to a
    /// power of two, if that is less.
    pub(super) fn of(scene: &Scene3d, most: usize) -> Self {
        let wanted = most.min(1 << scene.len().max(1).ilog2());
        match scene.sh_degree {
            1 => Self::of_rows::<3>(scene, wanted),
            2 => Self::of_rows::<6>(scene, wanted),
            _ => Self::of_rows::<12>(scene, wanted),
        }
    }

    fn of_rows<const V: usize>(scene: &Scene3d, wanted: usize) -> Self {
        let mut members = members(scene);
        let clusters = bisected::<V>(&mut members, wanted);
        let coefficients = scene.sh_len() - 1;
        let means: Vec<Row<V>> = clusters.par_iter().map(|c| mean(&members[c.start..c.end])).collect();
        let mut centroids = Vec::with_capacity(clusters.len() * coefficients);
        for mean in means {
            let numbers = mean.map(|vector| vector.to_array());
            let triples = numbers.as_flattened().as_chunks::<3>().0;
            centroids.extend(triples[..coefficients].iter().map(|&c| Vec3::from_array(c)));
        }
        let mut labels = vec![0; scene.len()];
        for (label, cluster) in clusters.iter().enumerate() {
            let inside = &members[cluster.start..cluster.end];
            inside.iter().for_each(|member| labels[member.index as usize] = label as u16);
        }
        Self { centroids, labels }
    }
}

/// A Gaussian in a cluster.
#[derive(Debug, Clone, Copy)]
struct Member<const V: usize> {
    row: Row<V>,
    index: u32,
}

fn members<const V: usize>(scene: &Scene3d) -> Vec<Member<V>> {
    let of = |(index, sh): (usize, &[Vec3])| {
        let mut numbers = sh[1..].iter().flat_map(|c| c.to_array());
        let row = [[(); 4]; V].map(|vector| Vec4::from_array(vector.map(|()| numbers.next().unwrap_or(0.0))));
        Member { row, index: index as u32 }
    };
    scene.sh.par_chunks_exact(scene.sh_len()).enumerate().map(of).collect()
}

/// Members next to each other.
#[derive(Debug, Clone, Copy)]
struct Cluster<const V: usize> {
    start: usize,
    end: usize,
    /// Their mean, to rounding.
    mean: Row<V>,
    /// Sum of their squared distances from it; 0 where they are all alike.
    error: f64,
}

/// Puts the members in the order of at most `wanted` clusters, and returns these in that order.
fn bisected<const V: usize>(members: &mut [Member<V>], wanted: usize) -> Vec<Cluster<V>> {
    let whole = Cluster { start: 0, end: members.len(), mean: mean(members), error: f64::INFINITY };
    let mut clusters = vec![whole];
    while clusters.len() < wanted {
        let chosen = largest(&clusters, wanted - clusters.len());
        if chosen.is_empty() {
            break;
        }
        let mut rest = &mut *members;
        let mut at = 0;
        let mut parts = Vec::with_capacity(chosen.len());
        for &k in &chosen {
            let Cluster { start, end, .. } = clusters[k];
            let part = rest.split_off_mut(start - at..).unwrap_or_default();
            let (part, after) = part.split_at_mut(end - start);
            parts.push((clusters[k], part));
            (rest, at) = (after, end);
        }
        let halves: Vec<_> = parts.into_par_iter().map(|(cluster, members)| cluster.split(members)).collect();
        for (k, halves) in chosen.into_iter().zip(halves) {
            match halves {
                None => clusters[k].error = 0.0,
                Some([left, right]) => {
                    clusters[k] = left;
                    clusters.push(right);
                }
            }
        }
        clusters.sort_unstable_by_key(|cluster| cluster.start);
    }
    clusters
}

/// The clusters to split next, at most `most`, by index: those whose errors are at least half of the
/// largest.
fn largest<const V: usize>(clusters: &[Cluster<V>], most: usize) -> Vec<usize> {
    let least = clusters.iter().map(|cluster| cluster.error).fold(f64::MIN_POSITIVE, f64::max) / 2.0;
    let mut chosen: Vec<usize> = (0..clusters.len()).filter(|&k| clusters[k].error >= least).collect();
    chosen.sort_by(|&a, &b| clusters[b].error.total_cmp(&clusters[a].error));
    chosen.truncate(most);
    chosen.sort_unstable();
    chosen
}

impl<const V: usize> Cluster<V> {
    /// Puts the members in the order of two halves, by 2-means; `None` where all are alike.
    fn split(&self, members: &mut [Member<V>]) -> Option<[Self; 2]> {
        let stride = members.len().div_ceil(SAMPLE);
        let plane = Plane::between(&self.mean, members, stride)
            .or_else(|| Plane::between(&self.mean, members, 1).filter(|_| stride > 1))?;
        let mut sides = [Sums::<V>::ZERO; 2];
        let mut left = 0;
        for k in 0..members.len() {
            let row = &members[k].row;
            let is_left = plane.has_left(row, &self.mean);
            sides[usize::from(!is_left)].add(row, &self.mean);
            if is_left {
                members.swap(left, k);
                left += 1;
            }
        }
        if left == 0 || left == members.len() {
            return None;
        }
        let middle = self.start + left;
        let [(left_mean, left_error), (right_mean, right_error)] = sides.map(|side| side.mean_and_error(&self.mean));
        Some([
            Self { start: self.start, end: middle, mean: left_mean, error: left_error },
            Self { start: middle, end: self.end, mean: right_mean, error: right_error },
        ])
    }
}

/// The plane in the middle between two means, relative to the mean of all.
struct Plane<const V: usize> {
    normal: Row<V>,
    distance: f32,
}

impl<const V: usize> Plane<V> {
    /// The plane of 2-means of every `stride`th member, which begins across the widest coordinate;
    /// `None` where no plane is between them.
    fn between(mean: &Row<V>, members: &[Member<V>], stride: usize) -> Option<Self> {
        let (mut all, mut spread, mut count) = ([Vec4::ZERO; V], [Vec4::ZERO; V], 0);
        for member in members.iter().step_by(stride) {
            for k in 0..V {
                let offset = member.row[k] - mean[k];
                all[k] += offset;
                spread[k] += offset * offset;
            }
            count += 1;
        }
        let mut plane = Self { normal: widest(&spread), distance: 0.0 };
        let mut before = 0;
        for _ in 0..ROUNDS {
            let (mut left, mut of_left) = ([Vec4::ZERO; V], 0);
            for member in members.iter().step_by(stride) {
                if plane.has_left(&member.row, mean) {
                    add(&mut left, &member.row, mean);
                    of_left += 1;
                }
            }
            if of_left == 0 || of_left == count {
                return None;
            }
            if of_left == before {
                break;
            }
            before = of_left;
            let right = difference(&all, &left).map(|sum| sum / (count - of_left) as f32);
            let left = left.map(|sum| sum / of_left as f32);
            plane.normal = difference(&right, &left);
            plane.distance = (dot(&right, &right) - dot(&left, &left)) / 2.0;
        }
        Some(plane)
    }

    #[inline(always)]
    fn has_left(&self, row: &Row<V>, mean: &Row<V>) -> bool {
        let mut along = Vec4::ZERO;
        for k in 0..V {
            along += self.normal[k] * (row[k] - mean[k]);
        }
        along.element_sum() <= self.distance
    }
}

/// The axis with the largest number.
fn widest<const V: usize>(spread: &Row<V>) -> Row<V> {
    let mut largest = (0, 0);
    for (k, vector) in spread.iter().enumerate() {
        for lane in 0..4 {
            if vector[lane] > spread[largest.0][largest.1] {
                largest = (k, lane);
            }
        }
    }
    let mut axis = [Vec4::ZERO; V];
    axis[largest.0][largest.1] = 1.0;
    axis
}

/// Sums over offsets from a point.
#[derive(Clone, Copy)]
struct Sums<const V: usize> {
    count: usize,
    /// Of whole blocks, and of the last one.
    offsets: [DVec4; V],
    block: Row<V>,
    squares: f64,
}

impl<const V: usize> Sums<V> {
    const ZERO: Self = Self { count: 0, offsets: [DVec4::ZERO; V], block: [Vec4::ZERO; V], squares: 0.0 };

    #[inline(always)]
    fn add(&mut self, row: &Row<V>, origin: &Row<V>) {
        let mut squares = Vec4::ZERO;
        for k in 0..V {
            let offset = row[k] - origin[k];
            self.block[k] += offset;
            squares += offset * offset;
        }
        self.squares += f64::from(squares.element_sum());
        self.count += 1;
        if self.count.is_multiple_of(BLOCK) {
            self.end_block();
        }
    }

    fn end_block(&mut self) {
        self.offsets.iter_mut().zip(self.block).for_each(|(sum, part)| *sum += part.as_dvec4());
        self.block = [Vec4::ZERO; V];
    }

    /// The mean of the points, and the sum of their squared distances from it.
    fn mean_and_error(mut self, origin: &Row<V>) -> (Row<V>, f64) {
        self.end_block();
        let (mut mean, mut error) = (*origin, self.squares);
        for (value, sum) in mean.iter_mut().zip(self.offsets) {
            let offset = sum / self.count.max(1) as f64;
            *value = (value.as_dvec4() + offset).as_vec4();
            error -= sum.dot(offset);
        }
        (mean, error.max(0.0))
    }
}

/// The mean of members: their coefficients where they are all alike.
fn mean<const V: usize>(members: &[Member<V>]) -> Row<V> {
    let mut sums = Sums::ZERO;
    members.iter().for_each(|member| sums.add(&member.row, &[Vec4::ZERO; V]));
    sums.mean_and_error(&[Vec4::ZERO; V]).0
}

#[inline(always)]
fn difference<const V: usize>(a: &Row<V>, b: &Row<V>) -> Row<V> {
    // A copy of `a` would be a call of `memcpy`.
    let mut out = [Vec4::ZERO; V];
    for k in 0..V {
        out[k] = a[k] - b[k];
    }
    out
}

/// Adds a row's offset from a mean.
#[inline(always)]
fn add<const V: usize>(sum: &mut Row<V>, row: &Row<V>, mean: &Row<V>) {
    for k in 0..V {
        sum[k] += row[k] - mean[k];
    }
}

#[inline(always)]
fn dot<const V: usize>(a: &Row<V>, b: &Row<V>) -> f32 {
    let mut sum = Vec4::ZERO;
    for k in 0..V {
        sum += a[k] * b[k];
    }
    sum.element_sum()
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
            row.iter().zip(&spread.sh[4 * i + 1..4 * i + 4]).map(|(&a, &b)| (a - b).length_squared()).sum::<f32>()
        };
        assert!((0..1000).map(error).fold(0.0, f32::max) < 0.001);
        assert_eq!(Clusters::of(&scene([0.5].into_iter()), 256).centroids.len(), 3);
    }
}
