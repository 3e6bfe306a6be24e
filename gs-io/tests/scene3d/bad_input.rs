//! Invalid files give one error that says what is wrong, where, and how to fix it.

use std::{fs, path::Path};

use gs_core::{Scene3d, examination::SMALLEST_LOG_SCALE};
use gs_io::{
    AnyScene, ConversionLoss, Error, File3d, Format3d, SpzVersion, Values, WriteOptions3d, format_3d, read_3d,
    read_scene, write_3d,
};

use serde_json::json;

use super::samples::{self, compressed_ply, gltf_beside, gzip, rad, rad_properties, read, scene, text_ply, written};

/// The scene with whatever values it has.
fn unchecked(path: &Path) -> File3d {
    match read_scene(path, Values::Any).unwrap().scene {
        AnyScene::ThreeD(file) => *file,
        AnyScene::TwoD(_) => panic!("a 2D scene"),
    }
}

/// The bytes with a piece replaced.
fn edited(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|part| part == from).expect("the piece is there");
    [&bytes[..at], to, &bytes[at + from.len()..]].concat()
}

#[track_caller]
fn refused(bytes: &[u8], name: &str, expected: &str) -> Error {
    let error = read(bytes, name).unwrap_err();
    let text = error.to_string();
    assert!(text.contains(expected) && text.starts_with(name) && !text.contains('\n'), "{text:?}, not {expected:?}");
    error
}

#[test]
fn scenes_and_meshes_of_other_kinds_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, expected) in [
        ("a.lcc", &b"{\"version\": \"1.1\"}"[..], "is an XGrids .lcc scene"),
        (
            "metadata.json",
            b"{\"means\": {}, \"scales\": {}, \"quats\": {}, \"sh0\": {}}",
            "is the meta.json of a SOG scene",
        ),
        ("splats.ckpt", b"PK\x03\x04....", "is a PyTorch checkpoint, which is not read; export a PLY"),
        ("scene.zip", b"PK\x03\x04....", "is a ZIP archive"),
        ("a.csv", b"x,y,z\n1,2,3\n", "is a table of numbers"),
        ("a.obj", b"v 1 2 3\n", "is a mesh, which is not read; it holds no Gaussians"),
        ("points.las", b"LASF....", "is a LAS point cloud"),
        ("cameras.json", b"[{\"id\": 0}]", "such as the cameras.json of 3DGS"),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        for error in
            [read_3d(&path).unwrap_err(), format_3d(&path).err().unwrap_or_else(|| read_3d(&path).unwrap_err())]
        {
            let text = error.to_string();
            assert!(matches!(error, Error::Unusable { .. }) && text.contains(expected), "{text}");
        }
    }
}

#[test]
fn lying_ply_headers() {
    let binary = written("a.ply", &scene(3, 0), &WriteOptions3d::default());
    for count in ["4", "4294967296", "18446744073709551615", "1000000000000"] {
        for good in [&binary, &text_ply(), &compressed_ply()] {
            let from: &[u8] = if *good == text_ply() { b"vertex 2" } else { b"vertex 3" };
            let text =
                read(&edited(good, from, format!("vertex {count}").as_bytes()), "a.ply").unwrap_err().to_string();
            assert!(text.contains("damaged"), "{text}");
        }
    }
    refused(&edited(&binary, b"vertex 3", b"vertex -1"), "a.ply", "number of rows");
    refused(
        &edited(&binary, b"property float x", b"property list uchar float x"),
        "a.ply",
        "one number as property x, found a list",
    );
    refused(&edited(&binary, b"property float x", b"property quad x"), "a.ply", "a type of numbers");
    refused(&edited(&binary, b"property float x\n", b""), "a.ply", "its vertices have no x");
    refused(&edited(&text_ply(), b"f_rest_8", b"f_rest_9"), "a.ply", "0, 9, 24, 45 or 72");
    refused(&edited(&text_ply(), b"f_rest_3", b"f_west_3"), "a.ply", "its vertices have no f_rest_3");
    refused(&edited(&text_ply(), b"f_rest_8", b"f_rest_18446744073709551615"), "a.ply", "0, 9, 24, 45 or 72");
    refused(&edited(&binary, b"binary_little_endian", b"middle_endian"), "a.ply", "found \"format middle_endian 1.0\"");
    refused(&edited(&text_ply(), b"inf 255 1", b"inf 255 one"), "a.ply", "a number, found \"one\"");
    refused(&edited(&text_ply(), b"0.5 2 7 8", b"0.5 -2 7 8"), "a.ply", "the length of a list");
    refused(b"ply\nformat ascii 1.0\nelement face 1\nproperty int a\nend_header\n1\n", "a.ply", "an element `vertex`");
    let error = refused(
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
        "a.ply",
        "export it as a 3DGS PLY",
    );
    assert!(
        error.to_string().contains("no y, z, scale_0, scale_1, scale_2, rot_0, rot_1, rot_2, rot_3, opacity, f_dc_0")
    );
    refused(&edited(&compressed_ply(), b"element sh 3", b"element sh 2"), "a.ply", "3 rows of element sh");
    refused(&edited(&compressed_ply(), b"element chunk 1", b"element chunk 0"), "a.ply", "1 chunks for 3 vertices");
}

