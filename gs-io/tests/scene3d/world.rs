//! Scenes far from the origin of their world, or in another unit: files in the frame of the scene, and
//! in coordinates of the world.

use std::fs;

use glam::{DVec3, dvec3};
use gs_core::Scene3d;
use gs_io::{
    ConversionLoss, Coordinates, File3d, Format3d, TrainedWith, WorldFrame, WriteOptions3d, encode_3d, read_3d,
    write_3d,
};

use super::samples;

const FAR: WorldFrame = WorldFrame { origin: dvec3(4_500_000.0, 451_230.0, -120.0), unit: 100.0 };
const KILOMETRES: WorldFrame = WorldFrame { origin: DVec3::ZERO, unit: 1000.0 };

fn options(frame: WorldFrame, coordinates: Coordinates) -> WriteOptions3d {
    WriteOptions3d::default().with(|s| {
        s.trained_with = TrainedWith::default().with(|s| s.frame = frame);
        s.coordinates = coordinates;
    })
}

/// The scene written to a file of this name and read again, with the losses of writing.
fn back(name: &str, scene: &Scene3d, options: &WriteOptions3d) -> (File3d, Vec<ConversionLoss>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let losses = write_3d(&path, scene, options).unwrap().losses;
    (read_3d(&path).unwrap(), losses)
}

/// The means of the file in coordinates of the world.
fn in_world(file: &File3d) -> Vec<DVec3> {
    file.scene.means.iter().map(|mean| file.trained_with.frame.to_world(mean.as_dvec3())).collect()
}

#[test]
fn files_in_either_coordinates_are_read_into_the_frame() {
    let scene = samples::scene(40, 1);
    for (name, frame) in ["a.ply", "a.gltf", "a.glb"].into_iter().flat_map(|name| [FAR, KILOMETRES].map(|f| (name, f)))
    {
        let (as_scene, losses) = back(name, &scene, &options(frame, Coordinates::Scene));
        assert!(!losses.iter().any(|loss| matches!(loss, ConversionLoss::Frame(_))));
        assert_eq!((as_scene.trained_with.frame, &as_scene.scene.means), (frame, &scene.means), "{name}");
        let (of_world, _) = back(name, &scene, &options(frame, Coordinates::World));
        assert_eq!(of_world.trained_with.frame, frame, "{name}");
        for (a, b) in of_world.scene.means.iter().zip(&scene.means) {
            assert!(a.distance(*b) <= 1e-6 * b.length().max(1.0), "{name}: {a} {b}");
        }
        for (a, b) in of_world.scene.log_scales.iter().zip(&scene.log_scales) {
            assert!(a.abs_diff_eq(*b, 1e-5), "{name}: {a} {b}");
        }
    }
}

#[test]
fn a_ply_in_world_coordinates_says_where_other_programs_find_it() {
    let folder = tempfile::tempdir().unwrap();
    let scene = samples::scene(3, 0);
    let header = |frame| {
        let path = folder.path().join("a.ply");
        write_3d(&path, &scene, &options(frame, Coordinates::World)).unwrap();
        let bytes = fs::read(&path).unwrap();
        let end = bytes.windows(10).position(|part| part == b"end_header").unwrap();
        (String::from_utf8(bytes[..end].to_vec()).unwrap(), bytes[end + 11..].to_vec())
    };
    let (text, rows) = header(FAR);
    assert!(text.contains("property double x\nproperty double y\nproperty double z\nproperty float nx"), "{text}");
    let x = f64::from_le_bytes(*rows.first_chunk().unwrap());
    assert_eq!(x, FAR.to_world(scene.means[0].as_dvec3()).x);
    let (text, rows) = header(KILOMETRES);
    assert!(text.contains("property float x\n") && !text.contains("double"), "{text}");
    assert_eq!(f32::from_le_bytes(*rows.first_chunk().unwrap()), scene.means[0].x * 1000.0);
}

