//! `poses_bounds.npy` of LLFF.

use std::{fs, path::Path};

use glam::{DVec3, dvec2, dvec3};

use super::made::{folder, picture, pixel, read, refusal, skipped, world_points};
use crate::dataset::{DatasetKind, Remark, Skip};

/// An array of these rows, as `numpy.save` writes it.
fn npy(rows: &[[f64; 17]]) -> Vec<u8> {
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, 17), }}", rows.len());
    let header = format!("{header:<117}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(rows.iter().flatten().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// The axes down, right and back of a camera that looks at the origin, and its position.
fn camera(i: usize) -> [DVec3; 4] {
    let position = dvec3(4.0 * (0.3 * i as f64).sin(), 0.5 - 0.25 * i as f64, 4.0);
    let back = position.normalize();
    let right = DVec3::Y.cross(back).normalize();
    [-back.cross(right), right, back, position]
}

/// The row of an image of 80×60 px.
fn row(i: usize) -> [f64; 17] {
    let mut row = [0.0; 17];
    for (r, size) in [60.0, 80.0, 70.0].into_iter().enumerate() {
        let [down, right, back, position] = camera(i).map(|axis| axis[r]);
        row[5 * r..5 * r + 5].copy_from_slice(&[down, right, back, position, size]);
    }
    row[15..].copy_from_slice(&[1.0, 9.0]);
    row
}

/// Small files for the fuzz target, of one image of 20×10 px.
pub(super) fn seeds() -> Vec<Vec<u8>> {
    let mut row = row(1);
    (row[4], row[9], row[14]) = (10.0, 20.0, 30.0);
    let whole = npy(&[row]);
    let mut of_f32 = whole[..128].to_vec();
    let at = of_f32.windows(3).position(|part| part == b"<f8").unwrap();
    of_f32[at + 2] = b'4';
    of_f32.extend(row.iter().flat_map(|value| (*value as f32).to_le_bytes()));
    let cut = whole[..200].to_vec();
    let two = npy(&[row, row]);
    vec![whole, of_f32, cut, two]
}

fn images(root: &Path, folder: &str, count: usize) {
    (0..count).for_each(|i| drop(picture(root.join(format!("{folder}/{i:03}.png")), 40, 30)));
}

#[test]
fn points_appear_where_the_formulas_of_llff_say() {
    let place = folder();
    images(place.path(), "images_2", 3);
    images(place.path(), "masks", 1);
    fs::write(place.path().join("poses_bounds.npy"), npy(&[row(0), row(1), row(2)])).unwrap();
    for path in [place.path().to_owned(), place.path().join("poses_bounds.npy")] {
        let dataset = read(&path);
        assert_eq!((dataset.kind, dataset.views.len()), (DatasetKind::Llff, 3));
        assert!(dataset.remarks.contains(&Remark::NoPoints), "{:?}", dataset.remarks);
        assert!(dataset.views[0].mask.is_some() && dataset.views[1].mask.is_none());
        for (i, point) in (0..3).flat_map(|i| world_points().map(move |point| (i, point))) {
            let [down, right, back, position] = camera(i);
            let ray = point - position;
            // The image has half of the size, so it has half of the focal length.
            let expected = dvec2(20.0, 15.0) + 35.0 * dvec2(ray.dot(right), ray.dot(down)) / -ray.dot(back);
            let found = pixel(&dataset, &format!("{i:03}.png"), point).unwrap();
            assert!(found.distance(expected) < 1e-4, "{found} for {expected}");
        }
    }
}

#[test]
fn numbers_may_have_32_bits() {
    let place = folder();
    picture(place.path().join("a.png"), 20, 10);
    let of = |file: &[u8]| {
        fs::write(place.path().join("poses_bounds.npy"), file).unwrap();
        read(place.path()).views[0].camera
    };
    let [double, single] = [0, 1].map(|i| of(&seeds()[i]));
    assert!(single.position().distance(double.position()) < 1e-6);
    assert_eq!((single.focal, single.center), (double.focal, double.center));
}

#[test]
fn a_row_of_nan_or_without_focal_length_leaves_out_its_image() {
    let place = folder();
    images(place.path(), "images", 4);
    let mut rows = [0, 1, 2, 3].map(row);
    rows[0][3] = f64::NAN;
    rows[1][14] = 0.0;
    rows[2][0] = 7.0;
    fs::write(place.path().join("poses_bounds.npy"), npy(&rows)).unwrap();
    let dataset = read(place.path());
    assert_eq!(dataset.views.len(), 1);
    for why in [Skip::PoseNotFinite, Skip::BadCamera, Skip::BadPose] {
        assert_eq!(skipped(&dataset, why), 1, "{why}");
    }
}

#[test]
fn malformed_or_mismatched_poses_are_refused() {
    let place = folder();
    let file = place.path().join("poses_bounds.npy");
    let says = |bytes: Vec<u8>, words: &str| {
        fs::write(&file, bytes).unwrap();
        let error = refusal(place.path());
        assert!(error.contains("poses_bounds.npy: it") && error.contains(words), "{error}");
    };
    says(npy(&[row(0)]), "1 pose for the images by name, but there are no images; put exactly");
    images(place.path(), "images", 2);
    says(npy(&[row(0)]), "1 pose for the images by name, but images has 2");
    says(b"text".to_vec(), "is not a NumPy array");
    says(npy(&[]), "0 rows");
    let whole = npy(&[row(0), row(1)]);
    says(whole[..whole.len() - 1].to_vec(), "271 bytes of numbers where 272 are needed");
    says(whole[..9].to_vec(), "is not a NumPy array");
    let with = |from: &[u8], to: &[u8]| {
        let at = whole.windows(from.len()).position(|part| part == from).unwrap();
        [&whole[..at], to, &whole[at + from.len()..]].concat()
    };
    says(with(b"(2, 17)", b"(17, 2)"), "17 rows of 2 numbers");
    says(with(b"(2, 17), }         ", b"(4000000000, 17), }"), "4000000000 rows");
    says(with(b"<f8", b">f8"), "little-endian");
}