#[test]
fn the_first_number_that_is_none_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    for (k, what) in [(0, "mean"), (6, "SH coefficient"), (9, "opacity logit"), (10, "log-scale"), (13, "rotation")] {
        let mut bytes = written("a.ply", &scene(5, 0), &WriteOptions3d::default());
        let at = bytes.len() - 2 * 4 * 17 + 4 * k;
        bytes[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        fs::write(&path, &bytes).unwrap();
        let text = read_3d(&path).unwrap_err().to_string();
        assert!(text.contains(&format!("{what} of Gaussian 3 is not finite (NaN)")), "{text}");
        assert_eq!(unchecked(&path).scene.means.len(), 5);
    }
}

#[test]
fn scales_of_zero_are_raised_and_reported_except_in_unchecked_reads() {
    let folder = tempfile::tempdir().unwrap();
    for (name, number, zero) in [("a.ply", 10, f32::NEG_INFINITY), ("a.splat", 3, 0.0)] {
        let path = folder.path().join(name);
        let mut bytes = written(name, &scene(5, 0), &WriteOptions3d::default());
        let row = if name == "a.ply" { 4 * 17 } else { 32 };
        let at = bytes.len() - 2 * row + 4 * number;
        bytes[at..at + 4].copy_from_slice(&zero.to_le_bytes());
        fs::write(&path, &bytes).unwrap();
        assert_eq!(unchecked(&path).scene.log_scales[3].x, f32::NEG_INFINITY, "{name}");
        let read = read_3d(&path).unwrap();
        assert_eq!(read.losses, [ConversionLoss::ZeroScales { gaussians: 1 }], "{name}");
        assert_eq!(read.scene.log_scales[3].x, SMALLEST_LOG_SCALE, "{name}");
    }
    // As a number, and as the byte that stands for it.
    let mut bytes = rad_properties();
    bytes.retain(|(property, _)| property["property"] != "scales");
    bytes.push((json!({ "property": "scales", "encoding": "ln_0r8", "min": -3, "max": 1 }), vec![1, 1, 9, 9, 255, 0]));
    for properties in [rad_properties(), bytes] {
        let path = folder.path().join("a.rad");
        fs::write(&path, rad(2, &properties, json!({ "maxSh": 1 }), json!({}))).unwrap();
        assert_eq!(unchecked(&path).scene.log_scales[1].z, f32::NEG_INFINITY);
        let read = read_3d(&path).unwrap();
        assert_eq!(read.losses, [ConversionLoss::ZeroScales { gaussians: 1 }]);
        assert_eq!(read.scene.log_scales[1].z, SMALLEST_LOG_SCALE);
    }
}

