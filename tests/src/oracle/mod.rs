//! The oracle: planar scenes rendered and differentiated in `f64`, densely, one pixel at a time; no tiles, no cut-offs but the
//! defined ones. Slow and obvious; held against finite differences in this crate's own tests.
//!
//! Beside each number the oracle gives what `f32` arithmetic may change it by (`rounding`: a first-order error analysis, so that a
//! needle is allowed more than a disc) and what decisions within rounding of their threshold may change it by (`flip`: the
//! α cut, full pixels, clamped α, the kink of |C − Y|). [`tolerance`](crate::tolerance) makes comparisons of the two.

mod adam;
mod least_squares;
mod loss;
mod parameters;
mod pixel;
mod project;
mod ssim;
mod statistics;

use gs_core::{
    Canvas, Error, Image, Loss, RenderSettings,
    effects::{Antialias, Blend, Order, Outputs},
    statistics::Culled,
};

pub(crate) use self::adam::rate_of;
pub use self::{
    adam::AdamReference,
    least_squares::best_colors,
    parameters::{COLOR, OPACITY, OracleScene, PARAMETER_NAMES, Parameters, ROTATION, rows_of_gradients},
    statistics::StepStatistics,
};
use self::{
    pixel::{Lean, Pixel},
    project::{Projected, Projection},
};
use crate::tolerance::ROUNDINGS;

/// Renders planar scenes through one canvas with one set of settings, and differentiates the result.
#[derive(Debug, Clone, Copy)]
pub struct Oracle {
    view: Canvas,
    settings: RenderSettings,
}

/// An image by the oracle, `[H · W]` row-major each.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendering {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// RGB, not clamped.
    pub pixels: Vec<[f64; 3]>,
    /// What `f32` may change each value by, in roundings: the tolerance is a multiple of it.
    pub rounding: Vec<[f64; 3]>,
    /// What decisions within rounding of their threshold may change each value by; 0 at all but a few pixels.
    pub flip: Vec<[f64; 3]>,
    /// Gaussians left out, by cause; `outside` are those without a pixel centre above the cut.
    pub culled: Culled,
    /// Whether each Gaussian counts at some pixel, `[N]`.
    pub drawn: Vec<bool>,
}

/// A loss and its gradients by the oracle.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradients {
    /// The loss.
    pub loss: f64,
    /// What `f32` may change the loss by, in roundings.
    pub loss_rounding: f64,
    /// What decisions within rounding may change the loss by.
    pub loss_flip: f64,
    /// ∂L/∂(parameter), `[N]`.
    pub values: Vec<Parameters>,
    /// What `f32` may change each by, in roundings, `[N]`.
    pub rounding: Vec<Parameters>,
    /// What decisions within rounding may change each by, `[N]`.
    pub flip: Vec<Parameters>,
}

impl Rendering {
    /// The image in `f32`.
    ///
    /// # Panics
    /// Never for a rendering by the oracle, whose size is that of a valid canvas.
    pub fn image(&self) -> Image {
        let pixels = self.pixels.iter().map(|p| p.map(|v| v as f32)).collect();
        Image::from_pixels(self.width, self.height, pixels).expect("a canvas has a valid size")
    }

    /// Whether pixel `index` (row-major) is within rounding of a discontinuity.
    pub fn is_near_discontinuity(&self, index: usize) -> bool {
        self.flip[index].iter().any(|&v| v > 0.0)
    }
}

impl Oracle {
    /// An oracle for one view.
    ///
    /// # Errors
    /// [`Error::Size`] or [`Error::Setting`] for an impossible view or settings; [`Error::Unsupported`] for effects beyond order by
    /// index, both blends and backgrounds.
    pub fn new(view: Canvas, settings: RenderSettings) -> Result<Self, Error> {
        view.validate()?;
        settings.validate()?;
        let effects = settings.effects;
        if effects.order != Order::Index || effects.antialias != Antialias::None || effects.outputs != Outputs::Color {
            return Err(Error::Unsupported { backend: "oracle", effect: format!("{effects:?}") });
        }
        Ok(Self { view, settings })
    }

    /// The canvas it looks through.
    pub fn view(&self) -> Canvas {
        self.view
    }

    /// The settings it renders with.
    pub fn settings(&self) -> RenderSettings {
        self.settings
    }

    /// Renders a scene.
    pub fn render(&self, scene: &OracleScene) -> Rendering {
        self.rendering(scene, &self.blend(scene, Lean::Exact))
    }

    /// The loss of a scene, without its gradients.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] where the target has not the canvas's size.
    pub fn loss(&self, scene: &OracleScene, target: &Image, loss: &Loss) -> Result<f64, Error> {
        self.check_target(target)?;
        let image = self.render(scene);
        let at = loss::evaluate(loss, self.view.width as usize, &image.pixels, &image.rounding, target, 0.0);
        Ok(at.value)
    }

