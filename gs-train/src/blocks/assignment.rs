//! What each Gaussian and each block contribute to views, as blending weights.

use glam::Vec3;
use gs_core::{Camera, Image, Parameterization, Rasterizer, RenderSettings, Scene as _, Scene3d};
use gs_io::dataset::Window;

use crate::{
    error::Error,
    train::plain,
    views::{blending_weights, color_gradients, colorless},
};

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
    /// A rectangle with nearly all of what the block contributes, as shares of the view's sides: left, top, right and
    /// bottom; `None` for the whole view. Gaussians count as opaque discs, so that faint and long ones may reach beyond.
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
        let grey = on.upload(&plain(scene), Parameterization::ScaleRotation)?;
        Ok(Self { on, scene, grey, render: colorless(render) })
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
    /// whether a Gaussian is in a set. Each view is drawn once, for however many sets.
    pub(super) async fn contributions(
        &self,
        sets: usize,
        contains: impl Fn(usize, usize) -> bool,
        cameras: &[Camera],
    ) -> Result<Vec<Vec<Contribution>>, Error> {
        let sets_of = |index: usize| (0..sets).filter(|&set| contains(set, index)).collect();
        let sets_of: Vec<Vec<usize>> = (0..self.scene.len()).map(sets_of).collect();
        let mut found = vec![Vec::with_capacity(cameras.len()); sets];
        for camera in cameras {
            let maps = Image::from_fn(camera.width, camera.height, |x, y| [1.0, x as f32 + 0.5, y as f32 + 0.5])?;
            let sums = color_gradients((self.on, &self.grey), camera, &self.render, &maps, 1.0).await?;
            let mut of_sets = vec![Lines::new(camera); sets];
            for (sum, sets) in sums.iter().zip(&sets_of) {
                sets.iter().for_each(|&set| of_sets[set].add(*sum));
            }
            let all = sums.iter().map(|sum| f64::from(sum.x)).sum();
            found.iter_mut().zip(&of_sets).for_each(|(found, lines)| found.push(lines.contribution(all)));
        }
        Ok(found)
    }
}

/// The blending weights of some Gaussians in each column and each row of a view, px.
#[derive(Debug, Clone)]
struct Lines {
    columns: Vec<f64>,
    rows: Vec<f64>,
}

impl Lines {
    fn new(camera: &Camera) -> Self {
        Self { columns: vec![0.0; camera.width as usize], rows: vec![0.0; camera.height as usize] }
    }

    /// Adds a Gaussian by the sum of its weights, and the sums of each weight times its column and its row. The
    /// Gaussian is taken for an opaque disc.
    fn add(&mut self, Vec3 { x: weight, y: across, z: down }: Vec3) {
        if weight > 0.0 {
            let radius = (weight / std::f32::consts::PI).sqrt();
            for (lines, at) in [(&mut self.columns, across / weight), (&mut self.rows, down / weight)] {
                let line = |at: f32| (at.max(0.0) as usize).min(lines.len() - 1);
                let reached = line(at - radius)..=line(at + radius);
                let each = f64::from(weight) / reached.clone().count() as f64;
                lines[reached].iter_mut().for_each(|line| *line += each);
            }
        }
    }

    /// The contribution to a view with this sum of weights.
    fn contribution(&self, all: f64) -> Contribution {
        let Self { columns, rows } = self;
        let sum: f64 = rows.iter().sum();
        let share = if all > 0.0 { sum / all } else { 0.0 };
        let (across, down) = (within(columns, sum), within(rows, sum));
        let pixels = (columns.len() * rows.len()) as f64;
        if share >= WHOLE || (across.len() * down.len()) as f64 >= WHOLE * pixels {
            return Contribution { share, window: None };
        }
        let side = |range: std::ops::Range<usize>, size: usize| {
            let [from, to] = [range.start, range.end].map(|at| at as f32 / size as f32);
            let padding = PADDING * (to - from);
            [(from - padding).max(0.0), (to + padding).min(1.0)]
        };
        let ([left, right], [top, bottom]) = (side(across, columns.len()), side(down, rows.len()));
        Contribution { share, window: Some([left, top, right, bottom]) }
    }
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
        let camera = Camera::looking_forward(200, 100, 1.0);
        let pixels = |of: fn(u32, u32) -> f32| {
            let mut lines = Lines::new(&Camera::looking_forward(20, 10, 1.0));
            for (x, y) in (0..200).map(|pixel| (pixel % 20, pixel / 20)) {
                lines.add(of(x, y) * Vec3::new(1.0, x as f32 + 0.5, y as f32 + 0.5));
            }
            lines.contribution(200.0)
        };
        let part = pixels(|x, y| if (5..15).contains(&x) && y < 5 { 0.5 } else { 0.001 });
        assert!((part.share - (25.0 + 0.15) / 200.0).abs() < 1e-6, "{part:?}");
        assert_eq!(part.window_of(&camera), Some(Window { left: 40, top: 0, width: 120, height: 55 }));
        assert_eq!(pixels(|_, _| 0.2).window_of(&camera), None);
        let nothing = pixels(|_, _| 0.0);
        assert_eq!((nothing.share, nothing.window_of(&camera).map(|w| (w.width, w.height))), (0.0, Some((1, 1))));
        // A Gaussian that covers 28 pixels around (12, 4), whose disc has a radius of 3 px.
        let mut lines = Lines::new(&Camera::looking_forward(20, 10, 1.0));
        lines.add(28.0 * Vec3::new(1.0, 12.0, 4.0));
        let window = lines.contribution(200.0).window_of(&camera);
        assert_eq!(window, Some(Window { left: 84, top: 4, width: 72, height: 72 }));
    }

    #[test]
    fn a_drawing_gives_the_shares_and_windows_of_all_sets() {
        // Opaque discs of 1,257 px, left and right of the middle of a view of 200 by 100 px.
        let disc = |x: f32| gs_core::Gaussian3d {
            mean: Vec3::new(x, 0.0, 100.0),
            log_scale: Vec3::new(1.8, 1.8, -6.0),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 4.0,
            sh: vec![Vec3::ZERO],
        };
        let scene: Scene3d = [disc(-50.0), disc(50.0), disc(50.0)].into_iter().collect();
        let camera = Camera { focal: [100.0; 2].into(), ..Camera::looking_forward(200, 100, 1.0) };
        let on = gs_cpu::CpuRasterizer::new(gs_cpu::CpuSettings::default()).unwrap();
        let coarse = Coarse::new(&on, &scene, &crate::TrainSettings::default().render).unwrap();
        let sets = |set: usize, index: usize| [index == 0, index > 0, true, false][set];
        let found = pollster::block_on(coarse.contributions(4, sets, &[camera, camera])).unwrap();
        let shares: Vec<f64> = found.iter().map(|of_views| of_views[0].share).collect();
        let near = |a: f64, b: f64| (a - b).abs() < 1e-4;
        assert!(near(shares[0] + shares[1], 1.0) && near(shares[2], 1.0) && shares[3] == 0.0, "{shares:?}");
        assert!(shares[1] > shares[0], "two discs cover more than one: {shares:?}");
        let windows: Vec<_> = found.iter().map(|of_views| of_views[1].window_of(&camera)).collect();
        let [Some(left), Some(right), None, _] = windows[..] else { panic!("{windows:?}") };
        let middle = |window: Window| window.left + window.width / 2;
        assert_eq!((middle(left), middle(right)), (50, 150));
        assert!(left.width > 20 && left.width < 60 && left.height > 20 && left.height < 60, "{left:?}");
    }
}
