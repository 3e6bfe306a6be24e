//! The oracle as a backend, `f64` inside and `f32` in its results, with one fault or none.

use gs_conformance::{
    oracle::{OPACITY_3D, Oracle, OracleScene, SH_3D, ViewGradients},
    subject::Subject,
};
use gs_core::{
    AdamRates, Backend, Camera, CameraGradient, Culled, DensityStatistics, Dropout, EditPlan, Error, Gaussian3d, Image,
    Loss, MeanNoise, Optimizer, Output, Parameterization, Participants, Rasterizer, RenderSettings, Scene, Scene3d,
    SplatsState, TargetImage, TrainStep, Wait,
    effects::{Antialias, Background, Order, Statistics},
    logit,
};
use pollster::FutureExt as _;

mod splats;

use super::target::Target;
use splats::{Gradients, Pass, Splats, narrow, scene_of, tensors};

/// The fault of the backend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    /// No fault: a backend may refuse statistics.
    RefusesPixelGradients,
    ShiftsImages,
    DimsImages,
    DrawsInTheScenesOrder,
    OrdersByMean,
    ForgetsAntialiasing,
    ForgetsCompensation,
    IgnoresTheDegree,
    ForgetsTheAccuracy,
    ForgetsTheBackground,
    MistakesCauses,
    NegatesQuaternionGradients,
    GradientsInWrongUnits,
    HoldsDirectionsFixed,
    ShowsColoursForDepths,
    KeepsAllGaussians,
    ForgetsTheGain,
    LeavesOutTheSame,
    NegatesGivenGradients,
    NegatesTurns,
    MovesTheWrongWay,
    AnswersUnasked,
    KeepsCameraGradients,
    NormalisesQuaternions,
    ForgetsMomentsOnRestore,
    StepsUphill,
    OneRateForAllColours,
    ForgetsBiasCorrection,
    MovesAll,
    MovesOnlyTheVisible,
    MovesTheFixed,
    FusedStepDoesTooMuch,
    UsesListsOfAnotherView,
    SwapsLosses,
    ForgetsLossesOnEdit,
    DoublesStatistics,
    LetsGradientsCancel,
    MistakesErrorsForGradients,
    CountsStepsForPixels,
    ForgetsDepths,
    SeesEverything,
    NoiseIsAStep,
    IgnoresMasks,
    IgnoresAlpha,
    IgnoresWeights,
    ForgetsMomentsOnEdit,
    EditsEvenWhenItRefuses,
    AcceptsNan,
    SwallowsBadSettings,
    RestoresAnything,
    DrawsByParity,
    DrawsByPlace,
    NearIsAbsolute,
}

use Fault::*;

/// The oracle as a backend.
pub(crate) struct Faulty(pub(crate) Fault);

impl Faulty {
    fn is(&self, fault: Fault) -> bool {
        self.0 == fault
    }

    /// The gradient by the camera, if it is asked for.
    fn by_camera(&self, view: &Camera, oracle: &Oracle, found: &ViewGradients) -> Option<CameraGradient> {
        let numbers: Vec<f32> = found.values.iter().map(|&v| v as f32).collect();
        let mut gradient = CameraGradient::from_array(numbers.try_into().expect("a camera has ten numbers"));
        match self.0 {
            NegatesTurns => gradient.rotation *= -1.0,
            MovesTheWrongWay => gradient.translation = view.rotation.transpose() * gradient.translation,
            GradientsInWrongUnits => gradient.focal *= 1.01,
            _ => {}
        }
        oracle.settings().camera_gradient.then_some(gradient)
    }

