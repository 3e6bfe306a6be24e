#![doc = include_str!("../README.md")]
//! # Inside
//!
//! The error analysis is first-order, so a needle is allowed more than a disc. The conformance
//! suite compares in units of [`ROUNDINGS`]. How one Gaussian is seen is in `scene2d` and
//! `perspective`; everything else serves both kinds of scenes. [`Oracle::colors_at`] leaves the
//! analysis out, where many pixels are needed and nothing but their colours.

// Guards are phrased so that NaN fails them: `!(x > 0.0)` is not `x <= 0.0`.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod colors;
mod least_squares;
mod loss;
mod parameters;
mod perspective;
mod pixel;
mod rounded;
mod scene2d;
mod spherical_harmonics;
mod splat;
mod statistics;
mod view_gradients;

use std::sync::Arc;

use gs_core::{CullCause, Culled, Error, Image, Loss, RenderSettings, check_same_size, effects::Blend};

pub use self::{
    least_squares::best_colors,
    parameters::{COLOR, OPACITY, OPACITY_3D, OracleScene, PARAMETER_NAMES, Parameters, QUATERNION, ROTATION, SH_3D},
    perspective::MovedCamera,
    rounded::Rounded,
    splat::{Appearance, Depth, Exponent, Lean, OracleView, Projection, Splat},
    statistics::StepStatistics,
    view_gradients::ViewGradients,
};
use self::{loss::LossSlopes, pixel::Pixel, splat::Share};

/// Tolerance of images, losses and gradients, in roundings.
///
/// Largest deviations over 30 scenes of each kind and blend (24 Gaussians on 35×26 px), with gs-cpu
/// at four SIMD levels and gs-wgpu with three kinds of kernels: images 5.6 (5.7e-6); gradients 14.2
/// (`Opaque` under `Over`, L1), 9.2 (the same, L2) and 5.2 (all others), all within 1.8e-4 of the
/// largest gradient by the same parameter. `cargo run -p gs-conformance --example worst_cases`
/// measures them.
pub const ROUNDINGS: f64 = 24.0;

/// Relative distance from its threshold within which a decision is near; at least [`ROUNDINGS`].
pub const NEAR_CUT: f64 = 1e-3;

/// Renders scenes through one view with one set of settings, and differentiates the result.
#[derive(Debug, Clone)]
pub struct Oracle {
    view: Arc<dyn OracleView>,
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
    /// Uncertainty of each value in `f32`, in roundings. The tolerance is a multiple of it.
    pub rounding: Vec<[f64; 3]>,
    /// Change of each value by decisions within rounding of their threshold; 0 at most pixels.
    pub flip: Vec<[f64; 3]>,
    /// Number of culled Gaussians by cause; `outside`: no pixel centre is above the cut.
    pub culled: Culled,
    /// Whether each Gaussian contributes to some pixel, `[N]`.
    pub drawn: Vec<bool>,
}

/// A loss and its gradients by the oracle.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradients {
    /// The loss.
    pub loss: f64,
    /// Uncertainty of the loss in `f32`, in roundings.
    pub loss_rounding: f64,
    /// Change of the loss by decisions within rounding.
    pub loss_flip: f64,
    /// ∂L/∂(parameter), `[N]`.
    pub values: Vec<Parameters>,
    /// Uncertainty of each gradient in `f32`, in roundings, `[N]`.
    pub rounding: Vec<Parameters>,
    /// Change of each gradient by decisions within rounding, `[N]`.
    pub flip: Vec<Parameters>,
    /// The gradient by the view.
    pub view: ViewGradients,
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
}

impl Oracle {
    /// An oracle for one view.
    ///
    /// # Errors
    /// [`Error::Size`] or [`Error::Setting`] for an invalid view or settings;
    /// [`Error::Unsupported`] for effects without a definition here.
    pub fn new(view: impl OracleView, settings: RenderSettings) -> Result<Self, Error> {
        settings.validate()?;
        view.check(&settings)?;
        Ok(Self { view: Arc::new(view), settings })
    }

