//! A backend that is the oracle itself, `f64` inside and `f32` in what it keeps and hands over, with one fault or none.

use gs_conformance::{
    oracle::{Oracle, OracleScene, SPATIAL_SH},
    subject::Subject,
};
use gs_core::{
    AdamRates, Camera, Chart, CloudState, DensityStatistics, EditPlan, Error, Image, Loss, Participants, Rasterizer,
    RenderSettings, Scene, SpatialGaussian, SpatialScene, TrainStep, Wait,
    edit::{Moments, Source},
    effects::{Antialias, Background, Order, Statistics},
    scene::logit,
    statistics::Culled,
};

mod cloud;

use cloud::{Cloud, FRAME, Frame, Gradients, narrow, scene_of, tensors};

/// What is wrong with the backend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    /// Nothing: what passes.
    Faultless,
    /// Nothing either: a backend may.
    RefusesFrames,
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
    NormalisesQuaternions,
    RoundsFrames,
    TurnsTheGradientsAxes,
    MovesInTheWorld,
    ForgetsMomentsOnRestore,
    StepsUphill,
    OneRateForAllColours,
    ForgetsBiasCorrection,
    MovesAll,
    MovesOnlyTheVisible,
    FusedStepDoesTooMuch,
    UsesListsOfAnotherView,
    SwapsLosses,
    ForgetsLossesOnEdit,
    DoublesStatistics,
    LetsGradientsCancel,
    MistakesErrorsForGradients,
    SeesEverything,
    ShiftsAreSteps,
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

/// The oracle as a backend: `f64` inside, `f32` in what it keeps and hands over.
pub(crate) struct Faulty(pub(crate) Fault);

impl Faulty {
    fn is(&self, fault: Fault) -> bool {
        self.0 == fault
    }

    fn check_chart(&self, chart: Chart) -> Result<(), Error> {
        match chart {
            Chart::LocalFrame if self.is(RefusesFrames) => {
                Err(Error::Unsupported { backend: "oracle", effect: "chart LocalFrame".to_owned() })
            }
            _ => Ok(()),
        }
    }

    /// What it renders with instead of what it is told.
    fn altered(
        &self,
        cloud: &Cloud,
        view: &Camera,
        settings: &RenderSettings,
    ) -> (OracleScene, Camera, RenderSettings) {
        let (mut scene, mut view, mut settings) = (cloud.rows(), *view, *settings);
        let effects = &mut settings.effects;
        match self.0 {
            DrawsInTheScenesOrder => effects.order = Order::Index,
            OrdersByMean if effects.order == Order::PixelDepth => effects.order = Order::TileDepth,
            ForgetsAntialiasing => effects.antialias = Antialias::None,
            ForgetsCompensation if effects.antialias.compensates() => effects.antialias = Antialias::Dilate,
            IgnoresTheDegree => effects.sh_degree = 3,
            ForgetsTheAccuracy => settings.accuracy = gs_core::Accuracy::default(),
            ForgetsTheBackground => effects.background = Background::None,
            NearIsAbsolute => view.near = 0.2,
            SwallowsBadSettings if settings.validate().is_err() => settings = RenderSettings::default(),
            DrawsByParity => scene.gaussians.iter_mut().step_by(2).for_each(|row| row[SPATIAL_SH] += 0.1),
            DrawsByPlace => {
                scene.gaussians.iter_mut().filter(|row| row[0] > 0.0).for_each(|row| row[SPATIAL_SH] += 0.1);
            }
            _ => {}
        }
        (scene, view, settings)
    }
}

impl Rasterizer<SpatialScene> for Faulty {
    type Cloud = Cloud;
    type Frame = Frame;
    type Gradients = Gradients;
    type Target = Image;

    fn describe(&self) -> String {
        format!("oracle ({:?})", self.0)
    }

    fn upload(&self, scene: &SpatialScene, chart: Chart) -> Result<Cloud, Error> {
        let mut scene = scene.clone();
        if self.is(AcceptsNan) {
            scene.means.iter_mut().filter(|mean| mean.is_nan()).for_each(|mean| *mean = glam::Vec3::ZERO);
        }
        scene.validate()?;
        self.check_chart(chart)?;
        if self.is(NormalisesQuaternions) {
            for q in &mut scene.rotations {
                *q = glam::Vec4::from_array(*q).normalize().to_array();
            }
        }
        if self.is(RoundsFrames) && chart == Chart::LocalFrame {
            scene.log_scales.iter_mut().for_each(|scales| *scales = (*scales * 100.0).round() / 100.0);
        }
        Ok(Cloud::of(&scene, chart))
    }

