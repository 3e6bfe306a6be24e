//! Small scenes, and files of every kind made of them: by the writers, or by hand if there is no
//! writer.

use std::{fs, io::Write, path::Path};

use base64::{Engine, engine::general_purpose::STANDARD};
use flate2::{Compression, write::GzEncoder};
use glam::Vec3;
use gs_core::{Gaussian3d, Scene, Scene3d};
use gs_io::{File3d, Format3d, SpzVersion, WriteOptions3d, decode_3d, write_3d};
use serde_json::{Value, json};

/// A scene whose numbers all differ, with unit quaternions.
pub(crate) fn scene(count: usize, sh_degree: u8) -> Scene3d {
    let mut scene = Scene3d { sh_degree, ..Scene3d::default() };
    for i in 0..count {
        let t = i as f32;
        let wave = |k: usize| (1.7 * t + 0.9 * k as f32).sin();
        let length = (0..4).map(|k| wave(k).powi(2)).sum::<f32>().sqrt();
        let gaussian = Gaussian3d {
            mean: Vec3::new(3.0 * wave(1), t - 2.0, 0.25 * wave(2)),
            log_scale: Vec3::new(-4.0 + wave(3), -2.5, 0.1 * t),
            rotation: [0, 1, 2, 3].map(|k| wave(k) / length),
            opacity_logit: [f32::INFINITY, 0.3 * t, f32::NEG_INFINITY][i % 3],
            sh: (0..16).map(|k| Vec3::new(0.9 * wave(k), 0.5 * wave(2 * k), -0.01 * k as f32)).collect(),
        };
        scene.push(gaussian.with_degree(sh_degree));
    }
    scene
}

/// The bytes that a writer makes.
pub(crate) fn written(name: &str, scene: &Scene3d, options: &WriteOptions3d) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write_3d(&path, scene, options).unwrap();
    fs::read(path).unwrap()
}

/// The `.glb` of a small scene's only tile, whose Gaussians are an SPZ.
fn tile(scene: &Scene3d) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    write_3d(folder.path().join("tileset.json"), scene, &WriteOptions3d::default()).unwrap();
    fs::read(folder.path().join("0_0.glb")).unwrap()
}

pub(crate) fn spz(version: SpzVersion) -> WriteOptions3d {
    WriteOptions3d::default().with(|s| s.spz_version = version)
}

/// A `.gltf` whose buffer is the file of this name, and that buffer.
pub(crate) fn gltf_beside(scene: &Scene3d, name: &str) -> (Vec<u8>, Vec<u8>) {
    let mut json: serde_json::Value =
        serde_json::from_slice(&written("a.gltf", scene, &WriteOptions3d::default())).unwrap();
    let uri = json["buffers"][0]["uri"].as_str().unwrap();
    let buffer = STANDARD.decode(uri.strip_prefix("data:application/octet-stream;base64,").unwrap()).unwrap();
    json["buffers"][0]["uri"] = name.into();
    (json.to_string().into_bytes(), buffer)
}

/// The scene that is read from bytes, recognised by their start and this name.
pub(crate) fn read(bytes: &[u8], name: &str) -> Result<File3d, gs_io::Error> {
    let path = Path::new(name);
    let format = Format3d::recognise(&bytes[..bytes.len().min(64)], path).expect("a kind");
    decode_3d(format, bytes, path)
}

/// A text PLY of degree 1 with properties in an unusual order, and other properties and elements
/// between them.
pub(crate) fn text_ply() -> Vec<u8> {
    let mut text = "ply\nformat ascii 1.0\ncomment by hand\nelement camera 2\nproperty float fov\n\
        property list uchar int seen\nelement vertex 2\n"
        .to_owned();
    let scalars = "opacity red x y z rot_0 rot_1 rot_2 rot_3 scale_0 scale_1 scale_2 f_dc_0 f_dc_1 f_dc_2";
    let names = scalars.split(' ').map(str::to_owned).chain((0..9).map(|k| format!("f_rest_{k}")));
    names.for_each(|name| text += &format!("property float {name}\n"));
    text += "element face 1\nproperty list uchar int vertex_indices\nend_header\n0.5 2 7 8\n0.25 0\n";
    text += "inf 255 1 2 3 1 0 0 0 -1 -2 -3 0.1 0.2 0.3 1 2 3 4 5 6 7 8 9\n";
    text += "-1.5 255 4 5 6 0 1 0 0 -4 -5 -6 0.4 0.5 0.6 -1 -2 -3 -4 -5 -6 -7 -8 -9\n3 0 1 2\n";
    text.into_bytes()
}