#[test]
fn an_spz_that_promises_too_much() {
    let bomb = |version: u32| {
        let mut head = b"NGSP".to_vec();
        head.extend([version, 200_000_000].map(u32::to_le_bytes).concat());
        head.extend([3, 12, 0, 6]);
        head.extend([32, 0, 0, 0]);
        head.resize(32, 0);
        head
    };
    for bytes in [gzip(&[bomb(3), vec![0; 1 << 20]].concat()), bomb(4)] {
        let error = refused(&bytes, "a.spz", "more than its size allows");
        assert!(error.to_string().contains("declare 13000000000 of content"), "{error}");
    }
    // A stream that decompresses to more than the table says: 10 MB of zeros for three Gaussians.
    let good = written("a.spz", &scene(3, 0), &WriteOptions3d::default());
    let mut long = good.clone();
    let table = 32;
    let first = u64::from_le_bytes(good[table..table + 8].try_into().unwrap()) as usize;
    let zeros = zstd::bulk::compress(&vec![0; 10 << 20], 19).unwrap();
    long[table..table + 8].copy_from_slice(&(zeros.len() as u64).to_le_bytes());
    let streams = table + 5 * 16;
    long.splice(streams..streams + first, zeros);
    refused(&long, "a.spz", "a zstd stream of 27 bytes");
    let mut lying = good.clone();
    lying[table + 8] = 28;
    refused(&lying, "a.spz", "a stream of 27 bytes, found 28");
    let mut outside = good.clone();
    outside[table + 3] = 1;
    refused(&outside, "a.spz", "bytes of a stream");
}

#[test]
fn spz_heads_that_cannot_be() {
    let good = written("a.spz", &scene(3, 1), &WriteOptions3d::default());
    for (at, value, expected) in [
        (4, 5, "update this program"),
        (4, 3, "version 4 where there is no gzip stream"),
        (4, 1, "version 1 of SPZ is not supported"),
        (12, 5, "an SH degree of 0 to 4"),
        (13, 24, "23 fractional bits"),
        (15, 5, "6 streams, found 5"),
        (16, 31, "where the table of contents starts"),
        (19, 255, "where the table of contents starts"),
    ] {
        let mut bad = good.clone();
        bad[at] = value;
        refused(&bad, "a.spz", expected);
    }
    let old = written("a.spz", &scene(3, 1), &samples::spz(SpzVersion::V3));
    let mut checksum = old.clone();
    let end = checksum.len() - 5;
    checksum[end] ^= 1;
    refused(&checksum, "a.spz", "a gzip stream");
    refused(&gzip(b"just some text, not splats"), "a.spz", "`NGSP`");
}

