//! Written scenes are read back bit for bit, or to the format's step.

use std::{f32::consts::LN_2, fs};

use glam::Vec3;
use gs_conformance::properties::fresh;
use gs_core::{
    Scene, Scene3d,
    effects::{Antialias, Order},
    sigmoid,
};
use gs_io::{ConversionLoss, Format3d, SpzVersion, TrainedWith, WriteOptions3d, encode_3d, read_3d, write_3d};
use proptest::{collection::vec, prelude::*};

use super::samples;

fn finite() -> impl Strategy<Value = f32> {
    use prop::num::f32::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO
}

fn logit() -> impl Strategy<Value = f32> {
    prop_oneof![4 => -12.0..12.0_f32, 1 => Just(f32::INFINITY), 1 => Just(f32::NEG_INFINITY)]
}

/// Scenes with these means and coefficients, unit quaternions, and log-scales within the range of
/// all formats.
fn scenes<M, C>(mean: fn() -> M, coefficient: fn() -> C) -> impl Strategy<Value = Scene3d>
where
    M: Strategy<Value = f32>,
    C: Strategy<Value = f32>,
{
    (1..7_usize, 0..=3_u8).prop_flat_map(move |(count, sh_degree)| {
        let triples = move || vec([mean(), mean(), mean()].prop_map(Vec3::from), count);
        let log_scales = vec([-9.9..5.9_f32, -9.9..5.9_f32, -9.9..5.9_f32].prop_map(Vec3::from), count);
        let rotations = vec([-1.0..1.0_f32, -1.0..1.0_f32, -1.0..1.0_f32, 0.1..1.0_f32].prop_map(unit), count);
        let sh_len = (usize::from(sh_degree) + 1).pow(2);
        let sh = vec([coefficient(), coefficient(), coefficient()].prop_map(Vec3::from), count * sh_len);
        (triples(), log_scales, rotations, vec(logit(), count), sh).prop_map(
            move |(means, log_scales, rotations, opacity_logits, sh)| Scene3d {
                means,
                log_scales,
                rotations,
                opacity_logits,
                sh_degree,
                sh,
            },
        )
    })
}

fn unit(q: [f32; 4]) -> [f32; 4] {
    let length = q.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
    q.map(|v| (f64::from(v) / length) as f32)
}

fn bits<'a>(vectors: impl IntoIterator<Item = &'a Vec3>) -> Vec<u32> {
    vectors.into_iter().flat_map(|v| v.to_array()).map(f32::to_bits).collect()
}

/// The scene read back from a file of this name, which must report the format.
fn back(name: &str, scene: &Scene3d, options: &WriteOptions3d) -> Scene3d {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let written = write_3d(&path, scene, options).unwrap();
    let read = read_3d(&path).unwrap();
    assert_eq!(read.format, written.format);
    // A glTF's numbers are in a separate file.
    let files = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().metadata().unwrap().len());
    assert_eq!(read.bytes, files.sum::<u64>());
    assert!(read.losses.is_empty(), "{:?}", read.losses);
    read.scene
}

/// The finite logit for an infinite one, in formats without rounded opacities.
fn read_infinite(logit: f32) -> f32 {
    if logit > 0.0 { 18.021_827 } else { -88.0 }
}

/// The cosine of half the angle between two rotations; 1 for q and −q.
fn cosine(a: [f32; 4], b: [f32; 4]) -> f64 {
    let dot = |a: [f32; 4], b: [f32; 4]| a.iter().zip(b).map(|(&a, b)| f64::from(a) * f64::from(b)).sum::<f64>();
    (dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()).abs()
}

#[track_caller]
fn assert_near(what: &str, a: Vec3, b: Vec3, tolerance: f32) {
    assert!((a - b).abs().max_element() <= tolerance, "{what}: {a} {b}, more than {tolerance} apart");
}

