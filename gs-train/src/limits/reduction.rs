//! Reducing a scene to fewer Gaussians: those that contribute least to its views are merged into
//! their neighbours, or removed.

use gs_core::{Camera, Parameterization, Rasterizer, RenderSettings, Scene, Scene3d};
use gs_density::merged;
use rstar::{RTree, primitives::GeomWithData};

use crate::error::Error;
use crate::train::plain;
use crate::views::{blending_weights, colorless};

/// Distance of two Gaussians, in sums of their largest standard deviations, within which one is
/// merged into the other. Measured on two trained scenes: without merging, 0.1 to 5 dB less; at 0.3,
/// up to 1.1 dB less.
const NEAR: f32 = 0.6;

/// A scene with fewer Gaussians.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Reduced {
    /// The Gaussians that are left, in their order in the scene.
    pub scene: Scene3d,
    /// Number of Gaussians that were merged into others.
    pub merged: usize,
    /// Number of Gaussians that were removed.
    pub removed: usize,
}

/// Reduces a scene to at most `count` Gaussians, 1 or more, by what each contributes to the images
/// of these cameras: the sum of its weights in all pixels.
///
/// The `count` that contribute most are kept. Each of the others is merged into the nearest of them,
/// if they overlap, and removed if not, or if no camera sees it. Weights of merged Gaussians are
/// their contributions.
///
/// # Errors
/// [`gs_core::Error::Setting`] for a count of 0 or no camera; those of the backend.
pub async fn reduce<R: Rasterizer<Scene3d>>(
    on: &R,
    scene: &Scene3d,
    cameras: &[Camera],
    render: &RenderSettings,
    count: usize,
) -> Result<Reduced, Error> {
    if count == 0 || cameras.is_empty() {
        return Err(gs_core::Error::setting("the number of Gaussians and of cameras", 0, "at least 1").into());
    }
    let contribution = contributions(on, scene, cameras, render).await?;
    let mut order: Vec<usize> = (0..scene.len()).collect();
    order.sort_by(|&a, &b| contribution[b].total_cmp(&contribution[a]));
    let (kept, rest) = order.split_at(count.min(order.len()));
    let mut kept = kept.to_vec();
    kept.sort_unstable();
    let entries = kept.iter().enumerate().map(|(place, &i)| GeomWithData::new(scene.means[i].to_array(), place));
    let tree: RTree<GeomWithData<[f32; 3], usize>> = RTree::bulk_load(entries.collect());
    let reach = |i: usize| scene.log_scales[i].max_element().exp();
    let mut joining: Vec<Vec<usize>> = vec![Vec::new(); kept.len()];
    for &i in rest.iter().filter(|&&i| contribution[i] > 0.0) {
        let Some(nearest) = tree.nearest_neighbor(scene.means[i].to_array()) else { continue };
        let main = kept[nearest.data];
        if scene.means[i].distance(scene.means[main]) <= NEAR * (reach(i) + reach(main)) {
            joining[nearest.data].push(i);
        }
    }
    let mut reduced = Scene3d { sh_degree: scene.sh_degree, ..Scene3d::default() };
    let mut joined = 0;
    for (&main, others) in kept.iter().zip(&joining) {
        let all = std::iter::once(&main).chain(others);
        let parts: Vec<_> = all.map(|&i| (scene.gaussian(i), f64::from(contribution[i]))).collect();
        let one = if others.is_empty() { None } else { merged(&parts) };
        joined += if one.is_some() { others.len() } else { 0 };
        reduced.push(one.unwrap_or_else(|| scene.gaussian(main)));
    }
    Ok(Reduced { removed: scene.len() - reduced.len() - joined, merged: joined, scene: reduced })
}

/// The sum of each Gaussian's weights in the pixels of all images, `[N]`.
async fn contributions<R: Rasterizer<Scene3d>>(
    on: &R,
    scene: &Scene3d,
    cameras: &[Camera],
    render: &RenderSettings,
) -> Result<Vec<f32>, Error> {
    let grey = on.upload(&plain(scene), Parameterization::ScaleRotation)?;
    let mut sums = vec![0.0; scene.len()];
    for camera in cameras {
        let weights = blending_weights((on, &grey), camera, &colorless(render)).await?;
        sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight.max(0.0));
    }
    Ok(sums)
}
