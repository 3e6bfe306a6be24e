//! The fuzz targets. The crate in `fuzz/` and the test of the corpus share this file.
//!
//! A target may read a possible value or return an error of one line. A panic, an endless loop, or
//! memory beyond the fuzzer's limit is a finding.

use std::{fs, path::Path, sync::LazyLock};

use glam::{Vec3, dvec2};
use gs_codec::Extent;
use gs_core::{Camera, Gaussian3d, Image, Scene, Scene3d};
use gs_io::{
    Error, Format3d, LodFile3d, WriteOptions3d,
    dataset::{DatasetSettings, read_dataset},
    decode_3d, decode_gsi, fuzzing, read_3d, write_3d,
};

/// A target that reads bytes.
pub type Target = fn(&[u8]);

/// The targets by their names, which are also those of the files in `fuzz/fuzz_targets` and of the
/// corpus's folders.
pub const TARGETS: [(&str, Target); 15] = [
    ("colmap_binary", colmap_binary),
    ("colmap_text", colmap_text),
    ("compressed_ply", compressed_ply),
    ("gltf", gltf),
    ("gsi", gsi),
    ("ksplat", ksplat),
    ("lens", lens),
    ("ply", ply),
    ("poses", poses),
    ("rad", rad),
    ("sog", sog),
    ("splat", splat),
    ("spz", spz),
    ("streamed_sog", streamed_sog),
    ("transforms", transforms),
];

/// 3DGS PLY, in text and binary.
pub fn ply(bytes: &[u8]) {
    scene_3d(Format3d::Ply, bytes);
}

/// Compressed PLY; the reader is that of [`ply`], but the seeds differ.
pub fn compressed_ply(bytes: &[u8]) {
    scene_3d(Format3d::CompressedPly, bytes);
}

/// `.splat`.
pub fn splat(bytes: &[u8]) {
    scene_3d(Format3d::Splat, bytes);
}

/// SPZ of every version.
pub fn spz(bytes: &[u8]) {
    scene_3d(Format3d::Spz, bytes);
}

/// Bundled SOG.
pub fn sog(bytes: &[u8]) {
    scene_3d(Format3d::Sog, bytes);
}

/// The folder of a streamed SOG of nine Gaussians: chunks `0_0`, `1_0`, `2_0` and `3_0`.
static LEVELS: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let gaussian = |i: u8| Gaussian3d {
        mean: Vec3::new(f32::from(i), f32::from(i % 3), 5.0),
        log_scale: Vec3::NEG_ONE,
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: 1.0,
        sh: vec![Vec3::splat(0.1)],
    };
    let scene: Scene3d = (0..9).map(gaussian).collect();
    write_3d(folder.path().join("lod-meta.json"), &scene, &WriteOptions3d::default()).expect("a scene to write");
    folder
});

/// `lod-meta.json` of a streamed SOG with small chunks, of which cuts are read, too.
pub fn streamed_sog(bytes: &[u8]) {
    let file = LEVELS.path().join("lod-meta.json");
    fs::write(&file, bytes).expect("a file that can be written");
    one_line(read_3d(&file));
    cuts(&file);
}

/// Reads cuts through the levels of detail of a file, if it has some.
fn cuts(file: &Path) {
    let Some(levels) = one_line(LodFile3d::open(file)).flatten() else { return };
    for budget in [1, 12, usize::MAX] {
        let cut = levels.tree().cut(&[Camera::looking_forward(64, 48, 1.0)], budget, 1.0);
        let cut = cut.expect("a budget above 0");
        if let Some(file) = one_line(levels.read(&cut.levels)) {
            assert!(file.scene.len() >= cut.gaussians);
        }
    }
}

/// RAD, with and without a tree, of which cuts are read, too.
pub fn rad(bytes: &[u8]) {
    scene_3d(Format3d::Rad, bytes);
    let file = LEVELS.path().join("a.rad");
    fs::write(&file, bytes).expect("a file that can be written");
    cuts(&file);
}

/// `.ksplat` of every compression level.
pub fn ksplat(bytes: &[u8]) {
    scene_3d(Format3d::Ksplat, bytes);
}

/// `.gltf` and `.glb`.
pub fn gltf(bytes: &[u8]) {
    scene_3d(Format3d::Gltf, bytes);
}

/// `.gsi`, whole and as a prefix. The checksums are set right, so that the decoder sees what the fuzzer
/// makes.
pub fn gsi(bytes: &[u8]) {
    for extent in [Extent::Whole, Extent::Prefix] {
        if let Ok(file) = decode_gsi(&with_checksums(bytes), extent) {
            file.colors.validate().expect("a decoded scene can be drawn");
            file.on([1.0; 3]).validate().expect("so it can on white");
        }
    }
    if let Err(error) = decode_gsi(bytes, Extent::Whole) {
        assert!(!error.to_string().contains('\n'), "{error:?}");
    }
}

/// The bytes of a `.gsi` file with the right checksums.
pub fn with_checksums(bytes: &[u8]) -> Vec<u8> {
    let mut fixed = bytes.to_vec();
    let mut end = gsi_header(bytes);
    while let Some(place) = end.filter(|&end| end + 4 <= fixed.len()) {
        let checksum = crc32fast::hash(&fixed[..place]).to_le_bytes();
        fixed[place..place + 4].copy_from_slice(&checksum);
        end = layer_end(&fixed, place + 4);
    }
    fixed
}