#[test]
fn gltf_that_points_outside() {
    let good = written("a.gltf", &scene(3, 0), &WriteOptions3d::default());
    let json: serde_json::Value = serde_json::from_slice(&good).unwrap();
    let changed = |pointer: &str, value: serde_json::Value| {
        let mut json = json.clone();
        *json.pointer_mut(pointer).unwrap() = value;
        json.to_string().into_bytes()
    };
    let splatting = "/meshes/0/primitives/0/extensions/KHR_gaussian_splatting";
    for (pointer, value, expected) in [
        ("/accessors/0/count", 4.into(), "an accessor within its bounds"),
        ("/accessors/1/count", 2.into(), "3 rows in ROTATION, found 2"),
        ("/accessors/0/count", 4_294_967_296_u64.into(), "more than its size allows"),
        ("/accessors/0/count", u64::MAX.into(), "more than its size allows"),
        ("/accessors/0/bufferView", 99.into(), "a buffer view that there is"),
        ("/accessors/0/componentType", 5125.into(), "a component type"),
        ("/accessors/0/type", "VEC2".into(), "VEC3 in POSITION"),
        ("/bufferViews/0/buffer", 1.into(), "a buffer that there is"),
        ("/bufferViews/0/byteOffset", u64::MAX.into(), "a buffer view within its bounds"),
        ("/bufferViews/0/byteLength", 1_000_000.into(), "a buffer view within its bounds"),
        ("/buffers/0/byteLength", 1_000_000.into(), "1000000 bytes in buffer 0"),
        ("/buffers/0/uri", "data:;base64,???".into(), "a data uri in base64"),
        ("/buffers/0/uri", "../../etc/passwd".into(), "which is no file beside it"),
        ("/nodes/0/mesh", 7.into(), "a mesh that there is"),
        ("/scenes/0/nodes/0", 7.into(), "a node that there is"),
        ("/scene", 7.into(), "a scene that there is"),
        ("/nodes/0", serde_json::json!({ "mesh": 0, "children": [0] }), "a tree, in which each node stands once"),
        (
            "/nodes/0",
            serde_json::json!({ "mesh": 0, "scale": [1e308, 1e308, 1e308], "rotation": [0, 0, 0, 0] }),
            "transform is finite",
        ),
        ("/meshes/0/primitives/0/attributes/POSITION", 99.into(), "an accessor that there is"),
        (splatting, serde_json::json!({ "colorSpace": "acescg" }), "the colour space \"acescg\""),
        (
            splatting,
            serde_json::json!({ "extensions": { "KHR_gaussian_splatting_compression_spz_2": {} } }),
            "the compression KHR_gaussian_splatting_compression_spz_2",
        ),
        (
            splatting,
            serde_json::json!({ "extensions": { "KHR_gaussian_splatting_compression_spz_2": { "bufferView": 99 } } }),
            "a buffer view that there is in KHR_gaussian_splatting_compression_spz_2",
        ),
        (
            splatting,
            serde_json::json!({ "extensions": { "KHR_gaussian_splatting_compression_spz_2": { "bufferView": 0 } } }),
            "the SPZ in a glTF",
        ),
        ("/meshes/0/primitives", serde_json::json!([]), "a glTF without KHR_gaussian_splatting"),
        ("/accessors", serde_json::json!("none"), "the JSON of a glTF"),
    ] {
        refused(&changed(pointer, value), "a.gltf", expected);
    }
    let mut required = json.clone();
    required["extensionsRequired"] = serde_json::json!(["KHR_draco_mesh_compression"]);
    refused(required.to_string().as_bytes(), "a.gltf", "the extension KHR_draco_mesh_compression");
    let mut incomplete = json.clone();
    incomplete["meshes"][0]["primitives"][0]["attributes"]
        .as_object_mut()
        .unwrap()
        .remove("KHR_gaussian_splatting:SCALE");
    refused(incomplete.to_string().as_bytes(), "a.gltf", "an attribute KHR_gaussian_splatting:SCALE");
    let beside = changed("/buffers/0/uri", "no-such-file.bin".into());
    assert!(matches!(read(&beside, "a.gltf").unwrap_err(), Error::Missing { .. }));
    let folder = tempfile::tempdir().unwrap();
    let (json, buffer) = gltf_beside(&scene(3, 0), "the%20buffer.bin");
    fs::write(folder.path().join("the buffer.bin"), &buffer).unwrap();
    fs::write(folder.path().join("a.gltf"), &json).unwrap();
    let file = read_3d(folder.path().join("a.gltf")).unwrap();
    assert_eq!((file.scene.means.len(), file.bytes), (3, (json.len() + buffer.len()) as u64));

    let binary = written("a.glb", &scene(3, 0), &WriteOptions3d::default());
    let mut version = binary.clone();
    version[4] = 1;
    refused(&version, "a.glb", "version 2 of glTF");
    let mut chunk = binary.clone();
    chunk[15] = 0x40;
    refused(&chunk, "a.glb", "bytes of a chunk");
}

