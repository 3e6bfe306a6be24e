//! The projection of a 3D Gaussian in `f64`: centre, precision matrix, depth and colour on the
//! image (paper eq. 4, 5). `backward` has its derivatives.
//!
//! Legend: μ = mean, p = W μ + t, J = the perspective's Jacobian at p with clamped slopes, R =
//! rotation of q/|q|, S = diag(scales), N = W R S, M′ = J N, Σ = M′ M′ᵀ before antialiasing, Σ′
//! after; `v_x` = ∂L/∂x.

mod backward;
mod moved;
mod shading;

use gs_core::{
    Camera, CullCause, Error, Output, RenderSettings,
    constants::{MIN_DETERMINANT_PX4, MIN_QUATERNION_NORM2},
    effects::{Antialias, Order},
};

pub use self::moved::MovedCamera;
use self::{
    backward::Chain,
    shading::{Opacity, Shading, appearance},
};
use super::{
    parameters::{OPACITY_3D, SH_3D, sh_len},
    rounded::{F32_ROUNDING, Matrix, Rounded, applied, dot, product, transposed},
    splat::{Appearance, Depth, Exponent, Lean, OracleView, Projection, Splat},
};
use crate::ROUNDINGS;

/// Unclamped margin beyond the image's edge, as a share of half the image (3DGS: 0.3).
const MARGIN: f64 = 0.3;

/// Roundings of a term of σ, or of a depth: those of Σ′⁻¹, of the offset, of the products.
const TERMS: f64 = 2.0;

/// Roundings of a derivative of σ, in its own terms.
const OPERATIONS: f64 = 8.0;

/// A projected 3D Gaussian, px.
///
/// Its share is by its centre u, v, by Σ′ as (uu, uv, vv), where uv stands for both equal entries,
/// by its compensated opacity, and by its colour.
#[derive(Debug, Clone)]
pub(crate) struct Splat3d {
    /// u, v, px.
    center: [Rounded; 2],
    /// Σ′⁻¹ as (uu, uv, vv), px⁻².
    precision: [f64; 3],
    /// p, world units.
    point: [Rounded; 3],
    /// cov(z, (u, v)), world units · px.
    depth_covariance: [Rounded; 2],
    appearance: Appearance,
    chain: Chain,
}

/// Decisions of the guards, and whether one was within rounding.
struct Guards {
    lean: Lean,
    undecided: bool,
}

impl Guards {
    fn reaches(&mut self, value: Rounded, threshold: f64) -> bool {
        let band = ROUNDINGS * value.error;
        self.undecided |= (value.value - threshold).abs() <= band && band > 0.0;
        let leaning = match self.lean {
            Lean::Exact => 0.0,
            Lean::More => band,
            Lean::Fewer => -band,
        };
        value.value + leaning >= threshold
    }
}

impl OracleView for Camera {
    fn has_depth(&self) -> bool {
        true
    }

    fn numbers(&self) -> usize {
        10
    }

    fn check(&self, _: &RenderSettings) -> Result<(), Error> {
        self.validate()
    }

    fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    fn device_units(&self) -> [f64; 2] {
        [f64::from(self.width) / 2.0, f64::from(self.height) / 2.0]
    }

    fn project(&self, g: &[f64], settings: &RenderSettings, lean: Lean) -> Projection {
        match projected(&Pinhole::new(self), g, settings, lean) {
            Ok(splat) => Projection::Drawable(Box::new(splat)),
            Err(cause) => Projection::Left(cause),
        }
    }
}

/// The projection of a Gaussian, or the reason why it is culled.
fn projected(pinhole: &Pinhole, g: &[f64], settings: &RenderSettings, lean: Lean) -> Result<Splat3d, CullCause> {
    let effects = settings.effects;
    let finite = g.iter().enumerate().filter(|&(i, _)| i != OPACITY_3D).all(|(_, v)| v.is_finite());
    if !finite || g[OPACITY_3D].is_nan() {
        return Err(CullCause::NotFinite);
    }
    let mut guards = Guards { lean, undecided: false };
    let mean = [0, 1, 2].map(|i| Rounded::exact(g[i]));
    let point = pinhole.in_front(&mean, &mut guards)?;
    let center = pinhole.center(&point);
    let (slopes, clamped) = pinhole.slopes(&point);
    let jacobian = pinhole.jacobian(point[2], &slopes);

    let Ellipsoid { quaternion, quaternion_length, scales, factor } = Ellipsoid::new(g, &mut guards)?;
    let seen = product(&pinhole.world, &factor);
    let footprint = product(&jacobian, &seen);
    let covariance = Covariance::new(&footprint, &center, effects.antialias, &mut guards)?;
    let opacity = Opacity::new(g[OPACITY_3D], settings, &covariance);
    let (direction, distance) = pinhole.direction(&mean);
    let shading = match settings.output {
        Output::Color => Shading::new(g, &direction, effects.sh_degree)?,
        Output::InverseDepth => Shading::constant(Rounded::ONE / point[2]),
        Output::Alpha => Shading::constant(Rounded::ONE),
    };

    Ok(Splat3d {
        center,
        precision: covariance.precision.map(|v| v.value),
        point,
        depth_covariance: [0, 1].map(|i| dot(&seen[2], &footprint[i])),
        appearance: appearance(&opacity, &shading, guards.undecided),
        chain: Chain {
            world: pinhole.world,
            translation: pinhole.translation,
            mean,
            focal: pinhole.focal,
            slopes,
            clamped,
            jacobian,
            quaternion,
            quaternion_length,
            scales,
            factor,
            seen,
            footprint,
            opacity: opacity.stored,
            compensation: opacity.compensation,
            compensation_slope: opacity.compensation_slope,
            direction,
            distance,
            sh: shading.sh,
            sh_len: sh_len(g),
            shows: shading.shows,
            output: settings.output,
        },
    })
}

