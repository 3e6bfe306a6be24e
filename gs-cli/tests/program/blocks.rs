//! A scene trained in blocks: `gs blocks prepare`, `work`, `status` and `merge`.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Child, Stdio},
};

use gs_conformance::posed::{small_scene, write_dataset};
use gs_cpu::{CpuRasterizer, CpuSettings};

use crate::process::{Run, command, folder, gs, names_in};

fn dataset(place: &Path) -> PathBuf {
    let path = place.join("data");
    write_dataset(&path, &small_scene(0), &CpuRasterizer::new(CpuSettings::default()).unwrap(), true).unwrap();
    path
}

/// Prepares blocks of a data set, with these flags.
fn prepare(dataset: &Path, output: &Path, flags: &[&str]) -> Run {
    let usual = ["--backend", "cpu", "-i", "2000", "-n", "80"];
    let of_coarse = ["--coarse-gaussians", "40", "--start", "random"];
    let coarse: &[&str] = if flags.contains(&"--model") { &[] } else { &of_coarse };
    let words = ["blocks", "prepare", dataset.to_str().unwrap(), "-o", output.to_str().unwrap()];
    gs(words.iter().chain(flags).chain(coarse).chain(&usual))
}

fn words<'a>(action: &'a str, path: &'a Path) -> [&'a str; 3] {
    ["blocks", action, path.to_str().unwrap()]
}

