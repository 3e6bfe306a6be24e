//! Small data sets of posed images with a known scene, for tests of training.

use std::{error::Error, fmt::Write as _, fs, path::Path};

use glam::{Vec2, Vec3};
use gs_core::{
    Blend, Camera, Gaussian3d, Rasterizer, RenderSettings, Scene, Scene3d,
    constants::SH_C0,
    effects::{Antialias, Order},
};
use pollster::FutureExt as _;

/// Number of views of a data set.
const VIEWS: u32 = 8;

/// Eight Gaussians of different colours around the origin. Other variants are turned and have other
/// colours.
pub fn small_scene(variant: u32) -> Scene3d {
    let turn = variant as f32;
    let mut scene = Scene3d::default();
    for i in 0..8 {
        let angle = 0.8 * i as f32 + 0.3 * turn;
        let color = Vec3::new((i % 2) as f32, (i % 3) as f32 / 2.0, (0.3 + 0.2 * turn).fract());
        scene.push(Gaussian3d {
            mean: 0.6 * Vec3::new(angle.cos(), angle.sin(), 0.5 * (2.0 * angle).sin()),
            log_scale: Vec3::new(0.2, 0.3, 0.15).map(f32::ln),
            rotation: [1.0, 0.1 * i as f32, 0.0, 0.3],
            opacity_logit: 2.0,
            sh: vec![(color - 0.5) / SH_C0],
        });
    }
    scene
}

/// Writes eight images of a scene on black, 32×24 px, as a Nerfstudio data set into `folder`, which
/// is made. With points, the data set has one at the mean of each Gaussian.
///
/// # Errors
/// Those of the backend and of writing a file.
pub fn write_dataset(
    folder: &Path,
    scene: &Scene3d,
    rasterizer: &impl Rasterizer<Scene3d>,
    with_points: bool,
) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(folder.join("images"))?;
    let lens = Camera::looking_forward(32, 24, 0.7);
    let mut render = RenderSettings::blended(Blend::Over).on([0.0; 3]);
    (render.effects.order, render.effects.antialias) = (Order::Global, Antialias::Dilate);
    let mut frames = Vec::new();
    for i in 0..VIEWS {
        let position = 4.0 * Vec2::from_angle(0.8 * i as f32).extend(0.3).normalize();
        let camera = lens.looking_at(position, Vec3::ZERO, Vec3::Z).ok_or("a view from above")?;
        let image = rasterizer.render(scene, &camera, &render).block_on()?;
        let name = format!("images/{i}.png");
        gs_io::write_png(folder.join(&name), &image)?;
        // Their camera axes are right, up, backward.
        let [right, down, forward] = [0, 1, 2].map(|row| camera.rotation.row(row));
        let row = |axis: usize| [right[axis], -down[axis], -forward[axis], position[axis]];
        let matrix = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
        frames.push(format!("{{ \"file_path\": \"{name}\", \"transform_matrix\": {matrix:?} }}"));
    }
    let points = if with_points { ", \"ply_file_path\": \"points.ply\"" } else { "" };
    let (focal, center, frames) = (lens.focal, lens.center, frames.join(",\n"));
    let json = format!(
        "{{ \"w\": 32, \"h\": 24, \"fl_x\": {}, \"fl_y\": {}, \"cx\": {}, \"cy\": {}{points}, \"frames\": [{frames}] }}",
        focal.x, focal.y, center.x, center.y
    );
    fs::write(folder.join("transforms.json"), json)?;
    if with_points {
        let properties = "property float x\nproperty float y\nproperty float z";
        let mut ply = format!("ply\nformat ascii 1.0\nelement vertex {}\n{properties}\nend_header\n", scene.len());
        for mean in &scene.means {
            writeln!(ply, "{} {} {}", mean.x, mean.y, mean.z)?;
        }
        fs::write(folder.join("points.ply"), ply)?;
    }
    Ok(())
}