/// A camera's numbers.
struct Pinhole {
    /// W.
    world: Matrix<3, 3>,
    /// t.
    translation: [Rounded; 3],
    focal: [Rounded; 2],
    principal: [Rounded; 2],
    /// Columns and rows, px.
    size: [f64; 2],
    near: f64,
}

impl Pinhole {
    fn new(camera: &Camera) -> Self {
        let exact = |v: f32| Rounded::exact(f64::from(v));
        Self {
            world: std::array::from_fn(|i| std::array::from_fn(|j| exact(camera.rotation.col(j)[i]))),
            translation: camera.translation.to_array().map(exact),
            focal: camera.focal.to_array().map(exact),
            principal: camera.center.to_array().map(exact),
            size: [camera.width, camera.height].map(f64::from),
            near: f64::from(camera.near),
        }
    }

    /// p of a mean that is in front of the near plane.
    fn in_front(&self, mean: &[Rounded; 3], guards: &mut Guards) -> Result<[Rounded; 3], CullCause> {
        let turned = applied(&self.world, mean);
        let point: [Rounded; 3] = std::array::from_fn(|i| turned[i] + self.translation[i]);
        if guards.reaches(point[2], self.near) { Ok(point) } else { Err(CullCause::Near) }
    }

    /// u, v of p.
    fn center(&self, point: &[Rounded; 3]) -> [Rounded; 2] {
        std::array::from_fn(|i| self.focal[i] * point[i] / point[2] + self.principal[i])
    }

    /// The tx, ty of J: those of p, clamped to the image and its margin; and whether each is
    /// clamped.
    fn slopes(&self, point: &[Rounded; 3]) -> ([Rounded; 2], [bool; 2]) {
        let Self { focal, principal, size, .. } = self;
        let (mut slopes, mut clamped) = ([Rounded::ZERO; 2], [false; 2]);
        for i in 0..2 {
            let slope = point[i] / point[2];
            let margin = Rounded::exact(MARGIN * 0.5 * size[i]) / focal[i];
            let least = -(principal[i] / focal[i] + margin);
            let most = (Rounded::exact(size[i]) - principal[i]) / focal[i] + margin;
            clamped[i] = !(least.value..=most.value).contains(&slope.value);
            slopes[i] = if slope.value < least.value {
                least
            } else if slope.value > most.value {
                most
            } else {
                slope
            };
        }
        (slopes, clamped)
    }

    /// J.
    fn jacobian(&self, z: Rounded, slopes: &[Rounded; 2]) -> Matrix<2, 3> {
        let [fx, fy] = self.focal;
        [[fx / z, Rounded::ZERO, -(fx * slopes[0] / z)], [Rounded::ZERO, fy / z, -(fy * slopes[1] / z)]]
    }

    /// Unit vector from the camera to a mean, and the distance; forward, if the mean is at the
    /// camera.
    fn direction(&self, mean: &[Rounded; 3]) -> ([Rounded; 3], Rounded) {
        let position = applied(&transposed(&self.world), &self.translation).map(|v| -v);
        let away: [Rounded; 3] = std::array::from_fn(|i| mean[i] - position[i]);
        let distance = dot(&away, &away).sqrt();
        let direction = if distance.value > 0.0 {
            away.map(|v| v / distance)
        } else {
            [Rounded::ZERO, Rounded::ZERO, Rounded::ONE]
        };
        (direction, distance)
    }
}

/// A Gaussian's axes in the world.
struct Ellipsoid {
    /// q/|q|.
    quaternion: [Rounded; 4],
    quaternion_length: Rounded,
    scales: [Rounded; 3],
    /// R S.
    factor: Matrix<3, 3>,
}