/// The scene in [`text_ply`].
pub(crate) fn text_ply_scene() -> Scene3d {
    let mut scene = Scene3d { sh_degree: 1, ..Scene3d::default() };
    for (i, sign) in [1.0, -1.0].into_iter().enumerate() {
        let t = 3.0 * i as f32;
        scene.push(Gaussian3d {
            mean: Vec3::new(1.0 + t, 2.0 + t, 3.0 + t),
            log_scale: -Vec3::new(1.0 + t, 2.0 + t, 3.0 + t),
            rotation: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]][i],
            opacity_logit: [f32::INFINITY, -1.5][i],
            sh: vec![
                [Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.4, 0.5, 0.6)][i],
                sign * Vec3::new(1.0, 4.0, 7.0),
                sign * Vec3::new(2.0, 5.0, 8.0),
                sign * Vec3::new(3.0, 6.0, 9.0),
            ],
        });
    }
    scene
}

/// The sample PLY in binary with either byte order, as doubles; a list makes rows differ in length.
pub(crate) fn binary_ply(order: &str) -> Vec<u8> {
    let scene = text_ply_scene();
    let mut bytes = format!("ply\r\nformat binary_{order}_endian 1.0\r\nelement vertex 2\r\n").into_bytes();
    let scalars = "x y z opacity rot_0 rot_1 rot_2 rot_3 scale_0 scale_1 scale_2";
    let names = scalars.split(' ').map(|name| format!("double {name}"));
    let sh = (0..3).map(|k| format!("float f_dc_{k}")).chain((0..9).map(|k| format!("float f_rest_{k}")));
    let list = ["list ushort short notes".to_owned()];
    names.chain(list).chain(sh).for_each(|p| bytes.extend(format!("property {p}\r\n").into_bytes()));
    bytes.extend(b"end_header\r\n");
    let mut put = |part: &[u8]| match order {
        "big" => bytes.extend(part.iter().rev()),
        _ => bytes.extend(part),
    };
    for i in 0..2 {
        let g = scene.gaussian(i);
        let doubles =
            [g.mean.to_array().to_vec(), vec![g.opacity_logit], g.rotation.to_vec(), g.log_scale.to_array().to_vec()];
        doubles.concat().into_iter().for_each(|v| put(&f64::from(v).to_le_bytes()));
        put(&(2 * i as u16 + 1).to_le_bytes());
        (0..2 * i as i16 + 1).for_each(|v| put(&v.to_le_bytes()));
        let rest = (0..3).flat_map(|channel| (1..4).map(move |k| (channel, k)));
        g.sh[0].to_array().into_iter().for_each(|v| put(&v.to_le_bytes()));
        rest.for_each(|(channel, k)| put(&g.sh[k][channel].to_le_bytes()));
    }
    bytes
}