    /// The inputs after a fault.
    fn altered(
        &self,
        splats: &Splats,
        view: &Camera,
        settings: &RenderSettings,
    ) -> (OracleScene, Camera, RenderSettings) {
        let (mut scene, mut view, mut settings) = (splats.rows(), *view, *settings);
        let effects = &mut settings.effects;
        match self.0 {
            DrawsInTheScenesOrder => effects.order = Order::Index,
            OrdersByMean if effects.order == Order::PerPixel => effects.order = Order::Global,
            ForgetsAntialiasing => effects.antialias = Antialias::None,
            ForgetsCompensation if effects.antialias.compensates() => effects.antialias = Antialias::Dilate,
            ShowsColoursForDepths => settings.output = Output::Color,
            LeavesOutTheSame => settings.dropout.seed = 0,
            KeepsAllGaussians => settings.dropout = Dropout::NONE,
            ForgetsTheGain if !settings.dropout.is_none() => {
                // Makes the left-out Gaussians transparent, and does not raise the opacity of the rest.
                let dropout = settings.dropout;
                let left_out = (0..).zip(&mut scene.gaussians).filter(|(index, _)| dropout.leaves_out(*index));
                left_out.for_each(|(_, row)| row[OPACITY_3D] = f64::NEG_INFINITY);
                settings.dropout = Dropout::NONE;
            }
            IgnoresTheDegree => effects.sh_degree = 3,
            ForgetsTheAccuracy => settings.accuracy = gs_core::Accuracy::default(),
            ForgetsTheBackground => effects.background = Background::None,
            NearIsAbsolute => view.near = 0.2,
            SwallowsBadSettings if settings.validate().is_err() => settings = RenderSettings::default(),
            DrawsByParity => scene.gaussians.iter_mut().step_by(2).for_each(|row| row[SH_3D] += 0.1),
            DrawsByPlace => {
                scene.gaussians.iter_mut().filter(|row| row[0] > 0.0).for_each(|row| row[SH_3D] += 0.1);
            }
            _ => {}
        }
        (scene, view, settings)
    }
}

impl Backend for Faulty {
    fn describe(&self) -> String {
        format!("oracle ({:?})", self.0)
    }
}

impl Rasterizer<Scene3d> for Faulty {
    type Splats = Splats;
    type ForwardPass = Pass;
    type Gradients = Gradients;
    type Target = Target;

    fn upload(&self, scene: &Scene3d, parameterization: Parameterization) -> Result<Splats, Error> {
        let mut scene = scene.clone();
        if self.is(AcceptsNan) {
            scene.means.iter_mut().filter(|mean| mean.is_nan()).for_each(|mean| *mean = glam::Vec3::ZERO);
        }
        scene.validate()?;
        parameterization.check_3d()?;
        if self.is(NormalisesQuaternions) {
            for q in &mut scene.rotations {
                *q = glam::Vec4::from_array(*q).normalize().to_array();
            }
        }
        Ok(Splats::of(&scene))
    }

    async fn download(&self, splats: &Splats) -> Result<Scene3d, Error> {
        Ok(scene_of(&narrow(&splats.rows().gaussians), splats.sh_len))
    }

    fn len(&self, splats: &Splats) -> usize {
        splats.parameters.len()
    }

