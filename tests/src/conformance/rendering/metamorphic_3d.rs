//! Cases of changes to a 3D scene and its camera that must not change the image.

use glam::{Mat3, Quat, Vec3, Vec4};
use gs_core::{
    Camera, Image, Optimizer, Scene, Scene3d,
    effects::{Blend, Order},
};
use pollster::FutureExt as _;

use crate::conformance::{
    is_refused,
    rendering::{analysis, around, permuted},
};
use crate::{
    failure::Failure,
    oracle::Rendering,
    scenes::{Draw, Kind3d},
    tolerance::compare_images,
};

/// The indices of the Gaussians do not change the image with a depth sort.
pub(crate) fn indices_do_not_matter_by_depth<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for order in [Order::Global, Order::PerPixel] {
        for (seed, kind) in (2500..).zip([Kind3d::Typical, Kind3d::Overlapping, Kind3d::Needles]) {
            let draw = Draw::for_3d(kind, Blend::Over, 50, (40, 30), seed).in_order(order);
            if order == Order::PerPixel && is_refused(rasterizer, &draw)? {
                continue;
            }
            let image = rasterizer.render(&draw.scene, &draw.view, &draw.settings).block_on()?;
            let again = rasterizer.render(&permuted(&draw.scene), &draw.view, &draw.settings).block_on()?;
            compare_images(&around(&image, &analysis(&draw)?), &again)
                .map_err(|failure| failure.at(format!("{kind:?}, {order:?}, permuted")))?;
        }
    }
    Ok(())
}

/// Moving camera and scene together, with the SH rotated, does not change the image.
pub(crate) fn rigid_motions_change_nothing<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    let turn = Quat::from_axis_angle(Vec3::new(0.6, -0.48, 0.64), 2.1);
    let shift = Vec3::new(3.0, -5.5, 1.25);
    let moved = |draw: &Draw<Scene3d>| {
        let mut moved = draw.clone();
        let matrix = Mat3::from_quat(turn);
        moved.scene.means.iter_mut().for_each(|mean| *mean = matrix * *mean + shift);
        for q in &mut moved.scene.rotations {
            let [w, x, y, z] = *q;
            // `Quat`'s product also multiplies the lengths.
            let turned = Vec4::from(turn * Quat::from_vec4(Vec4::new(x, y, z, w)));
            *q = [turned.w, turned.x, turned.y, turned.z];
        }
        if moved.scene.sh_degree == 1 {
            // Degree 1 is C₁ a·d with a = (−sh₃, −sh₁, sh₂), a vector for each channel.
            for sh in moved.scene.sh.chunks_exact_mut(4) {
                let columns = Mat3::from_cols(-sh[3], -sh[1], sh[2]).transpose();
                let turned = (matrix * columns).transpose();
                (sh[3], sh[1], sh[2]) = (-turned.x_axis, -turned.y_axis, turned.z_axis);
            }
        }
        moved.view.rotation = draw.view.rotation * matrix.transpose();
        moved.view.translation = draw.view.translation - moved.view.rotation * shift;
        moved
    };
    for order in [Order::Global, Order::PerPixel] {
        // Seeds of SH degree 0 and 1.
        for (seed, kind) in [(2520, Kind3d::Typical), (2525, Kind3d::Edge), (2529, Kind3d::Needles)] {
            let draw = Draw::for_3d(kind, Blend::Over, 40, (40, 30), seed).in_order(order);
            if order == Order::PerPixel && is_refused(rasterizer, &draw)? {
                continue;
            }
            same(rasterizer, &draw, &moved(&draw)).map_err(|failure| failure.at("moved"))?;
        }
    }
    Ok(())
}

/// Scaling scene and camera by a power of two does not change the image.
pub(crate) fn scales_of_the_world_change_nothing<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for power in [-5, 7] {
        let factor = 2f32.powi(power);
        for (seed, kind) in (2541..).zip([Kind3d::Typical, Kind3d::Near, Kind3d::Edge]) {
            let draw = Draw::for_3d(kind, Blend::Over, 40, (40, 30), seed);
            let mut scaled = draw.clone();
            scaled.scene.means.iter_mut().for_each(|mean| *mean *= factor);
            scaled.scene.log_scales.iter_mut().for_each(|scale| *scale += power as f32 * std::f32::consts::LN_2);
            scaled.view =
                Camera { translation: draw.view.translation * factor, near: draw.view.near * factor, ..draw.view };
            same(rasterizer, &draw, &scaled).map_err(|failure| failure.at(format!("{factor} times as large")))?;
        }
    }
    Ok(())
}

fn same<R: Optimizer<Scene3d>>(rasterizer: &R, draw: &Draw<Scene3d>, other: &Draw<Scene3d>) -> Result<(), Failure> {
    let [a, b]: [Result<Image, _>; 2] =
        [draw, other].map(|draw| rasterizer.render(&draw.scene, &draw.view, &draw.settings).block_on());
    let (first, second) = (analysis(draw)?, analysis(other)?);
    Failure::unless(draw.scene != other.scene && draw.scene.len() == other.scene.len(), || "nothing moved".to_owned())?;
    // Each image has its own roundings, and so does the other scene.
    let sum = |a: &[[f64; 3]], b: &[[f64; 3]]| -> Vec<[f64; 3]> {
        a.iter().zip(b).map(|(a, b)| [0, 1, 2].map(|k| a[k] + b[k])).collect()
    };
    let both =
        Rendering { rounding: sum(&first.rounding, &second.rounding), flip: sum(&first.flip, &second.flip), ..first };
    compare_images(&around(&a?, &both), &b?)?;
    Ok(())
}
