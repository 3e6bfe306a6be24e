//! A 3D scene and the views of it that these tests share.

use std::sync::{Arc, Mutex};

use glam::{Vec2, Vec3};
use gs_core::{
    Blend, Camera, EditPlan, Gaussian3d, Rasterizer, RenderSettings, Scene, Scene3d, constants::SH_C0, effects::Order,
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_density::{DensityPolicy, Evidence, EvidenceRequest, Needs, Observation, Rng};
use gs_io::dataset::PosedImage;
use gs_train::{
    Rounds, TrainPreset, TrainSettings,
    train::{PosedView, Views},
};
use pollster::FutureExt as _;

/// A rasterizer with two threads on any machine.
pub(crate) fn rasterizer() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(2);
        s.level = None;
    }))
    .expect("two threads can be started")
}

/// 48×40 px.
pub(crate) const LENS: (u32, u32) = (48, 40);

/// Numbers between 0 and 1 without pattern, from an integer.
fn scattered(i: usize, k: usize) -> f32 {
    let mixed = (i as u32 * 31 + k as u32 + 1).wrapping_mul(0x9e37_79b9);
    ((mixed ^ (mixed >> 15)).wrapping_mul(0x85eb_ca6b) >> 8) as f32 / (1 << 24) as f32
}

/// Gaussians of all colours within about 1 of the origin.
pub(crate) fn thirty() -> Scene3d {
    let mut scene = Scene3d::default();
    for i in 0..30 {
        let at = |k| scattered(i, k);
        let color = Vec3::new(at(0), at(1), at(2));
        scene.push(Gaussian3d {
            mean: 1.6 * Vec3::new(at(3), at(4), at(5)) - 0.8,
            log_scale: (0.1 + 0.25 * Vec3::new(at(6), at(7), at(8))).map(f32::ln),
            rotation: [1.0, at(9), at(10), at(11)],
            opacity_logit: 1.0 + 3.0 * at(12),
            sh: vec![(color - 0.5) / SH_C0],
        });
    }
    scene
}

/// The camera of view `i`, on a sphere of radius 4.03 around the origin.
pub(crate) fn camera(i: usize) -> Camera {
    let lens = Camera::looking_forward(LENS.0, LENS.1, 0.7);
    let (angle, height) = (2.4 * i as f32, 0.9 - 1.7 * ((i as f32 * 0.618) % 1.0));
    let around = Vec2::from_angle(angle) * (1.0 - height * height).sqrt();
    lens.looking_at(4.03 * around.extend(height), Vec3::ZERO, Vec3::Z).expect("it does not look straight up")
}

/// The settings with which the images were rendered: a black background, in order of depth.
pub(crate) fn render() -> RenderSettings {
    let mut render = RenderSettings::blended(Blend::Over).on([0.0; 3]);
    render.effects.order = Order::Global;
    render
}

/// Twelve views to train with and three to be judged by.
pub(crate) fn views(rasterizer: &CpuRasterizer) -> Views {
    let view = |i: usize| {
        let camera = camera(i);
        let image = rasterizer.render(&thirty(), &camera, &render()).block_on().expect("the scene can be rendered");
        PosedView::of_image(format!("view-{i:02}"), camera, image.clamped())
    };
    Views::new((0..12).map(view).collect(), (12..15).map(view).collect())
}

/// Returns these views with changed images.
pub(crate) fn changed(views: Views, change: impl Fn(usize, PosedImage) -> PosedImage) -> Views {
    let change = |(i, view): (usize, PosedView)| {
        let image = change(i, view.image().expect("it is in memory"));
        PosedView { source: Arc::new(image), ..view }
    };
    let train = views.train.into_iter().enumerate().map(change).collect();
    Views { train, ..views }
}

/// Settings with few steps and few initial Gaussians, with rounds among the steps.
pub(crate) fn short(iterations: u32) -> TrainSettings {
    let mut settings = TrainPreset::ThreeDgs.settings(Some(iterations));
    settings.gaussians = 600;
    settings.init.random = 300;
    settings.render.effects.sh_degree = 1;
    settings.render.effects.antialias = render().effects.antialias;
    settings.sh_degree_every = iterations / 4;
    settings.rounds = Rounds::until(10, (iterations / 2).max(10));
    settings
}

/// A policy that makes this request in each round, edits nothing, and keeps the last scene and the
/// evidence about it.
pub(crate) struct Curious {
    request: Option<EvidenceRequest>,
    pub(crate) seen: Mutex<Option<(Scene3d, Evidence)>>,
}

impl Curious {
    pub(crate) fn new(request: Option<EvidenceRequest>) -> Arc<Self> {
        Arc::new(Self { request, seen: Mutex::default() })
    }
}

impl DensityPolicy<Scene3d> for Curious {
    fn plan(
        &self,
        observation: &Observation<'_, Scene3d>,
        _: &mut Rng,
    ) -> Result<EditPlan<Gaussian3d>, gs_core::Error> {
        *self.seen.lock().unwrap() = observation.evidence.map(|e| (observation.scene.clone(), e.clone()));
        Ok(EditPlan::default())
    }

    fn needs(&self) -> Needs {
        Needs { evidence: self.request.is_some(), ..Needs::default() }
    }

    fn evidence(&self, _: u32, _: f32) -> Option<EvidenceRequest> {
        self.request
    }
}