/// Where the checksum of the first layer is.
fn gsi_header(bytes: &[u8]) -> Option<usize> {
    let flags = *bytes.get(5)?;
    let mut place = if flags & 1 != 0 { 16 } else { 14 };
    if flags & 2 != 0 {
        place += 2 + usize::from(u16::from_le_bytes([*bytes.get(place)?, *bytes.get(place + 1)?]));
    }
    layer_end(bytes, place)
}

/// Where the checksum of a layer that begins here is.
fn layer_end(bytes: &[u8], mut place: usize) -> Option<usize> {
    let mut number = || {
        let mut number = 0;
        for shift in [0, 7, 14, 21] {
            let byte = *bytes.get(place)?;
            place += 1;
            number |= usize::from(byte & 127) << shift;
            if byte < 128 {
                break;
            }
        }
        Some(number)
    };
    let [_, length, ..] = [number()?, number()?, number()?, number()?];
    Some(place + 7 + length)
}

/// COLMAP's binary models: the lengths of `cameras.bin` and `images.bin`, two bytes each, then both
/// files, then `points3D.bin`.
pub fn colmap_binary(bytes: &[u8]) {
    let Some((lengths, files)) = bytes.split_first_chunk::<4>() else { return };
    let [a, b, c, d] = *lengths;
    let (cameras, rest) = files.split_at(files.len().min(u16::from_le_bytes([a, b]).into()));
    let (images, points) = rest.split_at(rest.len().min(u16::from_le_bytes([c, d]).into()));
    one_line(fuzzing::read_colmap(false, cameras, images, Some(points)));
}

/// COLMAP's text models: `cameras.txt`, `images.txt` and `points3D.txt`, separated by 0 bytes.
pub fn colmap_text(bytes: &[u8]) {
    let mut files = bytes.splitn(3, |byte| *byte == 0);
    let (Some(cameras), Some(images)) = (files.next(), files.next()) else { return };
    one_line(fuzzing::read_colmap(true, cameras, images, files.next()));
}

/// Lenses with any coefficients, in both directions: the id of COLMAP's camera model and its
/// parameters.
pub fn lens(bytes: &[u8]) {
    let Some((id, rest)) = bytes.split_first() else { return };
    let parameters = rest.as_chunks::<8>().0.iter().map(|chunk| f64::from_le_bytes(*chunk)).collect();
    let Some(source) = fuzzing::camera(*id, parameters) else { return };
    for (x, y) in [(0.0, 0.0), (32.0, 24.0), (64.0, 1.0), (1e3, -1e9)] {
        if let Some(ray) = source.to_ray(dvec2(x, y)) {
            assert!(source.to_pixel(ray).is_none_or(|pixel| pixel.is_finite()) || !source.focal.is_finite());
        }
    }
    let picture = source.pinhole();
    assert!(picture.width <= 128 && picture.height <= 96);
}

static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let picture = Image::filled(20, 10, [0.5; 3]).expect("a small image");
    gs_io::write_png(folder.path().join("a.png"), &picture).expect("an image that can be written");
    folder
});

/// Data sets with a `transforms.json`, images and points: that file and `a.ply`, separated by a 0
/// byte, and an image `a.png`.
pub fn transforms(bytes: &[u8]) {
    let file = FOLDER.path().join("transforms.json");
    let (json, points) = match bytes.iter().position(|byte| *byte == 0) {
        Some(end) => (&bytes[..end], &bytes[end + 1..]),
        None => (bytes, &[][..]),
    };
    fs::write(&file, json).expect("a file that can be written");
    fs::write(FOLDER.path().join("a.ply"), points).expect("a file that can be written");
    data_set(&file);
}

/// The files of other programs with poses.
const POSES: [&str; 4] = ["poses_bounds.npy", "reconstruction.json", "cameras.xml", "cameras.csv"];

/// Poses of other programs, of an image `a.png`: the number of one of [`POSES`], and its content.
pub fn poses(bytes: &[u8]) {
    let Some((which, content)) = bytes.split_first() else { return };
    let file = FOLDER.path().join(POSES[usize::from(*which) % POSES.len()]);
    fs::write(&file, content).expect("a file that can be written");
    data_set(&file);
}

fn data_set(file: &Path) {
    let Some(dataset) = one_line(read_dataset(file, &DatasetSettings::default())) else { return };
    assert!(dataset.points.iter().all(|point| point.position.is_finite()));
    for view in dataset.views {
        view.camera.validate().expect("a possible camera");
        let posed = view.read_image().expect("an image that is there");
        assert_eq!(posed.image.size(), (view.camera.width, view.camera.height));
        one_line(view.read_depth());
    }
}

fn scene_3d(format: Format3d, bytes: &[u8]) {
    if let Some(file) = one_line(decode_3d(format, bytes, Path::new("fuzzed"))) {
        // Arrays of different lengths would be a reader's mistake, not the file's.
        assert!(!matches!(file.scene.validate(), Err(gs_core::Error::Length { .. })));
    }
}

/// The value, if it was read. Errors must be one line.
fn one_line<T>(read: Result<T, Error>) -> Option<T> {
    read.inspect_err(|error| assert!(!error.to_string().contains('\n'), "{error:?}")).ok()
}
