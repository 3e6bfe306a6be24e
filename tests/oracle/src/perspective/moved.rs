//! A camera that is moved by less than `f32` can tell, for difference quotients.

use gs_core::{Camera, Error, RenderSettings};

use super::{Pinhole, projected};
use crate::{
    rounded::{Matrix, Rounded, applied, product},
    splat::{Lean, OracleView, Projection},
};

/// A camera moved by a twist, and with other intrinsics, in `f64`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovedCamera {
    /// The camera before.
    pub camera: Camera,
    /// The twist (v, ω), by which p goes to exp(ω×) p + v, in world units and radians; what is added
    /// to fx, fy, cx, cy, px.
    pub by: [f64; 10],
}

impl OracleView for MovedCamera {
    fn has_depth(&self) -> bool {
        true
    }

    fn numbers(&self) -> usize {
        10
    }

    fn check(&self, settings: &RenderSettings) -> Result<(), Error> {
        self.camera.check(settings)
    }

    fn size(&self) -> (u32, u32) {
        OracleView::size(&self.camera)
    }

    fn device_units(&self) -> [f64; 2] {
        self.camera.device_units()
    }

    fn project(&self, g: &[f64], settings: &RenderSettings, lean: Lean) -> Projection {
        let [vx, vy, vz, wx, wy, wz, fx, fy, cx, cy] = self.by.map(Rounded::exact);
        let before = Pinhole::new(&self.camera);
        let turn = exponential([wx, wy, wz]);
        let turned = applied(&turn, &before.translation);
        let moved = Pinhole {
            world: product(&turn, &before.world),
            translation: [turned[0] + vx, turned[1] + vy, turned[2] + vz],
            focal: [before.focal[0] + fx, before.focal[1] + fy],
            principal: [before.principal[0] + cx, before.principal[1] + cy],
            ..before
        };
        match projected(&moved, g, settings, lean) {
            Ok(splat) => Projection::Drawable(Box::new(splat)),
            Err(cause) => Projection::Left(cause),
        }
    }
}

/// exp(ω×): I + sin θ/θ ω× + (1 − cos θ)/θ² (ω×)², θ = |ω|.
fn exponential([x, y, z]: [Rounded; 3]) -> Matrix<3, 3> {
    let o = Rounded::ZERO;
    let cross = [[o, -z, y], [z, o, -x], [-y, x, o]];
    let square = product(&cross, &cross);
    let angle = (x * x + y * y + z * z).value.sqrt();
    // 1 − cos θ = 2 sin² (θ/2).
    let [first, second] = match angle > 0.0 {
        true => [angle.sin() / angle, 2.0 * ((0.5 * angle).sin() / angle).powi(2)],
        false => [1.0, 0.5],
    };
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let unit = if i == j { Rounded::ONE } else { Rounded::ZERO };
            unit + first * cross[i][j] + second * square[i][j]
        })
    })
}
