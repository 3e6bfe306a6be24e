//! Stage `project`: computes the [`Splat`] of every Gaussian. Parallel over Gaussians. Colours are
//! only evaluated where the ellipse's bounding box touches the image.

use glam::Vec3;
use gs_core::{
    Blend, Camera, CameraGradient, CullCause, Culled, Dropout, Effects, Output, RenderSettings,
    math::{
        perspective::{Perspective, ProjectionGradient},
        sh,
    },
};
use rayon::prelude::*;

use super::splats::{self, Splats3d};
use crate::{
    bin::touches,
    layout::Grid,
    splat::{CHUNK, Covariance, PixelDepth, Splat},
    tiles::Tiles,
};

/// The camera, and the settings that projection needs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Eye {
    pub(crate) perspective: Perspective,
    /// The evaluated degree of the SH.
    pub(crate) degree: u8,
    pub(crate) output: Output,
    /// Rows of the rotation from the world's to the camera's axes, and the translation after it.
    pub(crate) rotation: [[f32; 3]; 3],
    pub(crate) translation: [f32; 3],
    /// Place in the world.
    pub(crate) position: [f32; 3],
    /// Focal length, px.
    pub(crate) focal: [f32; 2],
    /// The dilation, px², where opacities compensate for it.
    pub(crate) compensated_dilation: Option<f32>,
    pub(crate) is_over: bool,
}

impl Eye {
    /// Of a valid camera with valid settings.
    pub(crate) fn new(camera: &Camera, settings: &RenderSettings, degree: u8) -> Self {
        let Effects { antialias, blend, .. } = settings.effects;
        let is_over = blend == Blend::Over;
        Self {
            perspective: Perspective::new(camera, settings),
            degree,
            output: settings.output,
            rotation: camera.rotation.transpose().to_cols_array_2d(),
            translation: camera.translation.to_array(),
            position: camera.position().to_array(),
            focal: camera.focal.to_array(),
            compensated_dilation: (antialias.compensates() && is_over).then(|| antialias.dilation()),
            is_over,
        }
    }

    /// What a Gaussian shows.
    #[inline(always)]
    fn color(&self, row: &[f32]) -> [f32; 3] {
        let mean = splats::mean(row);
        match self.output {
            Output::Color => sh::color(self.degree, self.direction(mean), splats::sh(row)),
            Output::InverseDepth => [1.0 / self.perspective.depth(mean); 3],
            Output::Alpha => [1.0; 3],
        }
    }

    /// The gradient by the mean of a Gaussian, from that by [`Self::color`]. Writes the gradient by
    /// the SH coefficients into `v_sh`, which holds zeros.
    #[inline(always)]
    pub(crate) fn color_vjp(&self, row: &[f32], v_color: [f32; 3], v_sh: &mut [[f32; 3]]) -> Vec3 {
        let mean = splats::mean(row);
        match self.output {
            Output::Color => {
                let direction = self.direction(mean);
                let v_direction = sh::color_vjp(self.degree, direction, splats::sh(row), v_color, v_sh);
                self.direction_vjp(mean, v_direction)
            }
            Output::InverseDepth => self.perspective.inverse_depth_vjp(mean, v_color.iter().sum()),
            Output::Alpha => Vec3::ZERO,
        }
    }

    /// The gradient by the camera through a Gaussian, from those by its projection and, through its
    /// colour, by its mean.
    pub(crate) fn camera_vjp(&self, row: &[f32], v: &ProjectionGradient, by_color: Vec3) -> CameraGradient {
        let Self { perspective, .. } = self;
        let through_color = match self.output {
            Output::Color => perspective.direction_camera_vjp(by_color),
            Output::InverseDepth => perspective.inverse_depth_camera_vjp(splats::mean(row), by_color),
            Output::Alpha => CameraGradient::default(),
        };
        perspective.camera_vjp(&splats::ellipsoid(row), v) + through_color
    }

    /// The direction from which a Gaussian is seen. Arbitrary at degree 0, where colours do not
    /// depend on it.
    #[inline(always)]
    fn direction(&self, mean: Vec3) -> Vec3 {
        if self.degree == 0 { Vec3::Z } else { self.perspective.direction(mean) }
    }

    /// The gradient by the mean, from that by the direction.
    #[inline(always)]
    fn direction_vjp(&self, mean: Vec3, v_direction: Vec3) -> Vec3 {
        if self.degree == 0 { Vec3::ZERO } else { self.perspective.direction_vjp(mean, v_direction) }
    }
}

/// Projects the Gaussian with this index. Gaussians left out by dropout count as transparent.
fn project(
    eye: &Eye,
    (index, row): (usize, &[f32]),
    grid: &Grid,
    (settings, dropout, longest): (&RenderSettings, Option<&Dropout>, f32),
) -> Result<(Splat, PixelDepth), CullCause> {
    if dropout.is_some_and(|dropout| dropout.leaves_out(index as u32)) {
        return Err(CullCause::Transparent);
    }
    let p = eye.perspective.project(&splats::ellipsoid(row))?;
    let [xx, xy, yy] = p.covariance;
    let covariance = Covariance { xx, xy, yy, determinant: p.determinant };
    let mut splat = Splat::new(p.mean, covariance, [0.0; 3], (p.opacity, settings.accuracy.alpha_cut), longest);
    if !touches(&splat, (splat.reach * yy).sqrt(), grid) {
        return Err(CullCause::Outside);
    }
    splat.color = eye.color(row);
    if !splat.color.iter().all(|c| c.is_finite()) {
        return Err(CullCause::NotFinite);
    }
    Ok((splat, PixelDepth { depth: p.depth, slope: p.depth_slope.to_array() }))
}

/// Projects all Gaussians by index, and counts the culled.
pub(crate) fn project_all(splats: &Splats3d, eye: &Eye, tiles: &mut Tiles) {
    let Tiles { projected, depths, grid, settings, tuning, .. } = tiles;
    projected.resize(splats.len(), Splat::CULLED);
    depths.resize(splats.len(), PixelDepth::default());
    let dropout = Some(&settings.dropout).filter(|dropout| !dropout.is_none());
    let how = (&*settings, dropout, f32::from(tuning.recurrence_rows));
    let rows = splats.parameters.par_chunks(CHUNK * splats.pitch());
    let chunks = projected.par_chunks_mut(CHUNK).zip(depths.par_chunks_mut(CHUNK)).zip(rows).enumerate();
    let culled = chunks.map(|(number, ((projected, depths), rows))| {
        let mut culled = Culled::default();
        let rows = (number * CHUNK..).zip(rows.chunks_exact(splats.pitch()));
        for ((splat, depth), row) in projected.iter_mut().zip(depths).zip(rows) {
            match project(eye, row, grid, how) {
                Ok(found) => (*splat, *depth) = found,
                Err(cause) => {
                    culled.count(cause);
                    *depth = PixelDepth::default();
                }
            }
        }
        culled
    });
    tiles.culled = culled.reduce(Culled::default, Culled::plus);
}
