//! 2D Gaussians on the device: parameters and Adam moments, with edits, saving and restoring.

use glam::{Mat2, Vec2, Vec3};
use gs_core::{Error, Gaussian2d, Parameterization, Scene, Scene2d, SplatsState, check_len};

use crate::{
    dispatch::{Commands, dispatch},
    gpu::{Gpu, STORAGE},
    kind::State,
    layout::{Gaussian, Moments},
    shaders::Variant,
    splats::Edit,
    tiles::groups_of,
};

/// Parameters and Adam moments.
#[derive(Debug)]
pub struct State2d {
    pub(crate) parameterization: Parameterization,
    /// Whether opacities are stored; without them every Gaussian is opaque.
    pub(crate) has_opacity: bool,
    pub(crate) gaussians: wgpu::Buffer,
    pub(crate) moments: wgpu::Buffer,
}

/// A Gaussian's parameters in its parameterization.
fn packed(g: &Gaussian2d, parameterization: Parameterization) -> Gaussian {
    let shape = match parameterization {
        Parameterization::ScaleRotation => [g.log_scale.x, g.log_scale.y, g.rotation, 0.0],
        Parameterization::CovarianceFactor => g.factor().to_cols_array(),
    };
    Gaussian {
        mean: g.mean.to_array(),
        opacity_logit: g.opacity_logit,
        steps: 0,
        shape,
        color: g.color.to_array(),
        unused: 0.0,
    }
}

impl State2d {
    fn from_parts(
        gpu: &Gpu,
        parameterization: Parameterization,
        has_opacity: bool,
        gaussians: &[Gaussian],
        moments: &[Moments],
    ) -> Result<Self, Error> {
        let (gaussians, moments) = (gpu.storage("Gaussians", gaussians)?, gpu.storage("Adam moments", moments)?);
        Ok(Self { parameterization, has_opacity, gaussians, moments })
    }

    /// L with Σ = L Lᵀ of a Gaussian.
    pub(crate) fn factor(&self, g: &Gaussian) -> Mat2 {
        match self.parameterization {
            Parameterization::CovarianceFactor => Mat2::from_cols_array(&g.shape),
            Parameterization::ScaleRotation => {
                let [x, y, angle, _] = g.shape;
                let (sin, cos) = angle.sin_cos();
                Mat2::from_cols(Vec2::new(cos, sin) * x.exp(), Vec2::new(-sin, cos) * y.exp())
            }
        }
    }

    pub(crate) async fn download_gaussians(&self, gpu: &Gpu, len: usize) -> Result<Vec<Gaussian>, Error> {
        gpu.read(&self.gaussians, len).await
    }
}

impl State<Scene2d> for State2d {
    fn new(gpu: &Gpu, scene: &Scene2d, parameterization: Parameterization) -> Result<Self, Error> {
        scene.validate()?;
        let gaussians: Vec<Gaussian> = scene.iter().map(|g| packed(&g, parameterization)).collect();
        let moments = vec![Moments::default(); gaussians.len()];
        Self::from_parts(gpu, parameterization, scene.has_opacity(), &gaussians, &moments)
    }

    async fn scene(&self, gpu: &Gpu, len: usize) -> Result<Scene2d, Error> {
        let mut scene = Scene2d::default();
        for g in self.download_gaussians(gpu, len).await? {
            let (log_scale, rotation) = match self.parameterization {
                Parameterization::ScaleRotation => (Vec2::new(g.shape[0], g.shape[1]), g.shape[2]),
                Parameterization::CovarianceFactor => Gaussian2d::shape_of_factor(Mat2::from_cols_array(&g.shape)),
            };
            scene.means.push(Vec2::from_array(g.mean));
            scene.log_scales.push(log_scale);
            scene.rotations.push(rotation);
            scene.colors.push(Vec3::from_array(g.color));
            if self.has_opacity {
                scene.opacity_logits.push(g.opacity_logit);
            }
        }
        Ok(scene)
    }

