//! Scene files and checkpoints round-trip bit for bit, and damaged ones are refused without a
//! panic.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use gs_conformance::properties::fresh;
use gs_core::{Blend, Parameterization, RenderSettings, Scene2d, SplatsState, Tensor, TensorData};
use gs_io::{Checkpoint, Error, File2d, IccProfile, read_2d, read_checkpoint, write_2d, write_checkpoint};
use proptest::{collection::vec, prelude::*};

fn finite() -> impl Strategy<Value = f32> {
    use prop::num::f32::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO
}

fn logit() -> impl Strategy<Value = f32> {
    prop_oneof![4 => finite(), 1 => Just(f32::INFINITY), 1 => Just(f32::NEG_INFINITY)]
}

prop_compose! {
    fn scene_files()(n in 0..9_usize)(
        rows in vec((finite(), finite(), finite(), finite(), finite(), [finite(), finite(), finite()]), n),
        opacity_logits in prop_oneof![vec(logit(), n), Just(Vec::new())],
        (width, height) in (1..=16_384_u32, 1..=16_384_u32),
        background in [finite(), finite(), finite()],
    ) -> File2d {
        let blend = if opacity_logits.is_empty() { Blend::Sum } else { Blend::Over };
        let scene = Scene2d {
            means: rows.iter().map(|r| [r.0, r.1].into()).collect(),
            log_scales: rows.iter().map(|r| [r.2, r.3].into()).collect(),
            rotations: rows.iter().map(|r| r.4).collect(),
            opacity_logits,
            colors: rows.iter().map(|r| r.5.into()).collect(),
        };
        File2d { scene, width, height, settings: RenderSettings::blended(blend).on(background), profile: None }
    }
}

/// Every number of a scene as bits, because −0 == 0.
fn bits(file: &File2d) -> Vec<u32> {
    let Scene2d { means, log_scales, rotations, opacity_logits, colors } = &file.scene;
    let pairs = means.iter().chain(log_scales).flat_map(|v| v.to_array());
    let single = rotations.iter().chain(opacity_logits).copied();
    let rest = colors.iter().flat_map(|v| v.to_array()).chain(file.settings.background);
    pairs.chain(single).chain(rest).map(f32::to_bits).collect()
}

fn small_file() -> File2d {
    File2d {
        scene: Scene2d {
            means: vec![[1.0, 2.0].into(), [3.5, -4.0].into()],
            log_scales: vec![[0.1, 0.2].into(), [-0.3, 0.4].into()],
            rotations: vec![0.5, -1.5],
            opacity_logits: vec![f32::INFINITY, f32::NEG_INFINITY],
            colors: vec![[0.1, 0.2, 0.3].into(), [-0.4, 1.5, 0.6].into()],
        },
        width: 7,
        height: 5,
        settings: RenderSettings::default(),
        profile: IccProfile::new(b"bytes of a profile"),
    }
}

fn small_checkpoint() -> Checkpoint {
    let mut state = SplatsState::new(Parameterization::CovarianceFactor);
    // A signalling NaN with a payload, which arithmetic would change.
    state.insert("mean", [[1.0, f32::from_bits(0x7fa1_2345)], [-0.0, f32::NEG_INFINITY]]);
    state.insert_u32("steps", vec![0, u32::MAX]);
    Checkpoint { state, metadata: BTreeMap::from([("step".to_owned(), "17 \"äöü\"\n".to_owned())]) }
}

fn state_bits(state: &SplatsState) -> Vec<(&String, &Vec<usize>, Vec<u32>)> {
    let bits_of = |data: &TensorData| match data {
        TensorData::F32(values) => values.iter().map(|v| v.to_bits()).collect(),
        TensorData::U32(values) => values.clone(),
    };
    state.tensors.iter().map(|(name, tensor)| (name, &tensor.shape, bits_of(&tensor.data))).collect()
}