    /// The settings.
    pub fn settings(&self) -> RenderSettings {
        self.settings
    }

    /// Renders a scene.
    pub fn render(&self, scene: &OracleScene) -> Rendering {
        self.rendering(scene, &self.blend(scene, Lean::Exact))
    }

    /// Whether a Gaussian would contribute to each pixel if it were alone in a scene (with index 0),
    /// `[H · W]`; true if within rounding.
    pub fn footprint(&self, gaussian: &Parameters) -> Vec<bool> {
        let alone = OracleScene { gaussians: vec![gaussian.clone()] };
        self.blend(&alone, Lean::More).iter().map(|pixel| pixel.near > 0 || pixel.touched().next().is_some()).collect()
    }

    /// The projection of each Gaussian, or the reason why it is culled; `[N]`.
    pub fn project(&self, scene: &OracleScene) -> Vec<Projection> {
        self.projected(scene, Lean::Exact).collect()
    }

    fn projected<'a>(&'a self, scene: &'a OracleScene, lean: Lean) -> impl Iterator<Item = Projection> + 'a {
        let dropout = &self.settings.dropout;
        (0..).zip(&scene.gaussians).map(move |(index, g)| match dropout.leaves_out(index) {
            true => Projection::Left(CullCause::Transparent),
            false => self.view.project(g, &self.settings, lean),
        })
    }

    /// The loss of a scene, without its gradients.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] if the target does not have the view's size.
    pub fn loss(&self, scene: &OracleScene, target: &Image, loss: &Loss) -> Result<f64, Error> {
        self.check_target(target)?;
        let image = self.render(scene);
        Ok(loss::value(loss, image.width as usize, &image.pixels, target))
    }

    /// The loss of a scene and its gradients with respect to every parameter.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] if the target does not have the view's size.
    pub fn gradients(&self, scene: &OracleScene, target: &Image, loss: &Loss) -> Result<Gradients, Error> {
        self.check_target(target)?;
        let value = |width, image: &[_]| loss::value(loss, width, image, target);
        let slopes =
            |width, image: &[_], rounding: &[_], lean| loss::slopes(loss, width, image, rounding, target, lean);
        Ok(self.differentiate(scene, &value, &slopes))
    }

    /// The gradients of a loss L with ∂L/∂image = `v_image`, `[H, W, 3]`; the loss is returned as 0.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] if `v_image` does not have the view's size.
    pub fn image_vjp(&self, scene: &OracleScene, v_image: &Image) -> Result<Gradients, Error> {
        self.check_target(v_image)?;
        let v_color: Vec<[f64; 3]> = v_image.pixels().iter().map(|v| v.map(f64::from)).collect();
        let v_rounding = vec![[0.0; 3]; v_color.len()];
        let given = LossSlopes { v_color, v_rounding };
        Ok(self.differentiate(scene, &|_, _| 0.0, &|_, _, _, _| given.clone()))
    }

