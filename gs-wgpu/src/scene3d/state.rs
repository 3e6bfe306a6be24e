//! 3D Gaussians on the device: parameters, SH coefficients and Adam moments, with edits, saving and
//! restoring.

use glam::Vec3;
use gs_core::{
    Error, Gaussian3d, MomentFormat, Parameterization, Scene, Scene3d, SplatsState, check_len,
    math::{packed_moments, sh::coefficients},
};

use crate::{
    dispatch::{Commands, dispatch},
    gpu::{Gpu, STORAGE},
    kind::State,
    layout::{Ellipsoid, EllipsoidMoments},
    shaders::Variant,
    splats::Edit,
    tiles::groups_of,
};

/// Bytes of an SH coefficient's three channels.
pub(crate) const COLOR_BYTES: u64 = 12;

/// Numbers of a Gaussian without its colour in saved moments.
const GEOMETRY: usize = 11;

/// Parameters and Adam moments.
#[derive(Debug)]
pub struct State3d {
    pub(crate) sh_degree: u8,
    pub(crate) ellipsoids: wgpu::Buffer,
    /// `[N, K, 3]`.
    pub(crate) sh: wgpu::Buffer,
    /// `None` before the first training step: drawing needs no moments.
    moments: Option<Moments>,
}

/// Adam moments.
#[derive(Debug)]
pub(crate) struct Moments {
    pub(crate) geometry: wgpu::Buffer,
    /// Of SH coefficients. In `F32`: first and second moments, `[N, K, 3]` each. In `Bf16`: both
    /// moments of degree 0, `[N, 2, 3]`, and [packed](packed_moments) ones of the others,
    /// `[N, K − 1, 3]`.
    pub(crate) sh: [wgpu::Buffer; 2],
    format: MomentFormat,
}

const GEOMETRY_MOMENTS: &str = "Adam moments";
const SH_MOMENTS: &str = "Adam moments of SH coefficients";

impl Moments {
    fn allocate(gpu: &Gpu, n: u64, coefficients: u64, format: MomentFormat) -> Result<Self, Error> {
        let [first, second] = match format {
            MomentFormat::F32 => [coefficients; 2],
            MomentFormat::Bf16 => [2, coefficients - 1],
        };
        let sh = |colors: u64| gpu.allocate(SH_MOMENTS, n * colors * COLOR_BYTES, STORAGE);
        let geometry = gpu.allocate(GEOMETRY_MOMENTS, n * size_of::<EllipsoidMoments>() as u64, STORAGE)?;
        Ok(Self { geometry, sh: [sh(first)?, sh(second)?], format })
    }

    /// Moments of zeros.
    fn zeros(gpu: &Gpu, n: u64, coefficients: u64, format: MomentFormat) -> Result<Self, Error> {
        let moments = Self::allocate(gpu, n, coefficients, format)?;
        let mut commands = Commands::new(gpu);
        for buffer in [&moments.geometry].into_iter().chain(&moments.sh) {
            commands.encoder().clear_buffer(buffer, 0, None);
        }
        commands.submit(gpu);
        Ok(moments)
    }

    /// Moments in `format` of `k` SH coefficients per Gaussian. Those that were not in 16 bits are
    /// rounded towards zero.
    fn upload(
        gpu: &Gpu,
        geometry: wgpu::Buffer,
        [first, second]: [&[[f32; 3]]; 2],
        k: usize,
        format: MomentFormat,
    ) -> Result<Self, Error> {
        let sh = match format {
            MomentFormat::F32 => [gpu.storage(SH_MOMENTS, first)?, gpu.storage(SH_MOMENTS, second)?],
            MomentFormat::Bf16 => {
                let (mut base, mut rest) = (Vec::new(), Vec::new());
                for (first, second) in first.chunks_exact(k).zip(second.chunks_exact(k)) {
                    base.push([first[0], second[0]]);
                    let pairs = first[1..].as_flattened().iter().zip(second[1..].as_flattened());
                    rest.extend(pairs.map(|(&first, &second)| packed_moments::packed(first, second)));
                }
                [gpu.storage(SH_MOMENTS, &base)?, gpu.storage(SH_MOMENTS, &rest)?]
            }
        };
        Ok(Self { geometry, sh, format })
    }

