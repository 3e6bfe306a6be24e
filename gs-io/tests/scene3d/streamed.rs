//! Streamed SOG: levels of detail round-trip, a folder is written whole or not at all, and damaged trees
//! are refused.

use std::{
    fs,
    path::{Path, PathBuf},
};

use glam::Vec3;
use gs_core::{Camera, Gaussian3d, LodNode, Scene, Scene3d, sigmoid};
use gs_io::{
    Error, FilesInMemory, FolderClaim, Format3d, LevelsInMemory, LodFile3d, WriteOptions3d, read_3d, read_scene,
    write_3d, write_levels_of_parts_3d,
};
use serde_json::{Value, json};
use tempfile::TempDir;

/// A file with levels of detail.
fn opened(path: &Path) -> LodFile3d {
    LodFile3d::open(path).unwrap().expect("levels of detail")
}

/// Gaussians on a wavy square of about 40 by 40, more than a cell has.
pub(crate) fn city(count: usize) -> Scene3d {
    let gaussian = |i: usize| {
        let t = i as f32;
        let (x, y) = ((t * 0.618_034).fract() * 40.0, (t * 0.754_877_7).fract() * 40.0);
        Gaussian3d {
            mean: Vec3::new(x, (0.5 * x).sin() + (0.3 * y).cos(), y),
            log_scale: Vec3::new(-1.5 + 0.3 * (1.3 * t).sin(), -1.6, -4.0),
            rotation: [1.0, 0.3 * (0.7 * t).sin(), 0.0, 0.3 * t.cos()],
            opacity_logit: 1.5 * (2.1 * t).sin() + 1.0,
            sh: (0..4).map(|k| Vec3::splat((0.2 * x + k as f32).sin())).collect(),
        }
    };
    (0..count).map(gaussian).collect()
}

/// A scene of this many Gaussians in the folder `city` of a temporary folder.
fn written(count: usize) -> (TempDir, PathBuf, Scene3d) {
    let (place, scene) = (tempfile::tempdir().unwrap(), city(count));
    let path = place.path().join("city/lod-meta.json");
    let written = write_3d(&path, &scene, &WriteOptions3d::default()).unwrap();
    assert_eq!(written.format, Format3d::StreamedSog);
    assert!(written.beside.iter().all(|file| file.is_file()) && !written.losses.is_empty());
    (place, path, scene)
}

