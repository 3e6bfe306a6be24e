//! The target, the settings and the backend that these tests share.

use gs_core::{Blend, Image};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_train::{ColorSolve, FitSettings, InitialCount, Rounds};

/// A rasterizer with two threads on any machine.
pub(crate) fn rasterizer() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(2);
        s.level = None;
    }))
    .expect("two threads can be started")
}

/// 48×40 px of ramps and an edge.
pub(crate) fn small_target() -> Image {
    Image::from_fn(48, 40, |x, y| {
        let (x, y) = (x as f32 / 48.0, y as f32 / 40.0);
        if (x - 0.4).hypot(y - 0.6) < 0.25 { [0.9, 0.2, 0.1] } else { [0.2 + 0.5 * x, 0.8 - 0.4 * y, 0.5 * x * y] }
    })
    .expect("the size is possible")
}

/// 42 steps from 20 Gaussians to at most 60, with three rounds.
pub(crate) fn small_fit(blend: Blend) -> FitSettings {
    let mut settings = FitSettings::for_image(60, (48, 40), 42).with(|s| {
        s.initial = InitialCount::Fixed(20);
        s.rounds = Rounds::until(10, 30);
        s.rebin_every = 4;
        s.color_solve = ColorSolve::default().with(|s| {
            s.at_start = 5;
            s.after_edit = 2;
        });
    });
    settings.render.effects.blend = blend;
    settings
}