impl Ellipsoid {
    fn new(g: &[f64], guards: &mut Guards) -> Result<Self, CullCause> {
        let at = |i: usize| Rounded::exact(g[i]);
        let raw = [at(6), at(7), at(8), at(9)];
        let norm2 = dot(&raw, &raw);
        if !guards.reaches(norm2, f64::from(MIN_QUATERNION_NORM2)) {
            return Err(CullCause::Degenerate);
        }
        let quaternion_length = norm2.sqrt();
        let quaternion = raw.map(|v| v / quaternion_length);
        let rotation = rotation_of(&quaternion);
        let scales = [at(3), at(4), at(5)].map(Rounded::exp);
        let factor = std::array::from_fn(|i| std::array::from_fn(|k| rotation[i][k] * scales[k]));
        Ok(Self { quaternion, quaternion_length, scales, factor })
    }
}

/// Σ and Σ′, their determinants, and Σ′⁻¹.
struct Covariance {
    /// Σ as (uu, uv, vv), px².
    spread: [Rounded; 3],
    /// det Σ, px⁴.
    thin: Rounded,
    /// det Σ′, px⁴.
    determinant: Rounded,
    /// Σ′⁻¹ as (uu, uv, vv), px⁻².
    precision: [Rounded; 3],
}

impl Covariance {
    /// The covariance from M′. The centre must be finite, too.
    fn new(
        footprint: &Matrix<2, 3>,
        center: &[Rounded; 2],
        antialias: Antialias,
        guards: &mut Guards,
    ) -> Result<Self, CullCause> {
        let spread = |i: usize, j: usize| dot(&footprint[i], &footprint[j]);
        let minor = |a: usize, b: usize| footprint[0][a] * footprint[1][b] - footprint[0][b] * footprint[1][a];
        let dilation = Rounded::exact(antialias.dilation().into());
        let (uu, uv, vv) = (spread(0, 0), spread(0, 1), spread(1, 1));
        // Cauchy–Binet: cancellation is only possible within a minor.
        let thin = minor(0, 1).squared() + minor(0, 2).squared() + minor(1, 2).squared();
        let determinant = thin + dilation * (uu + vv) + dilation.squared();
        let (wide_uu, wide_vv) = (uu + dilation, vv + dilation);
        // The product must be finite, too, because backends compute it.
        let guarded = [wide_uu, uv, wide_vv, wide_uu * wide_vv, determinant, center[0], center[1]];
        if !guarded.into_iter().all(Rounded::is_finite) {
            return Err(CullCause::NotFinite);
        }
        if !guards.reaches(determinant, f64::from(MIN_DETERMINANT_PX4)) {
            return Err(CullCause::Degenerate);
        }
        let precision = [wide_vv / determinant, -(uv / determinant), wide_uu / determinant];
        Ok(Self { spread: [uu, uv, vv], thin, determinant, precision })
    }

    /// ρ = √(det Σ / det Σ′) of Mip and Compensated and ∂ρ/∂Σ, where uv stands for both entries; 1
    /// and 0 without.
    fn compensation(&self, antialias: Antialias) -> (Rounded, [Rounded; 3]) {
        let &Self { spread: [uu, uv, vv], thin, determinant, precision } = self;
        if !matches!(antialias, Antialias::Mip | Antialias::Compensated) {
            return (Rounded::ONE, [Rounded::ZERO; 3]);
        }
        let compensation = (thin / determinant).sqrt();
        if !(thin.value > 0.0) {
            return (compensation, [Rounded::ZERO; 3]);
        }
        // dρ = ½ ρ tr((Σ⁻¹ − Σ′⁻¹) dΣ), and ρ Σ⁻¹ = adj Σ / √(det Σ det Σ′).
        let root = (thin * determinant).sqrt();
        let half = |adjugate: Rounded, wide: Rounded| 0.5 * (adjugate / root - compensation * wide);
        (compensation, [half(vv, precision[0]), 2.0 * half(-uv, precision[1]), half(uu, precision[2])])
    }
}

/// R of a unit quaternion (w, x, y, z).
fn rotation_of(&[w, x, y, z]: &[Rounded; 4]) -> Matrix<3, 3> {
    let diagonal = |a: Rounded, b: Rounded| Rounded::ONE - 2.0 * (a * a + b * b);
    [
        [diagonal(y, z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), diagonal(x, z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), diagonal(x, y)],
    ]
}

/// The unit vectors of a share.
const UNITS: [[Rounded; 9]; 9] = {
    let mut units = [[Rounded::ZERO; 9]; 9];
    let mut i = 0;
    while i < 9 {
        units[i][i] = Rounded::ONE;
        i += 1;
    }
    units
};