struct Written {
    _folder: tempfile::TempDir,
    path: PathBuf,
    bytes: Vec<u8>,
}

fn written(write: impl FnOnce(&Path)) -> Written {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gs2d.safetensors");
    write(&path);
    let bytes = fs::read(&path).unwrap();
    Written { _folder: folder, path, bytes }
}

fn small_scene_written() -> Written {
    written(|path| write_2d(path, &small_file()).unwrap())
}

/// The error of reading these bytes as a scene; its text must be one line that names the file.
fn refusal(file: &Written, bytes: &[u8]) -> Error {
    fs::write(&file.path, bytes).unwrap();
    let error = read_2d(&file.path).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("a.gs2d.safetensors") && !text.contains('\n'), "{text:?}");
    error
}

/// A safetensors file with this header and as many zeros as data.
fn with_header(header: &str, data_bytes: usize) -> Vec<u8> {
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.as_bytes());
    bytes.resize(bytes.len() + data_bytes, 0);
    bytes
}

/// The bytes with a piece of the header replaced and its length corrected.
fn edited(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let header_bytes = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let (header, data) = bytes[8..].split_at(header_bytes);
    let header = std::str::from_utf8(header).unwrap();
    assert!(header.contains(from), "{from} is not in {header}");
    let mut edited = with_header(&header.replacen(from, to, 1), 0);
    edited.extend(data);
    edited
}

proptest! {
    #![proptest_config(fresh(100))]

    #[test]
    fn scenes_survive_a_round_trip_bit_for_bit(file in scene_files()) {
        let first = written(|path| write_2d(path, &file).unwrap());
        let read = read_2d(&first.path).unwrap();
        prop_assert_eq!(bits(&read), bits(&file));
        prop_assert_eq!(&read, &file);
        let second = written(|path| write_2d(path, &read).unwrap());
        prop_assert_eq!(first.bytes, second.bytes, "the same scene gave other bytes");
    }

    #[test]
    fn checkpoints_survive_a_round_trip_bit_for_bit(
        values in vec(any::<u32>(), 0..40),
        integers in vec(any::<u32>(), 0..9),
        name in ".{0,12}",
        metadata in prop::collection::btree_map(".{0,9}", ".{0,30}", 0..5),
    ) {
        let mut state = SplatsState::new(Parameterization::ScaleRotation);
        let data = TensorData::F32(values.iter().map(|&v| f32::from_bits(v)).collect());
        state.tensors.insert(name, Tensor { shape: vec![values.len(), 1, 1], data });
        state.insert_u32("another", integers);
        let checkpoint = Checkpoint { state, metadata };
        let file = written(|path| write_checkpoint(path, &checkpoint).unwrap());
        let read = read_checkpoint(&file.path).unwrap();
        prop_assert_eq!(state_bits(&read.state), state_bits(&checkpoint.state));
        prop_assert_eq!(read.state.parameterization, checkpoint.state.parameterization);
        prop_assert_eq!(read.metadata, checkpoint.metadata);
    }

    #[test]
    fn flipped_bytes_never_panic(at in any::<prop::sample::Index>(), mask in 1..=255_u8) {
        for file in [small_scene_written(), written(|path| write_checkpoint(path, &small_checkpoint()).unwrap())] {
            let mut bytes = file.bytes.clone();
            bytes[at.index(file.bytes.len())] ^= mask;
            fs::write(&file.path, &bytes).unwrap();
            // A number may change, or the file may be refused.
            let _ = (read_2d(&file.path), read_checkpoint(&file.path));
        }
    }
}

#[test]
fn a_file_cut_short_anywhere_is_refused() {
    let scene = small_scene_written();
    for end in 0..scene.bytes.len() {
        let error = refusal(&scene, &scene.bytes[..end]);
        assert!(matches!(error, Error::Damaged { .. }), "{error}");
    }
    let checkpoint = written(|path| write_checkpoint(path, &small_checkpoint()).unwrap());
    for end in 0..checkpoint.bytes.len() {
        fs::write(&checkpoint.path, &checkpoint.bytes[..end]).unwrap();
        let error = read_checkpoint(&checkpoint.path).unwrap_err();
        assert!(matches!(error, Error::Damaged { .. }), "{error}");
    }
}