proptest! {
    #![proptest_config(fresh(100))]

    #[test]
    fn ply_is_the_identity(scene in scenes(finite, finite), q in [finite(), finite(), finite(), finite()]) {
        let mut scene = scene;
        scene.rotations[0] = q; // of any length, 0 too: PLY keeps it
        let read = back("a.ply", &scene, &WriteOptions3d::default());
        let finite = |logit: &mut f32| *logit = if logit.is_infinite() { read_infinite(*logit) } else { *logit };
        scene.opacity_logits.iter_mut().for_each(finite);
        prop_assert_eq!(format!("{read:?}"), format!("{scene:?}"));
        let numbers = |s: &Scene3d| [bits(&s.means), bits(&s.log_scales), bits(&s.sh)].concat();
        prop_assert_eq!(numbers(&read), numbers(&scene));
    }

    #[test]
    fn gltf_keeps_means_rotations_and_sh(
        scene in scenes(finite, finite),
        name in prop_oneof![Just("a.gltf"), Just("a.glb")],
    ) {
        let read = back(name, &scene, &WriteOptions3d::default());
        prop_assert_eq!(bits(&read.means), bits(&scene.means));
        prop_assert_eq!(bits(&read.sh), bits(&scene.sh));
        prop_assert_eq!(&read.rotations, &scene.rotations);
        prop_assert_eq!(read.sh_degree, scene.sh_degree);
        for i in 0..scene.len() {
            assert_near("log-scale", read.log_scales[i], scene.log_scales[i], 1e-6);
            let (a, b) = (read.opacity_logits[i], scene.opacity_logits[i]);
            prop_assert!((sigmoid(a) - sigmoid(b)).abs() <= 1.2e-7, "{} {}", a, b);
        }
    }

    #[test]
    fn spz_stays_within_its_steps(
        scene in scenes(|| -2000.0..2000.0_f32, || -1.0..=1.0_f32),
        version in prop_oneof![Just(SpzVersion::V3), Just(SpzVersion::V4)],
    ) {
        let read = back("a.spz", &scene, &samples::spz(version));
        prop_assert_eq!(read.sh_degree, scene.sh_degree);
        for i in 0..scene.len() {
            assert_near("mean", read.means[i], scene.means[i], 0.5 / 4096.0 + 1e-4);
            assert_near("log-scale", read.log_scales[i], scene.log_scales[i], 0.5 / 16.0 + 1e-6);
            prop_assert!((sigmoid(read.opacity_logits[i]) - sigmoid(scene.opacity_logits[i])).abs() < 0.501 / 255.0);
            prop_assert!(cosine(read.rotations[i], scene.rotations[i]) > 0.999_99);
            let len = scene.sh_len();
            for k in 0..len {
                let step = [1.0 / 255.0 / 0.15, 8.0 / 128.0, 16.0 / 128.0][usize::from(k > 0) + usize::from(k > 3)];
                assert_near("coefficient", read.sh[i * len + k], scene.sh[i * len + k], 0.5 * step + 1e-5);
            }
        }
    }

    #[test]
    fn rad_stays_within_its_steps(scene in scenes(finite, || -1.0..=1.0_f32)) {
        let folder = tempfile::tempdir().unwrap();
        let order = write_3d(folder.path().join("a.rad"), &scene, &WriteOptions3d::default()).unwrap().order.unwrap();
        let read = back("a.rad", &scene, &WriteOptions3d::default());
        prop_assert_eq!((read.len(), read.sh_degree), (scene.len(), scene.sh_degree));
        for (i, original) in order.into_iter().enumerate() {
            let (a, b) = (read.gaussian(i), scene.gaussian(original as usize));
            prop_assert_eq!(a.mean, b.mean);
            assert_near("log-scale", a.log_scale, b.log_scale, 0.501 * 21.0 / 254.0);
            prop_assert!((sigmoid(a.opacity_logit) - sigmoid(b.opacity_logit)).abs() < 0.501 / 255.0);
            prop_assert!(cosine(a.rotation, b.rotation) > 0.9998);
            assert_near("colour", a.sh[0], b.sh[0], 0.501 * 3.0 / 255.0 / 0.2821);
            (1..b.sh.len()).for_each(|k| assert_near("coefficient", a.sh[k], b.sh[k], 0.501 / 127.0));
        }
    }

    #[test]
    fn sog_stays_within_its_steps(
        scene in scenes(|| -2000.0..2000.0_f32, || -1.0..=1.0_f32),
        name in prop_oneof![Just("a.sog"), Just("meta.json")],
    ) {
        let folder = tempfile::tempdir().unwrap();
        let order = write_3d(folder.path().join(name), &scene, &WriteOptions3d::default()).unwrap().order.unwrap();
        let read = back(name, &scene, &WriteOptions3d::default());
        prop_assert_eq!(read.sh_degree, scene.sh_degree);
        for (i, &from) in order.iter().enumerate() {
            let (a, b) = (read.gaussian(i), scene.gaussian(from as usize));
            // Half of 65,535 steps of at most 2 ln 2001.
            let step = 15.3 / 131_070.0 * (1.0 + b.mean.abs().max_element());
            assert_near("mean", a.mean, b.mean, step);
            prop_assert!((sigmoid(a.opacity_logit) - sigmoid(b.opacity_logit)).abs() < 0.501 / 255.0);
            prop_assert!(cosine(a.rotation, b.rotation) > 0.999_9);
            // Tables of 256 hold the few values of such scenes; palettes have a power of 2 of rows.
            prop_assert_eq!((a.log_scale, a.sh[0]), (b.log_scale, b.sh[0]));
            prop_assert!(!scene.len().is_power_of_two() || a.sh == b.sh);
        }
    }

    #[test]
    fn splat_stays_within_its_steps(scene in scenes(finite, || -1.7..1.7_f32)) {
        let read = back("a.splat", &scene, &WriteOptions3d::default());
        prop_assert_eq!(bits(&read.means), bits(&scene.means));
        prop_assert_eq!(read.sh_degree, 0);
        for i in 0..scene.len() {
            assert_near("log-scale", read.log_scales[i], scene.log_scales[i], 1e-6);
            prop_assert!((sigmoid(read.opacity_logits[i]) - sigmoid(scene.opacity_logits[i])).abs() < 0.501 / 255.0);
            prop_assert!(cosine(read.rotations[i], scene.rotations[i]) > 0.999_8);
            assert_near("colour", 0.282_094_79 * read.sh[i], 0.282_094_79 * scene.sh[i * scene.sh_len()], 0.501 / 255.0);
        }
    }
}

