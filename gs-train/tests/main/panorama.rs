//! 360° images: a scene is rendered into one, which is read again as the faces of a cube and must
//! show the same scene.

use std::{f64::consts::PI, fs};

use crate::fixture_3d::{rasterizer, render, short};
use glam::{Mat3, Vec2, Vec3};
use gs_core::{Camera, Gaussian3d, Image, Rasterizer, Scene, Scene3d, constants::SH_C0};
use gs_cpu::CpuRasterizer;
use gs_density::Policy;
use gs_io::{
    WorldFrame,
    dataset::{DatasetSettings, Remark, read_dataset},
};
use gs_train::{
    Trainer3d,
    train::{PosedView, RefinePoses, Start, Views, evaluate},
};
use pollster::FutureExt as _;
use rayon::prelude::*;

/// Columns and rows of the 360° images, and of the renderings that they are made of.
const SIZE: (u32, u32) = (384, 192);
const SIDE: u32 = 256;

/// Large Gaussians on all sides of the origin.
fn around() -> Scene3d {
    let mut scene = Scene3d::default();
    for i in 0..24 {
        let (angle, height) = (2.4 * i as f32, (2.0 * i as f32 + 1.0) / 24.0 - 1.0);
        let direction = (Vec2::from_angle(angle) * (1.0 - height * height).sqrt()).extend(height);
        let color = Vec3::new(0.2 + 0.7 * (i % 3) as f32 / 2.0, 0.9 - 0.03 * i as f32, 0.2 + 0.2 * (i % 4) as f32);
        scene.push(Gaussian3d {
            mean: (3.0 + 0.1 * i as f32) * direction,
            log_scale: Vec3::new(0.5, 0.7, 0.9).map(f32::ln),
            rotation: [1.0, 0.3 * i as f32, 0.5, 0.1],
            opacity_logit: 2.0,
            sh: vec![(color - 0.5) / SH_C0],
        });
    }
    scene
}

/// The 360° image of a camera at `position`, with axes as the world's, assembled from six
/// renderings whose cameras this test rotates itself.
fn panorama(rasterizer: &CpuRasterizer, position: Vec3) -> Image {
    // The columns are right, down, forward.
    let turns = [Vec3::Z, Vec3::X, Vec3::NEG_Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::Y].map(|forward| {
        let down = if forward.y == 0.0 { Vec3::Y } else { Vec3::X };
        Mat3::from_cols(down.cross(forward), down, forward)
    });
    let sides = turns.map(|turn| {
        let rotation = turn.transpose();
        // A little more than 90°, so that borders can be interpolated.
        let camera = Camera {
            rotation,
            translation: -(rotation * position),
            focal: Vec2::splat(0.49 * SIDE as f32),
            center: Vec2::splat(0.5 * SIDE as f32),
            ..Camera::looking_forward(SIDE, SIDE, 1.0)
        };
        (camera, rasterizer.render(&around(), &camera, &render()).block_on().unwrap())
    });
    let color = |x: u32, y: u32| {
        let longitude = (2.0 * PI * ((f64::from(x) + 0.5) / f64::from(SIZE.0) - 0.5)) as f32;
        let latitude = (PI * ((f64::from(y) + 0.5) / f64::from(SIZE.1) - 0.5)) as f32;
        let direction = Vec3::new(longitude.sin() * latitude.cos(), latitude.sin(), longitude.cos() * latitude.cos());
        let ahead = |camera: &Camera| camera.rotation.row(2).dot(direction);
        let (camera, image) = sides.iter().max_by(|a, b| ahead(&a.0).total_cmp(&ahead(&b.0))).unwrap();
        let (at, _) = camera.project(position + direction).unwrap();
        let (corner, part) = ((at - 0.5).floor(), (at - 0.5).fract());
        let pixel = |dx: u32, dy: u32| Vec3::from_array(image.pixel(corner.x as u32 + dx, corner.y as u32 + dy));
        let row = |dy: u32| pixel(0, dy).lerp(pixel(1, dy), part.x);
        row(0).lerp(row(1), part.y).to_array()
    };
    Image::from_fn(SIZE.0, SIZE.1, color).unwrap().clamped()
}