    /// Gradients of a loss with a value of (columns, image) and slopes of (columns, image, its
    /// rounding, lean); see [`loss::slopes`].
    fn differentiate(
        &self,
        scene: &OracleScene,
        value: &dyn Fn(usize, &[[f64; 3]]) -> f64,
        slopes: &Slopes<'_>,
    ) -> Gradients {
        let exact = self.blend(scene, Lean::Exact);
        let rendering = self.rendering(scene, &exact);
        let width = rendering.width as usize;
        let at_exact = slopes(width, &rendering.pixels, &rendering.rounding, 0.0);
        let count = scene.gaussians.len();
        let projected = self.project(scene);
        let chain = Chain::of(&projected, scene);
        let by_view = Chain::of_view(&projected);
        let (mut view, mut view_rounding) =
            (ViewGradients::zeros(self.view.numbers()), vec![vec![0.0; self.view.numbers()]; count]);
        let mut shares = vec![[0.0; 9]; count];
        let mut rounding: Vec<Parameters> = scene.gaussians.iter().map(|g| vec![0.0; g.len()]).collect();
        let (mut loss_rounding, mut loss_flip) = (0.0, 0.0);
        for (p, pixel) in exact.iter().enumerate() {
            let (v, v_rounding) = (at_exact.v_color[p], at_exact.v_rounding[p]);
            add(&mut shares, &pixel.gradients(v));
            for (g, together, own) in pixel.gradient_rounding(v, v_rounding) {
                chain.add_rounding(g, &together, &own, &mut rounding[g]);
                by_view.add_rounding(g, &together, &own, &mut view_rounding[g]);
            }
            for k in 0..3 {
                loss_rounding += v[k].abs() * rendering.rounding[p][k];
                loss_flip += 2.0 * v[k].abs() * rendering.flip[p][k];
            }
        }
        for (g, share) in shares.iter().enumerate() {
            chain.add_own_rounding(g, share, &mut rounding[g]);
            by_view.add_own_rounding(g, share, &mut view_rounding[g]);
            view.add(&by_view.parameters(g, share), &view_rounding[g]);
        }
        let mut gradients = Gradients {
            loss: value(width, &rendering.pixels),
            loss_rounding,
            loss_flip,
            values: (0..count).map(|g| chain.parameters(g, &shares[g])).collect(),
            rounding,
            flip: scene.gaussians.iter().map(|g| vec![0.0; g.len()]).collect(),
            view,
        };
        // Repeats the blend with every decision within rounding taken to either side.
        for (lean, direction) in [(Lean::More, 1.0), (Lean::Fewer, -1.0)] {
            let other = self.blend(scene, lean);
            let pixels: Vec<_> = other.iter().map(|pixel| pixel.color).collect();
            let at_other = slopes(width, &pixels, &rendering.rounding, direction * ROUNDINGS);
            for (p, (pixel, twin)) in exact.iter().zip(&other).enumerate() {
                let (v, v_other) = (at_exact.v_color[p], at_other.v_color[p]);
                let several = f64::from(pixel.near.max(twin.near));
                if several == 0.0 && v == v_other {
                    continue;
                }
                for (g, change) in differences(&pixel.gradients(v), &twin.gradients(v_other)) {
                    let of_gaussian = gradients.flip[g].iter_mut().zip(chain.parameters(g, &change));
                    let of_view = gradients.view.flip.iter_mut().zip(by_view.parameters(g, &change));
                    for (flip, change) in of_gaussian.chain(of_view) {
                        *flip += several.max(1.0) * change.abs();
                    }
                }
            }
        }
        gradients
    }

    fn check_target(&self, target: &Image) -> Result<(), Error> {
        check_same_size(self.view.size(), target.size())
    }

    fn blend(&self, scene: &OracleScene, lean: Lean) -> Vec<Pixel> {
        let drawable = |projection| match projection {
            Projection::Drawable(splat) => Some(splat),
            Projection::Left(_) => None,
        };
        let drawable: Vec<Option<Box<dyn Splat>>> = self.projected(scene, lean).map(drawable).collect();
        let (width, height) = self.view.size();
        let centers = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        centers
            .map(|(x, y)| Pixel::blend(&drawable, [f64::from(x) + 0.5, f64::from(y) + 0.5], &self.settings, lean))
            .collect()
    }

    fn rendering(&self, scene: &OracleScene, pixels: &[Pixel]) -> Rendering {
        let mut drawn = vec![false; scene.gaussians.len()];
        pixels.iter().flat_map(Pixel::touched).for_each(|index| drawn[index] = true);
        let mut culled = Culled::default();
        let cut = f64::from(self.settings.accuracy.alpha_cut);
        let over = self.settings.effects.blend == Blend::Over;
        for (g, &drawn) in self.project(scene).iter().zip(&drawn) {
            match g {
                Projection::Left(cause) => culled.count(*cause),
                Projection::Drawable(g) if over && g.appearance().opacity < cut => culled.count(CullCause::Transparent),
                Projection::Drawable(_) if !drawn => culled.count(CullCause::Outside),
                Projection::Drawable(_) => {}
            }
        }
        let (width, height) = self.view.size();
        Rendering {
            width,
            height,
            pixels: pixels.iter().map(|p| p.color).collect(),
            rounding: pixels.iter().map(|p| p.rounding).collect(),
            flip: pixels.iter().map(|p| p.flip).collect(),
            culled,
            drawn,
        }
    }