#[test]
fn formats_without_a_frame_say_what_they_lose_or_refuse() {
    let scene = samples::scene(3, 0);
    for name in ["a.spz", "a.splat", "a.sog"] {
        let (_, losses) = back(name, &scene, &options(FAR, Coordinates::Scene));
        assert!(losses.contains(&ConversionLoss::Frame(FAR)), "{name} {losses:?}");
        let (scaled, losses) = back(name, &scene, &options(KILOMETRES, Coordinates::World));
        assert!(!losses.iter().any(|loss| matches!(loss, ConversionLoss::Frame(_))), "{name} {losses:?}");
        let size = |scene: &Scene3d| scene.means.iter().fold(0.0, |size: f32, mean| size.max(mean.length()));
        assert!((size(&scaled.scene) / size(&scene) - 1000.0).abs() < 1.0, "{name}");
        let folder = tempfile::tempdir().unwrap();
        let error = write_3d(folder.path().join(name), &scene, &options(FAR, Coordinates::World)).unwrap_err();
        assert!(error.to_string().contains("need 64 bits") && error.to_string().contains("write a PLY"), "{error}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}

#[test]
fn a_format_says_which_gaussians_it_cannot_hold() {
    let mut scene = samples::scene(6, 0);
    (scene.means[1].z, scene.means[3].x, scene.means[4].y) = (-9e6, 1e36, 8.3e6);
    let in_scene = options(KILOMETRES, Coordinates::Scene);
    let in_world = options(KILOMETRES, Coordinates::World);
    for (format, options, expected) in [
        (Format3d::Spz, &in_scene, &[1, 3][..]),
        (Format3d::Spz, &in_world, &[1, 3, 4]),
        (Format3d::Sog, &in_scene, &[]),
        (Format3d::Sog, &in_world, &[3]),
        (Format3d::Splat, &in_world, &[3]),
        (Format3d::Glb, &in_world, &[]),
        (Format3d::Ply, &in_scene, &[]),
    ] {
        assert_eq!(format.cannot_hold(&scene, options), expected, "{format} {:?}", options.coordinates);
    }
    let message = encode_3d("a.spz", &scene, &in_scene).unwrap_err().to_string();
    assert!(message.contains("a coordinate of ±9e6 (Gaussian 1 and 1 other), beyond ±8388607 units"), "{message}");
    (scene.means[1].z, scene.means[3].x) = (0.0, 0.0);
    let losses = encode_3d("a.spz", &scene, &in_scene).unwrap().written.losses;
    assert!(losses.iter().any(|loss| loss.to_string().contains("1 units, because Gaussian 4 is at ±8300000")));
}

#[test]
fn doubles_of_other_programs_keep_their_digits() {
    let scene = samples::scene(20, 0);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    // Millimetres between Gaussians, at UTM coordinates.
    let frame = WorldFrame { origin: dvec3(451_230.0, 5_411_870.0, 420.0), unit: 1e-3 };
    write_3d(&path, &scene, &options(frame, Coordinates::World)).unwrap();
    let bytes = fs::read(&path).unwrap();
    let text = b"comment gs world-frame";
    let at = bytes.windows(text.len()).position(|part| part == text).unwrap();
    let end = at + bytes[at..].iter().position(|byte| *byte == b'\n').unwrap() + 1;
    fs::write(&path, [&bytes[..at], &bytes[end..]].concat()).unwrap();
    let read = read_3d(&path).unwrap();
    assert!(read.trained_with.frame.unit == 1.0 && read.trained_with.frame.origin != DVec3::ZERO);
    for (found, mean) in in_world(&read).iter().zip(&scene.means) {
        assert!(found.distance(frame.to_world(mean.as_dvec3())) < 1e-8);
    }
    let [ConversionLoss::RoundedMeans { largest, visible: 0 }] = read.losses[..] else { panic!("{:?}", read.losses) };
    assert!(largest > 0.0 && largest < 1e-3, "{largest}");
}

#[test]
fn a_scene_moves_between_frames() {
    let (mut file, _) = back("a.ply", &samples::scene(10, 2), &options(FAR, Coordinates::Scene));
    let before = in_world(&file);
    let scales = file.scene.log_scales.clone();
    file.move_to(WorldFrame { origin: FAR.origin + 500.0, unit: 10.0 });
    for (a, b) in in_world(&file).iter().zip(&before) {
        assert!(a.distance(*b) < 1e-3, "{a} {b}");
    }
    assert!((file.scene.log_scales[0].x - scales[0].x - 10f32.ln()).abs() < 1e-5);
}