    fn download(&self, cloud: &Cloud) -> Result<SpatialScene, Error> {
        Ok(scene_of(&narrow(&cloud.rows().gaussians), cloud.sh_len))
    }

    fn len(&self, cloud: &Cloud) -> usize {
        cloud.parameters.len()
    }

    fn upload_target(&self, image: &Image) -> Result<Image, Error> {
        Ok(image.clone())
    }

    fn save(&self, cloud: &Cloud) -> Result<CloudState, Error> {
        let mut state = CloudState::new(cloud.chart);
        let columns = |range: std::ops::Range<usize>| -> Vec<f32> {
            cloud.parameters.iter().flat_map(|row| row[range.clone()].iter().copied()).collect()
        };
        let mut from = 0;
        for (name, columns_) in tensors(cloud.chart, 3 * cloud.sh_len) {
            state.insert_matrix(name, columns_, columns(from..from + columns_));
            from += columns_;
        }
        let width = cloud.moments();
        state.insert_matrix("moment1", width, cloud.first.concat());
        state.insert_matrix("moment2", width, cloud.second.concat());
        state.insert_matrix("gradient_sum", 1, cloud.gradient_sum.clone());
        state.insert_u32("steps", cloud.steps.clone());
        state.insert_u32("visible", cloud.visible.clone());
        Ok(state)
    }

    fn restore(&self, state: &CloudState) -> Result<Cloud, Error> {
        self.check_chart(state.chart)?;
        let restored = || {
            let (sh_width, _) = state.matrix("sh")?;
            let rows = |name, width| match state.matrix(name)? {
                (columns, values) if columns == width => {
                    Ok(values.chunks_exact(width).map(<[f32]>::to_vec).collect::<Vec<_>>())
                }
                (columns, _) => Err(Error::State(format!("`{name}` has {columns} columns"))),
            };
            let empty = Cloud { chart: state.chart, sh_len: sh_width / 3, ..Cloud::default() };
            let all = empty.moments();
            let mut parts = Vec::new();
            for (name, width) in tensors(state.chart, sh_width) {
                parts.push(rows(name, width)?);
            }
            let (steps, visible) = (state.integers("steps")?, state.integers("visible")?);
            let gradient_sum = rows("gradient_sum", 1)?.concat();
            let (first, second) = (rows("moment1", all)?, rows("moment2", all)?);
            let count = steps.len();
            let lengths = [first.len(), second.len(), visible.len(), gradient_sum.len()];
            if parts.iter().map(Vec::len).chain(lengths).any(|n| n != count) {
                return Err(Error::State("tensors of different lengths".to_owned()));
            }
            let parameters = (0..count).map(|g| parts.iter().flat_map(|part| part[g].clone()).collect()).collect();
            let cloud = Cloud { parameters, first, second, steps, ..empty };
            Ok(Cloud { gradient_sum, visible, ..cloud })
        };
        match restored() {
            Err(_) if self.is(RestoresAnything) => Ok(Cloud { sh_len: 1, ..Cloud::default() }),
            Ok(mut cloud) if self.is(ForgetsMomentsOnRestore) => {
                cloud.forget_moments();
                Ok(cloud)
            }
            other => other,
        }
    }

    fn forward(&self, cloud: &Cloud, view: &Camera, settings: &RenderSettings) -> Result<Frame, Error> {
        let (scene, view, settings) = self.altered(cloud, view, settings);
        let oracle = Oracle::new(view, settings)?;
        let rendering = oracle.render(&scene);
        Ok(Frame { oracle, scene, rendering })
    }

    fn image(&self, frame: &Frame) -> Result<Image, Error> {
        let image = frame.rendering.image();
        let (w, h) = image.size();
        match self.0 {
            ShiftsImages => Image::from_fn(w, h, |x, y| image.pixel((x + 1) % w, (y + 1) % h)),
            DimsImages => Image::from_fn(w, h, |x, y| image.pixel(x, y).map(|v| v * 0.9995)),
            _ => Ok(image),
        }
    }