    fn upload_target<'a>(&self, target: impl Into<TargetImage<'a>>) -> Result<Target, Error> {
        let mut target = target.into();
        target.validate()?;
        match self.0 {
            IgnoresMasks => target.mask = None,
            IgnoresAlpha => target.alpha = None,
            IgnoresWeights => target.weights = None,
            _ => {}
        }
        Ok(Target::new(&target))
    }

    async fn forward(&self, splats: &Splats, view: &Camera, settings: &RenderSettings) -> Result<Pass, Error> {
        if self.is(RefusesPixelGradients) && settings.effects.statistics == Statistics::PixelGradient {
            return Err(Error::Unsupported { backend: "oracle", effect: "gradients of pixels".to_owned() });
        }
        let (scene, view, settings) = self.altered(splats, view, settings);
        let oracle = Oracle::new(view, settings)?;
        let rendering = oracle.render(&scene);
        Ok(Pass { view, oracle, scene, rendering })
    }

    async fn image(&self, pass: &Pass) -> Result<Image, Error> {
        let image = pass.rendering.image();
        let (w, h) = image.size();
        match self.0 {
            ShiftsImages => Image::from_fn(w, h, |x, y| image.pixel((x + 1) % w, (y + 1) % h)),
            DimsImages => Image::from_fn(w, h, |x, y| image.pixel(x, y).map(|v| v * 0.9995)),
            _ => Ok(image),
        }
    }

    fn culled(&self, pass: &Pass) -> Culled {
        let culled = pass.rendering.culled;
        let mistaken = Culled { near: 0, outside: culled.outside + culled.near, ..culled };
        if self.is(MistakesCauses) { mistaken } else { culled }
    }

    async fn backward(&self, _: &Splats, pass: Pass, target: &Target, loss: &Loss) -> Result<(f32, Gradients), Error> {
        loss.validate()?;
        let Pass { view, oracle, scene, rendering } = pass;
        if let Some(weights) = &target.weights {
            let (value, v_image) = target.weighted(weights, &rendering.image(), *loss)?;
            let found = oracle.image_vjp(&scene, &v_image)?;
            let (rows, camera) = (found.values, self.by_camera(&view, &oracle, &found.view));
            let (statistic, weight) = (vec![0.0; rows.len()], vec![1; rows.len()]);
            return Ok((value as f32, Gradients { rows, statistic, weight, drawn: rendering.drawn, camera }));
        }
        let target = &target.completed(&rendering.image(), oracle.settings().background_color());
        let mut gradients = oracle.gradients(&scene, target, loss)?;
        if self.is(HoldsDirectionsFixed) {
            // With SH of degree 0, nothing depends on the direction.
            let mut settings = oracle.settings();
            settings.effects.sh_degree = 0;
            let flat = Oracle::new(view, settings)?.gradients(&scene, target, loss)?;
            for (row, flat) in gradients.values.iter_mut().zip(&flat.values) {
                row[0..3].copy_from_slice(&flat[0..3]);
            }
            gradients.view.values = flat.view.values;
        }
        let of_step = oracle.statistics(&scene, target, loss)?;
        let statistic = match oracle.settings().effects.statistics {
            Statistics::None => vec![0.0; scene.gaussians.len()],
            Statistics::AbsoluteGradient if !self.is(LetsGradientsCancel) => of_step.absolute_gradient,
            Statistics::PixelGradient => match self.is(ForgetsDepths) {
                true => {
                    of_step.mean_gradient.iter().zip(&of_step.pixels).map(|(norm, &m)| norm * f64::from(m)).collect()
                }
                false => of_step.pixel_gradient,
            },
            Statistics::PixelError if !self.is(MistakesErrorsForGradients) => of_step.pixel_error,
            _ => of_step.mean_gradient,
        };
        let weight = match oracle.settings().effects.statistics {
            Statistics::PixelGradient if !self.is(CountsStepsForPixels) => of_step.pixels,
            _ => vec![1; scene.gaussians.len()],
        };
        let drawn = rendering.drawn.iter().map(|&drawn| drawn || self.is(SeesEverything)).collect();
        let camera = self.by_camera(&view, &oracle, &gradients.view);
        Ok((gradients.loss as f32, Gradients { rows: gradients.values, statistic, weight, drawn, camera }))
    }

    async fn image_vjp(&self, _: &Splats, pass: Pass, v_image: &Image) -> Result<Gradients, Error> {
        let Pass { view, oracle, scene, rendering } = pass;
        v_image.check_finite("the gradient of an image")?;
        let mut gradients = oracle.image_vjp(&scene, v_image)?;
        if self.is(NegatesGivenGradients) {
            gradients.values.iter_mut().flatten().for_each(|v| *v = -*v);
            gradients.view.values.iter_mut().for_each(|v| *v = -*v);
        }
        let statistic = vec![0.0; scene.gaussians.len()];
        let weight = vec![1; statistic.len()];
        let camera = self.by_camera(&view, &oracle, &gradients.view);
        Ok(Gradients { rows: gradients.values, statistic, weight, drawn: rendering.drawn, camera })
    }

    async fn camera_gradient(&self, gradients: &Gradients) -> Result<CameraGradient, Error> {
        match gradients.camera {
            None if self.is(AnswersUnasked) => Ok(CameraGradient::default()),
            found => found.ok_or_else(CameraGradient::not_requested),
        }
    }

    async fn gradients(&self, splats: &Splats, gradients: &Gradients) -> Result<Scene3d, Error> {
        let mut scene = scene_of(&narrow(&gradients.rows), splats.sh_len);
        match self.0 {
            NegatesQuaternionGradients => scene.rotations.iter_mut().flatten().for_each(|v| *v = -*v),
            GradientsInWrongUnits => scene.means.iter_mut().for_each(|v| *v *= 1.01),
            _ => {}
        }
        Ok(scene)
    }
}