#[test]
fn a_sog_that_is_read_and_written_again_is_the_same() {
    let first = samples::read(&samples::written("a.sog", &samples::scene(300, 2), &WriteOptions3d::default()), "a.sog");
    let options = WriteOptions3d::default().with(|s| s.trained_with.antialias = Some(Antialias::Mip));
    let again = samples::read(&samples::written("a.sog", &first.as_ref().unwrap().scene, &options), "a.sog").unwrap();
    assert_eq!(again.trained_with.antialias, Some(Antialias::Mip));
    let (first, again) = (first.unwrap().scene, again.scene);
    // Means and rotations move by their rounding; palettes are made anew.
    assert_eq!(first.log_scales, again.log_scales);
    first.rotations.iter().zip(&again.rotations).for_each(|(a, b)| assert!(cosine(*a, *b) > 0.999_9, "{a:?} {b:?}"));
    first.means.iter().zip(&again.means).for_each(|(a, b)| assert_near("mean", *a, *b, 1e-4));
    first.sh.iter().zip(&again.sh).for_each(|(a, b)| assert_near("coefficient", *a, *b, 0.02));
}

#[test]
fn a_ksplat_of_every_level_holds_the_same_two() {
    for level in 0..3 {
        let file = samples::read(&samples::ksplat(level), "a.ksplat").unwrap();
        let (scene, range) = (file.scene, 2.0 / 65_534.0);
        assert_eq!((file.format, scene.len(), scene.sh_degree), (Format3d::Ksplat, 2, 1));
        assert_near("mean", scene.means[0], Vec3::new(1.0, 2.0, 3.0), range);
        assert_near("mean", scene.means[1], Vec3::new(-1.0, 0.0, 0.5), range);
        for i in 0..2 {
            assert_near("scale", scene.log_scales[i], Vec3::new(-LN_2, 0.0, LN_2), 1e-6);
            assert_eq!(scene.rotations[i], [0.0, 1.0, 0.0, 0.0]);
            let color = 0.5 + 0.282_094_79 * scene.sh[4 * i];
            assert_near("colour", color, Vec3::new(1.0, 128.0 / 255.0, 0.0), 1e-6);
            assert!((sigmoid(scene.opacity_logits[i]) - 64.0 / 255.0).abs() < 1e-6);
            // Red is −2, 2, −2; green 2, −2, 2; blue −2, 2, −2.
            assert_eq!(scene.sh[4 * i + 1], Vec3::new(-2.0, 2.0, -2.0));
            assert_eq!(scene.sh[4 * i + 2], Vec3::new(2.0, -2.0, 2.0));
        }
    }
}

