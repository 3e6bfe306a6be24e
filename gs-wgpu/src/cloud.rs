//! The Gaussians where this backend computes: parameters, Adam moments and statistics in buffers, and how scenes, edits and checkpoints
//! get there and back.

use std::sync::{Mutex, MutexGuard, PoisonError};

use glam::{Mat2, Vec2, Vec3};
use gs_core::{
    Chart, CloudState, DensityStatistics, EditPlan, Error, PlanarGaussian, PlanarScene, Scene, Wait,
    edit::{AfterEdit, Moments as Heritage, Source as From},
    scene::logit,
};

use crate::{
    dispatch::{Commands, dispatch},
    gpu::{Gpu, STORAGE},
    in_flight::InFlight,
    layout::{Gaussian, Moments, Source, Statistics, Step},
    shaders::Variant,
};

/// Planar Gaussians on a device, with their Adam moments and density statistics.
#[derive(Debug)]
pub struct PlanarCloud {
    pub(crate) len: usize,
    pub(crate) chart: Chart,
    /// Whether opacities are stored; without them every Gaussian is opaque.
    pub(crate) has_opacity: bool,
    pub(crate) gaussians: wgpu::Buffer,
    pub(crate) moments: wgpu::Buffer,
    pub(crate) statistics: wgpu::Buffer,
    /// Training steps whose outcome is not known yet; what looks at the cloud waits for them, though it may not change it.
    pub(crate) in_flight: Mutex<InFlight>,
    /// Another number for every cloud and after every edit, by which lists made for another state are recognised.
    pub(crate) edition: u64,
}