/// Starts a process that takes part.
fn start(output: &Path, shard: &str) -> Child {
    let mut command = command();
    command.args(words("work", output)).args(["--threads", "1", "--shard", shard]);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn blocks_have_the_bits_of_one_process_whoever_is_killed() {
    let place = folder();
    let data = dataset(place.path());
    let (alone, shared) = (place.path().join("alone"), place.path().join("shared"));
    let prepared = prepare(&data, &alone, &["--blocks", "2x1"]).done();
    assert!(prepared.stdout.starts_with("2 blocks of 40 coarse Gaussians and 7 views: "), "{prepared:?}");
    assert!(fs::read_to_string(alone.join("map.svg")).unwrap().contains("block 2</text>"));
    let none = gs(words("merge", &alone));
    assert!(none.refusal().contains("block 1 has not been done: do it with gs blocks work --retry"), "{none:?}");
    prepare(&data, &shared, &["--blocks", "2x1", "--model", alone.join("coarse").to_str().unwrap()]).done();

    let worked = gs(words("work", &alone)).done();
    assert!(worked.stdout.starts_with("2 blocks done, none is left; join them with gs blocks merge "), "{worked:?}");
    let mut processes = ["0/2", "1/2"].map(|shard| start(&shared, shard));
    // Until both have a block, or one has ended what there was.
    let claimed = || names_in(&shared.join("runs")).iter().filter(|name| name.ends_with(".claim")).count();
    while claimed() < 2 && processes.iter_mut().all(|process| process.try_wait().unwrap().is_none()) {
        std::thread::yield_now();
    }
    processes[0].kill().unwrap();
    let ended = processes.map(|process| Run::ended(process.wait_with_output().unwrap()));
    assert!(ended[1].stdout.contains("none is left"), "{ended:?}");
    let status = gs(words("status", &shared)).done().stdout;
    assert!(status.starts_with("2 of 2 blocks done\nblock 1 ("), "{status}");
    let merged = [&alone, &shared].map(|output| {
        let merged = gs(words("merge", output).iter().chain(&["--lod"])).done();
        assert!(merged.stdout.contains("pixels near cell edges") && merged.stdout.contains("\nall "), "{merged:?}");
        assert!(gs(["info", output.join("lod").to_str().unwrap()]).done().stdout.contains("streamed SOG"));
        ["scene.ply", "lod/lod-meta.json"].map(|name| fs::read(output.join(name)).unwrap())
    });
    assert!(merged[0] == merged[1]);
    let compared = gs(words("merge", &alone).iter().chain(&["--compare", alone.join("coarse").to_str().unwrap()]));
    assert!(compared.done().stdout.contains("\nall "));
}

#[test]
fn memory_decides_how_many_blocks_there_are() {
    let place = tempfile::tempdir().unwrap();
    let (data, output) = (dataset(place.path()), place.path().join("one"));
    let text = |run: Run| run.done().stdout;
    assert!(text(prepare(&data, &output, &["--memory", "1G"])).starts_with("1 block of "));
    let coarse = output.join("coarse");
    let with = |name: &str, memory: &str| {
        let flags = ["--model", coarse.to_str().unwrap(), "--memory", memory];
        prepare(&data, &place.path().join(name), &flags)
    };
    // One byte less than one block needs.
    let plan: serde_json::Value = serde_json::from_slice(&fs::read(output.join("blocks.json")).unwrap()).unwrap();
    let needed = plan["plan"]["blocks"][0]["memory"].as_u64().unwrap();
    let two = text(with("two", &(needed - 1).to_string()));
    assert!(two.starts_with("2 blocks of "), "{two}");
    let none = with("none", "1M");
    assert!(none.status == Some(1) && none.stderr.contains("and there cannot be more ("), "{none:?}");
    assert!(!place.path().join("none/blocks.json").exists());
    assert_eq!(names_in(&place.path().join("none/starts")), [""; 0]);
    assert_eq!(names_in(&place.path().join("two/starts")).len(), 2);
}

#[test]
fn impossible_block_commands_are_refused_in_one_line() {
    let place = folder();
    let (data, output) = (dataset(place.path()), place.path().join("out"));
    let refused = |run: Run, expected: &str| assert!(run.refusal().contains(expected), "{expected}: {run:?}");
    refused(prepare(&data, &output, &["--blocks", "4"]), "write it as MxN, such as 4x4");
    refused(prepare(&data, &output, &["--blocks", "1x1", "--margin", "2"]), "margin is 2");
    refused(prepare(&data, &output, &["--blocks", "1x1", "--minutes", "2"]), "--minutes");
    refused(prepare(&data, &output, &["--blocks", "1x1", "--memory", "1G"]), "--memory is for --blocks auto");
    refused(prepare(&data, &output, &["--blocks", "1x1", "--exactly"]), "--exactly");
    refused(prepare(&place.path().join("none"), &output, &["--blocks", "1x1"]), "none");
    refused(gs(words("work", place.path())), "contains no blocks");
    let many = prepare(&data, &output, &["--blocks", "90x1"]);
    assert!(many.status == Some(2) && many.stderr.contains("number of blocks is 90x1"), "{many:?}");
    let coarse = output.join("coarse");
    let model = place.path().join("model");
    fs::create_dir(&model).unwrap();
    fs::copy(coarse.join("scene.ply"), model.join("scene.ply")).unwrap();
    fs::write(model.join("summary.json"), r#"{"poses": {"used": true}}"#).unwrap();
    let unsettled =
        prepare(&data, &place.path().join("other"), &["--blocks", "1x1", "--model", model.to_str().unwrap()]);
    assert!(
        unsettled.status == Some(2) && unsettled.stderr.contains("poses were corrected for this scene"),
        "{unsettled:?}"
    );
    prepare(&data, &output, &["--blocks", "1x1", "--model", coarse.to_str().unwrap()]).done();
    refused(prepare(&data, &output, &["--blocks", "1x1"]), "contains blocks already");
    let merged = place.path().join("merged");
    fs::create_dir(&merged).unwrap();
    fs::copy(coarse.join("scene.ply"), merged.join("scene.ply")).unwrap();
    let mut plan: serde_json::Value = serde_json::from_slice(&fs::read(output.join("blocks.json")).unwrap()).unwrap();
    plan["plan"]["views"][0]["pose"] = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0].into();
    fs::write(merged.join("blocks.json"), plan.to_string()).unwrap();
    let corrected = prepare(&data, &place.path().join("again"), &["--model", merged.to_str().unwrap()]);
    assert!(
        corrected.status == Some(2) && corrected.stderr.contains("was corrected for these blocks"),
        "{corrected:?}"
    );
    let moved = place.path().join("moved");
    fs::rename(&data, &moved).unwrap();
    refused(gs(words("work", &output)), "name the data set's place on this machine with --data");
    let with_data = |path: &Path| gs(words("work", &output).iter().chain(&["--data", path.to_str().unwrap()]));
    let image = moved.join("images/3.png");
    let whole = fs::read(&image).unwrap();
    fs::copy(moved.join("images/4.png"), &image).unwrap();
    let changed = with_data(&moved);
    assert!(changed.status == Some(1) && changed.stderr.contains("1 image has changed"), "{changed:?}");
    fs::write(&image, whole).unwrap();
    with_data(&moved).done();
    fs::write(output.join("scene.ply"), "mine").unwrap();
    refused(gs(words("merge", &output).iter().chain(&["--data", moved.to_str().unwrap()])), "scene.ply");
}