#[test]
fn ply_has_the_whole_layout_of_its_degree() {
    for (degree, properties) in [(0, 17), (1, 26), (2, 41), (3, 62)] {
        let bytes = samples::written("a.ply", &samples::scene(5, degree), &WriteOptions3d::default());
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        assert_eq!(header.lines().filter(|line| line.starts_with("property float ")).count(), properties);
        assert_eq!(bytes.len(), end + 5 * 4 * properties);
    }
}

#[test]
fn text_and_both_byte_orders_read_alike() {
    let expected = samples::text_ply_scene();
    for bytes in [samples::text_ply(), samples::binary_ply("little"), samples::binary_ply("big")] {
        let file = samples::read(&bytes, "a.ply").unwrap();
        assert_eq!((&file.scene, file.format), (&expected, Format3d::Ply));
    }
}

#[test]
fn a_compressed_ply_reads_as_its_ranges_say() {
    let file = samples::read(&samples::compressed_ply(), "a.ply").unwrap();
    let scene = file.scene;
    assert_eq!((file.format, scene.len(), scene.sh_degree), (Format3d::CompressedPly, 3, 1));
    assert_eq!((scene.means[0], scene.means[1]), (Vec3::new(-1.0, -2.0, -3.0), Vec3::new(1.0, 2.0, 3.0)));
    assert!(scene.means[2].x.abs() < 1e-3 && scene.means[2].y == -2.0);
    assert_eq!((scene.log_scales[0].x, scene.log_scales[1].z), (-9.0, -1.0));
    // The last quarter of a step of 255.
    let ends = [scene.opacity_logits[0], scene.opacity_logits[1]].map(|logit| 255.0 * sigmoid(logit));
    assert!((ends[0] - 0.25).abs() < 1e-4 && (ends[1] - 254.75).abs() < 1e-4, "{ends:?}");
    assert!((sigmoid(scene.opacity_logits[2]) - 128.0 / 255.0).abs() < 1e-6);
    let color = |i: usize| 0.5 + 0.282_094_79 * scene.sh[4 * i];
    assert_near("darkest", color(0), Vec3::new(0.0, 0.1, 0.2), 1e-6);
    assert_near("brightest", color(1), Vec3::new(1.0, 1.1, 1.2), 1e-6);
    assert_near("red", color(2), Vec3::new(1.0, 0.1, 0.2), 1e-6);
    assert_eq!((scene.sh[1], scene.sh[4 + 3]), (Vec3::splat(-4.0), Vec3::splat(4.0)));
    assert!(scene.rotations[0][0] > 0.999 && scene.rotations[1][3] > 0.999, "{:?}", scene.rotations);
}

/// Found by fuzzing: rows without bytes gave Gaussians without coefficients of degree 0.
#[test]
fn sh_of_no_columns_leave_the_colours() {
    let header_end = |bytes: &[u8]| bytes.windows(7).position(|w| w == b"end_hea").unwrap();
    let whole = samples::compressed_ply();
    let columns = whole.windows(20).position(|w| w == b"property uchar f_res").unwrap();
    let bytes = [&whole[..columns], &whole[header_end(&whole)..whole.len() - 27]].concat();
    let scene = samples::read(&bytes, "a.ply").unwrap().scene;
    scene.validate().unwrap();
    let colors: Vec<Vec3> = samples::read(&whole, "a.ply").unwrap().scene.sh.iter().step_by(4).copied().collect();
    assert_eq!((scene.sh_degree, scene.sh), (0, colors));
}

#[test]
fn an_spz_of_version_2_reads_with_our_axes() {
    let scene = samples::read(&samples::spz_of_version_2(), "a.spz").unwrap().scene;
    assert_eq!(scene.means, [Vec3::new(1.0, -2.0, 3.0)]);
    assert!((sigmoid(scene.opacity_logits[0]) - 254.75 / 255.0).abs() < 1e-6, "{:?}", scene.opacity_logits);
    assert_eq!(scene.log_scales, [Vec3::new(0.0, -1.0, -2.0)]);
    assert_near("colour", scene.sh[0], Vec3::new(-0.5, 128.0 / 255.0 - 0.5, 0.5) / 0.15, 1e-6);
    assert!(cosine(scene.rotations[0], [0.0, 1.0, 0.0, 0.0]) > 0.999_9, "{:?}", scene.rotations);
}

