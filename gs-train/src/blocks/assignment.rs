//! What each Gaussian and each block contribute to views, as blending weights.

use glam::Vec3;
use gs_core::{
    Camera, Image, Parameterization, Rasterizer, RenderSettings, Scene as _, Scene3d, constants::SH_C0,
    effects::Statistics,
};
use gs_io::dataset::Window;

use crate::{
    edit::{blending_weights, colorless},
    error::Error,
    train::plain,
};

/// Blocks whose contributions are drawn at once: one for each channel.
const AT_ONCE: usize = 3;

/// Share of a block's weights in a view that may lie beyond each side of its window: a few pixels far from all others
/// would make windows whole views.
const BEYOND: f64 = 0.02;

/// What is added to a window at each side, as a share of the window's side: what lies near it changes little in it.
const PADDING: f32 = 0.1;

/// Share of a view's pixels, or of its weights, from which a window is the whole view.
const WHOLE: f64 = 0.8;

/// What a block contributes to a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Contribution {
    /// Share of the view's blending weights.
    pub(super) share: f64,
    /// The pixels that the block contributes to, as shares of the view's sides: left, top, right and bottom; `None`
    /// for the whole view.
    pub(super) window: Option<[f32; 4]>,
}

/// A coarse scene, which is only looked at.
pub(super) struct Coarse<'a, R: Rasterizer<Scene3d>> {
    on: &'a R,
    scene: &'a Scene3d,
    grey: R::Splats,
    render: RenderSettings,
}

impl<'a, R: Rasterizer<Scene3d>> Coarse<'a, R> {
    /// `render` draws the scene.
    pub(super) fn new(on: &'a R, scene: &'a Scene3d, render: &RenderSettings) -> Result<Self, Error> {
        let render = colorless(render).with(|s| s.effects.statistics = Statistics::None);
        Ok(Self { on, scene, grey: on.upload(&plain(scene), Parameterization::ScaleRotation)?, render })
    }

    /// The sum of each Gaussian's blending weights over views, px, `[N]`.
    pub(super) async fn weights(&self, cameras: &[Camera]) -> Result<Vec<f64>, Error> {
        let mut sums = vec![0.0; self.scene.len()];
        for camera in cameras {
            let weights = blending_weights((self.on, &self.grey), camera, &self.render).await?;
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += f64::from(weight));
        }
        Ok(sums)
    }

    /// What each of several sets of Gaussians contributes to each view, `[sets][views]`. `contains(set, index)` says
    /// whether a Gaussian is in a set.
    pub(super) async fn contributions(
        &self,
        sets: usize,
        contains: impl Fn(usize, usize) -> bool,
        cameras: &[Camera],
    ) -> Result<Vec<Vec<Contribution>>, Error> {
        let mut alphas = Vec::with_capacity(cameras.len());
        for camera in cameras {
            let (alpha, _) = self.on.draw(&self.grey, camera, &self.render.of_alpha()).await?;
            alphas.push(alpha.pixels().iter().map(|pixel| f64::from(pixel[0])).sum::<f64>());
        }
        let mut found = Vec::with_capacity(sets);
        for first in (0..sets).step_by(AT_ONCE) {
            let mut marked = plain(self.scene);
            for (index, sh) in marked.sh.iter_mut().enumerate() {
                let color = [0, 1, 2].map(|k| if first + k < sets && contains(first + k, index) { 1.0 } else { 0.0 });
                *sh = (Vec3::from_array(color) - 0.5) / SH_C0;
            }
            let splats = self.on.upload(&marked, Parameterization::ScaleRotation)?;
            let mut of_sets = vec![Vec::with_capacity(cameras.len()); AT_ONCE.min(sets - first)];
            for (camera, alpha) in cameras.iter().zip(&alphas) {
                let (image, _) = self.on.draw(&splats, camera, &self.render).await?;
                let of_channel =
                    |(channel, of_set): (usize, &mut Vec<_>)| of_set.push(contribution(&image, channel, *alpha));
                of_sets.iter_mut().enumerate().for_each(of_channel);
            }
            found.extend(of_sets);
        }
        Ok(found)
    }
}

/// The contribution in one channel to a view with this sum of weights.
fn contribution(image: &Image, channel: usize, all: f64) -> Contribution {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let (mut columns, mut rows) = (vec![0.0; width], vec![0.0; height]);
    for (index, pixel) in image.pixels().iter().enumerate() {
        columns[index % width] += f64::from(pixel[channel]);
        rows[index / width] += f64::from(pixel[channel]);
    }
    let sum: f64 = rows.iter().sum();
    let share = if all > 0.0 { sum / all } else { 0.0 };
    let (across, down) = (within(&columns, sum), within(&rows, sum));
    if share >= WHOLE || (across.len() * down.len()) as f64 >= WHOLE * (width * height) as f64 {
        return Contribution { share, window: None };
    }
    let side = |range: std::ops::Range<usize>, size: usize| {
        let [from, to] = [range.start, range.end].map(|at| at as f32 / size as f32);
        let padding = PADDING * (to - from);
        [(from - padding).max(0.0), (to + padding).min(1.0)]
    };
    let ([left, right], [top, bottom]) = (side(across, width), side(down, height));
    Contribution { share, window: Some([left, top, right, bottom]) }
}

/// The lines of an image that hold all of a sum but [`BEYOND`] on each side; none of a sum of 0.
fn within(lines: &[f64], sum: f64) -> std::ops::Range<usize> {
    let first = |lines: &mut dyn Iterator<Item = &f64>| {
        let mut beyond = 0.0;
        lines
            .take_while(|line| {
                beyond += **line;
                beyond <= BEYOND * sum
            })
            .count()
    };
    let from = first(&mut lines.iter());
    from..lines.len().saturating_sub(first(&mut lines.iter().rev())).max(from)
}

impl Contribution {
    /// The window of a view of this size; `None` for the whole view.
    pub(super) fn window_of(&self, camera: &Camera) -> Option<Window> {
        let [left, top, right, bottom] = self.window?;
        let side = |from: f32, to: f32, size: u32| {
            let from = ((from * size as f32).round() as u32).min(size - 1);
            (from, ((to * size as f32).round() as u32).clamp(from + 1, size) - from)
        };
        let ((left, width), (top, height)) = (side(left, right, camera.width), side(top, bottom, camera.height));
        Some(Window { left, top, width, height })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_hold_nearly_all_weights_and_some_more() {
        let image =
            Image::from_fn(20, 10, |x, y| [if (5..15).contains(&x) && y < 5 { 0.5 } else { 0.001 }, 0.2, 0.0]).unwrap();
        let camera = Camera::looking_forward(200, 100, 1.0);
        let part = contribution(&image, 0, 200.0);
        assert!((part.share - (25.0 + 0.15) / 200.0).abs() < 1e-6, "{part:?}");
        assert_eq!(part.window_of(&camera), Some(Window { left: 40, top: 0, width: 120, height: 55 }));
        assert_eq!(contribution(&image, 1, 200.0).window_of(&camera), None);
        let nothing = contribution(&image, 2, 0.0);
        assert_eq!((nothing.share, nothing.window_of(&camera).map(|w| (w.width, w.height))), (0.0, Some((1, 1))));
    }
}
