//! 2D splats: parameters, Adam moments and statistics, with edits, saving and restoring.

use glam::{Mat2, Vec2, Vec3};
use gs_core::{
    DensityStatistics, EditPlan, Error, Gaussian2d, MeanNoise, Parameterization, SavedState, Scene, Scene2d,
    SplatsState, check_len,
    edit::{Moments, Source},
    logit,
    math::whitened::aligned,
    sigmoid,
};
use rayon::prelude::*;

use crate::kind::{Shared, Splats};

/// The shapes of all Gaussians in their parameterization.
#[derive(Debug, Clone)]
pub(crate) enum Shapes {
    /// ln-scale 2 (ln px), rotation (rad).
    ScaleRotation(Vec<[f32; 3]>),
    /// L with Σ = L Lᵀ, px.
    CovarianceFactor(Vec<Mat2>),
}

/// Parameters that Adam moves in one vector: mean 2, shape 3, colour 3.
pub(crate) const VECTOR: usize = 8;

/// 2D Gaussians on the CPU, with their Adam moments and density statistics.
#[derive(Debug)]
pub struct Splats2d {
    pub(crate) means: Vec<Vec2>,
    pub(crate) shapes: Shapes,
    pub(crate) colors: Vec<[f32; 3]>,
    /// Empty where all Gaussians are opaque.
    pub(crate) opacity_logits: Vec<f32>,
    /// First and second moments of mean, shape and colour.
    pub(crate) moments: [Vec<[f32; VECTOR]>; 2],
    /// First and second moments of the opacities.
    pub(crate) opacity_moments: Vec<[f32; 2]>,
    /// Number of Adam steps of each Gaussian.
    pub(crate) steps: Vec<u32>,
    pub(crate) shared: Shared<Scene2d>,
}

impl Splats2d {
    pub(crate) fn len(&self) -> usize {
        self.means.len()
    }

    pub(crate) fn parameterization(&self) -> Parameterization {
        match self.shapes {
            Shapes::ScaleRotation(_) => Parameterization::ScaleRotation,
            Shapes::CovarianceFactor(_) => Parameterization::CovarianceFactor,
        }
    }

    /// L with Σ = L Lᵀ of Gaussian `index`.
    pub(crate) fn factor(&self, index: usize) -> Mat2 {
        match &self.shapes {
            Shapes::CovarianceFactor(factors) => factors[index],
            Shapes::ScaleRotation(shapes) => {
                let [x, y, angle] = shapes[index];
                let (sin, cos) = angle.sin_cos();
                Mat2::from_cols(Vec2::new(cos, sin) * x.exp(), Vec2::new(-sin, cos) * y.exp())
            }
        }
    }

    fn check_lengths(&self) -> Result<(), Error> {
        let shapes = match &self.shapes {
            Shapes::ScaleRotation(shapes) => shapes.len(),
            Shapes::CovarianceFactor(factors) => factors.len(),
        };
        let opacities = if self.opacity_logits.is_empty() { self.len() } else { self.opacity_logits.len() };
        let lengths = [
            ("shape", shapes),
            ("color", self.colors.len()),
            ("opacity_logit", opacities),
            ("moment1", self.moments[0].len()),
            ("moment2", self.moments[1].len()),
            ("steps", self.steps.len()),
            ("gradient_sum", self.shared.statistics.signal_sum.len()),
            ("visible", self.shared.statistics.visible.len()),
        ];
        lengths.into_iter().try_for_each(|(what, found)| check_len(what, self.len(), found))
    }
}

impl Splats<Scene2d> for Splats2d {
    fn new(scene: &Scene2d, parameterization: Parameterization) -> Result<Self, Error> {
        scene.validate()?;
        let shapes = match parameterization {
            Parameterization::ScaleRotation => {
                Shapes::ScaleRotation(scene.iter().map(|g| scale_rotation(&g)).collect())
            }
            Parameterization::CovarianceFactor => Shapes::CovarianceFactor(scene.iter().map(|g| g.factor()).collect()),
        };
        let n = scene.len();
        Ok(Self {
            means: scene.means.clone(),
            shapes,
            colors: scene.colors.iter().map(Vec3::to_array).collect(),
            opacity_logits: scene.opacity_logits.clone(),
            moments: [vec![[0.0; VECTOR]; n], vec![[0.0; VECTOR]; n]],
            opacity_moments: vec![[0.0; 2]; scene.opacity_logits.len()],
            steps: vec![0; n],
            shared: Shared::new(DensityStatistics::zeros(n)),
        })
    }

    fn scene(&self) -> Scene2d {
        let (log_scales, rotations) = match &self.shapes {
            Shapes::ScaleRotation(shapes) => shapes.iter().map(|&[x, y, angle]| (Vec2::new(x, y), angle)).unzip(),
            Shapes::CovarianceFactor(factors) => factors.iter().map(|&l| Gaussian2d::shape_of_factor(l)).unzip(),
        };
        Scene2d {
            means: self.means.clone(),
            log_scales,
            rotations,
            opacity_logits: self.opacity_logits.clone(),
            colors: self.colors.iter().map(|&c| Vec3::from_array(c)).collect(),
        }
    }