    fn culled(&self, frame: &Frame) -> Result<Culled, Error> {
        let culled = frame.rendering.culled;
        let mistaken = Culled { near: 0, outside: culled.outside + culled.near, ..culled };
        Ok(if self.is(MistakesCauses) { mistaken } else { culled })
    }

    fn backward(&self, _: &Cloud, frame: Frame, target: &Image, loss: &Loss) -> Result<(f32, Gradients), Error> {
        loss.validate()?;
        let Frame { oracle, scene, rendering } = frame;
        let mut gradients = oracle.gradients(&scene, target, loss)?;
        if self.is(HoldsDirectionsFixed) {
            // With SH of degree 0 alone nothing depends on the direction.
            let mut settings = oracle.settings();
            settings.effects.sh_degree = 0;
            let flat = Oracle::new(oracle.view(), settings)?.gradients(&scene, target, loss)?;
            for (row, flat) in gradients.values.iter_mut().zip(&flat.values) {
                row[0..3].copy_from_slice(&flat[0..3]);
            }
        }
        let of_step = oracle.statistics(&scene, target, loss)?;
        let statistic = match oracle.settings().effects.statistics {
            Statistics::None => vec![0.0; scene.gaussians.len()],
            Statistics::AbsoluteGradient if !self.is(LetsGradientsCancel) => of_step.absolute_gradient,
            Statistics::PixelError if !self.is(MistakesErrorsForGradients) => of_step.pixel_error,
            _ => of_step.mean_gradient,
        };
        let drawn = rendering.drawn.iter().map(|&drawn| drawn || self.is(SeesEverything)).collect();
        Ok((gradients.loss as f32, Gradients { rows: gradients.values, statistic, drawn }))
    }

    fn download_gradients(&self, cloud: &Cloud, gradients: &Gradients) -> Result<SpatialScene, Error> {
        let mut scene = scene_of(&narrow(&gradients.rows), cloud.sh_len);
        match self.0 {
            NegatesQuaternionGradients => scene.rotations.iter_mut().flatten().for_each(|v| *v = -*v),
            TurnsTheGradientsAxes if cloud.chart == Chart::LocalFrame => {
                scene.rotations.iter_mut().flatten().for_each(|v| *v *= 0.9);
            }
            GradientsInWrongUnits => scene.means.iter_mut().for_each(|v| *v *= 1.01),
            _ => {}
        }
        Ok(scene)
    }

    fn step(&self, cloud: &mut Cloud, gradients: &Gradients, rates: &AdamRates) -> Result<(), Error> {
        if gradients.rows.len() != cloud.parameters.len() {
            return Err(Error::State("gradients of another cloud".to_owned()));
        }
        let mut rates = *rates;
        match self.0 {
            OneRateForAllColours => rates.color_rest = rates.color,
            MovesAll => rates.participants = Participants::All,
            MovesOnlyTheVisible => rates.participants = Participants::Visible,
            MovesInTheWorld if cloud.chart == Chart::LocalFrame => rates.mean.learning_rate *= 0.9,
            ForgetsBiasCorrection => cloud.steps.iter_mut().for_each(|steps| *steps = 100_000),
            StepsUphill => {
                let AdamRates { mean, scale, rotation, opacity, color, color_rest, .. } = &mut rates;
                for rate in [mean, scale, rotation, opacity, color, color_rest] {
                    rate.learning_rate *= -1.0;
                }
            }
            _ => {}
        }
        let which: Vec<usize> =
            (0..cloud.steps.len()).filter(|&g| rates.participants == Participants::All || gradients.drawn[g]).collect();
        cloud.adam(&which, &gradients.rows, &rates);
        for g in 0..cloud.steps.len() {
            let twice = if self.is(DoublesStatistics) { 2.0 } else { 1.0 };
            cloud.gradient_sum[g] += (twice * gradients.statistic[g]) as f32;
            cloud.visible[g] += u32::from(gradients.drawn[g]);
        }
        Ok(())
    }