impl Splat for Splat3d {
    /// The exponent σ and its gradients: with q = Σ′⁻¹ d, ∂σ/∂(u, v) = −q and ∂σ/∂Σ′ = −½ q qᵀ.
    ///
    /// The uncertainty in `f32` includes the sums of the textbook's formulas, which cancel in
    /// needles, and to first order the errors of u, v and M′: dσ = −q·d(u, v) − (qᵀ dM′)(M′ᵀ q).
    fn exponent(&self, p: [f64; 2]) -> Exponent {
        let d = self.offset(p);
        let ([qx, qy], magnitude) = self.whitened(d);
        let textbook = 0.5 * (magnitude[0] * d[0].abs() + magnitude[1] * d[1].abs());
        let moved: f64 = (0..2).map(|i| [qx, qy][i].abs() * self.center[i].error).sum();
        let [mu, mv] = &self.chain.footprint;
        let bent: f64 = (mu.iter().zip(mv))
            .map(|(u, v)| (qx * u.value + qy * v.value).abs() * (qx.abs() * u.error + qy.abs() * v.error))
            .sum();
        let [a, b, c] = self.precision;
        let displaced = [0, 1].map(|i| {
            let [x, y] = [[a, b], [b, c]][i].map(|v| v * self.center[i].error);
            [x, y, qx * x, qx * y + qy * x, qy * y]
        });
        let derivatives = [-qx, -qy, -0.5 * qx * qx, -qx * qy, -0.5 * qy * qy];
        let [_, _, uu, uv, vv] = derivatives;
        let magnitudes = [magnitude[0], magnitude[1], uu, uv, vv];
        Exponent {
            sigma: 0.5 * (qx * d[0] + qy * d[1]),
            rounding: TERMS * F32_ROUNDING * textbook + moved + bent,
            derivatives,
            derivative_rounding: magnitudes.map(|v| OPERATIONS * F32_ROUNDING * v.abs()),
            displaced,
        }
    }

    fn sigma(&self, p: [f64; 2]) -> f64 {
        let d = self.offset(p);
        let [a, b, c] = self.precision;
        0.5 * ((a * d[0] + b * d[1]) * d[0] + (b * d[0] + c * d[1]) * d[1])
    }

    fn appearance(&self) -> &Appearance {
        &self.appearance
    }

    /// z of the mean; for [`Order::PerPixel`] the mean of z given that the ray goes through `p`,
    /// z + cov(z, (u, v)) Σ′⁻¹ d.
    fn depth(&self, p: [f64; 2], order: Order) -> Depth {
        let [x, y, z] = self.point;
        let mut origin = [x.value, y.value, z.value, 0.0, 0.0, 0.0, 0.0, 0.0];
        if order != Order::PerPixel {
            return Depth { value: z.value, rounding: z.error, origin };
        }
        let (q, q_magnitude) = self.whitened(self.offset(p));
        let k = self.depth_covariance;
        origin[3..6].copy_from_slice(&self.precision);
        origin[6..].copy_from_slice(&k.map(|v| v.value));
        let textbook: f64 = (0..2).map(|i| k[i].value.abs() * q_magnitude[i]).sum();
        let inherited: f64 = (0..2).map(|i| k[i].error * q[i].abs()).sum();
        Depth {
            value: z.value + k[0].value * q[0] + k[1].value * q[1],
            // The sum has a rounding error relative to the depth, even if the slope's term is
            // small.
            rounding: z.error + TERMS * F32_ROUNDING * (z.value.abs() + textbook) + inherited,
            origin,
        }
    }

    fn jacobian(&self) -> Vec<[Rounded; 9]> {
        let columns = UNITS.map(|unit| self.chain.vjp(unit, self.point));
        (0..SH_3D + 3 * self.chain.sh_len).map(|row| std::array::from_fn(|j| columns[j][row])).collect()
    }

    fn view_jacobian(&self) -> Vec<[Rounded; 9]> {
        let columns = UNITS.map(|unit| self.chain.camera_vjp(unit, self.point));
        (0..10).map(|row| std::array::from_fn(|j| columns[j][row])).collect()
    }
}

impl Splat3d {
    fn offset(&self, p: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| p[i] - self.center[i].value)
    }

    /// q = Σ′⁻¹ d, and the same with every term by magnitude.
    fn whitened(&self, [dx, dy]: [f64; 2]) -> ([f64; 2], [f64; 2]) {
        let [a, b, c] = self.precision;
        let magnitude = [(a * dx).abs() + (b * dy).abs(), (b * dx).abs() + (c * dy).abs()];
        ([a * dx + b * dy, b * dx + c * dy], magnitude)
    }
}