#[test]
fn a_scene_is_as_good_in_the_faces_as_it_is() {
    let (rasterizer, folder) = (rasterizer(), tempfile::tempdir().unwrap());
    let positions = [Vec3::ZERO, Vec3::new(0.4, -0.1, 0.2), Vec3::new(-0.3, 0.2, 0.3)];
    let frames = positions.iter().enumerate().map(|(i, position)| {
        gs_io::write_png(folder.path().join(format!("{i}.png")), &panorama(&rasterizer, *position)).unwrap();
        // Camera-to-world with axes right, up, back.
        let [x, y, z] = position.to_array();
        serde_json::json!({"file_path": format!("{i}.png"), "transform_matrix":
            [[1.0, 0.0, 0.0, x], [0.0, -1.0, 0.0, y], [0.0, 0.0, -1.0, z], [0.0, 0.0, 0.0, 1.0]]})
    });
    let file = serde_json::json!({"camera_model": "EQUIRECTANGULAR", "frames": frames.collect::<Vec<_>>()});
    fs::write(folder.path().join("transforms.json"), file.to_string()).unwrap();
    let dataset =
        read_dataset(folder.path(), &DatasetSettings::default().with(|s| s.frame = Some(WorldFrame::WORLD))).unwrap();
    assert!(dataset.remarks.contains(&Remark::Split { count: 3 }));
    let views = Views::of_dataset(&dataset);
    assert_eq!((views.train.len(), views.test.len()), (12, 6));
    let all: Vec<PosedView> = views.train.into_iter().chain(views.test).collect();
    let judged = evaluate(&rasterizer, &around(), &all, &render()).block_on().unwrap();
    let worst = judged.views.iter().map(|view| view.psnr).fold(f64::INFINITY, f64::min);
    assert!(worst > 40.0, "{worst} dB; {:?}", judged.views);

    let refined = short(40).with(|s| s.refine_poses = RefinePoses::Auto);
    let refused = Trainer3d::from_views(&rasterizer, Views::of_dataset(&dataset), Start::Random, refined).block_on();
    assert!(refused.unwrap_err().to_string().contains("360"), "the faces of an image have one pose");

    // Steps on these faces find nothing to change.
    let mut settings = short(40);
    settings.policy = Policy::None;
    settings.render.effects.sh_degree = 0;
    let views = Views::of_dataset(&dataset);
    let mut trainer = Trainer3d::from_views(&rasterizer, views, Start::Scene(around()), settings).block_on().unwrap();
    trainer.run(&mut ()).block_on().unwrap();
    let trained = trainer.evaluate(&|_, _, _| Ok(())).block_on().unwrap();
    assert!(trained.psnr > 36.0, "{}", trained.psnr);
}

#[test]
fn a_360_image_is_decoded_once_for_its_faces() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.png");
    let color = |x: u32, y: u32| [x as f32 / 64.0, y as f32 / 32.0, 0.5];
    gs_io::write_png(&file, &Image::from_fn(64, 32, color).unwrap()).unwrap();
    let rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let frame = serde_json::json!({"file_path": "a.png", "transform_matrix": rows});
    let transforms = serde_json::json!({"camera_model": "EQUIRECTANGULAR", "frames": [frame]});
    fs::write(folder.path().join("transforms.json"), transforms.to_string()).unwrap();
    let dataset = read_dataset(folder.path(), &DatasetSettings::default()).unwrap();
    let expected: Vec<_> = dataset.views.iter().map(|view| view.read_image().unwrap()).collect();
    let faces = Views::of_dataset(&dataset).train;
    assert_eq!(faces.len(), 6);
    assert_eq!(faces[3].source.read().unwrap(), expected[3]);
    fs::remove_file(&file).unwrap();
    for index in [0, 1, 2, 4, 5] {
        assert_eq!(faces[index].source.read().unwrap(), expected[index], "{}", faces[index].name);
    }
    assert!(faces[0].source.read().is_err(), "faces that have been read are not kept");
}

/// On a pool of more threads than this machine may have: a thread that waits for others while it
/// makes faces must not wait for itself in another face.
#[test]
fn faces_are_read_on_many_threads() {
    let folder = tempfile::tempdir().unwrap();
    let color = |x: u32, y: u32| [x as f32 / 64.0, y as f32 / 32.0, 0.5];
    let rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let frames: Vec<_> = (0..12)
        .map(|number| {
            let name = format!("{number:02}.png");
            gs_io::write_png(folder.path().join(&name), &Image::from_fn(64, 32, color).unwrap()).unwrap();
            serde_json::json!({"file_path": name, "transform_matrix": rows})
        })
        .collect();
    let transforms = serde_json::json!({"camera_model": "EQUIRECTANGULAR", "frames": frames});
    fs::write(folder.path().join("transforms.json"), transforms.to_string()).unwrap();
    let settings = DatasetSettings::default().with(|s| s.test_every = None);
    let dataset = read_dataset(folder.path(), &settings).unwrap();
    let expected: Vec<_> = dataset.views[..6].iter().map(|view| view.read_image().unwrap()).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
    for _ in 0..5 {
        let faces = Views::of_dataset(&dataset).train;
        assert_eq!(faces.len(), 72);
        let read: Vec<_> = pool.install(|| faces.par_iter().map(|face| face.source.read().unwrap()).collect());
        assert!(read.chunks(6).all(|read| read == expected));
    }
}