impl Optimizer<Scene3d> for Faulty {
    async fn save(&self, splats: &Splats) -> Result<SplatsState, Error> {
        let mut state = SplatsState::new(Parameterization::ScaleRotation);
        let columns = |range: std::ops::Range<usize>| -> Vec<f32> {
            splats.parameters.iter().flat_map(|row| row[range.clone()].iter().copied()).collect()
        };
        let mut from = 0;
        for (name, columns_) in tensors(3 * splats.sh_len) {
            state.insert_matrix(name, columns_, columns(from..from + columns_));
            from += columns_;
        }
        let width = splats.moments();
        state.insert_matrix("moment1", width, splats.first.concat());
        state.insert_matrix("moment2", width, splats.second.concat());
        state.insert_matrix("gradient_sum", 1, splats.signal_sum.clone());
        state.insert_u32("steps", splats.steps.clone());
        state.insert_u32("visible", splats.visible.clone());
        Ok(state)
    }

    fn restore(&self, state: &SplatsState) -> Result<Splats, Error> {
        state.parameterization.check_3d()?;
        let restored = || {
            let (sh_width, _) = state.matrix("sh")?;
            let rows = |name, width| match state.matrix(name)? {
                (columns, values) if columns == width => {
                    Ok(values.chunks_exact(width).map(<[f32]>::to_vec).collect::<Vec<_>>())
                }
                (columns, _) => Err(Error::State(format!("`{name}` has {columns} columns"))),
            };
            let empty = Splats { sh_len: sh_width / 3, ..Splats::default() };
            let all = empty.moments();
            let mut parts = Vec::new();
            for (name, width) in tensors(sh_width) {
                parts.push(rows(name, width)?);
            }
            let (steps, visible) = (state.integers("steps")?, state.integers("visible")?);
            let signal_sum = rows("gradient_sum", 1)?.concat();
            let (first, second) = (rows("moment1", all)?, rows("moment2", all)?);
            let count = steps.len();
            let lengths = [first.len(), second.len(), visible.len(), signal_sum.len()];
            if parts.iter().map(Vec::len).chain(lengths).any(|n| n != count) {
                return Err(Error::State("tensors of different lengths".to_owned()));
            }
            let parameters = (0..count).map(|g| parts.iter().flat_map(|part| part[g].clone()).collect()).collect();
            let splats = Splats { parameters, first, second, steps, ..empty };
            Ok(Splats { signal_sum, visible, ..splats })
        };
        match restored() {
            Err(_) if self.is(RestoresAnything) => Ok(Splats { sh_len: 1, ..Splats::default() }),
            Ok(mut splats) if self.is(ForgetsMomentsOnRestore) => {
                splats.forget_moments();
                Ok(splats)
            }
            other => other,
        }
    }

    async fn step(&self, splats: &mut Splats, gradients: &Gradients, rates: &AdamRates) -> Result<(), Error> {
        if gradients.rows.len() != splats.parameters.len() {
            return Err(Error::State("gradients of other splats".to_owned()));
        }
        let mut rates = *rates;
        match self.0 {
            OneRateForAllColours => rates.color_rest = rates.color,
            MovesAll => rates.participants = Participants::All,
            MovesOnlyTheVisible => rates.participants = Participants::Visible,
            MovesTheFixed => rates.fixed = 0,
            ForgetsBiasCorrection => splats.steps.iter_mut().for_each(|steps| *steps = 100_000),
            StepsUphill => {
                let AdamRates { mean, scale, rotation, opacity, color, color_rest, .. } = &mut rates;
                for rate in [mean, scale, rotation, opacity, color, color_rest] {
                    rate.learning_rate *= -1.0;
                }
            }
            _ => {}
        }
        let moving = rates.fixed as usize..splats.steps.len();
        let which: Vec<usize> =
            (moving.clone()).filter(|&g| rates.participants == Participants::All || gradients.drawn[g]).collect();
        splats.adam(&which, &gradients.rows, &rates);
        for g in moving {
            let twice = if self.is(DoublesStatistics) { 2.0 } else { 1.0 };
            splats.signal_sum[g] += (twice * gradients.statistic[g]) as f32;
            splats.visible[g] += gradients.weight[g] * u32::from(gradients.drawn[g]);
        }
        Ok(())
    }

