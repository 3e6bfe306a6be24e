//! The frame of a new backend: every required method, here handed on to gs-cpu. Replace one method
//! after the other by your own, and run the suite after each.
//!
//! `cargo run --release -p gs-conformance --example own_backend`
#![allow(clippy::print_stdout)]

use gs_conformance::{Failure, conformance::conformance};
use gs_core::{
    AdamRates, Backend, Canvas, Culled, DensityStatistics, EditPlan, Error, Gaussian2d, Image, Loss, MeanNoise,
    Optimizer, Parameterization, Rasterizer, RenderSettings, Scene2d, SplatsState, TargetImage, TrainStep, Wait,
};
use gs_cpu::{CpuRasterizer, CpuSettings};

/// What the methods that are not yet your own run on.
struct Mine(CpuRasterizer);

type Sound = CpuRasterizer;

impl Backend for Mine {
    fn describe(&self) -> String {
        "mine".to_owned()
    }
}

/// Enough to draw, and to optimise a scene with a loss and an optimizer of the caller's own. `loss`,
/// `draw` and `render` have defaults.
impl Rasterizer<Scene2d> for Mine {
    type Splats = <Sound as Rasterizer<Scene2d>>::Splats;
    type ForwardPass = <Sound as Rasterizer<Scene2d>>::ForwardPass;
    type Gradients = <Sound as Rasterizer<Scene2d>>::Gradients;
    type Target = <Sound as Rasterizer<Scene2d>>::Target;

    fn upload(&self, scene: &Scene2d, parameterization: Parameterization) -> Result<Self::Splats, Error> {
        self.0.upload(scene, parameterization)
    }

    async fn forward(
        &self,
        splats: &Self::Splats,
        view: &Canvas,
        settings: &RenderSettings,
    ) -> Result<Self::ForwardPass, Error> {
        // An effect that this backend lacks: an error that names it, and the suite skips its cases.
        // return Err(Error::Unsupported { backend: "mine", effect: "blend `over`".to_owned() });
        Rasterizer::<Scene2d>::forward(&self.0, splats, view, settings).await
    }

    async fn image(&self, pass: &Self::ForwardPass) -> Result<Image, Error> {
        self.0.for_2d().image(pass).await
    }

    fn culled(&self, pass: &Self::ForwardPass) -> Culled {
        self.0.for_2d().culled(pass)
    }

    fn upload_target<'a>(&self, target: impl Into<TargetImage<'a>>) -> Result<Self::Target, Error> {
        self.0.for_2d().upload_target(target)
    }

    async fn backward(
        &self,
        splats: &Self::Splats,
        pass: Self::ForwardPass,
        target: &Self::Target,
        loss: &Loss,
    ) -> Result<(f32, Self::Gradients), Error> {
        self.0.for_2d().backward(splats, pass, target, loss).await
    }

    async fn image_vjp(
        &self,
        splats: &Self::Splats,
        pass: Self::ForwardPass,
        v_image: &Image,
    ) -> Result<Self::Gradients, Error> {
        self.0.for_2d().image_vjp(splats, pass, v_image).await
    }

    async fn gradients(&self, splats: &Self::Splats, gradients: &Self::Gradients) -> Result<Scene2d, Error> {
        self.0.for_2d().gradients(splats, gradients).await
    }

    async fn download(&self, splats: &Self::Splats) -> Result<Scene2d, Error> {
        self.0.for_2d().download(splats).await
    }

    fn len(&self, splats: &Self::Splats) -> usize {
        self.0.for_2d().len(splats)
    }
}

/// Training. `saved` has a default.
impl Optimizer<Scene2d> for Mine {
    async fn train_step(
        &self,
        splats: &mut Self::Splats,
        view: &Canvas,
        target: &Self::Target,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        self.0.for_2d().train_step(splats, view, target, step).await
    }

    async fn losses(&self, splats: &mut Self::Splats, wait: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
        self.0.for_2d().losses(splats, wait, losses).await
    }

    async fn step(
        &self,
        splats: &mut Self::Splats,
        gradients: &Self::Gradients,
        rates: &AdamRates,
    ) -> Result<(), Error> {
        self.0.for_2d().step(splats, gradients, rates).await
    }

    async fn statistics(&self, splats: &Self::Splats) -> Result<DensityStatistics, Error> {
        self.0.for_2d().statistics(splats).await
    }

    async fn edit(&self, splats: &mut Self::Splats, plan: &EditPlan<Gaussian2d>) -> Result<(), Error> {
        self.0.for_2d().edit(splats, plan).await
    }

    fn add_noise(&self, splats: &mut Self::Splats, noise: &MeanNoise) -> Result<(), Error> {
        self.0.for_2d().add_noise(splats, noise)
    }

    async fn solve_colors(
        &self,
        splats: &mut Self::Splats,
        view: &Canvas,
        target: &Self::Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        self.0.for_2d().solve_colors(splats, view, target, settings, iterations).await
    }

    async fn save(&self, splats: &Self::Splats) -> Result<SplatsState, Error> {
        self.0.for_2d().save(splats).await
    }

    fn restore(&self, state: &SplatsState) -> Result<Self::Splats, Error> {
        self.0.for_2d().restore(state)
    }
}

fn main() -> Result<(), Failure> {
    let backend = Mine(CpuRasterizer::new(CpuSettings::default()).expect("every machine has a CPU"));
    let skipped = conformance(&backend)?;
    skipped.iter().for_each(|case| println!("{case}"));
    println!("{} conforms; {} cases were skipped", backend.describe(), skipped.len());
    Ok(())
}
