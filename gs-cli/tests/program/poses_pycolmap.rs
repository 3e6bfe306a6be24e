//! `gs poses` by PyCOLMAP, with programs in place of Python and its module.

#![cfg(unix)]

use std::{fs, process::Command};

use crate::{
    poses::Scene,
    process::{Run, folder},
    train::text,
};

/// Takes the place of a Python with PyCOLMAP: `python3 -c SCRIPT COMMAND ...`.
const PYTHON: &str = r#"#!/bin/sh
here=${0%/*}
[ "$1" = -c ] || exit 9
shift 2
[ -f "$here/none" ] && echo "no PyCOLMAP" >&2 && exit 1
[ -f "$here/old" ] && echo "COLMAP 3.13.0 -- PyCOLMAP" && exit 0
[ "$1" = help ] && echo "COLMAP 4.2.1 -- PyCOLMAP (without CUDA) mapper global_mapper" && exit 0
[ "$2" = -h ] && echo "--FeatureExtraction.use_gpu --FeatureMatching.use_gpu" && exit 0
exec "$here/as-colmap" "$@"
"#;

#[test]
fn without_colmap_pycolmap_does_the_same() {
    let scene = Scene::textured();
    fs::rename(scene.path("bin/colmap"), scene.path("bin/as-colmap")).unwrap();
    scene.program("python3", PYTHON);
    let gs = |python: &str| {
        let mut command = scene.command(&["poses", "photos", "-o", "set"]);
        command.env("PATH", scene.path("bin"));
        // One that is empty is none.
        Run::of(command.env("GS_PYTHON", python))
    };
    gs("").done();
    assert_eq!(scene.calls(), ["feature_extractor", "feature_extractor", "exhaustive_matcher", "mapper"]);
    let log = fs::read_to_string(scene.path("set/poses.log")).unwrap();
    assert!(
        log.contains("$ PyCOLMAP of python3 feature_extractor ") && log.contains("--FeatureMatching.use_gpu 0"),
        "{log}"
    );
    fs::write(scene.path("bin/old"), "").unwrap();
    let line = gs("").refusal().to_owned();
    let expected =
        "PyCOLMAP of python3 is COLMAP 3.13, but 4.1.1 or later is needed: python3 -m pip install --upgrade pycolmap";
    assert!(line.contains(expected), "{line}");
    fs::write(scene.path("bin/none"), "").unwrap();
    assert!(gs("").refusal().contains("or anywhere python3 -m pip install pycolmap"));
    let named = scene.path("bin/python3");
    let line = gs(text(&named)).refusal().to_owned();
    let python = named.display();
    assert!(line.contains(&format!("no pycolmap in {python})")), "{line}");
    assert!(line.ends_with(&format!("; or anywhere {python} -m pip install pycolmap")), "{line}");
}

/// Takes the place of the module: says what it is called with.
const MODULE: &str = r#"
__version__, has_cuda = "4.2.1", False
class Options(dict):
    def __init__(self, **fields): self.__dict__ = self; self.update(fields)
def ImageReaderOptions(): return Options(camera_model="SIMPLE_RADIAL", camera_params="", mask_path="")
def FeatureExtractionOptions():
    return Options(use_gpu=True, max_image_size=-1, sift=Options(max_num_features=8192, peak_threshold=0.0067))
def FeatureMatchingOptions(): return Options(use_gpu=True, num_threads=-1)
def ExhaustivePairingOptions(): return Options(block_size=50)
def SequentialPairingOptions(): return Options(overlap=5, loop_detection=False)
def ImportedPairingOptions(): return Options(match_list_path="")
def GlobalPipelineOptions(): return Options(num_threads=-1)
def IncrementalPipelineOptions():
    return Options(ba_global_function_tolerance=0.0, mapper=Options(init_min_tri_angle=16.0))
class CameraMode: SINGLE = "single"
def say(name): return lambda **given: print(name, sorted(given.items()))
extract_features, match_exhaustive, match_sequential = say("extract"), say("exhaustive"), say("sequential")
match_image_pairs = say("pairs")
incremental_mapping, global_mapping = say("incremental"), say("global")
"#;

#[test]
fn commands_become_calls_of_pycolmap() {
    let place = folder();
    fs::write(place.path().join("pycolmap.py"), MODULE).unwrap();
    fs::write(place.path().join("list"), "a b.png\n").unwrap();
    let script = include_str!("../../../gs-poses/src/colmap/pycolmap.py");
    let python = |words: &str| {
        let mut command = Command::new("python3");
        command.args(["-c", script]).args(words.split(' ')).current_dir(place.path()).env("PYTHONPATH", place.path());
        command.output().map(Run::ended)
    };
    let Ok(help) = python("help") else { return eprintln!("skipped: there is no python3") };
    assert!(help.done().stdout.starts_with("COLMAP 4.2.1 -- PyCOLMAP (without CUDA) feature_extractor"));
    assert!(python("feature_extractor -h").unwrap().done().stdout.contains("--FeatureExtraction.use_gpu"));
    let cases = [
        (
            "feature_extractor --database_path d --image_list_path list --ImageReader.single_camera 1 \
             --ImageReader.camera_model OPENCV --FeatureExtraction.use_gpu 0 --SiftExtraction.max_num_features 9 \
             --ImageReader.camera_params 4,4,2,2,0,0,0,0 --SiftExtraction.peak_threshold 0.003",
            "extract [('camera_mode', 'single'), ('database_path', 'd'), ('extraction_options', {'use_gpu': False, \
             'max_image_size': -1, 'sift': {'max_num_features': 9, 'peak_threshold': 0.003}}), ('image_names', ['a b.png']), \
             ('reader_options', {'camera_model': 'OPENCV', 'camera_params': '4,4,2,2,0,0,0,0', 'mask_path': ''})]",
        ),
        (
            "sequential_matcher --database_path d --SequentialMatching.overlap 10 --SequentialMatching.loop_detection 1",
            "sequential [('database_path', 'd'), ('matching_options', {'use_gpu': True, 'num_threads': -1}), \
             ('pairing_options', {'overlap': 10, 'loop_detection': True})]",
        ),
        (
            "matches_importer --database_path d --match_list_path pairs --match_type pairs",
            "pairs [('database_path', 'd'), ('matching_options', {'use_gpu': True, 'num_threads': -1}), \
             ('pairing_options', {'match_list_path': 'pairs'})]",
        ),
        (
            "global_mapper --output_path o --GlobalMapper.num_threads 3",
            "global [('options', {'num_threads': 3}), ('output_path', 'o')]",
        ),
        (
            "mapper --output_path o --Mapper.ba_global_function_tolerance 0.000001 --Mapper.init_min_tri_angle 4",
            "incremental [('options', {'ba_global_function_tolerance': 1e-06, 'mapper': {'init_min_tri_angle': 4.0}}), \
             ('output_path', 'o')]",
        ),
    ];
    for (words, expected) in cases {
        assert_eq!(python(words).unwrap().done().stdout.trim(), expected);
    }
    let failed = python("model_merger").unwrap();
    assert!(failed.status == Some(2) && failed.stderr.starts_with("ERROR: KeyError"), "{failed:?}");
    let failed = python("mapper --Mapper.other 1").unwrap();
    let expected = "ERROR: ValueError: PyCOLMAP 4.2.1 has no option other\n";
    assert!(failed.status == Some(2) && failed.stderr == expected, "{failed:?}");
}
