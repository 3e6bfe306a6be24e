//! Stage `project`: computes the [`Splat`] of every Gaussian. Parallel over Gaussians, a lane for
//! each. Colours are only evaluated where the ellipse's bounding box touches the image.

use glam::Vec3;
use gs_core::{
    Blend, Camera, CameraGradient, CullCause, Culled, Effects, Output, RenderSettings,
    math::{
        perspective::{Perspective, ProjectionGradient},
        sh,
    },
};
use rayon::prelude::*;

use super::{
    lanes_project::{self, Limits},
    splats::{self, Splats3d},
};
use crate::{
    bin::touches,
    lanes::LANES,
    level::{Level, dispatch},
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
    /// Focal length and principal point, px.
    pub(crate) focal: [f32; 2],
    pub(crate) center: [f32; 2],
    /// The near plane, world units.
    pub(crate) near: f32,
    /// The dilation, px².
    pub(crate) dilation: f32,
    /// The dilation, px², where opacities compensate for it.
    pub(crate) compensated_dilation: Option<f32>,
    pub(crate) is_over: bool,
    /// The factor of opacities by dropout.
    pub(crate) gain: f32,
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
            center: camera.center.to_array(),
            near: camera.near,
            dilation: antialias.dilation(),
            compensated_dilation: (antialias.compensates() && is_over).then(|| antialias.dilation()),
            is_over,
            gain: settings.dropout.gain(),
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

/// Projects one Gaussian: for extreme numbers, and outputs other than colours.
#[cold]
#[inline(never)]
fn project(eye: &Eye, row: &[f32], limits: Limits<'_>) -> Result<(Splat, PixelDepth), CullCause> {
    let p = eye.perspective.project(&splats::ellipsoid(row))?;
    let [xx, xy, yy] = p.covariance;
    let covariance = Covariance { xx, xy, yy, determinant: p.determinant };
    let mut splat = Splat::new(p.mean, covariance, [0.0; 3], (p.opacity, limits.alpha_cut));
    if !touches(&splat, (splat.reach * yy).sqrt(), limits.grid) {
        return Err(CullCause::Outside);
    }
    splat.color = eye.color(row);
    if !splat.color.iter().all(|c| c.is_finite()) {
        return Err(CullCause::NotFinite);
    }
    Ok((splat, PixelDepth { depth: p.depth, slope: p.depth_slope.to_array() }))
}

/// Projects all Gaussians by index, and counts the culled. Those left out by dropout count as
/// transparent.
pub(crate) fn project_all(splats: &Splats3d, eye: &Eye, tiles: &mut Tiles, level: Level) {
    let Tiles { projected, depths, grid, settings, .. } = tiles;
    projected.resize(splats.len(), Splat::CULLED);
    depths.resize(splats.len(), PixelDepth::default());
    let dropout = Some(&settings.dropout).filter(|dropout| !dropout.is_none());
    let limits = Limits { grid, alpha_cut: settings.accuracy.alpha_cut };
    let pitch = splats.pitch();
    let rows = splats.parameters.par_chunks(CHUNK * pitch);
    let chunks = projected.par_chunks_mut(CHUNK).zip(depths.par_chunks_mut(CHUNK)).zip(rows).enumerate();
    let culled = chunks.map(|(number, ((projected, depths), rows))| {
        let mut culled = Culled::default();
        let blocks = projected.chunks_mut(LANES).zip(depths.chunks_mut(LANES)).zip(rows.chunks(LANES * pitch));
        for (block, ((projected, depths), rows)) in blocks.enumerate() {
            let lanes = dispatch!(level, simd => lanes_project::project(simd, eye, limits, rows, pitch));
            let rows = rows.chunks_exact(pitch).zip(number * CHUNK + block * LANES..);
            for (lane, ((splat, depth), (row, index))) in projected.iter_mut().zip(depths).zip(rows).enumerate() {
                let found = match dropout.is_some_and(|dropout| dropout.leaves_out(index as u32)) {
                    true => Err(CullCause::Transparent),
                    false => lanes.of(lane).unwrap_or_else(|| project(eye, row, limits)),
                };
                match found {
                    Ok(found) => (*splat, *depth) = found,
                    Err(cause) => {
                        culled.count(cause);
                        *depth = PixelDepth::default();
                    }
                }
            }
        }
        culled
    });
    tiles.culled = culled.reduce(Culled::default, Culled::plus);
}

#[cfg(test)]
mod tests {
    use gs_core::{Gaussian3d, Parameterization, Scene as _, Scene3d, effects::Antialias, logit};

    use super::*;
    use crate::{kind::Splats as _, layout::Grid, level::SimdLevel, scene3d::splats::LOG_SCALE};

    /// A number from −1 to 1.
    fn unit(seed: u32) -> f32 {
        let bits = seed.wrapping_mul(0x9E37_79B9) ^ 0x85EB_CA6B;
        let bits = (bits ^ (bits >> 15)).wrapping_mul(0x2C1B_3C6D);
        (bits ^ (bits >> 13)) as f32 / u32::MAX as f32 * 2.0 - 1.0
    }

    /// Gaussians of all fates; every 31st has an extreme number, and every 62nd NaN.
    fn splats() -> Splats3d {
        let mut scene = Scene3d { sh_degree: 3, ..Scene3d::default() };
        for i in 0..1_001 {
            let numbers: [f32; 80] = std::array::from_fn(|k| unit(i * 80 + k as u32));
            let [x, y, z, a, b, c] = [0, 1, 2, 3, 4, 5].map(|k| numbers[k]);
            let mut gaussian = Gaussian3d {
                mean: Vec3::new(2.0 * x, 2.0 * y, 2.5 + 3.0 * z),
                log_scale: Vec3::new(a, b, c) * 1.5 - 2.5,
                rotation: [numbers[6], numbers[7], numbers[8], numbers[9]],
                opacity_logit: 8.0 * numbers[10],
                sh: (0..16).map(|k| Vec3::from_slice(&numbers[11 + 3 * k..])).collect(),
            };
            match i % 124 {
                0 => gaussian.log_scale.x = 90.0,
                31 => gaussian.opacity_logit = logit(1.0),
                62 => gaussian.rotation = [0.0; 4],
                93 => gaussian.sh[7].y = f32::MAX,
                _ => {}
            }
            scene.push(gaussian);
        }
        let mut splats = Splats3d::new(&scene, Parameterization::ScaleRotation).unwrap();
        let pitch = splats.pitch();
        for (i, row) in splats.parameters.chunks_exact_mut(pitch).enumerate() {
            if i % 124 == 11 || i % 124 == 43 {
                row[LOG_SCALE.start + i % 124 / 43] = f32::NAN;
            }
        }
        splats
    }

    #[test]
    fn lanes_project_as_gs_core_does() {
        let splats = splats();
        let camera = Camera::looking_forward(200, 120, 1.0);
        for (blend, antialias) in
            [(Blend::Over, Antialias::Compensated), (Blend::Over, Antialias::Dilate), (Blend::Sum, Antialias::None)]
        {
            let mut settings = RenderSettings::blended(blend);
            settings.effects.antialias = antialias;
            for (degree, level) in
                [0, 1, 2, 3].into_iter().flat_map(|d| SimdLevel::available().into_iter().map(move |l| (d, l)))
            {
                let eye = Eye::new(&camera, &settings, degree);
                let grid = &Grid::new((200, 120), 16);
                let limits = Limits { grid, alpha_cut: settings.accuracy.alpha_cut };
                check(&splats, &eye, limits, level);
            }
        }
    }

    fn check(splats: &Splats3d, eye: &Eye, limits: Limits<'_>, level: SimdLevel) {
        let pitch = splats.pitch();
        let token = level.instructions().unwrap();
        let (mut drawn, mut extreme) = (0, 0);
        for (block, rows) in splats.parameters.chunks(LANES * pitch).enumerate() {
            let lanes = dispatch!(token, simd => lanes_project::project(simd, eye, limits, rows, pitch));
            for (lane, row) in rows.chunks_exact(pitch).enumerate() {
                let at = format!("{level}, degree {}, Gaussian {}", eye.degree, block * LANES + lane);
                let Some(found) = lanes.of(lane) else {
                    extreme += 1;
                    continue;
                };
                match (found, project(eye, row, limits)) {
                    (Ok(found), Ok(expected)) => {
                        drawn += 1;
                        for (found, expected) in numbers(&found).into_iter().zip(numbers(&expected)) {
                            let error = (found - expected).abs() / (1.0 + expected.abs());
                            assert!(error < 1e-4, "{at}: {found} instead of {expected}");
                        }
                        assert!(found.0.restart_rows.abs_diff(expected.0.restart_rows) <= 1, "{at}");
                    }
                    (found, expected) => assert_eq!(found.err(), expected.err(), "{at}"),
                }
            }
        }
        assert!(drawn > 80, "{drawn}");
        assert!((24..64).contains(&extreme), "{extreme}");
    }

    fn numbers((splat, depth): &(Splat, PixelDepth)) -> Vec<f32> {
        let Splat { mean, inverse_xx, slope, c, ratio, fall, color, opacity, cut, reach, half_x, lowest_dx, .. } =
            *splat;
        let single = [inverse_xx, slope, c, ratio, fall, opacity, cut, reach, half_x, lowest_dx, depth.depth];
        [&mean[..], &color, &single, &depth.slope].concat()
    }
}