    /// First and second moments of `k` SH coefficients of each of `n` Gaussians, `[N, K, 3]` each.
    async fn of_sh(&self, gpu: &Gpu, n: usize, k: usize) -> Result<[Vec<[f32; 3]>; 2], Error> {
        let [one, other] = &self.sh;
        if self.format == MomentFormat::F32 {
            return Ok([gpu.read(one, n * k).await?, gpu.read(other, n * k).await?]);
        }
        let base: Vec<[[f32; 3]; 2]> = gpu.read(one, n).await?;
        let rest: Vec<[u32; 3]> = gpu.read(other, n * (k - 1)).await?;
        Ok([0, 1].map(|which| {
            let mut moments = Vec::with_capacity(n * k);
            for (i, base) in base.iter().enumerate() {
                moments.push(base[which]);
                let rest = &rest[i * (k - 1)..(i + 1) * (k - 1)];
                moments.extend(rest.iter().map(|color| color.map(|both| packed_moments::unpacked(both)[which])));
            }
            moments
        }))
    }

    /// The variant of the shaders that read them.
    pub(crate) fn variant(&self) -> Variant {
        Variant { packed: self.format == MomentFormat::Bf16, ..Variant::default() }
    }
}

/// A Gaussian's layout on the device, without its colour.
fn packed(g: &Gaussian3d) -> Ellipsoid {
    Ellipsoid {
        mean: g.mean.to_array(),
        opacity_logit: g.opacity_logit,
        log_scale: g.log_scale.to_array(),
        steps: 0,
        rotation: g.rotation,
    }
}

/// Moments without those of the colour in the order of saved states: mean 3, log-scale 3, rotation
/// 4, opacity 1.
fn geometry(m: &[f32; 12]) -> [f32; GEOMETRY] {
    [m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10], m[11], m[3]]
}

/// The inverse of [`geometry`].
fn on_device(m: &[f32]) -> [f32; 12] {
    [m[0], m[1], m[2], m[10], m[3], m[4], m[5], 0.0, m[6], m[7], m[8], m[9]]
}

impl State3d {
    fn of_scene(gpu: &Gpu, scene: &Scene3d, steps: &[u32], moments: Option<Moments>) -> Result<Self, Error> {
        let ellipsoid = |(i, &steps): (usize, &u32)| Ellipsoid {
            mean: scene.means[i].to_array(),
            opacity_logit: scene.opacity_logits[i],
            log_scale: scene.log_scales[i].to_array(),
            steps,
            rotation: scene.rotations[i],
        };
        let ellipsoids: Vec<Ellipsoid> = steps.iter().enumerate().map(ellipsoid).collect();
        let sh: Vec<[f32; 3]> = scene.sh.iter().map(Vec3::to_array).collect();
        let (ellipsoids, sh) = (gpu.storage("Gaussians", &ellipsoids)?, gpu.storage("SH coefficients", &sh)?);
        Ok(Self { sh_degree: scene.sh_degree, ellipsoids, sh, moments })
    }

    /// The format of the moments, if there are any.
    pub(crate) fn moment_format(&self) -> Option<MomentFormat> {
        Some(self.moments.as_ref()?.format)
    }

    /// Allocates the moments of `len` Gaussians, if there are none yet, or changes their format.
    ///
    /// A change goes through the host: it happens once, after a restored state.
    pub(crate) async fn make_moments(&mut self, gpu: &Gpu, len: usize, format: MomentFormat) -> Result<(), Error> {
        let k = self.coefficients();
        self.moments = Some(match &self.moments {
            None => Moments::zeros(gpu, len as u64, k as u64, format)?,
            Some(moments) if moments.format == format => return Ok(()),
            Some(moments) => {
                let [first, second] = moments.of_sh(gpu, len, k).await?;
                Moments::upload(gpu, moments.geometry.clone(), [&first, &second], k, format)?
            }
        });
        Ok(())
    }

