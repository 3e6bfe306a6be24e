//! Files made by other programs, if they are there.

use glam::Vec3;
use gs_core::{Scene, Scene3d, sigmoid};
use gs_io::{ConversionLoss, File3d, Format3d, WriteOptions3d, read_3d};

use super::samples;

/// Reads a file of `$GS_DATA/splats` or `../shared/data/splats`; prints a line and returns `None`
/// if it does not exist.
fn file(name: &str) -> Option<File3d> {
    gs_conformance::data::find(&format!("splats/{name}")).map(|path| read_3d(path).unwrap())
}

#[track_caller]
fn assert_near(a: &[Vec3], b: &[Vec3], tolerance: f32) {
    assert_eq!(a.len(), b.len());
    let far = a.iter().zip(b).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max);
    assert!(far <= tolerance, "{far}, more than {tolerance}, apart");
}

#[test]
fn biker_is_the_same_scene_as_spz_and_as_compressed_ply() {
    let (Some(ply), Some(spz)) = (file("biker.compressed.ply"), file("biker.spz")) else { return };
    assert_eq!((ply.format, spz.format), (Format3d::CompressedPly, Format3d::Spz));
    let (ply, spz) = (ply.scene, spz.scene);
    assert_eq!((ply.len(), ply.sh_degree, spz.len(), spz.sh_degree), (152_746, 0, 152_746, 0));
    // Positions of the PLY are in 1/1024 of a chunk, those of the SPZ in 1/4096 units; both round
    // scales and colours.
    assert_near(&ply.means, &spz.means, 2e-3);
    // An SPZ has no logarithm below −10.
    let log_scales: Vec<Vec3> = ply.log_scales.iter().map(|s| s.max(Vec3::splat(-10.0))).collect();
    assert_near(&log_scales, &spz.log_scales, 0.1);
    let colors = |scene: &Scene3d| scene.sh.iter().map(|c| 0.282_094_79 * *c).collect::<Vec<_>>();
    assert_near(&colors(&ply), &colors(&spz), 0.006);
    for i in 0..ply.len() {
        assert!((sigmoid(ply.opacity_logits[i]) - sigmoid(spz.opacity_logits[i])).abs() < 0.006);
        // Compares shapes, not quaternions: if scales are equal, the order of axes does not matter.
        let (a, b) = (ply.gaussian(i).covariance().unwrap(), spz.gaussian(i).covariance().unwrap());
        let size = a.x_axis.x + a.y_axis.y + a.z_axis.z;
        assert!(a.abs_diff_eq(b, 0.15 * size), "Gaussian {i}: {a} {b}");
    }
}

#[test]
fn kacytran_comes_back_to_the_byte() {
    let Some(read) = file("kacytran_iter7000_point_cloud.ply") else { return };
    assert_eq!((read.scene.len(), read.scene.sh_degree, read.format), (9_080, 3, Format3d::Ply));
    let again = samples::written("a.ply", &read.scene, &WriteOptions3d::default());
    assert_eq!(again.len() as u64, read.bytes);
    assert_eq!(format!("{:?}", samples::read(&again, "a.ply").unwrap().scene), format!("{:?}", read.scene));
}

#[test]
fn small_files_of_every_version_hold_the_same_four() {
    let names = ["st_minimal.splat", "st_minimal-v2.spz", "st_minimal-v3.spz", "st_minimal-v4.spz"];
    let files: Vec<Scene3d> = names.iter().filter_map(|name| file(name)).map(|file| file.scene).collect();
    let [splat, spz @ ..] = files.as_slice() else { return };
    for (scene, name) in spz.iter().zip(&names[1..]) {
        assert_eq!((scene.len(), scene.sh_degree), (4, 0), "{name}");
        assert_near(&scene.log_scales, &splat.log_scales, 1.0 / 16.0);
        scene.opacity_logits.iter().for_each(|&logit| assert!((sigmoid(logit) - 0.9).abs() < 0.01, "{name}"));
        for i in 0..4 {
            let (a, b) = (scene.gaussian(i).covariance().unwrap(), splat.gaussian(i).covariance().unwrap());
            assert!(a.abs_diff_eq(b, 0.1 * b.x_axis.x), "{name}: {a} {b}");
        }
    }
    assert_eq!(spz[1], spz[2], "versions 3 and 4 hold the same bytes");
    // Its maker flipped the axes of versions 3 and 4 relative to the .splat's, but not those of
    // version 2.
    let turned = |scene: &Scene3d, signs: Vec3| scene.means.iter().map(|m| *m * signs).collect::<Vec<_>>();
    assert_near(&spz[1].means, &splat.means, 0.0);
    assert_near(&turned(&spz[0], Vec3::new(1.0, -1.0, -1.0)), &splat.means, 0.0);
}

#[test]
fn text_and_binary_of_one_maker_are_alike() {
    let (Some(text), Some(binary)) = (file("gsplatrs_minimal_ascii.ply"), file("gsplatrs_minimal_binary.ply")) else {
        return;
    };
    assert_eq!(text.scene, binary.scene);
    assert_eq!((text.scene.len(), text.scene.sh_degree), (3, 0));
    assert_eq!(text.scene.sh[1], Vec3::new(0.7, 0.3, 0.2));
}

#[test]
fn others_read_with_the_counts_that_they_have() {
    for (name, count, degree) in
        [("victor_model.splat", 124_495, 0), ("schwa_3pts_train.ply", 3, 3), ("gsplatrs_minimal_v4_degree0.spz", 8, 0)]
    {
        let Some(file) = file(name) else { return };
        assert_eq!((file.scene.len(), file.scene.sh_degree, file.losses), (count, degree, vec![]), "{name}");
    }
}

#[test]
fn the_matrix_of_gltf_reads_alike_as_text_and_binary() {
    let (Some(text), Some(binary)) = (file("khr_conformance_matrix.gltf"), file("khr_conformance_matrix.glb")) else {
        return;
    };
    assert_eq!((text.format, binary.format), (Format3d::Gltf, Format3d::Glb));
    assert_eq!(text.scene, binary.scene);
    let scene = text.scene;
    assert_eq!((scene.len(), scene.sh_degree), (15, 3));
    // It follows the draft with logarithms as scales, and all but one of its meshes are in linear
    // light.
    assert!(text.losses.contains(&ConversionLoss::DraftScales) && text.losses.contains(&ConversionLoss::LinearLight));
    assert!(scene.means.iter().all(|&mean| mean == Vec3::new(-1.0, -2.0, 3.0)));
    // The integers of meshes 1 and 2 are the floats of mesh 0.
    for i in 1..3 {
        assert_eq!(scene.rotations[i], scene.rotations[0]);
    }
    assert_eq!(scene.log_scales[4], Vec3::new(1.0, -2.0, 3.0));
    assert_eq!(scene.log_scales[5], Vec3::new(1.0, 0.0, -1.0));
    let opacities = [8, 9, 10].map(|i| sigmoid(scene.opacity_logits[i]));
    assert!(
        (opacities[0] - 0.75).abs() < 1e-6 && opacities[1..].iter().all(|o| (o - 0.25).abs() < 2e-3),
        "{opacities:?}"
    );
    // Mesh 3 is in sRGB and not converted.
    assert_eq!(scene.gaussian(3).sh[0], Vec3::new(0.1, 0.2, 0.3));
}
