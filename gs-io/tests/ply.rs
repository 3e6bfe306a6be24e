//! The exported PLY has 3DGS's layout, and its numbers, read by a viewer's rules, are the scene's.

use glam::{Mat3, Quat, Vec2, Vec3};
use gs_core::{Blend, Image, PlanarGaussian, PlanarScene, RenderSettings, Scene};
use gs_io::{Error, PlanarFile, PlyColors, write_ply};

const PROPERTIES: [&str; 17] = [
    "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
    "rot_1", "rot_2", "rot_3",
];

/// The vertices of the file that is written, its header checked line by line.
fn exported(file: &PlanarFile, colors: PlyColors<'_>) -> Vec<[f32; 17]> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    write_ply(&path, file, colors).unwrap();
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

fn gaussian(x: f32, y: f32, log_scale: f32, opacity_logit: f32) -> PlanarGaussian {
    let (mean, log_scale) = (Vec2::new(x, y), Vec2::new(log_scale, log_scale - 1.0));
    PlanarGaussian { mean, log_scale, rotation: 0.7, opacity_logit, color: Vec3::new(0.25, 0.5, 1.5) }
}

fn file(gaussians: &[PlanarGaussian], blend: Blend) -> PlanarFile {
    let scene: PlanarScene = gaussians.iter().copied().collect();
    PlanarFile { scene, width: 200, height: 100, settings: RenderSettings::blended(blend) }
}

#[test]
fn an_over_scene_keeps_places_shapes_colours_and_order() {
    let gaussians = [gaussian(200.0, 0.0, 2.0, 1.5), gaussian(100.0, 50.0, 0.0, f32::INFINITY)];
    let rows = exported(&file(&gaussians, Blend::Over), PlyColors::Stored);
    // The top-right corner of a 200×100 canvas is (1, −½): y points down. The centre is the origin.
    assert_eq!((&rows[0][..2], &rows[1][..2]), (&[1.0, -0.5][..], &[0.0, 0.0][..]));
    assert!(rows[0][2] < rows[1][2] && rows[1][2] < 1e-3, "the first is in front, the stack thin");
    assert_eq!((rows[0][9], rows[1][9]), (1.5, 16.0));
    for (row, g) in rows.iter().zip(&gaussians) {
        let color = [6, 7, 8].map(|k| 0.5 + 0.282_094_79 * row[k]);
        assert!(Vec3::from(color).abs_diff_eq(g.color, 1e-6), "{color:?}");
        // Σ as viewers build it from quaternion (w, x, y, z) and exp(scale), against the scene's.
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
fn a_sum_scene_takes_the_picture_s_colours_with_the_small_in_front() {
    let gaussians = [
        gaussian(10.0, 10.0, 3.0, f32::INFINITY),
        gaussian(150.0, 99.0, 1.0, f32::INFINITY),
        gaussian(-9.0, 900.0, 2.0, f32::INFINITY),
    ];
    let file = file(&gaussians, Blend::Sum);
    let picture = Image::from_fn(20, 10, |x, y| [x as f32 / 20.0, y as f32 / 10.0, 0.5]).unwrap();
    let rows = exported(&file, PlyColors::Sampled(&picture));
    let color = |row: &[f32; 17]| Vec3::from([6, 7, 8].map(|k| 0.5 + 0.282_094_79 * row[k]));
    assert!(color(&rows[0]).abs_diff_eq(Vec3::new(0.05, 0.1, 0.5), 1e-6));
    assert!(color(&rows[1]).abs_diff_eq(Vec3::new(0.75, 0.9, 0.5), 1e-6));
    assert!(color(&rows[2]).abs_diff_eq(Vec3::new(0.0, 0.9, 0.5), 1e-6), "outside: the nearest border");
    assert!(rows[1][2] < rows[2][2] && rows[2][2] < rows[0][2]);
    assert!(rows.iter().all(|row| (1.0 / (1.0 + (-row[9]).exp()) - 0.9).abs() < 1e-6));
    let stored = exported(&file, PlyColors::Stored);
    assert!(color(&stored[0]).abs_diff_eq(gaussians[0].color, 1e-6));
}

#[test]
fn many_gaussians_stay_distinct_in_depth_yet_thin() {
    let gaussians: Vec<_> = (0..100_000).map(|i| gaussian(i as f32 / 500.0, 50.0, 0.0, 0.0)).collect();
    let rows = exported(&file(&gaussians, Blend::Over), PlyColors::Stored);
    assert!(rows.windows(2).all(|pair| pair[0][2] < pair[1][2]));
    assert!(rows.last().unwrap()[2] <= 0.02);
}

#[test]
fn what_no_viewer_could_show_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut broken = file(&[gaussian(0.0, 0.0, 0.0, 0.0)], Blend::Over);
    broken.scene.means[0].x = f32::NAN;
    for impossible in [broken, file(&[], Blend::Over)] {
        let error = write_ply(folder.path().join("a.ply"), &impossible, PlyColors::Stored).unwrap_err();
        assert!(matches!(error, Error::Content { .. }), "{error}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