    /// The loss of a scene and its gradients with respect to every parameter.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] where the target has not the canvas's size.
    pub fn gradients(&self, scene: &OracleScene, target: &Image, loss: &Loss) -> Result<Gradients, Error> {
        self.check_target(target)?;
        let width = self.view.width as usize;
        let exact = self.blend(scene, Lean::Exact);
        let rendering = self.rendering(scene, &exact);
        let at_exact = loss::evaluate(loss, width, &rendering.pixels, &rendering.rounding, target, 0.0);
        let count = scene.gaussians.len();
        let zeros = || vec![[0.0; 9]; count];
        let mut gradients = Gradients {
            loss: at_exact.value,
            loss_rounding: 0.0,
            loss_flip: 0.0,
            values: zeros(),
            rounding: zeros(),
            flip: zeros(),
        };
        for (p, pixel) in exact.iter().enumerate() {
            let (v, v_rounding) = (at_exact.v_color[p], at_exact.v_rounding[p]);
            for (rows, shares) in [
                (&mut gradients.values, pixel.gradients(v)),
                (&mut gradients.rounding, pixel.gradient_rounding(v, v_rounding)),
            ] {
                add(rows, &shares, 1.0);
            }
            for k in 0..3 {
                gradients.loss_rounding += v[k].abs() * rendering.rounding[p][k];
                gradients.loss_flip += 2.0 * v[k].abs() * rendering.flip[p][k];
            }
        }
        // A second opinion from either side: every decision within rounding taken the other way.
        for (lean, direction) in [(Lean::More, 1.0), (Lean::Fewer, -1.0)] {
            let other = self.blend(scene, lean);
            let pixels: Vec<_> = other.iter().map(|pixel| pixel.color).collect();
            let at_other = loss::evaluate(loss, width, &pixels, &rendering.rounding, target, direction * ROUNDINGS);
            for (p, (pixel, twin)) in exact.iter().zip(&other).enumerate() {
                let (v, v_other) = (at_exact.v_color[p], at_other.v_color[p]);
                if pixel.near == 0 && v == v_other {
                    continue;
                }
                let mut change = zeros();
                add(&mut change, &twin.gradients(v_other), 1.0);
                add(&mut change, &pixel.gradients(v), -1.0);
                let several = f64::from(pixel.near.max(1));
                for (row, change) in gradients.flip.iter_mut().zip(&change) {
                    (0..9).for_each(|i| row[i] += several * change[i].abs());
                }
            }
        }
        Ok(gradients)
    }

    fn check_target(&self, target: &Image) -> Result<(), Error> {
        if target.size() == (self.view.width, self.view.height) {
            return Ok(());
        }
        Err(Error::SizesDiffer {
            left_width: self.view.width,
            left_height: self.view.height,
            right_width: target.width(),
            right_height: target.height(),
        })
    }

    fn project(&self, scene: &OracleScene) -> Vec<Projection> {
        scene.gaussians.iter().map(|g| Projection::of(g, &self.view)).collect()
    }

    fn blend(&self, scene: &OracleScene, lean: Lean) -> Vec<Pixel> {
        let drawable: Vec<Option<Projected>> = self
            .project(scene)
            .into_iter()
            .map(|g| match g {
                Projection::Drawable(projected) => Some(projected),
                Projection::NotFinite | Projection::Degenerate => None,
            })
            .collect();
        let centers = (0..self.view.height).flat_map(|y| (0..self.view.width).map(move |x| (x, y)));
        centers
            .map(|(x, y)| Pixel::blend(&drawable, [f64::from(x) + 0.5, f64::from(y) + 0.5], &self.settings, lean))
            .collect()
    }

    fn rendering(&self, scene: &OracleScene, pixels: &[Pixel]) -> Rendering {
        let mut drawn = vec![false; scene.gaussians.len()];
        pixels.iter().flat_map(Pixel::touched).for_each(|index| drawn[index] = true);
        let mut culled = Culled::default();
        let cut = f64::from(self.settings.accuracy.alpha_cut);
        for (g, &drawn) in self.project(scene).iter().zip(&drawn) {
            match g {
                Projection::NotFinite => culled.not_finite += 1,
                Projection::Degenerate => culled.degenerate += 1,
                Projection::Drawable(g) if self.settings.effects.blend == Blend::Over && g.opacity < cut => {
                    culled.transparent += 1;
                }
                Projection::Drawable(_) => culled.outside += u32::from(!drawn),
            }
        }
        Rendering {
            width: self.view.width,
            height: self.view.height,
            pixels: pixels.iter().map(|p| p.color).collect(),
            rounding: pixels.iter().map(|p| p.rounding).collect(),
            flip: pixels.iter().map(|p| p.flip).collect(),
            culled,
            drawn,
        }
    }

    /// The weights of all Gaussians at every pixel, `[H · W]` lists of (Gaussian, w); [`Blend::Sum`].
    fn weights(&self, scene: &OracleScene) -> Vec<Vec<(usize, f64)>> {
        self.blend(scene, Lean::Exact).iter().map(|pixel| pixel.weights().collect()).collect()
    }
}

fn add(rows: &mut [Parameters], shares: &[(usize, Parameters)], factor: f64) {
    for (index, share) in shares {
        (0..9).for_each(|i| rows[*index][i] += factor * share[i]);
    }
}
