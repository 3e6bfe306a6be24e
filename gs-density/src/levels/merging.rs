//! Merging the Gaussians of a cell pair after pair, in the order of what a merge costs.

use std::{cmp::Reverse, collections::BinaryHeap};

use glam::{DMat3, DVec3, Vec3};
use gs_core::{Gaussian3d, Scene, Scene3d, sigmoid};
use rstar::{RTree, primitives::GeomWithData};

/// Nearest neighbours with which a Gaussian may be merged.
const NEIGHBOURS: usize = 8;

/// Most neighbours of a merged Gaussian that are remembered.
const MOST_NEIGHBOURS: usize = 12;

/// The highest opacity of a merged Gaussian, as in [`merged`](crate::merged).
const MOST_OPACITY: f64 = 0.99;

/// How much more a merge of colours costs that differ by 1 (SH coefficients of degree 0).
const COLOR: f64 = 4.0;

/// The weight of a Gaussian that would have none.
const LEAST_WEIGHT: f64 = 1e-30;

/// What a Gaussian covers, opacity times area: the product of its two larger standard deviations.
pub(super) fn weight(gaussian: &Gaussian3d) -> f64 {
    let scale = gaussian.log_scale.as_dvec3().map(f64::exp);
    (f64::from(sigmoid(gaussian.opacity_logit)) * area(scale)).max(LEAST_WEIGHT)
}

fn area(scale: DVec3) -> f64 {
    let [x, y, z] = scale.to_array();
    (x * y).max(y * z).max(x * z)
}

/// A Gaussian, or those in whose place it stands.
#[derive(Debug, Clone)]
struct Node {
    mean: DVec3,
    covariance: DMat3,
    weight: f64,
    color: Vec3,
    /// Nodes near it, which may have been merged since.
    near: Vec<u32>,
    /// The node that it became a part of.
    whole: Option<u32>,
}

/// The merges of a cell.
#[derive(Debug)]
pub(super) struct Merging {
    /// First the Gaussians, then those in place of two others.
    nodes: Vec<Node>,
    /// The cheapest merge of each node that is not part of another: the bits of the cost, which are in its
    /// order, the node, and the other, which may have been merged since.
    candidates: BinaryHeap<Reverse<(u64, u32, u32)>>,
    /// Number of Gaussians.
    gaussians: usize,
    /// Nodes that are not part of another.
    count: usize,
    /// The nodes of the last level.
    last: Vec<u32>,
}

impl Merging {
    /// The Gaussians before any merge.
    pub(super) fn of(scene: &Scene3d) -> Self {
        let node = |i: usize| {
            let gaussian = scene.gaussian(i);
            let covariance = gaussian.covariance().map(|c| c.as_dmat3()).filter(DMat3::is_finite);
            Node {
                mean: gaussian.mean.as_dvec3(),
                weight: if covariance.is_some() { weight(&gaussian) } else { LEAST_WEIGHT },
                covariance: covariance.unwrap_or(DMat3::ZERO),
                color: gaussian.sh[0],
                near: Vec::new(),
                whole: None,
            }
        };
        let nodes: Vec<Node> = (0..scene.len()).map(node).collect();
        let (count, last) = (nodes.len(), (0..nodes.len() as u32).collect());
        Self { nodes, candidates: BinaryHeap::new(), gaussians: count, count, last }
    }

    /// Finds the nearest neighbours of all nodes that are not part of another, and the cheapest merges.
    fn find_neighbours(&mut self) {
        let is_root = |&i: &u32| self.nodes[i as usize].whole.is_none();
        let roots: Vec<u32> = (0..self.nodes.len() as u32).filter(is_root).collect();
        let place = |&i: &u32| self.nodes[i as usize].mean.as_vec3().to_array();
        let tree = RTree::bulk_load(roots.iter().map(|i| GeomWithData::new(place(i), *i)).collect());
        let near: Vec<Vec<u32>> = roots
            .iter()
            .map(|i| {
                let nearest = tree.nearest_neighbor_iter(place(i)).map(|point| point.data);
                nearest.filter(|other| other != i).take(NEIGHBOURS).collect()
            })
            .collect();
        self.candidates.clear();
        roots.iter().zip(near).for_each(|(&i, near)| self.nodes[i as usize].near = near);
        roots.into_iter().for_each(|i| self.push_cheapest(i));
    }

    /// Merges until `count` nodes are left, and returns the Gaussians of the last level of which each of
    /// them is made, in order of the first.
    pub(super) fn until(&mut self, count: usize) -> Vec<Vec<u32>> {
        if self.count > count {
            self.find_neighbours();
        }
        while self.count > count {
            let Some(Reverse((_, node, other))) = self.candidates.pop() else {
                // Groups of neighbours that are far from each other have become one each.
                self.find_neighbours();
                continue;
            };
            if self.nodes[node as usize].whole.is_some() {
                continue;
            }
            // The other may have been merged since this cost was computed.
            if self.nodes[other as usize].whole.is_some() { self.push_cheapest(node) } else { self.merge(node, other) }
        }
        let (mut groups, mut level) = (Vec::<Vec<u32>>::new(), Vec::new());
        let mut numbers = vec![None; self.nodes.len()];
        for (i, &node) in self.last.iter().enumerate() {
            let root = self.root(node);
            let number = *numbers[root as usize].get_or_insert_with(|| {
                groups.push(Vec::new());
                level.push(root);
                level.len() - 1
            });
            groups[number].push(i as u32);
        }
        self.last = level;
        groups
    }

