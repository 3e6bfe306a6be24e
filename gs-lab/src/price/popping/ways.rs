//! The two ways of drawing a scene that a flight compares.

use gs_core::{Camera, Image, LodNode, Optimizer, RenderSettings, Scene3d, effects::Order};
use gs_io::{LevelsInMemory, LodFile3d};
use gs_train::Error;

use crate::price::{Loaded, Renderer as _};

/// Frames a second of a flight, which transitions between levels depend on.
const RATE: f64 = 60.0;

/// Most bytes of levels that were drawn before.
const ROOM: usize = 1 << 30;

/// Two ways of drawing a scene while the camera moves.
pub(crate) trait Ways {
    /// What distinguishes them.
    fn what(&self) -> &'static str;

    fn names(&self) -> [&'static str; 2];

    /// A frame in both ways. Stretches begin with frame 0.
    fn frames(&mut self, number: usize, camera: &Camera) -> Result<[Image; 2], Error>;
}

/// A scene in both orders.
pub(crate) struct Orders<'r, R: Optimizer<Scene3d>> {
    pub(crate) on: Loaded<&'r R, Scene3d>,
    pub(crate) render: RenderSettings,
}

impl<R: Optimizer<Scene3d>> Ways for Orders<'_, R> {
    fn what(&self) -> &'static str {
        "order"
    }

    fn names(&self) -> [&'static str; 2] {
        [Order::Global, Order::PerPixel].map(Order::name)
    }

    fn frames(&mut self, _: usize, camera: &Camera) -> Result<[Image; 2], Error> {
        let image = |order| self.on.image(camera, &self.render.with(|s| s.effects.order = order));
        Ok([image(Order::Global)?, image(Order::PerPixel)?])
    }
}

/// The levels of detail that each frame needs, drawn at once, and with transitions.
pub(crate) struct Levels<'r, R: Optimizer<Scene3d>> {
    rasterizer: &'r R,
    render: RenderSettings,
    levels: [LevelsInMemory; 2],
    /// Most Gaussians of a frame.
    budget: usize,
    /// What was drawn last at once, and its levels.
    drawn: Option<(Vec<usize>, Loaded<&'r R, Scene3d>)>,
}

impl<'r, R: Optimizer<Scene3d>> Levels<'r, R> {
    pub(crate) fn new(rasterizer: &'r R, file: &LodFile3d, budget: usize, render: RenderSettings) -> Self {
        let levels = [(), ()].map(|()| LevelsInMemory::of(file.clone(), ROOM));
        Self { rasterizer, render, levels, budget, drawn: None }
    }
}

impl<R: Optimizer<Scene3d>> Ways for Levels<'_, R> {
    fn what(&self) -> &'static str {
        "levels"
    }

    fn names(&self) -> [&'static str; 2] {
        ["at once", "transition"]
    }

    fn frames(&mut self, number: usize, camera: &Camera) -> Result<[Image; 2], Error> {
        let [at_once, fading] = &mut self.levels;
        let cut = at_once.tree().cut(&[*camera], self.budget, LodNode::USUAL_ERROR_PX)?.levels;
        if number == 0 {
            fading.shown(&cut);
        }
        let faded = fading.read_at(&cut, camera, number as f64 / RATE)?;
        let second = Loaded::new(self.rasterizer, &faded)?.image(camera, &self.render)?;
        if self.drawn.as_ref().is_none_or(|(levels, _)| *levels != cut) {
            let scene = at_once.read(&cut)?;
            self.drawn = Some((cut, Loaded::new(self.rasterizer, &scene)?));
        }
        let first = self.drawn.as_ref().map(|(_, on)| on.image(camera, &self.render)).transpose()?;
        Ok([first.unwrap_or_else(|| second.clone()), second])
    }
}
