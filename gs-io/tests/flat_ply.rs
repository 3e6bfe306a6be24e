//! The exported PLY has 3DGS's layout and represents the scene by a viewer's rules.

use glam::{Mat3, Quat, Vec2, Vec3};
use gs_core::{Blend, Gaussian2d, RenderSettings, Scene, Scene2d};
use gs_io::{Error, File2d, PICTURE_DISTANCE_WORLD, read_3d, write_ply};

const PROPERTIES: [&str; 17] = [
    "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
    "rot_1", "rot_2", "rot_3",
];

/// The vertices of the exported file, with its header checked line by line.
fn exported(file: &File2d) -> Vec<[f32; 17]> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    write_ply(&path, file).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header: Vec<&str> = std::str::from_utf8(&bytes[..end]).unwrap().lines().collect();
    let mut expected = vec!["ply".to_owned(), "format binary_little_endian 1.0".to_owned()];
    expected.push(format!("element vertex {}", file.scene.len()));
    expected.extend(PROPERTIES.map(|name| format!("property float {name}")));
    expected.push("end_header".to_owned());
    let header: Vec<&str> = header.into_iter().filter(|line| !line.starts_with("comment ")).collect();
    assert_eq!(header, expected);
    let (rows, rest) = bytes[end..].as_chunks::<{ 4 * 17 }>();
    assert!(rest.is_empty());
    rows.iter().map(|row| std::array::from_fn(|k| f32::from_le_bytes(row[4 * k..][..4].try_into().unwrap()))).collect()
}

fn gaussian(x: f32, y: f32, log_scale: f32, opacity_logit: f32) -> Gaussian2d {
    let (mean, log_scale) = (Vec2::new(x, y), Vec2::new(log_scale, log_scale - 1.0));
    Gaussian2d { mean, log_scale, rotation: 0.7, opacity_logit, color: Vec3::new(0.25, 0.5, 1.5) }
}

fn file(gaussians: &[Gaussian2d], blend: Blend) -> File2d {
    let scene: Scene2d = gaussians.iter().copied().collect();
    File2d { scene, width: 200, height: 100, settings: RenderSettings::blended(blend), profile: None }
}

#[test]
fn an_over_scene_keeps_places_shapes_colours_and_order() {
    let gaussians = [gaussian(200.0, 0.0, 2.0, 1.5), gaussian(100.0, 50.0, 0.0, f32::INFINITY)];
    let rows = exported(&file(&gaussians, Blend::Over));
    // The top-right corner of a 200×100 canvas is (1, −½): y points down. The centre is the origin.
    assert_eq!((&rows[0][..2], &rows[1][..2]), (&[1.0, -0.5][..], &[0.0, 0.0][..]));
    assert!(rows[0][2] < rows[1][2] && rows[1][2] < 1e-3, "the first is in front, the stack thin");
    assert_eq!((rows[0][9], rows[1][9]), (1.5, 16.0));
    for (row, g) in rows.iter().zip(&gaussians) {
        let color = [6, 7, 8].map(|k| 0.5 + 0.282_094_79 * row[k]);
        assert!(Vec3::from(color).abs_diff_eq(g.color, 1e-6), "{color:?}");
        // Σ as viewers compute it from quaternion (w, x, y, z) and exp(scale), compared with the
        // scene's.
        let rotation = Mat3::from_quat(Quat::from_xyzw(row[14], row[15], row[16], row[13]));
        let scale = Mat3::from_diagonal(Vec3::new(row[10].exp(), row[11].exp(), row[12].exp()));
        let covariance = (rotation * scale) * (rotation * scale).transpose();
        let expected = g.covariance() * 0.01 * 0.01;
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let (found, expected) = (covariance.col(i)[j], expected.col(i)[j]);
            assert!((found - expected).abs() < 1e-5 * g.covariance().determinant(), "{found} {expected}");
        }
        assert!(covariance.z_axis.truncate().length() == 0.0 && covariance.z_axis.z < 1e-7);
    }
}

#[test]
fn depth_changes_nothing_that_is_seen_from_the_front() {
    let gaussians: Vec<_> = (0..1000).map(|_| gaussian(190.0, 20.0, 1.0, 0.0)).collect();
    let rows = exported(&file(&gaussians, Blend::Over));
    let seen = |row: &[f32; 17]| {
        let distance = PICTURE_DISTANCE_WORLD + row[2];
        [row[0] / distance, row[1] / distance, row[10].exp() / distance, row[11].exp() / distance]
    };
    let (first, last) = (seen(&rows[0]), seen(&rows[999]));
    assert!(rows[999][2] > 4e-4);
    assert!(first.iter().zip(last).all(|(a, b)| (a - b).abs() < 1e-6 * a.abs()), "{first:?} {last:?}");
}

#[test]
fn the_file_says_which_picture_it_shows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let flat = file(&[gaussian(10.0, 20.0, 1.0, 0.0), gaussian(30.0, 40.0, 1.0, 0.0)], Blend::Over);
    write_ply(&path, &flat).unwrap();
    let read = read_3d(&path).unwrap();
    assert_eq!((read.picture, read.scene.len()), (Some((200, 100)), 2));
    let bytes = std::fs::read(&path).unwrap();
    for (other, expected) in [("300x100", Some((300, 100))), ("000x100", None), ("-00x100", None), ("2x0 100", None)] {
        let at = bytes.windows(7).position(|w| w == b"200x100").unwrap();
        let mut changed = bytes.clone();
        changed[at..at + 7].copy_from_slice(other.as_bytes());
        std::fs::write(&path, changed).unwrap();
        assert_eq!(read_3d(&path).unwrap().picture, expected, "{other}");
    }
}

#[test]
fn many_gaussians_stay_distinct_in_depth_yet_thin() {
    let gaussians: Vec<_> = (0..100_000).map(|i| gaussian(i as f32 / 500.0, 50.0, 0.0, 0.0)).collect();
    let rows = exported(&file(&gaussians, Blend::Over));
    assert!(rows.windows(2).all(|pair| pair[0][2] < pair[1][2]));
    assert!(rows.last().unwrap()[2] <= 0.02);
}

#[test]
fn what_no_viewer_could_show_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut broken = file(&[gaussian(0.0, 0.0, 0.0, 0.0)], Blend::Over);
    broken.scene.means[0].x = f32::NAN;
    let sum = file(&[gaussian(0.0, 0.0, 0.0, 0.0)], Blend::Sum);
    for impossible in [broken, file(&[], Blend::Over), sum] {
        let error = write_ply(folder.path().join("a.ply"), &impossible).unwrap_err();
        assert!(matches!(error, Error::Content { .. }), "{error}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