/// A compressed PLY of degree 1 with three Gaussians at the ends and in the middle of their ranges.
pub(crate) fn compressed_ply() -> Vec<u8> {
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement chunk 1\n".to_vec();
    let ranges = "min_x min_y min_z max_x max_y max_z min_scale_x min_scale_y min_scale_z max_scale_x max_scale_y max_scale_z \
        min_r min_g min_b max_r max_g max_b";
    ranges.split_whitespace().for_each(|name| bytes.extend(format!("property float {name}\n").into_bytes()));
    bytes.extend(b"element vertex 3\n");
    let packed = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];
    packed.iter().for_each(|name| bytes.extend(format!("property uint {name}\n").into_bytes()));
    bytes.extend(b"element sh 3\n");
    (0..9).for_each(|k| bytes.extend(format!("property uchar f_rest_{k}\n").into_bytes()));
    bytes.extend(b"end_header\n");
    let chunk = [-1.0_f32, -2.0, -3.0, 1.0, 2.0, 3.0, -9.0, -8.0, -7.0, -3.0, -2.0, -1.0, 0.0, 0.1, 0.2, 1.0, 1.1, 1.2];
    bytes.extend(chunk.iter().flat_map(|v| v.to_le_bytes()));
    let identity = 512 << 20 | 512 << 10 | 512_u32;
    for vertex in [
        [0_u32, identity, 0, 0],
        [u32::MAX, 3 << 30 | identity, u32::MAX, u32::MAX],
        [1024 << 21, identity, 0, 0xff00_0080],
    ] {
        bytes.extend(vertex.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes.extend((0..27).map(|k| if k < 9 { 0 } else { 255 }));
    bytes
}

/// An SPZ of version 2, which we do not write, with a Gaussian at (1, −2, 3) in our axes, turned by
/// half a turn about x.
pub(crate) fn spz_of_version_2() -> Vec<u8> {
    let mut bytes = b"NGSP".to_vec();
    bytes.extend([2_u32, 1].map(u32::to_le_bytes).concat());
    bytes.extend([0, 8, 0, 0]);
    for value in [1_i32, 2, -3] {
        bytes.extend(&(256 * value).to_le_bytes()[..3]);
    }
    bytes.extend([255, 0, 128, 255, 160, 144, 128, 255, 128, 127]);
    gzip(&bytes)
}

pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A `.ksplat` of two Gaussians of degree 1 at a compression level, at (1, 2, 3) and (−1, 0, 0.5),
/// in a full bucket of one and a partial one, with scales 0.5, 1 and 2.
pub(crate) fn ksplat(level: u16) -> Vec<u8> {
    let mut bytes = vec![0; 4096 + 1024];
    let mut put = |at: usize, part: &[u8]| bytes[at..at + part.len()].copy_from_slice(part);
    put(0, &[0, 1]);
    [(4, 1_u32), (8, 1), (12, 2), (16, 2)].iter().for_each(|&(at, v)| put(at, &v.to_le_bytes()));
    put(20, &level.to_le_bytes());
    [(36, -2.0_f32), (40, 2.0)].iter().for_each(|&(at, v)| put(at, &v.to_le_bytes()));
    let section = [(0, 2_u32), (4, 2), (8, 1), (12, 2), (24, 32_767), (32, 1), (36, 1)];
    section.iter().for_each(|&(at, v)| put(4096 + at, &v.to_le_bytes()));
    put(4096 + 16, &2.0_f32.to_le_bytes());
    put(4096 + 20, &[12, 0]);
    put(4096 + 40, &[1, 0]);
    bytes.extend(1_u32.to_le_bytes());
    let centers = [[1.5_f32, 2.0, 2.5], [-1.0, 0.0, 0.0]];
    bytes.extend(centers.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
    let means = [[1.0_f32, 2.0, 3.0], [-1.0, 0.0, 0.5]];
    for (mean, center) in means.iter().zip(centers) {
        let shape = [0.5_f32, 1.0, 2.0, 0.0, 1.0, 0.0, 0.0];
        if level == 0 {
            bytes.extend(mean.iter().chain(&shape).flat_map(|v| v.to_le_bytes()));
        } else {
            let steps = mean.iter().zip(center).map(|(m, c)| ((m - c) * 32_767.0 + 32_767.0).round() as u16);
            let halves = shape.map(|v| if v == 0.0 { 0 } else { ((v.to_bits() >> 23) as u16 - 112) << 10 });
            bytes.extend(steps.chain(halves).flat_map(u16::to_le_bytes));
        }
        bytes.extend([255, 128, 0, 64]);
        // −2 and 2 in turn, which all levels have.
        for k in 0..9 {
            let value = if k % 2 == 0 { -2.0_f32 } else { 2.0 };
            match level {
                0 => bytes.extend(value.to_le_bytes()),
                1 => bytes.extend((if k % 2 == 0 { 0xc000_u16 } else { 0x4000 }).to_le_bytes()),
                _ => bytes.push(if k % 2 == 0 { 0 } else { 255 }),
            }
        }
    }
    bytes
}

/// A RAD of one chunk of `count` Gaussians with these properties, each a description and its bytes. `head` and `chunk`
/// are what the JSON of the file and of the chunk have in addition or in place.
pub(crate) fn rad(count: usize, properties: &[(Value, Vec<u8>)], head: Value, chunk: Value) -> Vec<u8> {
    let (mut payload, mut described) = (Vec::new(), Vec::new());
    for (property, bytes) in properties {
        described.push(with(json!({ "offset": payload.len(), "bytes": bytes.len() }), property));
        payload.extend(bytes);
        payload.resize(payload.len().next_multiple_of(8), 0);
    }
    let chunk_head = json!({ "version": 1, "base": 0, "count": count, "properties": described });
    let mut part = rad_json(b"RADC", &with(chunk_head, &chunk));
    part.extend((payload.len() as u64).to_le_bytes());
    part.extend(payload);
    let ranges = [json!({ "offset": 0, "bytes": part.len() })];
    let mut bytes =
        rad_json(b"RAD0", &with(json!({ "version": 1, "type": "gsplat", "count": count, "chunks": ranges }), &head));
    bytes.extend(part);
    bytes
}

fn with(mut object: Value, more: &Value) -> Value {
    more.as_object().unwrap().iter().for_each(|(key, value)| object[key] = value.clone());
    object
}

fn rad_json(magic: &[u8; 4], json: &Value) -> Vec<u8> {
    let text = json.to_string();
    let mut bytes = [&magic[..], &(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// Numbers as they are in a RAD: the first of all Gaussians, then the second, and so on.
pub(crate) fn rad_floats<const N: usize>(name: &str, values: &[[f32; N]]) -> (Value, Vec<u8>) {
    let planes = (0..N).flat_map(|k| values.iter().flat_map(move |value| value[k].to_le_bytes()));
    (json!({ "property": name, "encoding": "f32" }), planes.collect())
}

/// Two Gaussians of a RAD, all as f32.
pub(crate) fn rad_properties() -> Vec<(Value, Vec<u8>)> {
    vec![
        rad_floats("center", &[[1.0, 2.0, 3.0], [-1.0, 0.0, 0.5]]),
        rad_floats("alpha", &[[0.25], [0.5]]),
        rad_floats("rgb", &[[0.5, 1.0, 0.0], [0.0, 0.5, 1.0]]),
        rad_floats("scales", &[[1.0, 0.5, 0.25], [2.0, 1.0, 0.0]]),
        rad_floats("orientation", &[[0.0, 0.0, 0.0], [0.6, 0.0, 0.8]]),
        rad_floats("sh1", &[[0.0, 1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 1.0, -1.0], [0.5; 9]]),
    ]
}

/// A RAD of Gaussian 0, which stands for the others, with this number of children and first of them.
pub(crate) fn rad_tree(children: u16, start: u32) -> Vec<u8> {
    let properties = [rad_properties(), rad_children(&[children, 0], &[start, 0])].concat();
    rad(2, &properties, json!({ "maxSh": 1, "lodTree": true }), json!({}))
}

/// The properties of a tree: the number of children of each Gaussian, and the first of them.
pub(crate) fn rad_children(counts: &[u16], starts: &[u32]) -> Vec<(Value, Vec<u8>)> {
    let property = |name: &str, encoding: &str| json!({ "property": name, "encoding": encoding });
    vec![
        (property("child_count", "u16"), counts.iter().flat_map(|count| count.to_le_bytes()).collect()),
        (property("child_start", "u32"), starts.iter().flat_map(|start| start.to_le_bytes()).collect()),
    ]
}

/// One small file of every kind and shape.
pub(crate) fn corpus() -> Vec<(&'static str, Vec<u8>)> {
    let (small, options) = (scene(3, 1), WriteOptions3d::default());
    vec![
        ("text.ply", text_ply()),
        ("little.ply", binary_ply("little")),
        ("big.ply", binary_ply("big")),
        ("a.ply", written("a.ply", &small, &options)),
        ("a.compressed.ply", compressed_ply()),
        ("a.splat", written("a.splat", &small, &options)),
        ("2.spz", spz_of_version_2()),
        ("3.spz", written("a.spz", &small, &spz(SpzVersion::V3))),
        ("4.spz", written("a.spz", &small, &options)),
        ("a.sog", written("a.sog", &small, &options)),
        ("a.rad", written("a.rad", &small, &options)),
        ("plain.rad", rad(2, &rad_properties(), json!({ "maxSh": 1 }), json!({}))),
        ("0.ksplat", ksplat(0)),
        ("2.ksplat", ksplat(2)),
        ("a.gltf", written("a.gltf", &small, &options)),
        ("a.glb", written("a.glb", &small, &options)),
        ("tile.glb", tile(&small)),
    ]
}