    /// The root of the mean squared distance of the Gaussians from those in whose place they are now.
    pub(super) fn error(&self) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        for node in &self.nodes[..self.gaussians] {
            total += node.weight;
            if let Some(whole) = node.whole {
                let Node { mean, covariance, .. } = &self.nodes[self.root(whole) as usize];
                sum += node.weight * distance2(node, *mean, covariance);
            }
        }
        (sum / total).sqrt()
    }

    /// The node that this one is part of, or itself.
    fn root(&self, mut node: u32) -> u32 {
        while let Some(whole) = self.nodes[node as usize].whole {
            node = whole;
        }
        node
    }

    /// Adds the cheapest merge of a node to the candidates, if it has neighbours.
    fn push_cheapest(&mut self, node: u32) {
        let mut near: Vec<u32> = self.nodes[node as usize].near.iter().map(|&other| self.root(other)).collect();
        near.sort_unstable();
        near.dedup();
        near.retain(|&other| other != node);
        let cheapest = near.iter().map(|&other| (self.cost(node, other).to_bits(), node, other)).min();
        self.candidates.extend(cheapest.map(Reverse));
        self.nodes[node as usize].near = near;
    }

    fn cost(&self, a: u32, b: u32) -> f64 {
        let parts = [a, b].map(|i| &self.nodes[i as usize]);
        let (mean, covariance) = moments(parts);
        let moved: f64 = parts.iter().map(|part| part.weight * distance2(part, mean, &covariance)).sum();
        moved * (1.0 + COLOR * f64::from(parts[0].color.distance_squared(parts[1].color)))
    }

    fn merge(&mut self, a: u32, b: u32) {
        let parts = [a, b].map(|i| &self.nodes[i as usize]);
        let (mean, covariance) = moments(parts);
        let total = parts[0].weight + parts[1].weight;
        let color = parts[0].color.lerp(parts[1].color, (parts[1].weight / total) as f32);
        let mut near: Vec<u32> = parts.iter().flat_map(|part| &part.near).map(|&i| self.root(i)).collect();
        near.sort_unstable();
        near.dedup();
        near.retain(|&i| i != a && i != b);
        near.sort_by_key(|&i| self.nodes[i as usize].mean.distance_squared(mean).to_bits());
        near.truncate(MOST_NEIGHBOURS);
        let weight = total.min(MOST_OPACITY * largest_area(&covariance)).max(LEAST_WEIGHT);
        let node = self.nodes.len() as u32;
        self.nodes.push(Node { mean, covariance, weight, color, near, whole: None });
        for part in [a, b] {
            self.nodes[part as usize].whole = Some(node);
            self.nodes[part as usize].near = Vec::new();
        }
        self.count -= 1;
        self.push_cheapest(node);
    }
}

/// The mean and covariance of two nodes.
fn moments([a, b]: [&Node; 2]) -> (DVec3, DMat3) {
    let share = b.weight / (a.weight + b.weight);
    let offset = b.mean - a.mean;
    let between = DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z);
    let covariance = a.covariance * (1.0 - share) + b.covariance * share + between * (share * (1.0 - share));
    (a.mean + offset * share, covariance)
}

/// The squared Wasserstein-2 distance of a Gaussian from another: d² + tr A + tr B − 2 tr √(√A B √A).
fn distance2(a: &Node, mean: DVec3, b: &DMat3) -> f64 {
    let product = a.covariance * *b;
    let trace = |m: &DMat3| m.x_axis.x + m.y_axis.y + m.z_axis.z;
    let shape = trace(&a.covariance) + trace(b) - 2.0 * trace_of_root(&product, trace(&product));
    a.mean.distance_squared(mean) + shape.max(0.0)
}

/// The sum of the roots of the eigenvalues λ of a product of covariances. With s = Σ √λ:
/// s² = Σ λ + 2 j and j² = Σ λλ′ + 2 s √(λ₁ λ₂ λ₃), which is iterated.
fn trace_of_root(product: &DMat3, trace: f64) -> f64 {
    let squares = product.x_axis.dot(product.transpose().x_axis)
        + product.y_axis.dot(product.transpose().y_axis)
        + product.z_axis.dot(product.transpose().z_axis);
    let pairs = (0.5 * (trace * trace - squares)).max(0.0);
    let root = product.determinant().max(0.0).sqrt();
    let mut sum = trace.max(0.0).sqrt();
    for _ in 0..8 {
        sum = (trace + 2.0 * (pairs + 2.0 * sum * root).sqrt()).max(0.0).sqrt();
    }
    sum
}

/// The product of the two larger standard deviations of a covariance.
fn largest_area(covariance: &DMat3) -> f64 {
    let (variances, _) = crate::eigen::decomposed(*covariance);
    area(variances.map(|variance| variance.max(0.0).sqrt()))
}