/// A Gaussian's parameters as its chart has them.
fn packed(g: &PlanarGaussian, chart: Chart) -> Gaussian {
    let shape = match chart {
        Chart::ScaleRotation => [g.log_scale.x, g.log_scale.y, g.rotation, 0.0],
        Chart::LocalFrame => g.frame().to_cols_array(),
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

impl PlanarCloud {
    pub(crate) fn new(gpu: &Gpu, scene: &PlanarScene, chart: Chart) -> Result<Self, Error> {
        scene.validate()?;
        let gaussians: Vec<Gaussian> = scene.iter().map(|g| packed(&g, chart)).collect();
        let n = gaussians.len();
        let (moments, statistics) = (vec![Moments::default(); n], vec![Statistics::default(); n]);
        Self::from_parts(gpu, chart, scene.has_opacity(), &gaussians, &moments, &statistics)
    }

    fn from_parts(
        gpu: &Gpu,
        chart: Chart,
        has_opacity: bool,
        gaussians: &[Gaussian],
        moments: &[Moments],
        statistics: &[Statistics],
    ) -> Result<Self, Error> {
        Ok(Self {
            len: gaussians.len(),
            chart,
            has_opacity,
            gaussians: gpu.storage("Gaussians", gaussians)?,
            moments: gpu.storage("Adam moments", moments)?,
            statistics: gpu.storage("statistics", statistics)?,
            in_flight: Mutex::default(),
            edition: next_edition(),
        })
    }

    /// Training steps that were sent and whose outcome is not known yet, at most [`STEPS_IN_FLIGHT`](crate::STEPS_IN_FLIGHT).
    pub fn steps_in_flight(&self) -> usize {
        self.in_flight().len()
    }

    pub(crate) fn in_flight(&self) -> MutexGuard<'_, InFlight> {
        self.in_flight.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Until all steps that were sent have been done: whatever looks at the cloud's buffers begins with this.
    pub(crate) fn settle(&self, gpu: &Gpu) -> Result<(), Error> {
        self.in_flight().settle(gpu, self, Wait::All)
    }

    /// L with Σ = L Lᵀ of a Gaussian as this cloud holds it.
    pub(crate) fn frame(&self, g: &Gaussian) -> Mat2 {
        match self.chart {
            Chart::LocalFrame => Mat2::from_cols_array(&g.shape),
            Chart::ScaleRotation => {
                let [x, y, angle, _] = g.shape;
                let (sin, cos) = angle.sin_cos();
                Mat2::from_cols(Vec2::new(cos, sin) * x.exp(), Vec2::new(-sin, cos) * y.exp())
            }
        }
    }

    pub(crate) fn download_gaussians(&self, gpu: &Gpu) -> Result<Vec<Gaussian>, Error> {
        gpu.read(&self.gaussians, self.len)
    }

    pub(crate) fn scene(&self, gpu: &Gpu) -> Result<PlanarScene, Error> {
        let mut scene = PlanarScene::default();
        for g in self.download_gaussians(gpu)? {
            let (log_scale, rotation) = match self.chart {
                Chart::ScaleRotation => (Vec2::new(g.shape[0], g.shape[1]), g.shape[2]),
                Chart::LocalFrame => PlanarGaussian::shape_of_frame(Mat2::from_cols_array(&g.shape)),
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

    pub(crate) fn density_statistics(&self, gpu: &Gpu) -> Result<DensityStatistics, Error> {
        let statistics: Vec<Statistics> = gpu.read(&self.statistics, self.len)?;
        Ok(DensityStatistics {
            gradient_sum: statistics.iter().map(|s| s.gradient_sum).collect(),
            visible: statistics.iter().map(|s| s.visible).collect(),
        })
    }

    /// One upload of where everything comes from, and of the new Gaussians; the arrays are rebuilt on the device.
    pub(crate) fn edit(&mut self, gpu: &Gpu, plan: &EditPlan<PlanarGaussian>) -> Result<(), Error> {
        let sources = plan.sources(self.len)?;
        let changed = plan.changed.iter().map(|c| &c.gaussian);
        let fresh: Vec<Gaussian> =
            changed.chain(plan.added.iter().map(|b| &b.gaussian)).map(|g| packed(g, self.chart)).collect();
        let has_opacity = self.has_opacity || fresh.iter().any(|g| g.opacity_logit != f32::INFINITY);
        let records: Vec<Source> = sources.iter().map(|source| record(plan, source)).collect();
        let n = records.len();
        let ceiling = plan.opacity_ceiling.filter(|_| has_opacity);
        let step = Step {
            gaussians: n as u32,
            collect: u32::from(ceiling.is_some()),
            alpha_max: ceiling.map_or(f32::INFINITY, logit),
            ..Step::default()
        };
        let uniform = gpu.allocate("step", size_of::<Step>() as u64, UNIFORM)?;
        gpu.write(&uniform, bytemuck::bytes_of(&step));
        let edited = [
            gpu.allocate("Gaussians", (n * size_of::<Gaussian>()) as u64, STORAGE)?,
            gpu.allocate("Adam moments", (n * size_of::<Moments>()) as u64, STORAGE)?,
            gpu.allocate("statistics", (n * size_of::<Statistics>()) as u64, STORAGE)?,
        ];
        let (records, fresh) = (gpu.storage("edits", &records)?, gpu.storage("new Gaussians", &fresh)?);
        let mut commands = Commands::new(gpu);
        let bindings = [
            &uniform,
            &records,
            &fresh,
            &self.gaussians,
            &self.moments,
            &self.statistics,
            &edited[0],
            &edited[1],
            &edited[2],
        ];
        dispatch(gpu, &mut commands, "edit", Variant::default(), &bindings, gpu.groups((n as u64).div_ceil(64)).into());
        commands.submit(gpu);
        gpu.check()?;
        [self.gaussians, self.moments, self.statistics] = edited;
        (self.len, self.has_opacity, self.edition) = (n, has_opacity, next_edition());
        Ok(())
    }

    pub(crate) fn save(&self, gpu: &Gpu) -> Result<CloudState, Error> {
        let gaussians = self.download_gaussians(gpu)?;
        let moments: Vec<Moments> = gpu.read(&self.moments, self.len)?;
        let statistics = self.density_statistics(gpu)?;
        let mut state = CloudState::new(self.chart);
        state.insert("mean", gaussians.iter().map(|g| g.mean));
        match self.chart {
            Chart::ScaleRotation => {
                state.insert("log_scale", gaussians.iter().map(|g| [g.shape[0], g.shape[1]]));
                state.insert("rotation", gaussians.iter().map(|g| [g.shape[2]]));
            }
            Chart::LocalFrame => state.insert("frame", gaussians.iter().map(|g| g.shape)),
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
        state.insert("gradient_sum", statistics.gradient_sum.iter().map(|&g| [g]));
        state.insert_u32("visible", statistics.visible);
        Ok(state)
    }

    pub(crate) fn restore(gpu: &Gpu, state: &CloudState) -> Result<Self, Error> {
        let means = state.rows::<2>("mean")?;
        let n = means.len();
        let of_length = |what: &'static str, found: usize| {
            if found == n { Ok(()) } else { Err(Error::Length { what, expected: n, found }) }
        };
        let shapes: Vec<[f32; 4]> = match state.chart {
            Chart::ScaleRotation => {
                let (scales, rotations) = (state.rows::<2>("log_scale")?, state.rows::<1>("rotation")?);
                of_length("rotation", rotations.len())?;
                scales.iter().zip(rotations).map(|(&[x, y], [angle])| [x, y, angle, 0.0]).collect()
            }
            Chart::LocalFrame => state.rows::<4>("frame")?,
        };
        let colors = state.rows::<3>("color")?;
        let has_opacity = state.contains("opacity_logit");
        let logits = if has_opacity { state.rows::<1>("opacity_logit")? } else { vec![[f32::INFINITY]; n] };
        let (first, second) = (state.rows::<9>("moment1")?, state.rows::<9>("moment2")?);
        let steps = state.integers("steps")?;
        let (sums, visible) = (state.rows::<1>("gradient_sum")?, state.integers("visible")?);
        for (what, found) in [
            ("shape", shapes.len()),
            ("color", colors.len()),
            ("opacity_logit", logits.len()),
            ("moment1", first.len()),
            ("moment2", second.len()),
            ("steps", steps.len()),
            ("gradient_sum", sums.len()),
            ("visible", visible.len()),
        ] {
            of_length(what, found)?;
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
        let statistics: Vec<Statistics> =
            sums.iter().zip(&visible).map(|(&[gradient_sum], &visible)| Statistics { gradient_sum, visible }).collect();
        Self::from_parts(gpu, state.chart, has_opacity, &gaussians, &moments, &statistics)
    }
}

/// Usage of a uniform that the host writes.
pub(crate) const UNIFORM: wgpu::BufferUsages = wgpu::BufferUsages::UNIFORM.union(wgpu::BufferUsages::COPY_DST);

/// What the device is told of one slot of the edited arrays.
fn record(plan: &EditPlan<PlanarGaussian>, source: &From) -> Source {
    let inherited = |moments: Heritage, from: Option<u32>| match (moments, from) {
        (Heritage::Inherit, Some(from)) => from,
        _ => Source::NONE,
    };
    let (parameters, is_fresh, moments, statistics) = match *source {
        From::Kept(i) => (i, 0, i, Some(i)),
        From::Changed { before, change } => {
            (change, 1, inherited(plan.changed[change as usize].moments, Some(before)), Some(before))
        }
        From::Added(k) => {
            let birth = &plan.added[k as usize];
            (plan.changed.len() as u32 + k, 1, inherited(birth.moments, birth.parent), birth.parent)
        }
    };
    let statistics = match plan.statistics {
        AfterEdit::Restart => Source::NONE,
        AfterEdit::Keep => statistics.unwrap_or(Source::NONE),
    };
    Source { parameters, moments, statistics, is_fresh }
}

fn next_edition() -> u64 {
    use std::sync::atomic::{AtomicU64, Ordering};
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}