#[test]
fn an_spz_that_names_its_axes_is_turned_from_those() {
    let scene = samples::scene(3, 2);
    let good = samples::written("a.spz", &scene, &WriteOptions3d::default());
    let named = |axes: u32| {
        let mut bytes = good.clone();
        bytes[14] |= 2;
        bytes[16..20].copy_from_slice(&(32_u32 + 11 + 12).to_le_bytes());
        // An unknown extension, then Adobe's.
        let extensions = [0x0001_0001, 3, 0, 0xadbe_0003, 4, axes].map(u32::to_le_bytes).concat();
        bytes.splice(32..32, extensions[..11].iter().chain(&extensions[12..]).copied());
        samples::read(&bytes, "a.spz").unwrap().scene
    };
    let plain = samples::read(&good, "a.spz").unwrap().scene;
    assert_eq!(named(4), plain, "right, up, back: what files have that say nothing");
    assert_eq!(named(0), plain, "not said");
    let signs = Vec3::new(1.0, -1.0, -1.0);
    let ours = named(6);
    for i in 0..3 {
        assert_eq!(ours.means[i], plain.means[i] * signs);
        assert_eq!(ours.sh[9 * i + 1], -plain.sh[9 * i + 1]);
        // Right, front, up: their y is our z, and their z our −y.
        let stored = plain.means[i] * signs;
        assert!(named(16).means[i].abs_diff_eq(Vec3::new(stored.x, -stored.z, stored.y), 1e-5));
    }
}

#[test]
fn conversion_losses_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = samples::scene(4, 3);
    scene.rotations[1] = [2.0, 0.0, 0.0, 0.0];
    scene.log_scales[2].x = -20.0;
    let losses = |name: &str| write_3d(folder.path().join(name), &scene, &WriteOptions3d::default()).unwrap().losses;
    assert_eq!(losses("a.ply"), [ConversionLoss::InfiniteLogits { gaussians: 3 }]);
    let has = |losses: &[ConversionLoss], text: &str| losses.iter().any(|loss| loss.to_string().contains(text));
    let splat = losses("a.splat");
    assert!(
        has(&splat, "above degree 0: 45 coefficients") && has(&splat, "colours are rounded to 8 bits"),
        "{splat:?}"
    );
    let spz = losses("a.spz");
    assert!(has(&spz, "log-scales outside -10..5.9375 are clamped: 1 value"), "{spz:?}");
    assert!(has(&spz, "means are rounded to 0.00024414063 units") && has(&spz, "lengths of quaternions"), "{spz:?}");
    let glb = losses("a.glb");
    assert!(has(&glb, "lengths of quaternions") && has(&glb, "opacities"), "{glb:?}");
}

/// Includes opacities of exactly 0 and 1.
#[test]
fn logits_are_finite_and_opacities_come_back_to_the_byte() {
    let scene = samples::scene(12, 0);
    assert!(scene.opacity_logits.contains(&f32::INFINITY) && scene.opacity_logits.contains(&f32::NEG_INFINITY));
    for (name, options) in [
        ("a.ply", WriteOptions3d::default()),
        ("a.splat", WriteOptions3d::default()),
        ("a.spz", WriteOptions3d::default()),
        ("a.spz", samples::spz(SpzVersion::V3)),
        ("a.gltf", WriteOptions3d::default()),
        ("a.glb", WriteOptions3d::default()),
    ] {
        let once = back(name, &scene, &options);
        assert!(once.opacity_logits.iter().all(|logit| logit.is_finite()), "{name}: {:?}", once.opacity_logits);
        let twice = back(name, &once, &options);
        assert_eq!(once.opacity_logits, twice.opacity_logits, "{name}");
        let largest = scene.opacity_logits.iter().zip(&once.opacity_logits);
        let largest = largest.map(|(&a, &b)| (sigmoid(a) - sigmoid(b)).abs()).fold(0.0, f32::max);
        assert!(largest < 0.501 / 255.0, "{name}: {largest}");
    }
}