#[test]
fn a_gltf_that_repeats_itself_without_end() {
    let good = written("a.gltf", &scene(10_000, 0), &WriteOptions3d::default());
    let mut json: serde_json::Value = serde_json::from_slice(&good).unwrap();
    json["nodes"] = (0..5000).map(|_| serde_json::json!({ "mesh": 0 })).collect();
    json["scenes"][0]["nodes"] = (0..5000).collect();
    let error = refused(json.to_string().as_bytes(), "a.gltf", "more than its size allows");
    assert!(error.to_string().contains("declare 2800000000 of content"), "{error}");

    // A thousand nodes that each refer to a thousand empty primitives.
    let mut json: serde_json::Value =
        serde_json::from_slice(&written("a.gltf", &scene(1, 0), &WriteOptions3d::default())).unwrap();
    let bare = serde_json::json!({ "attributes": {}, "extensions": { "KHR_gaussian_splatting": {} } });
    json["meshes"][0]["primitives"] = vec![bare; 1000].into();
    json["nodes"] = (0..1000).map(|_| serde_json::json!({ "mesh": 0 })).collect();
    json["scenes"][0]["nodes"] = (0..1000).collect();
    refused(json.to_string().as_bytes(), "a.gltf", "more than its size allows");
}

#[test]
fn empty_scenes_are_neither_read_nor_written() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.ply", "a.splat", "a.spz", "a.gltf", "a.glb"] {
        let error = write_3d(folder.path().join(name), &Scene3d::default(), &WriteOptions3d::default());
        assert!(error.unwrap_err().to_string().contains("without Gaussians"), "{name}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    let mut head = b"NGSP".to_vec();
    head.extend([3, 0, 0, 0, 0, 0, 0, 0, 0, 12, 0, 0]);
    let header = edited(&text_ply(), b"vertex 2", b"vertex 0");
    for (bytes, name) in [(gzip(&head), "a.spz"), (header, "a.ply"), (Vec::new(), "a.splat")] {
        let error = read(&bytes, name).unwrap_err();
        assert!(error.to_string().contains("without Gaussians"), "{name}: {error}");
    }
}

#[test]
fn unwritable_scenes_are_refused_and_leave_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, scene: &Scene3d, options: &WriteOptions3d| {
        write_3d(folder.path().join(name), scene, options).unwrap_err().to_string()
    };
    let (good, options) = (scene(3, 0), WriteOptions3d::default());
    for name in ["a.txt", "a", "a.compressed.ply", "ply"] {
        assert!(write(name, &good, &options).contains("use .ply, .spz, .sog, .rad, .glb, .gltf or .splat"), "{name}");
    }
    let mut degenerate = good.clone();
    degenerate.rotations[2] = [0.0; 4];
    for name in ["a.splat", "a.spz", "a.glb"] {
        assert!(write(name, &degenerate, &options).contains("the quaternion of Gaussian 2"), "{name}");
    }
    let mut broken = good.clone();
    broken.means[1].y = f32::INFINITY;
    let mut far = good.clone();
    far.means[1].y = 1e9;
    for (name, scene, expected) in [
        ("a.ply", &broken, "mean of Gaussian 1 is not finite"),
        ("a.spz", &far, "a coordinate of ±1e9 (Gaussian 1), beyond ±8388607 units, is not supported"),
    ] {
        assert!(write(name, scene, &options).contains(expected), "{name}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn other_files_are_said_to_be_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bin");
    for (bytes, found) in
        [(&b""[..], "an empty file"), (b"a,b\n1,2\n", "text"), (&[0, 159, 146, 150], "bytes [00, 9f, 92, 96]")]
    {
        fs::write(&path, bytes).unwrap();
        assert_eq!(format_3d(&path).unwrap(), None);
        let error = read_3d(&path).unwrap_err();
        assert!(error.to_string().contains(&format!("expected a 3D scene, found {found}")), "{error}");
    }
    assert!(matches!(read_3d(folder.path()).unwrap_err(), Error::NotAFile { .. }));
    assert!(matches!(read_3d(folder.path().join("absent.ply")).unwrap_err(), Error::Missing { .. }));
    refused(&[0; 33], "a.splat", "a record of 32 bytes, found 1");
    // Content takes precedence over the name.
    fs::write(&path, text_ply()).unwrap();
    assert_eq!(format_3d(&path).unwrap(), Some(Format3d::Ply));
    fs::write(folder.path().join("a.splat"), text_ply()).unwrap();
    assert_eq!(read_3d(folder.path().join("a.splat")).unwrap().format, Format3d::Ply);
}