    /// The weights of all Gaussians at every pixel, `[H · W]` lists of (Gaussian, w);
    /// [`Blend::Sum`].
    fn weights(&self, scene: &OracleScene) -> Vec<Vec<(usize, f64)>> {
        self.blend(scene, Lean::Exact).iter().map(|pixel| pixel.weights().collect()).collect()
    }
}

/// The slopes of a loss from (columns, image, its rounding, lean).
type Slopes<'a> = dyn Fn(usize, &[[f64; 3]], &[[f64; 3]], f64) -> LossSlopes + 'a;

/// The Jacobians of the projected Gaussians by their parameters, or by the numbers of the view.
struct Chain {
    /// ∂(share)/∂(parameters) of each Gaussian, a row for each parameter; zeros or no rows for culled
    /// Gaussians.
    jacobians: Vec<Vec<[Rounded; 9]>>,
}

impl Chain {
    fn of(projected: &[Projection], scene: &OracleScene) -> Self {
        let jacobians = projected.iter().zip(&scene.gaussians).map(|(projection, g)| match projection {
            Projection::Drawable(splat) => splat.jacobian(),
            Projection::Left(_) => vec![[Rounded::ZERO; 9]; g.len()],
        });
        Self { jacobians: jacobians.collect() }
    }

    fn of_view(projected: &[Projection]) -> Self {
        let jacobians = projected.iter().map(|projection| match projection {
            Projection::Drawable(splat) => splat.view_jacobian(),
            Projection::Left(_) => Vec::new(),
        });
        Self { jacobians: jacobians.collect() }
    }

    /// The gradient by the parameters of Gaussian `g` from that by its share.
    fn parameters(&self, g: usize, share: &Share) -> Parameters {
        self.jacobians[g].iter().map(|row| (0..9).map(|j| row[j].value * share[j]).sum()).collect()
    }

    /// Adds the uncertainty of [`Self::parameters`] from that of one pixel's share; see
    /// [`Pixel::gradient_rounding`].
    fn add_rounding(&self, g: usize, together: &[Share; 3], own: &Share, rounding: &mut Parameters) {
        for (sum, row) in rounding.iter_mut().zip(&self.jacobians[g]) {
            for part in together {
                *sum += (0..9).map(|j| row[j].value * part[j]).sum::<f64>().abs();
            }
            *sum += (0..9).map(|j| row[j].value.abs() * own[j]).sum::<f64>();
        }
    }

    /// Adds the uncertainty from the derivatives themselves.
    fn add_own_rounding(&self, g: usize, share: &Share, rounding: &mut Parameters) {
        for (sum, row) in rounding.iter_mut().zip(&self.jacobians[g]) {
            *sum += (0..9).map(|j| row[j].error * share[j].abs()).sum::<f64>();
        }
    }
}

fn add(sums: &mut [Share], shares: &[(usize, Share)]) {
    for (index, share) in shares {
        (0..9).for_each(|i| sums[*index][i] += share[i]);
    }
}

/// The second list minus the first, for each Gaussian in either.
fn differences(first: &[(usize, Share)], second: &[(usize, Share)]) -> Vec<(usize, Share)> {
    let mut all: std::collections::BTreeMap<usize, Share> = std::collections::BTreeMap::new();
    for (shares, sign) in [(first, -1.0), (second, 1.0)] {
        for (index, share) in shares {
            let sum = all.entry(*index).or_insert([0.0; 9]);
            (0..9).for_each(|i| sum[i] += sign * share[i]);
        }
    }
    all.into_iter().collect()
}
