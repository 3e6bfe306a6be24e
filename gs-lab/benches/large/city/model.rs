//! The files of a capture's cameras and points: COLMAP's text model.

use std::io::{self, Write};

use glam::Quat;
use gs_core::{Camera, Scene3d, constants::SH_C0};

use super::lens::RadialLens;

/// `cameras.txt`: one lens for all photographs.
pub(super) fn write_cameras(lens: &RadialLens, file: &mut dyn Write) -> io::Result<()> {
    let RadialLens { size, focal, k } = lens;
    let middle = 0.5 * size.as_vec2();
    writeln!(file, "1 SIMPLE_RADIAL {} {} {focal} {} {} {k}", size.x, size.y, middle.x, middle.y)
}

/// `images.txt`: a pose and a name for each photograph.
pub(super) fn write_images(photographs: &[(String, Camera)], file: &mut dyn Write) -> io::Result<()> {
    for (index, (name, camera)) in photographs.iter().enumerate() {
        let (q, t) = (Quat::from_mat3(&camera.rotation).normalize(), camera.translation);
        writeln!(file, "{} {} {} {} {} {} {} {} 1 {name}\n", index + 1, q.w, q.x, q.y, q.z, t.x, t.y, t.z)?;
    }
    Ok(())
}

/// `points3D.txt`: about `count` of a scene's Gaussians, evenly chosen.
pub(super) fn write_points(scene: &Scene3d, count: usize, file: &mut dyn Write) -> io::Result<()> {
    let every = scene.means.len().div_ceil(count.max(1)).max(1);
    let coefficients = scene.sh.len() / scene.means.len().max(1);
    for (index, p) in scene.means.iter().enumerate().step_by(every) {
        let color = (0.5 + SH_C0 * scene.sh[index * coefficients]).to_array();
        let [r, g, b] = color.map(|value| (value * 255.0).round() as u8);
        writeln!(file, "{} {} {} {} {r} {g} {b} 0.5", index + 1, p.x, p.y, p.z)?;
    }
    Ok(())
}