    fn saved(&self) -> SavedState<'static> {
        let mut state = SplatsState::new(self.parameterization());
        state.insert("mean", self.means.iter().map(|m| m.to_array()));
        match &self.shapes {
            Shapes::ScaleRotation(shapes) => {
                state.insert("log_scale", shapes.iter().map(|&[x, y, _]| [x, y]));
                state.insert("rotation", shapes.iter().map(|&[_, _, angle]| [angle]));
            }
            Shapes::CovarianceFactor(factors) => state.insert("factor", factors.iter().map(|l| l.to_cols_array())),
        }
        state.insert("color", self.colors.iter().copied());
        if !self.opacity_logits.is_empty() {
            state.insert("opacity_logit", self.opacity_logits.iter().map(|&o| [o]));
        }
        for (order, (name, moments)) in ["moment1", "moment2"].into_iter().zip(&self.moments).enumerate() {
            let nine = |(i, &[a, b, c, d, e, f, g, h]): (usize, &[f32; VECTOR])| {
                [a, b, c, d, e, f, g, h, self.opacity_moments.get(i).map_or(0.0, |m| m[order])]
            };
            state.insert(name, moments.iter().enumerate().map(nine));
        }
        state.insert_u32("steps", self.steps.clone());
        state.insert("gradient_sum", self.shared.statistics.signal_sum.iter().map(|&g| [g]));
        state.insert_u32("visible", self.shared.statistics.visible.clone());
        state.into()
    }

    fn restore(state: &SplatsState) -> Result<Self, Error> {
        let flat = |rows: Vec<[f32; 1]>| rows.into_iter().map(|[v]| v).collect::<Vec<_>>();
        let means: Vec<Vec2> = state.rows::<2>("mean")?.into_iter().map(Vec2::from_array).collect();
        let shapes = match state.parameterization {
            Parameterization::ScaleRotation => {
                let pairs = state.rows::<2>("log_scale")?.into_iter().zip(state.rows::<1>("rotation")?);
                Shapes::ScaleRotation(pairs.map(|([x, y], [angle])| [x, y, angle]).collect())
            }
            Parameterization::CovarianceFactor => {
                Shapes::CovarianceFactor(state.rows::<4>("factor")?.iter().map(Mat2::from_cols_array).collect())
            }
        };
        let opacity_logits =
            if state.contains("opacity_logit") { flat(state.rows::<1>("opacity_logit")?) } else { Vec::new() };
        let nines = [state.rows::<9>("moment1")?, state.rows::<9>("moment2")?];
        let opacity_moments = match opacity_logits.len() {
            0 => Vec::new(),
            _ => nines[0].iter().zip(&nines[1]).map(|(m, v)| [m[8], v[8]]).collect(),
        };
        let eight = |nine: &[f32; 9]| std::array::from_fn(|k| nine[k]);
        let splats = Self {
            shapes,
            colors: state.rows::<3>("color")?,
            moments: [0, 1].map(|k: usize| nines[k].iter().map(eight).collect()),
            opacity_moments,
            opacity_logits,
            steps: state.integers("steps")?,
            shared: Shared::new(DensityStatistics {
                signal_sum: flat(state.rows::<1>("gradient_sum")?),
                visible: state.integers("visible")?,
            }),
            means,
        };
        splats.check_lengths()?;
        Ok(splats)
    }

    fn edit(&mut self, plan: &EditPlan<Gaussian2d>) -> Result<(), Error> {
        let sources = plan.sources(self.len())?;
        let births_are_translucent = plan.added.iter().any(|b| b.gaussian.opacity_logit != f32::INFINITY)
            || plan.changed.iter().any(|c| c.gaussian.opacity_logit != f32::INFINITY);
        if self.opacity_logits.is_empty() && births_are_translucent {
            self.opacity_logits = vec![f32::INFINITY; self.len()];
            self.opacity_moments = vec![[0.0; 2]; self.len()];
        }
        self.means = plan.gather(&sources, &self.means, |g| g.mean);
        self.shapes = match &self.shapes {
            Shapes::ScaleRotation(shapes) => Shapes::ScaleRotation(plan.gather(&sources, shapes, scale_rotation)),
            Shapes::CovarianceFactor(factors) => {
                let mut edited = plan.gather(&sources, factors, Gaussian2d::factor);
                for (factor, source) in edited.iter_mut().zip(&sources) {
                    let heir_of = plan.origin(source, Moments::heir_of).filter(|_| !matches!(source, Source::Kept(_)));
                    if let Some(i) = heir_of {
                        *factor = aligned(*factor, factors[i as usize]);
                    }
                }
                Shapes::CovarianceFactor(edited)
            }
        };
        self.colors = plan.gather(&sources, &self.colors, |g| g.color.to_array());
        if !self.opacity_logits.is_empty() {
            self.opacity_logits = plan.gather(&sources, &self.opacity_logits, |g| g.opacity_logit);
            self.opacity_moments = plan.gather_moments(&sources, &self.opacity_moments);
        }
        for moments in &mut self.moments {
            *moments = plan.gather_moments(&sources, moments);
        }
        self.steps = plan.gather_steps(&sources, &self.steps);
        self.shared.edit(plan, &sources);
        if let Some(ceiling) = plan.opacity_ceiling {
            let opacities = self.opacity_logits.iter_mut().zip(&mut self.opacity_moments);
            for (value, moments) in opacities.skip(plan.fixed as usize) {
                if !(sigmoid(*value) <= ceiling) {
                    *value = logit(ceiling);
                }
                *moments = [0.0; 2];
            }
        }
        Ok(())
    }

    fn add_noise(&mut self, noise: &MeanNoise) {
        let mut means = std::mem::take(&mut self.means);
        (means.par_iter_mut().zip(&self.opacity_logits).enumerate().skip(noise.fixed as usize))
            .for_each(|(i, (mean, &logit))| *mean += noise.shift_2d(i as u32, self.factor(i), logit));
        self.means = means;
    }

    fn shared(&self) -> &Shared<Scene2d> {
        &self.shared
    }

    fn shared_mut(&mut self) -> &mut Shared<Scene2d> {
        &mut self.shared
    }
}

fn scale_rotation(g: &Gaussian2d) -> [f32; 3] {
    [g.log_scale.x, g.log_scale.y, g.rotation]
}