    /// The moments, after [`Self::make_moments`].
    pub(crate) fn moments(&self) -> &Moments {
        self.moments.as_ref().expect("moments are made before Gaussians are moved or edited")
    }
}

impl State<Scene3d> for State3d {
    fn new(gpu: &Gpu, scene: &Scene3d, parameterization: Parameterization) -> Result<Self, Error> {
        parameterization.check_3d()?;
        scene.validate()?;
        Self::of_scene(gpu, scene, &vec![0; scene.len()], None)
    }

    async fn scene(&self, gpu: &Gpu, len: usize) -> Result<Scene3d, Error> {
        let mut scene = Scene3d { sh_degree: self.sh_degree, ..Scene3d::default() };
        for g in gpu.read::<Ellipsoid>(&self.ellipsoids, len).await? {
            scene.means.push(Vec3::from_array(g.mean));
            scene.log_scales.push(Vec3::from_array(g.log_scale));
            scene.rotations.push(g.rotation);
            scene.opacity_logits.push(g.opacity_logit);
        }
        let sh: Vec<[f32; 3]> = gpu.read(&self.sh, len * self.coefficients()).await?;
        scene.sh = sh.into_iter().map(Vec3::from_array).collect();
        Ok(scene)
    }

    async fn save(&self, gpu: &Gpu, len: usize) -> Result<SplatsState, Error> {
        let columns = 3 * self.coefficients();
        let ellipsoids: Vec<Ellipsoid> = gpu.read(&self.ellipsoids, len).await?;
        let sh: Vec<f32> = gpu.read(&self.sh, len * columns).await?;
        let (moments, sh_moments) = match &self.moments {
            None => (vec![EllipsoidMoments::default(); len], [0, 1].map(|_| vec![[0.0; 3]; len * columns / 3])),
            Some(moments) => {
                let sh = moments.of_sh(gpu, len, columns / 3).await?;
                (gpu.read(&moments.geometry, len).await?, sh)
            }
        };
        let mut state = SplatsState::new(Parameterization::ScaleRotation);
        state.insert("mean", ellipsoids.iter().map(|g| g.mean));
        state.insert("log_scale", ellipsoids.iter().map(|g| g.log_scale));
        state.insert("rotation", ellipsoids.iter().map(|g| g.rotation));
        state.insert("opacity_logit", ellipsoids.iter().map(|g| [g.opacity_logit]));
        state.insert_matrix("sh", columns, sh);
        for (which, name) in ["moment1", "moment2"].into_iter().enumerate() {
            let mut rows = Vec::with_capacity(len * (GEOMETRY + columns));
            for (m, colors) in moments.iter().zip(sh_moments[which].as_flattened().chunks_exact(columns)) {
                rows.extend(geometry(if which == 0 { &m.first } else { &m.second }));
                rows.extend(colors);
            }
            state.insert_matrix(name, GEOMETRY + columns, rows);
        }
        state.insert_u32("steps", ellipsoids.iter().map(|g| g.steps).collect());
        Ok(state)
    }

    fn restore(gpu: &Gpu, state: &SplatsState, n: usize) -> Result<Self, Error> {
        state.parameterization.check_3d()?;
        let scene = state.scene_3d()?;
        check_len("mean", n, scene.len())?;
        let k = scene.sh_len();
        let shape = [n, GEOMETRY + 3 * k];
        let (first, second) = (state.matrix_of("moment1", shape)?, state.matrix_of("moment2", shape)?);
        let mut geometry = Vec::with_capacity(n);
        let mut sh_moments = [0, 1].map(|_| Vec::with_capacity(n * k));
        for (first, second) in first.chunks_exact(shape[1]).zip(second.chunks_exact(shape[1])) {
            geometry.push(EllipsoidMoments { first: on_device(first), second: on_device(second) });
            sh_moments[0].extend(first[GEOMETRY..].as_chunks().0);
            sh_moments[1].extend(second[GEOMETRY..].as_chunks().0);
        }
        let geometry = gpu.storage(GEOMETRY_MOMENTS, &geometry)?;
        let [first, second] = &sh_moments;
        let moments = Moments::upload(gpu, geometry, [first, second], k, MomentFormat::F32)?;
        Self::of_scene(gpu, &scene, &state.integers("steps")?, Some(moments))
    }