#[test]
fn a_checkpoint_keeps_the_payload_of_a_nan() {
    let file = written(|path| write_checkpoint(path, &small_checkpoint()).unwrap());
    let read = read_checkpoint(&file.path).unwrap();
    assert_eq!(state_bits(&read.state), state_bits(&small_checkpoint().state));
    assert_eq!(
        (read.state.parameterization, read.metadata),
        (Parameterization::CovarianceFactor, small_checkpoint().metadata)
    );
}

#[test]
fn a_scene_without_gaussians_is_a_scene() {
    let empty = File2d { scene: Scene2d::default(), ..small_file() };
    let file = written(|path| write_2d(path, &empty).unwrap());
    assert_eq!(read_2d(&file.path).unwrap(), empty);
}

#[test]
fn impossible_scenes_are_neither_written_nor_read() {
    let file = small_scene_written();
    // The last number of the data is a rotation, because tensors of one type are stored by name.
    let mut bytes = file.bytes.clone();
    let end = bytes.len();
    bytes[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    let error = refusal(&file, &bytes);
    assert!(error.to_string().contains("rotation of Gaussian 1 is not finite"), "{error}");

    let mut nan = small_file();
    nan.scene.colors[1].y = f32::NAN;
    let mut uneven = small_file();
    uneven.scene.rotations.pop();
    let sizeless = File2d { width: 0, ..small_file() };
    let mut unsettled = small_file();
    unsettled.settings.background[0] = f32::INFINITY;
    fs::remove_file(&file.path).unwrap();
    for impossible in [nan, uneven, sizeless, unsettled] {
        let error = write_2d(&file.path, &impossible).unwrap_err();
        assert!(matches!(error, Error::Content { .. }), "{error}");
        assert!(!file.path.exists());
    }
}

#[test]
fn a_header_that_lies_is_found_out() {
    let file = small_scene_written();
    let tensor_error = |from: &str, to: &str| {
        let error = refusal(&file, &edited(&file.bytes, from, to));
        assert!(error.to_string().contains(": tensor `"), "{error}");
        error.to_string()
    };
    // Another shape with as many numbers, another type with as many bytes, another name.
    let text = tensor_error(r#""shape":[2,3]"#, r#""shape":[3,2]"#);
    assert!(text.contains("tensor `color`: expected F32 [2, 3], found F32 [3, 2]"), "{text}");
    tensor_error(r#""mean":{"dtype":"F32","shape":[2,2]"#, r#""mean":{"dtype":"F32","shape":[4]"#);
    tensor_error(r#""mean":{"dtype":"F32""#, r#""mean":{"dtype":"I32""#);
    tensor_error(r#""rotation""#, r#""rotatoin""#);

    for (from, to) in [
        ("gs-scene-2d", "gs-scene-4d"),
        (r#"\"width\":7"#, r#"\"width\":-7"#),
        (r#"\"width\":7"#, r#"\"breadth\":7"#),
        (r#""gs":"#, r#""sg":"#),
        (r#""shape":[2,3]"#, r#""shape":[2,300000000000]"#),
        (r#""shape":[2,3]"#, r#""shape":[9223372036854775807,4]"#),
        ("{", "["),
    ] {
        let error = refusal(&file, &edited(&file.bytes, from, to));
        assert!(matches!(error, Error::Damaged { .. }), "{from} to {to}: {error}");
    }
    let error = refusal(&file, &edited(&file.bytes, r#"\"version\":1"#, r#"\"version\":2"#));
    assert!(error.to_string().contains("of version 1 or older, found version 2; update"), "{error}");
    let error = refusal(&file, &edited(&file.bytes, r#"\"width\":7"#, r#"\"width\":70000"#));
    assert!(matches!(error, Error::Content { .. }), "{error}");
    let error = refusal(&file, &[&file.bytes[..], b"more"].concat());
    assert!(error.to_string().contains("4 more bytes"), "{error}");
}

#[test]
fn claims_that_overflow_or_outgrow_memory_are_refused() {
    let file = small_scene_written();
    let error = refusal(&file, &u64::MAX.to_le_bytes());
    assert!(error.to_string().contains("the length of a safetensors header, found bytes [ff"), "{error}");
    // Eight tensors of 2⁶¹ bytes, minus what makes header and data wrap around to the file's true
    // length.
    let head = r#""__metadata__":{"gs":"{\"format\":\"gs-scene-2d\",\"version\":1,\"program\":\"\",\"content\":{\"width\":1,\"height\":1,\"settings\":{}}}"}"#;
    let tensors = |last: u64| {
        let part = 1_u64 << 61;
        let tensor = |k: u64, len: u64| {
            let (from, to) = (k * part, k * part + len);
            format!(r#","t{k}":{{"dtype":"U8","shape":[{len}],"data_offsets":[{from},{to}]}}"#)
        };
        (0..7).map(|k| tensor(k, part)).chain([tensor(7, last)]).collect::<String>()
    };
    let header_of = |last| format!("{{{head}{}}}", tensors(last));
    let header_bytes = header_of((1 << 61) - 1000).len() as u64;
    let header = header_of((1 << 61) - 8 - header_bytes);
    assert_eq!(header.len() as u64, header_bytes);
    let error = refusal(&file, &with_header(&header, 0));
    assert!(matches!(error, Error::Damaged { .. }), "{error}");
}

#[test]
fn a_file_of_another_kind_is_not_read_as_a_scene() {
    let file = small_scene_written();
    for bytes in [&b"{}"[..], b"just some text that is longer than eight bytes", &[0; 64], &with_header("{}", 0)] {
        let error = refusal(&file, bytes);
        assert!(error.to_string().contains("not a scene file"), "{error}");
    }
    write_checkpoint(&file.path, &small_checkpoint()).unwrap();
    let error = read_2d(&file.path).unwrap_err();
    assert!(error.to_string().contains("gs-checkpoint"), "{error}");
    write_2d(&file.path, &small_file()).unwrap();
    let error = read_checkpoint(&file.path).unwrap_err();
    assert!(error.to_string().contains("gs-scene-2d"), "{error}");

    let folder = file.path.parent().unwrap();
    assert!(matches!(read_2d(folder).unwrap_err(), Error::NotAFile { .. }));
    assert!(matches!(read_2d(folder.join("absent")).unwrap_err(), Error::Missing { .. }));
    assert!(matches!(write_2d(folder.join("no/a"), &small_file()).unwrap_err(), Error::NoFolder { .. }));
}

#[test]
fn a_checkpoint_whose_tensor_contradicts_its_shape_is_not_written() {
    let mut checkpoint = small_checkpoint();
    checkpoint.state.tensors.get_mut("steps").unwrap().shape = vec![3];
    let folder = tempfile::tempdir().unwrap();
    let error = write_checkpoint(folder.path().join("a"), &checkpoint).unwrap_err();
    assert!(error.to_string().contains("tensor `state.steps` has 2 values in a shape of [3]"), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn the_bytes_are_those_of_safetensors() {
    let file = small_scene_written();
    write_checkpoint(&file.path, &small_checkpoint()).unwrap();
    let written = fs::read(&file.path).unwrap();
    let (_, header) = safetensors::SafeTensors::read_metadata(&written).unwrap();
    let tensors = safetensors::SafeTensors::deserialize(&written).unwrap();
    assert!(!tensors.is_empty());
    assert_eq!(safetensors::serialize(tensors.tensors(), header.metadata().clone()).unwrap(), written);
}