    async fn save(&self, gpu: &Gpu, len: usize) -> Result<SplatsState, Error> {
        let gaussians = self.download_gaussians(gpu, len).await?;
        let moments: Vec<Moments> = gpu.read(&self.moments, len).await?;
        let mut state = SplatsState::new(self.parameterization);
        state.insert("mean", gaussians.iter().map(|g| g.mean));
        match self.parameterization {
            Parameterization::ScaleRotation => {
                state.insert("log_scale", gaussians.iter().map(|g| [g.shape[0], g.shape[1]]));
                state.insert("rotation", gaussians.iter().map(|g| [g.shape[2]]));
            }
            Parameterization::CovarianceFactor => state.insert("factor", gaussians.iter().map(|g| g.shape)),
        }
        state.insert("color", gaussians.iter().map(|g| g.color));
        if self.has_opacity {
            state.insert("opacity_logit", gaussians.iter().map(|g| [g.opacity_logit]));
        }
        let nine = |eight: [f32; 8], opacity: f32| {
            let mut nine = [opacity; 9];
            nine[..8].copy_from_slice(&eight);
            nine
        };
        state.insert("moment1", moments.iter().map(|m| nine(m.first, m.opacity[0])));
        state.insert("moment2", moments.iter().map(|m| nine(m.second, m.opacity[1])));
        state.insert_u32("steps", gaussians.iter().map(|g| g.steps).collect());
        Ok(state)
    }

    fn restore(gpu: &Gpu, state: &SplatsState, n: usize) -> Result<Self, Error> {
        let means = state.rows::<2>("mean")?;
        let shapes: Vec<[f32; 4]> = match state.parameterization {
            Parameterization::ScaleRotation => {
                let (scales, rotations) = (state.rows::<2>("log_scale")?, state.rows::<1>("rotation")?);
                check_len("rotation", n, rotations.len())?;
                scales.iter().zip(rotations).map(|(&[x, y], [angle])| [x, y, angle, 0.0]).collect()
            }
            Parameterization::CovarianceFactor => state.rows::<4>("factor")?,
        };
        let colors = state.rows::<3>("color")?;
        let has_opacity = state.contains("opacity_logit");
        let logits = if has_opacity { state.rows::<1>("opacity_logit")? } else { vec![[f32::INFINITY]; n] };
        let (first, second) = (state.rows::<9>("moment1")?, state.rows::<9>("moment2")?);
        let steps = state.integers("steps")?;
        for (what, found) in [
            ("mean", means.len()),
            ("shape", shapes.len()),
            ("color", colors.len()),
            ("opacity_logit", logits.len()),
            ("moment1", first.len()),
            ("moment2", second.len()),
            ("steps", steps.len()),
        ] {
            check_len(what, n, found)?;
        }
        let gaussian = |i: usize| Gaussian {
            mean: means[i],
            opacity_logit: logits[i][0],
            steps: steps[i],
            shape: shapes[i],
            color: colors[i],
            unused: 0.0,
        };
        let eight = |nine: &[f32; 9]| std::array::from_fn(|k| nine[k]);
        let moments = |i: usize| Moments {
            first: eight(&first[i]),
            second: eight(&second[i]),
            opacity: [first[i][8], second[i][8], 0.0, 0.0],
        };
        let gaussians: Vec<Gaussian> = (0..n).map(gaussian).collect();
        let moments: Vec<Moments> = (0..n).map(moments).collect();
        Self::from_parts(gpu, state.parameterization, has_opacity, &gaussians, &moments)
    }

    fn edit(&self, gpu: &Gpu, commands: &mut Commands, edit: &Edit<'_, Gaussian2d>) -> Result<Self, Error> {
        let fresh: Vec<Gaussian> = edit.fresh.iter().map(|g| packed(g, self.parameterization)).collect();
        let fresh = gpu.storage("new Gaussians", &fresh)?;
        let edited = Self {
            parameterization: self.parameterization,
            has_opacity: self.has_opacity_with(&edit.fresh),
            gaussians: gpu.allocate("Gaussians", (edit.len * size_of::<Gaussian>()) as u64, STORAGE)?,
            moments: gpu.allocate("Adam moments", (edit.len * size_of::<Moments>()) as u64, STORAGE)?,
        };
        let [statistics, edited_statistics] = edit.statistics;
        let bindings = [
            &edit.step,
            &edit.sources,
            &fresh,
            &self.gaussians,
            &self.moments,
            statistics,
            &edited.gaussians,
            &edited.moments,
            edited_statistics,
        ];
        let variant = Variant {
            covariance_factor: self.parameterization == Parameterization::CovarianceFactor,
            ..Variant::default()
        };
        dispatch(gpu, commands, "edit", variant, &bindings, groups_of(gpu, edit.len as u64, 64));
        Ok(edited)
    }

    /// Whether opacities are stored after `fresh` Gaussians were added.
    fn has_opacity_with(&self, fresh: &[&Gaussian2d]) -> bool {
        self.has_opacity || fresh.iter().any(|g| g.opacity_logit != f32::INFINITY)
    }

    fn has_factors(&self) -> bool {
        self.parameterization == Parameterization::CovarianceFactor
    }
}