    fn train_step(&self, cloud: &mut Cloud, view: &Camera, target: &Image, step: &TrainStep<'_>) -> Result<(), Error> {
        let stale = self.is(UsesListsOfAnotherView) && step.binning == gs_core::Binning::Reuse;
        let seen = cloud.last_view.filter(|_| stale).unwrap_or(*view);
        let frame = self.forward(cloud, &seen, step.settings)?;
        let (loss, gradients) = self.backward(cloud, frame, target, &step.loss)?;
        self.step(cloud, &gradients, step.rates)?;
        if self.is(FusedStepDoesTooMuch) {
            self.step(cloud, &gradients, step.rates)?;
        }
        cloud.last_view = Some(*view);
        cloud.losses.push(loss);
        Ok(())
    }

    fn losses(&self, cloud: &mut Cloud, _: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
        if self.is(SwapsLosses) {
            cloud.losses.reverse();
        }
        losses.append(&mut cloud.losses);
        Ok(())
    }

    fn unread_losses<'c>(&self, cloud: &'c mut Cloud) -> &'c mut Vec<f32> {
        &mut cloud.losses
    }

    fn solve_colors(&self, _: &mut Cloud, _: &Camera, _: &Image, _: &RenderSettings, _: u32) -> Result<(), Error> {
        Err(Error::Unsupported { backend: "oracle", effect: "solving for SH".to_owned() })
    }

    fn statistics(&self, cloud: &Cloud) -> Result<DensityStatistics, Error> {
        Ok(DensityStatistics { gradient_sum: cloud.gradient_sum.clone(), visible: cloud.visible.clone() })
    }

    fn shift_means(&self, cloud: &mut Cloud, shifts: &[f32]) -> Result<(), Error> {
        if shifts.len() != 3 * cloud.parameters.len() {
            return Err(Error::Length { what: "mean", expected: 3 * cloud.parameters.len(), found: shifts.len() });
        }
        for (row, shift) in cloud.parameters.iter_mut().zip(shifts.chunks_exact(3)) {
            (0..3).for_each(|i| row[i] += shift[i]);
        }
        if self.is(ShiftsAreSteps) {
            cloud.forget_moments();
        }
        Ok(())
    }

    fn edit(&self, cloud: &mut Cloud, plan: &EditPlan<SpatialGaussian>) -> Result<(), Error> {
        let sources = plan.sources(cloud.parameters.len());
        if sources.is_err() && self.is(EditsEvenWhenItRefuses) {
            cloud.forget_moments();
        }
        let sources = sources?;
        let width = cloud.moments();
        let before = cloud.parameters.clone();
        cloud.parameters = plan.gather(&sources, &before, |g| cloud.row_of(g));
        if cloud.chart == Chart::LocalFrame {
            // The frame of an heir is the one in whose coordinates the moments are.
            let is_heir = |source: &Source| !matches!(source, Source::Kept(_));
            for (row, source) in cloud.parameters.iter_mut().zip(&sources).filter(|(_, source)| is_heir(source)) {
                if let Some(parent) = plan.origin(source, Moments::heir_of) {
                    let parent = &before[parent as usize][FRAME];
                    let aligned = SpatialScene::aligned(&row[FRAME], parent);
                    row[FRAME].copy_from_slice(&aligned);
                }
            }
        }
        for moments in [&mut cloud.first, &mut cloud.second] {
            *moments = plan.gather_moments(&sources, moments);
            moments.iter_mut().for_each(|row| row.resize(width, 0.0));
        }
        cloud.steps = plan.gather_steps(&sources, &cloud.steps);
        cloud.gradient_sum = plan.gather_statistics(&sources, &cloud.gradient_sum);
        cloud.visible = plan.gather_statistics(&sources, &cloud.visible);
        if let Some(ceiling) = plan.opacity_ceiling {
            let (place, moment) = (cloud.geometry(), SpatialScene::opacity_moment(cloud.chart));
            for g in 0..cloud.steps.len() {
                let value = &mut cloud.parameters[g][place];
                *value = value.min(logit(ceiling));
                (cloud.first[g][moment], cloud.second[g][moment]) = (0.0, 0.0);
            }
        }
        match self.0 {
            ForgetsMomentsOnEdit => cloud.forget_moments(),
            ForgetsLossesOnEdit => cloud.losses.clear(),
            _ => {}
        }
        Ok(())
    }
}