    async fn train_step(
        &self,
        splats: &mut Splats,
        view: &Camera,
        target: &Target,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        let stale = self.is(UsesListsOfAnotherView) && step.binning == gs_core::Binning::Reuse;
        let seen = splats.last_view.filter(|_| stale).unwrap_or(*view);
        let pass = self.forward(splats, &seen, step.settings).block_on()?;
        let (loss, gradients) = self.backward(splats, pass, target, &step.loss).block_on()?;
        self.step(splats, &gradients, step.rates).block_on()?;
        if self.is(FusedStepDoesTooMuch) {
            self.step(splats, &gradients, step.rates).block_on()?;
        }
        splats.last_view = Some(*view);
        splats.losses.push(loss);
        splats.camera_gradients.extend(gradients.camera);
        Ok(())
    }

    async fn camera_gradients(
        &self,
        splats: &mut Splats,
        _: Wait,
        gradients: &mut Vec<CameraGradient>,
    ) -> Result<(), Error> {
        gradients.extend(&splats.camera_gradients);
        if !self.is(KeepsCameraGradients) {
            splats.camera_gradients.clear();
        }
        Ok(())
    }

    async fn losses(&self, splats: &mut Splats, _: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
        if self.is(SwapsLosses) {
            splats.losses.reverse();
        }
        losses.append(&mut splats.losses);
        Ok(())
    }

    async fn solve_colors(
        &self,
        _: &mut Splats,
        _: &Camera,
        _: &Target,
        _: &RenderSettings,
        _: u32,
    ) -> Result<(), Error> {
        Err(Error::Unsupported { backend: "oracle", effect: "solving for SH".to_owned() })
    }

    async fn statistics(&self, splats: &Splats) -> Result<DensityStatistics, Error> {
        Ok(DensityStatistics { signal_sum: splats.signal_sum.clone(), visible: splats.visible.clone() })
    }

    fn add_noise(&self, splats: &mut Splats, noise: &MeanNoise) -> Result<(), Error> {
        noise.validate()?;
        let shifts = scene_of(&narrow(&splats.rows().gaussians), splats.sh_len).shifts(noise);
        let moving = splats.parameters.iter_mut().zip(shifts.chunks_exact(3)).skip(noise.fixed as usize);
        for (row, shift) in moving {
            (0..3).for_each(|i| row[i] += shift[i]);
        }
        if self.is(NoiseIsAStep) {
            splats.forget_moments();
        }
        Ok(())
    }

    async fn edit(&self, splats: &mut Splats, plan: &EditPlan<Gaussian3d>) -> Result<(), Error> {
        let sources = plan.sources(splats.parameters.len());
        if sources.is_err() && self.is(EditsEvenWhenItRefuses) {
            splats.forget_moments();
        }
        let sources = sources?;
        let width = splats.moments();
        let before = splats.parameters.clone();
        splats.parameters = plan.gather(&sources, &before, |g| splats.row_of(g));
        for moments in [&mut splats.first, &mut splats.second] {
            *moments = plan.gather_moments(&sources, moments);
            moments.iter_mut().for_each(|row| row.resize(width, 0.0));
        }
        splats.steps = plan.gather_steps(&sources, &splats.steps);
        splats.signal_sum = plan.gather_statistics(&sources, &splats.signal_sum);
        splats.visible = plan.gather_statistics(&sources, &splats.visible);
        if let Some(ceiling) = plan.opacity_ceiling {
            let (place, moment) = (OPACITY_3D, Scene3d::OPACITY_MOMENT);
            for g in plan.fixed as usize..splats.steps.len() {
                let value = &mut splats.parameters[g][place];
                *value = value.min(logit(ceiling));
                (splats.first[g][moment], splats.second[g][moment]) = (0.0, 0.0);
            }
        }
        match self.0 {
            ForgetsMomentsOnEdit => splats.forget_moments(),
            ForgetsLossesOnEdit => splats.losses.clear(),
            _ => {}
        }
        Ok(())
    }
}
