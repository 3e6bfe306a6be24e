//! 3D Gaussians on the device: parameters, SH coefficients and Adam moments, with edits, saving and
//! restoring.

use glam::Vec3;
use gs_core::{Error, Gaussian3d, Parameterization, Scene, Scene3d, SplatsState, math::sh::coefficients};

use crate::{
    dispatch::{Commands, dispatch},
    gpu::{Gpu, STORAGE},
    layout::{Ellipsoid, EllipsoidMoments},
    shaders::Variant,
    splats::{Edit, check_len},
    tiles::groups_of,
    unsupported::unsupported,
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
    /// First and second moments, `[N, K, 3]` each.
    pub(crate) sh: [wgpu::Buffer; 2],
}

impl Moments {
    fn allocate(gpu: &Gpu, n: u64, coefficients: u64) -> Result<Self, Error> {
        let sh = || gpu.allocate("Adam moments of SH coefficients", n * coefficients * COLOR_BYTES, STORAGE);
        let geometry = gpu.allocate("Adam moments", n * size_of::<EllipsoidMoments>() as u64, STORAGE)?;
        Ok(Self { geometry, sh: [sh()?, sh()?] })
    }

    /// Moments of zeros.
    fn zeros(gpu: &Gpu, n: u64, coefficients: u64) -> Result<Self, Error> {
        let moments = Self::allocate(gpu, n, coefficients)?;
        let mut commands = Commands::new(gpu);
        for buffer in [&moments.geometry].into_iter().chain(&moments.sh) {
            commands.encoder().clear_buffer(buffer, 0, None);
        }
        commands.submit(gpu);
        Ok(moments)
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

/// Fails for parameterizations that this backend does not offer for 3D scenes.
fn check_parameterization(parameterization: Parameterization) -> Result<(), Error> {
    match parameterization {
        Parameterization::ScaleRotation => Ok(()),
        Parameterization::CovarianceFactor => {
            Err(unsupported(format!("parameterization {parameterization:?} for 3D scenes")))
        }
    }
}

/// The parameters on the host.
struct Parts {
    sh_degree: u8,
    ellipsoids: Vec<Ellipsoid>,
    sh: Vec<[f32; 3]>,
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
    pub(crate) fn new(gpu: &Gpu, scene: &Scene3d, parameterization: Parameterization) -> Result<Self, Error> {
        check_parameterization(parameterization)?;
        scene.validate()?;
        let ellipsoid = |i: usize| Ellipsoid {
            mean: scene.means[i].to_array(),
            opacity_logit: scene.opacity_logits[i],
            log_scale: scene.log_scales[i].to_array(),
            steps: 0,
            rotation: scene.rotations[i],
        };
        let parts = Parts {
            sh_degree: scene.sh_degree,
            ellipsoids: (0..scene.len()).map(ellipsoid).collect(),
            sh: scene.sh.iter().map(Vec3::to_array).collect(),
        };
        Self::from_parts(gpu, &parts, None)
    }

    fn from_parts(gpu: &Gpu, parts: &Parts, moments: Option<Moments>) -> Result<Self, Error> {
        Ok(Self {
            sh_degree: parts.sh_degree,
            ellipsoids: gpu.storage("Gaussians", &parts.ellipsoids)?,
            sh: gpu.storage("SH coefficients", &parts.sh)?,
            moments,
        })
    }

    /// Allocates the moments of `len` Gaussians, if there are none yet.
    pub(crate) fn make_moments(&mut self, gpu: &Gpu, len: usize) -> Result<(), Error> {
        if self.moments.is_none() {
            self.moments = Some(Moments::zeros(gpu, len as u64, self.coefficients() as u64)?);
        }
        Ok(())
    }

    /// The moments, after [`Self::make_moments`].
    pub(crate) fn moments(&self) -> &Moments {
        self.moments.as_ref().expect("moments are made before Gaussians are moved or edited")
    }

    /// K, the number of SH coefficients per Gaussian.
    pub(crate) fn coefficients(&self) -> usize {
        coefficients(self.sh_degree)
    }

    pub(crate) async fn scene(&self, gpu: &Gpu, len: usize) -> Result<Scene3d, Error> {
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

    pub(crate) fn edit(&self, gpu: &Gpu, commands: &mut Commands, edit: &Edit<'_, Gaussian3d>) -> Result<Self, Error> {
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
        let (moments, edited) = (self.moments(), Moments::allocate(gpu, n, k as u64)?);
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
        dispatch(gpu, commands, "edit_color", Variant::default(), &bindings, groups_of(gpu, numbers, 64));
        Ok(Self { sh_degree: self.sh_degree, ellipsoids, sh, moments: Some(edited) })
    }

    pub(crate) async fn save(&self, gpu: &Gpu, len: usize) -> Result<SplatsState, Error> {
        let columns = 3 * self.coefficients();
        let ellipsoids: Vec<Ellipsoid> = gpu.read(&self.ellipsoids, len).await?;
        let sh: Vec<f32> = gpu.read(&self.sh, len * columns).await?;
        let (moments, sh_moments) = match &self.moments {
            None => (vec![EllipsoidMoments::default(); len], [0, 1].map(|_| vec![0.0; len * columns])),
            Some(Moments { geometry, sh: [first, second] }) => {
                let sh = [gpu.read::<f32>(first, len * columns).await?, gpu.read(second, len * columns).await?];
                (gpu.read(geometry, len).await?, sh)
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
            for (m, colors) in moments.iter().zip(sh_moments[which].chunks_exact(columns)) {
                rows.extend(geometry(if which == 0 { &m.first } else { &m.second }));
                rows.extend(colors);
            }
            state.insert_matrix(name, GEOMETRY + columns, rows);
        }
        state.insert_u32("steps", ellipsoids.iter().map(|g| g.steps).collect());
        Ok(state)
    }

    pub(crate) fn restore(gpu: &Gpu, state: &SplatsState, n: usize) -> Result<Self, Error> {
        check_parameterization(state.parameterization)?;
        let (columns, sh) = state.matrix("sh")?;
        let Some(sh_degree) = (0..=3).find(|&degree| 3 * coefficients(degree) == columns) else {
            return Err(Error::State(format!("tensor `sh` has {columns} columns, not 3, 12, 27 or 48")));
        };
        check_len("sh", n, sh.len() / columns)?;
        let (means, log_scales) = (state.rows::<3>("mean")?, state.rows::<3>("log_scale")?);
        let (rotations, logits) = (state.rows::<4>("rotation")?, state.rows::<1>("opacity_logit")?);
        let steps = state.integers("steps")?;
        for (what, found) in [
            ("mean", means.len()),
            ("log_scale", log_scales.len()),
            ("rotation", rotations.len()),
            ("opacity_logit", logits.len()),
        ] {
            check_len(what, n, found)?;
        }
        let moments_of = |name: &'static str| {
            let (found, numbers) = state.matrix(name)?;
            if found != GEOMETRY + columns {
                return Err(Error::State(format!("tensor `{name}` has {found} columns, not {}", GEOMETRY + columns)));
            }
            check_len(name, n, numbers.len() / found)?;
            Ok(numbers)
        };
        let rows = [moments_of("moment1")?, moments_of("moment2")?].map(|m| m.chunks_exact(GEOMETRY + columns));
        let [first, second] = rows;
        let mut parts = Parts { sh_degree, ellipsoids: Vec::with_capacity(n), sh: sh.as_chunks().0.to_vec() };
        let mut geometry = Vec::with_capacity(n);
        let mut sh_moments = [0, 1].map(|_| Vec::with_capacity(n * columns));
        for (i, (first, second)) in first.zip(second).enumerate() {
            parts.ellipsoids.push(Ellipsoid {
                mean: means[i],
                opacity_logit: logits[i][0],
                log_scale: log_scales[i],
                steps: steps[i],
                rotation: rotations[i],
            });
            geometry.push(EllipsoidMoments { first: on_device(first), second: on_device(second) });
            sh_moments[0].extend(&first[GEOMETRY..]);
            sh_moments[1].extend(&second[GEOMETRY..]);
        }
        let of_sh = |moments: &Vec<f32>| gpu.storage("Adam moments of SH coefficients", moments);
        let moments = Moments {
            geometry: gpu.storage("Adam moments", &geometry)?,
            sh: [of_sh(&sh_moments[0])?, of_sh(&sh_moments[1])?],
        };
        Self::from_parts(gpu, &parts, Some(moments))
    }
}