pub(crate) fn json_of(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn inside(tree: &LodNode) -> bool {
    match tree {
        LodNode::Inner { bounds, children } => {
            children.iter().all(|child| bounds.contains(child.bounds()) && inside(child))
        }
        LodNode::Leaf { .. } => true,
    }
}

#[test]
fn levels_in_memory_are_those_of_the_file_and_only_what_is_missing_is_read() {
    let (_place, path, _) = written(9000);
    let streamed = opened(&path);
    let mut levels = LevelsInMemory::of(streamed.clone(), 0);
    for wanted in [[6, 6], [0, 6], [0, 3], [2, 3], [6, 6], [1, 1]] {
        assert_eq!(levels.read(&wanted).unwrap(), streamed.read(&wanted).unwrap().scene, "{wanted:?}");
    }
    // What a chunk has beside what is wanted leaves the memory before the next chunk comes.
    let mut narrow = LevelsInMemory::of(streamed.clone(), 0);
    for path in narrow.missing(&[0, 3], glam::Vec3::ZERO) {
        narrow.add(&path, None).unwrap();
    }
    let count =
        |levels: &mut LevelsInMemory, wanted: &[usize]| levels.shown(wanted).iter().map(|p| p.len()).sum::<usize>();
    let of = |cell: usize, level: usize| streamed.tree().cells()[cell].1[level].gaussians;
    assert_eq!(count(&mut narrow, &[3, 0]), of(0, 0) + of(1, 3), "the others of both chunks are gone");
    // Without the chunk of level 1, what is there can still be shown, but not read again.
    fs::remove_dir_all(path.with_file_name("1_0")).unwrap();
    assert_eq!(levels.read(&[1, 1]).unwrap().len(), 4500);
    let cells = streamed.tree().cells();
    assert_eq!(levels.read(&[0, 1]).unwrap().len(), cells[0].1[0].gaussians + cells[1].1[1].gaussians);
    levels.read(&[0, 0]).unwrap();
    assert!(matches!(levels.read(&[0, 1]).unwrap_err(), Error::Missing { .. }));
    // With room for them, levels stay that were wanted before.
    let mut levels = LevelsInMemory::of(streamed, 1 << 20);
    levels.read(&[2, 2]).unwrap();
    levels.read(&[0, 0]).unwrap();
    fs::remove_dir_all(path.with_file_name("2_0")).unwrap();
    assert_eq!(levels.read(&[2, 2]).unwrap().len(), 2250);
}

#[test]
fn levels_that_a_camera_sees_fade_and_end_as_they_are_read() {
    let (_place, path, _) = written(9000);
    let streamed = opened(&path);
    let read = |levels: &[usize]| streamed.read(levels).unwrap().scene;
    let lens = Camera::looking_forward(400, 300, 1.0);
    let above = lens.looking_at(Vec3::new(20.0, -60.0, 20.0), Vec3::new(20.0, 0.0, 20.1), Vec3::Z).unwrap();
    let away = lens.looking_at(Vec3::new(20.0, -60.0, 20.0), Vec3::new(20.0, -90.0, 20.1), Vec3::Z).unwrap();
    let mut levels = LevelsInMemory::of(streamed.clone(), 0);
    assert_eq!(levels.read_at(&[4, 4], &above, 0.0).unwrap(), read(&[4, 4]));
    assert_eq!(levels.read_at(&[3, 4], &above, 5.0).unwrap(), read(&[4, 4]), "it begins");
    assert!(levels.is_changing());
    let both = levels.read_at(&[3, 4], &above, 5.125).unwrap();
    let counts: Vec<usize> = streamed.tree().cells()[0].1.iter().map(|level| level.gaussians).collect();
    assert_eq!(both.len(), read(&[3, 4]).len() + counts[4]);
    let opacity = |scene: &Scene3d| scene.opacity_logits.iter().map(|&logit| f64::from(sigmoid(logit))).sum::<f64>();
    let mean = 0.5 * (opacity(&read(&[4, 4])) + opacity(&read(&[3, 4])));
    assert!((opacity(&both) / mean - 1.0).abs() < 1e-5, "half of each level");
    assert_eq!(levels.read_at(&[3, 4], &above, 5.3).unwrap(), read(&[3, 4]));
    assert!(!levels.is_changing());
    assert_eq!(levels.read_at(&[1, 2], &away, 6.0).unwrap(), read(&[1, 2]), "nobody sees it");
    assert_eq!(levels.read(&[0, 0]).unwrap(), read(&[0, 0]));
}

/// The files in the folder of a chunk, by their paths below that of `lod-meta.json`.
fn chunk_in_memory(root: &Path, meta: &Path) -> FilesInMemory {
    let folder = meta.parent().unwrap();
    let names = fs::read_dir(root.join(folder)).unwrap().map(|entry| entry.unwrap().file_name());
    names.map(|name| (folder.join(&name), fs::read(root.join(folder).join(&name)).unwrap())).collect()
}

#[test]
fn chunks_come_one_after_the_other_and_what_is_there_stands_in_for_the_others() {
    let (_place, path, _) = written(9000);
    let root = path.parent().unwrap();
    // Nothing is read from this folder, which is none.
    let meta = Path::new("nowhere/lod-meta.json");
    let streamed = LodFile3d::decode(&fs::read(&path).unwrap(), meta).unwrap();
    let mut levels = LevelsInMemory::of(streamed, 1 << 20);
    let cells: Vec<_> = levels.tree().cells().iter().map(|(bounds, _)| **bounds).collect();
    let chunk = |level: usize| PathBuf::from(format!("nowhere/{level}_0/meta.json"));
    let files = |level: usize| -> FilesInMemory {
        let files = chunk_in_memory(root, Path::new(&format!("{level}_0/meta.json")));
        files.into_iter().map(|(path, bytes)| (Path::new("nowhere").join(path), bytes)).collect()
    };
    let at = |cell: usize| cells[cell].min.midpoint(cells[cell].max);
    // A small chunk makes the first picture, and then the nearest comes first.
    assert_eq!(levels.missing(&[0, 3], at(0)), [chunk(3), chunk(0)]);
    let count = |levels: &mut LevelsInMemory, wanted| levels.shown(wanted).iter().map(|part| part.len()).sum::<usize>();
    assert_eq!(count(&mut levels, &[0, 3]), 0);
    levels.add(&chunk(6), Some(&files(6))).unwrap();
    assert_eq!(levels.missing(&[0, 3], at(0)), [chunk(0), chunk(3)]);
    assert_eq!(levels.missing(&[0, 3], at(1)), [chunk(3), chunk(0)]);
    let of = |counts: [usize; 2]| counts.iter().sum::<usize>();
    let counts: Vec<Vec<usize>> =
        levels.tree().cells().iter().map(|(_, l)| l.iter().map(|l| l.gaussians).collect()).collect();
    // Level 3 stands in for level 0, and later level 0 for a coarser one that is not there.
    levels.add(&chunk(3), Some(&files(3))).unwrap();
    assert_eq!(levels.missing(&[0, 3], at(1)), [chunk(0)]);
    assert_eq!(count(&mut levels, &[0, 3]), of([counts[0][3], counts[1][3]]));
    levels.add(&chunk(0), Some(&files(0))).unwrap();
    assert!(levels.missing(&[0, 3], at(1)).is_empty());
    assert_eq!(levels.read(&[0, 3]).unwrap(), opened(&path).read(&[0, 3]).unwrap().scene);
    assert_eq!(count(&mut levels, &[5, 4]), of([counts[0][6], counts[1][6]]));
    assert_eq!(count(&mut levels, &[6, 0]), of([counts[0][6], counts[1][0]]));
    assert_eq!(levels.shown_levels().unwrap(), [6, 0]);
    // A chunk without one of its images is an error that names it.
    let mut cut = files(1);
    cut.retain(|path, _| !path.ends_with("quats.webp"));
    let error = levels.add(&chunk(1), Some(&cut)).unwrap_err();
    assert!(matches!(&error, Error::Missing { path } if path.ends_with("1_0/quats.webp")), "{error}");
    // One with the Gaussians of another is an error, too.
    let wrong = files(2).into_iter().map(|(path, bytes)| (chunk(1).with_file_name(path.file_name().unwrap()), bytes));
    assert!(matches!(levels.add(&chunk(1), Some(&wrong.collect())), Err(Error::Damaged { .. })));
}

#[test]
fn all_levels_come_back() {
    let (place, path, scene) = written(9000);
    let finest = read_3d(&path).unwrap();
    assert_eq!((finest.format, finest.scene.len(), finest.scene.sh_degree), (Format3d::StreamedSog, 9000, 1));
    // Both are the same Gaussians in other orders, to 16 bits of the ln-distance.
    let sorted = |scene: &Scene3d| {
        let mut means = scene.means.clone();
        means.sort_by(|a, b| a.x.total_cmp(&b.x));
        means
    };
    let sums = |scene: &Scene3d| scene.means.iter().copied().sum::<Vec3>() / 9000.0;
    assert!(sorted(&scene).iter().zip(sorted(&finest.scene)).all(|(a, b)| (a.x - b.x).abs() < 0.01));
    assert!(sums(&scene).distance(sums(&finest.scene)) < 0.001);
    let streamed = opened(&path);
    assert_eq!(streamed.counts(), [9000, 4500, 2250, 1124, 562, 280, 140]);
    let cells = streamed.tree().cells();
    assert_eq!(cells.len(), 2);
    assert!(inside(streamed.tree()));
    for level in 0..7 {
        let file = streamed.read(&vec![level; cells.len()]).unwrap();
        assert_eq!(file.scene.len(), streamed.counts()[level]);
        assert!(file.bytes > 1000 && file.beside.len() >= 8);
        // Coarser Gaussians are at the same place, wider apart, and larger.
        assert!(sums_of(&file.scene).distance(sums(&scene)) < 1.0);
        let outside = |mean: &Vec3| {
            cells.iter().all(|(b, _)| !(b.min.cmple(*mean + 0.01).all() && b.max.cmpge(*mean - 0.01).all()))
        };
        assert!(!file.scene.means.iter().any(outside));
    }
    for (_, levels) in &cells {
        assert_eq!(levels[0].error, 0.0);
        assert!(levels.windows(2).all(|pair| pair[0].error < pair[1].error && pair[0].gaussians > pair[1].gaussians));
    }
    let mixed = streamed.read(&[3, 0]).unwrap().scene.len();
    assert_eq!(mixed, cells[0].1[3].gaussians + cells[1].1[0].gaussians);
    // The folder is a scene, too.
    assert_eq!(read_scene(path.parent().unwrap(), gs_io::Values::Checked).unwrap().path, path);
    drop(place);
}

fn sums_of(scene: &Scene3d) -> Vec3 {
    scene.means.iter().copied().sum::<Vec3>() / scene.len() as f32
}

#[test]
fn parts_have_a_tree_each_and_one_above_them() {
    let (place, whole, scene) = written(400);
    let path = place.path().join("parts/lod-meta.json");
    let options = WriteOptions3d::default();
    let write = |counts: &[usize]| {
        // Only one part is asked for at a time.
        let mut from = 0;
        write_levels_of_parts_3d::<Error>(&path, 1, counts, &options, |part| {
            let part: Scene3d = (from..from + counts[part]).map(|index| scene.gaussian(index)).collect();
            from += part.len();
            Ok(part)
        })
    };
    write(&[400]).unwrap();
    let content = |path: &Path| fs::read(path).unwrap();
    assert_eq!(content(&path), content(&whole), "one part is the whole");
    write(&[0, 300, 3, 97, 0]).unwrap();
    let streamed = opened(&path);
    let cells = streamed.tree().cells();
    assert!(inside(streamed.tree()));
    let sizes: Vec<usize> = cells.iter().map(|(_, levels)| levels[0].gaussians).collect();
    assert_eq!(sizes, [300, 3, 97]);
    let coarsest: Vec<usize> = cells.iter().map(|(_, levels)| levels[6].gaussians).collect();
    assert_eq!(coarsest, [4, 1, 1]);
    let finest = read_3d(&path).unwrap().scene;
    assert_eq!(finest.len(), 400);
    assert!(sums_of(&finest).distance(sums_of(&scene)) < 0.001);
    for level in 0..7 {
        assert_eq!(streamed.read(&[level; 3]).unwrap().scene.len(), streamed.counts()[level]);
    }
    let (before, folder) = (content(&path), place.path().join("other/lod-meta.json"));
    let changed = write_levels_of_parts_3d::<Error>(&folder, 1, &[400], &options, |_| Ok(city(8)));
    assert!(changed.unwrap_err().to_string().contains("part 1 has other Gaussians than was said"));
    assert!(!folder.parent().unwrap().exists());
    assert!(matches!(write(&[0, 0]), Err(Error::Unusable { .. })) && content(&path) == before);
}

#[test]
fn small_scenes_have_fewer_levels() {
    let (_place, path, _) = written(5);
    assert_eq!(opened(&path).counts(), [5, 2, 1]);
    let (_place, path, _) = written(1);
    assert_eq!(opened(&path).counts(), [1]);
}

#[test]
fn files_are_the_same_for_any_number_of_threads() {
    let (place, path, scene) = written(9000);
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let again = place.path().join("by one thread").join("lod-meta.json");
    let of_one = one.install(|| write_3d(&again, &scene, &WriteOptions3d::default())).unwrap();
    assert_eq!(of_one.beside.len(), 7 * 8);
    for other in of_one.beside.iter().chain([&again]) {
        let name = other.strip_prefix(again.parent().unwrap()).unwrap();
        assert_eq!(fs::read(other).unwrap(), fs::read(path.with_file_name(name)).unwrap(), "{}", name.display());
    }
}

#[test]
fn a_folder_is_replaced_only_if_gs_wrote_it() {
    let (_place, path, _) = written(70);
    let folder = path.parent().unwrap();
    // A smaller scene leaves nothing of the larger one.
    write_3d(&path, &city(3), &WriteOptions3d::default()).unwrap();
    assert_eq!(read_3d(&path).unwrap().scene.len(), 3);
    assert!(!folder.join("5_0/meta.json").exists() && folder.join("1_0/meta.json").is_file());
    let left = fs::read_dir(folder)
        .unwrap()
        .filter(|entry| entry.as_ref().unwrap().path().extension().is_some_and(|e| e == "tmp"));
    assert_eq!(left.count(), 0);
    fs::write(folder.join("mine.txt"), "mine").unwrap();
    write_3d(&path, &city(4), &WriteOptions3d::default()).unwrap();

    let other = tempfile::tempdir().unwrap();
    fs::create_dir(other.path().join("0_0")).unwrap();
    fs::write(other.path().join("0_0/meta.json"), "mine").unwrap();
    let error = write_3d(other.path().join("lod-meta.json"), &city(4), &WriteOptions3d::default()).unwrap_err();
    assert!(matches!(error, Error::InTheWay { .. }), "{error}");
    assert_eq!(fs::read(other.path().join("0_0/meta.json")).unwrap(), b"mine");
    assert!(!other.path().join("lod-meta.json").exists());
}

#[test]
fn a_failure_leaves_the_older_scene_or_nothing() {
    let (place, path, _) = written(70);
    let mut broken = city(70);
    broken.rotations[3] = [0.0; 4];
    assert!(matches!(write_3d(&path, &broken, &WriteOptions3d::default()), Err(Error::Content { .. })));
    assert_eq!(read_3d(&path).unwrap().scene.len(), 70);
    let new = place.path().join("new/lod-meta.json");
    assert!(write_3d(&new, &broken, &WriteOptions3d::default()).is_err());
    assert!(!place.path().join("new").exists());
    // Another run is at work in the folder.
    let _run = FolderClaim::new(path.parent().unwrap(), [""; 0]).begin().unwrap();
    assert!(matches!(write_3d(&path, &city(3), &WriteOptions3d::default()), Err(Error::Busy { .. })));
    assert_eq!(read_3d(&path).unwrap().scene.len(), 70);
}

/// Expects the error of a `lod-meta.json` that was edited.
#[track_caller]
fn refused(path: &Path, edit: impl FnOnce(&mut Value), expected: &str) {
    let mut meta = json_of(path);
    edit(&mut meta);
    let copy = path.with_file_name("copy").join("lod-meta.json");
    fs::create_dir_all(copy.parent().unwrap()).unwrap();
    fs::write(&copy, meta.to_string()).unwrap();
    let text = LodFile3d::open(&copy).map(drop).unwrap_err().to_string();
    assert!(
        text.contains(expected) && text.contains("lod-meta.json") && !text.contains('\n'),
        "{text:?}, not {expected:?}"
    );
}

#[test]
fn damaged_trees_are_refused() {
    let (_place, path, _) = written(8194);
    let left = |meta: &mut Value| meta["tree"]["children"][0].take();
    refused(&path, |m| m["tree"]["children"][1] = Value::Null, "expected two children of a node, found 1");
    refused(&path, |m| m["tree"]["children"] = json!([left(&mut m.clone())]), "two children of a node, found 1");
    refused(&path, |m| m["tree"]["children"][0]["children"] = json!([]), "either `children` or `lods`");
    refused(&path, |m| m["tree"]["children"][0]["lods"] = Value::Null, "either `children` or `lods`");
    refused(&path, |m| m["tree"]["bound"]["max"][0] = json!(1.0), "expected bounds inside those of the node above");
    refused(&path, |m| m["tree"]["bound"]["min"][2] = Value::Null, "expected finite bounds of nodes");
    refused(&path, |m| m["tree"]["bound"]["min"][2] = json!(1e300), "is damaged");
    refused(&path, |m| m["tree"]["bound"]["min"][2] = json!(100.0), "min up to max");
    refused(
        &path,
        |m| m["counts"][1] = json!(4),
        "expected [8194, 4, 2048, 1024, 512, 256, 128] Gaussians in the levels, found [8194, 4096",
    );
    refused(&path, |m| m["count"] = json!(4), "expected 4 Gaussians in all levels");
    refused(&path, |m| m["counts"] = json!([8194]), "expected [8194] Gaussians in the levels");
    refused(&path, |m| m["lodLevels"] = json!(1e6 as u64), "expected 1 to 64 levels, found 1000000");
    refused(&path, |m| m["lodLevels"] = json!(0), "expected 1 to 64 levels");
    let cell = |m: &mut Value, key: &str, value: Value| m["tree"]["children"][1]["lods"][key] = value;
    refused(&path, |m| cell(m, "7", json!({"file": 0, "offset": 0, "count": 1})), "expected levels below 7");
    refused(&path, |m| cell(m, "0", json!({"file": 99, "offset": 0, "count": 4097})), "expected chunks below 7");
    refused(&path, |m| cell(m, "0", json!({"file": 0, "offset": 5, "count": 4097})), "a run that begins at Gaussian");
    refused(&path, |m| cell(m, "0", json!({"file": 0, "offset": 0, "count": -1})), "invalid value");
    refused(
        &path,
        |m| m["tree"]["children"][0]["errors"] = json!([0, -1, 2, 3, 4, 5, 6]),
        "expected 7 errors of a cell",
    );
    refused(&path, |m| m["version"] = json!(2), "expected a streamed SOG of version 1 or older, found version 2");
    for name in ["/etc/passwd", "../0_0/meta.json", "0_0/../../x", "C:\\x", "", "a\\b", "\\\\host\\x"] {
        refused(&path, |m| m["filenames"][0] = json!(name), "names of files below the folder of lod-meta.json");
        refused(&path, |m| m["environment"] = json!(name), "names of files below the folder of lod-meta.json");
    }
    let twice = |m: &mut Value| m["filenames"][1] = m["filenames"][0].clone();
    refused(&path, twice, "each once");
    refused(&path, |m| m["environment"] = m["filenames"][0].clone(), "each once");
    // Nested more deeply than any tree.
    let deep = "{\"tree\":".repeat(100_000);
    fs::write(&path, deep).unwrap();
    assert!(matches!(LodFile3d::open(&path), Err(Error::Damaged { .. })));
}

#[test]
fn missing_and_damaged_chunks_are_named() {
    let (_place, path, _) = written(70);
    let folder = path.parent().unwrap();
    let text = |name: &str| {
        let text = read_3d(&path).unwrap_err().to_string();
        assert!(text.contains(name) && !text.contains('\n'), "{text}");
        text
    };
    let image = folder.join("0_0/quats.webp");
    let bytes = fs::read(&image).unwrap();
    fs::write(&image, &bytes[..bytes.len() / 2]).unwrap();
    text("quats.webp");
    fs::write(&image, &bytes).unwrap();
    // A chunk of another scene.
    let other = tempfile::tempdir().unwrap();
    let other_path = other.path().join("meta.json");
    let made = write_3d(&other_path, &city(60), &WriteOptions3d::default()).unwrap();
    for file in made.beside.iter().chain([&other_path]) {
        fs::copy(file, folder.join("0_0").join(file.file_name().unwrap())).unwrap();
    }
    assert!(text("lod-meta.json").contains("expected 70 Gaussians in "));
    fs::remove_file(folder.join("0_0/meta.json")).unwrap();
    assert!(text("meta.json").contains("no such file"));
    // Other levels do not need it.
    assert_eq!(opened(&path).read(&[1]).unwrap().scene.len(), 35);
}

#[test]
fn files_of_other_programs_are_read() {
    let (_place, path, _) = written(70);
    let mut meta = json_of(&path);
    // From before there were versions, without errors, with an environment.
    for key in ["version", "asset", "count", "counts", "lodErrors", "errorUnit"] {
        meta.as_object_mut().unwrap().remove(key);
    }
    meta["environment"] = Value::Null;
    meta["tree"]["lods"].as_object_mut().unwrap().remove("6");
    fs::write(&path, meta.to_string()).unwrap();
    let streamed = opened(&path);
    assert_eq!(streamed.counts()[5..], [2, 0]);
    let levels = streamed.tree().cells()[0].1.to_vec();
    // Errors are guessed; no Gaussians at all are the worst.
    assert!(levels[0].error == 0.0 && levels.windows(2).all(|pair| pair[0].error <= pair[1].error), "{levels:?}");
    let sky = path.with_file_name("sky");
    fs::create_dir(&sky).unwrap();
    for file in fs::read_dir(path.with_file_name("3_0")).unwrap().map(Result::unwrap) {
        fs::copy(file.path(), sky.join(file.file_name())).unwrap();
    }
    meta["environment"] = json!("sky/meta.json");
    fs::write(&path, meta.to_string()).unwrap();
    assert_eq!(read_3d(&path).unwrap().scene.len(), 70 + 8);
}