    fn edit(&self, gpu: &Gpu, commands: &mut Commands, edit: &Edit<'_, Gaussian3d>) -> Result<Self, Error> {
        let k = self.coefficients();
        let fresh: Vec<Ellipsoid> = edit.fresh.iter().map(|g| packed(g)).collect();
        // As in `Scene::push`, the SH are cut or padded with 0 to the splats' degree.
        let color = |g: &&Gaussian3d| {
            let mut sh: Vec<[f32; 3]> = g.sh.iter().map(Vec3::to_array).collect();
            sh.resize(k, [0.0; 3]);
            sh
        };
        let fresh_sh: Vec<[f32; 3]> = edit.fresh.iter().flat_map(color).collect();
        let (fresh, fresh_sh) = (gpu.storage("new Gaussians", &fresh)?, gpu.storage("new colours", &fresh_sh)?);
        let (n, numbers) = (edit.len as u64, (edit.len * k) as u64);
        let ellipsoids = gpu.allocate("Gaussians", n * size_of::<Ellipsoid>() as u64, STORAGE)?;
        let sh = gpu.allocate("SH coefficients", numbers * COLOR_BYTES, STORAGE)?;
        let moments = self.moments();
        let edited = Moments::allocate(gpu, n, k as u64, moments.format)?;
        let [statistics, edited_statistics] = edit.statistics;
        let bindings = [
            &edit.step,
            &edit.sources,
            &fresh,
            &self.ellipsoids,
            &moments.geometry,
            statistics,
            &ellipsoids,
            &edited.geometry,
            edited_statistics,
        ];
        let scene_3d = Variant { scene_3d: true, ..Variant::default() };
        dispatch(gpu, commands, "edit", scene_3d, &bindings, groups_of(gpu, n, 64));
        let [first, second] = &moments.sh;
        let [edited_first, edited_second] = &edited.sh;
        let bindings =
            [&edit.step, &edit.sources, &fresh_sh, &self.sh, first, second, &sh, edited_first, edited_second];
        dispatch(gpu, commands, "edit_color", moments.variant(), &bindings, groups_of(gpu, numbers, 64));
        Ok(Self { sh_degree: self.sh_degree, ellipsoids, sh, moments: Some(edited) })
    }

    /// K, the number of SH coefficients per Gaussian.
    fn coefficients(&self) -> usize {
        coefficients(self.sh_degree)
    }
}

#[cfg(test)]
mod tests {
    use pollster::FutureExt as _;

    use super::*;
    use crate::{WgpuRasterizer, WgpuSettings};

    #[test]
    fn wgpu_moments_in_16_bits_take_180_bytes_less() {
        let wgpu =
            WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
        let mut scene = Scene3d { sh_degree: 3, ..Scene3d::default() };
        let gaussian = Gaussian3d {
            mean: Vec3::ZERO,
            log_scale: Vec3::ZERO,
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 0.0,
            sh: Vec::new(),
        };
        (0..1000).for_each(|_| scene.push(gaussian.clone().with_degree(3)));
        let mut state = State3d::new(&wgpu.gpu, &scene, Parameterization::ScaleRotation).unwrap();
        let mut bytes = |format| {
            state.make_moments(&wgpu.gpu, scene.len(), format).block_on().unwrap();
            let Moments { geometry, sh: [one, other], .. } = state.moments();
            [geometry, one, other].map(wgpu::Buffer::size).iter().sum::<u64>()
        };
        let [first, packed, back] = [MomentFormat::F32, MomentFormat::Bf16, MomentFormat::F32].map(&mut bytes);
        assert_eq!((first - packed, back), (180 * 1000, first));
    }
}