#[test]
fn infinite_logits_of_other_programs_are_made_finite_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    fs::write(&path, samples::text_ply()).unwrap();
    let read = read_3d(&path).unwrap();
    assert_eq!(read.losses, [ConversionLoss::InfiniteLogits { gaussians: 1 }]);
    assert_eq!(read.scene.opacity_logits, [read_infinite(f32::INFINITY), -1.5]);
}

#[test]
fn a_scene_remembers_how_it_was_trained() {
    let scene = samples::scene(2, 1);
    let folder = tempfile::tempdir().unwrap();
    for (antialias, order) in Antialias::ALL.into_iter().flat_map(|a| [Order::Global, Order::PerPixel].map(|o| (a, o)))
    {
        let trained_with = TrainedWith::default().with(|s| {
            s.antialias = Some(antialias);
            s.order = Some(order);
        });
        for name in ["a.ply", "a.gltf", "a.glb", "a.spz", "a.splat"] {
            let path = folder.path().join(name);
            let options = WriteOptions3d::default().with(|s| s.trained_with = trained_with);
            let losses = write_3d(&path, &scene, &options).unwrap().losses;
            let read = read_3d(&path).unwrap().trained_with;
            let said = read.antialias.unwrap_or(Antialias::Dilate) == antialias
                && read.order.unwrap_or(Order::Global) == order;
            let lost = losses.iter().any(|loss| matches!(loss, ConversionLoss::TrainedWith(_)));
            assert_eq!(lost, !said, "{name} {trained_with:?} {read:?}");
            match name {
                "a.spz" => assert_eq!(
                    read.antialias,
                    Some(if antialias.compensates() { Antialias::Mip } else { Antialias::Dilate })
                ),
                "a.splat" => assert_eq!(read, TrainedWith::default()),
                _ => assert_eq!(read, trained_with, "{name}"),
            }
        }
    }
    let unsaid = back("a.ply", &scene, &WriteOptions3d::default());
    assert_eq!(unsaid.len(), 2);
    assert!(!samples::written("a.ply", &scene, &WriteOptions3d::default()).windows(7).any(|part| part == b"comment"));
}

#[test]
fn degree_4_is_cut_to_3_and_said_so() {
    let mut text = "ply\nformat ascii 1.0\nelement vertex 1\n".to_owned();
    let scalars = "x y z rot_0 rot_1 rot_2 rot_3 scale_0 scale_1 scale_2 opacity f_dc_0 f_dc_1 f_dc_2";
    scalars.split(' ').for_each(|name| text += &format!("property float {name}\n"));
    (0..72).for_each(|k| text += &format!("property float f_rest_{k}\n"));
    text += "end_header\n1 2 3 1 0 0 0 -1 -1 -1 0 0 0 0";
    (0..72).for_each(|k| text += &format!(" {k}"));
    let file = samples::read(text.as_bytes(), "a.ply").unwrap();
    assert_eq!(file.losses, [ConversionLoss::Sh { from: 4, to: 3 }]);
    // Each channel has 24, of which the first 15 are kept.
    assert_eq!((file.scene.sh[1], file.scene.sh[15]), (Vec3::new(0.0, 24.0, 48.0), Vec3::new(14.0, 38.0, 62.0)));
}

/// Alone, each other coefficient is off by a few hundredths at most.
#[test]
fn one_extreme_coefficient_leaves_a_sog_its_others() {
    for (which, what) in [(0, "of degree 0"), (2, "above degree 0")] {
        let mut scene = samples::scene(400, 1);
        scene.sh[7 * 4 + which].y = -1e20;
        let options = WriteOptions3d::default();
        let written = encode_3d("a.sog", &scene, &options).unwrap();
        let lost = format!("coefficients {what} outside -1000..1000 are clamped: 1 value");
        assert!(written.written.losses.iter().any(|loss| loss.to_string() == lost), "{lost}");
        let read = samples::read(&written.bytes, "a.sog").unwrap().scene;
        for (i, &from) in written.written.order.unwrap().iter().enumerate().filter(|(_, from)| **from != 7) {
            let of_scene = &scene.sh[4 * from as usize..][..4];
            read.sh[4 * i..][..4].iter().zip(of_scene).for_each(|(a, b)| assert_near("coefficient", *a, *b, 0.1));
        }
    }
}
