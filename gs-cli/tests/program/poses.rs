//! `gs poses` and `gs train` of photographs, with a program in place of COLMAP that writes a prepared model.

#![cfg(unix)]

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::PathBuf,
    process::{Command, Stdio},
    time::{Duration, Instant, SystemTime},
};

use gs_core::Image;

use crate::{
    process::{Run, command, folder, gs, names_in, signal},
    train::text,
};

/// Takes the place of COLMAP. Next to it, a file with the name of a command is done before the command, files that end in
/// `.help` are printed as help, and `model` and `second` are the models that it finds, `joined` what becomes of both.
const COLMAP: &str = r#"#!/bin/sh
here=${0%/*}
[ "$1" = help ] && [ -f "$here/.help" ] && exec /bin/cat "$here/.help"
[ "$1" = help ] && echo "COLMAP 3.8 -- Structure-from-Motion and Multi-View Stereo" && exit 0
[ "$2" = -h ] && [ -f "$here/$1.help" ] && exec /bin/cat "$here/$1.help"
[ "$2" = -h ] && exit 0
command=$1
all=$*
echo "$command" >> "$here/calls"
while [ $# -gt 1 ]; do
    case "$1" in --output_path) out=$2 ;; --image_list_path | --match_list_path) list=$2 ;; esac
    shift
done
[ -f "$here/$command.sh" ] && . "$here/$command.sh"
case "$command" in
feature_extractor) while read -r name; do echo "  Name: $name"; echo "  Features: 900"; done < "$list" ;;
mapper | global_mapper)
    if [ -d "$here/model" ]; then /bin/cp -r "$here/model" "$out/0"; fi
    if [ -d "$here/second" ]; then /bin/cp -r "$here/second" "$out/1"; fi ;;
model_merger) /bin/cp "$here/joined/"* "$out" ;;
esac
"#;

const NAMES: [&str; 5] = ["a b.png", "inner/é.png", "inner/写真.png", "m.png", "z.png"];

/// A place with the program, photographs of these names, and a model of the first four.
pub(crate) struct Scene {
    place: tempfile::TempDir,
}

impl Scene {
    fn new(color: impl Fn(usize, u32, u32) -> [f32; 3]) -> Self {
        let place = folder();
        fs::create_dir_all(place.path().join("bin")).unwrap();
        fs::create_dir_all(place.path().join("photos/inner")).unwrap();
        for (index, name) in NAMES.iter().enumerate() {
            let image = Image::from_fn(64, 48, |x, y| color(index, x, y)).unwrap();
            gs_io::write_png(place.path().join("photos").join(name), &image).unwrap();
        }
        let scene = Self { place };
        scene.program("colmap", COLMAP);
        scene.write_model(&NAMES[..4]);
        scene
    }

    pub(crate) fn textured() -> Self {
        Self::new(|index, x, y| [((x * 7 + y * 13 + index as u32 * 5) % 17) as f32 / 16.0; 3])
    }

    /// Puts a program on the `PATH`.
    pub(crate) fn program(&self, name: &str, script: &str) {
        let path = self.path("bin").join(name);
        fs::write(&path, script).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.place.path().join(name)
    }

    /// Does this before a command of COLMAP.
    pub(crate) fn before(&self, command: &str, script: &str) {
        fs::write(self.path(&format!("bin/{command}.sh")), script).unwrap();
    }

    pub(crate) fn calls(&self) -> Vec<String> {
        let calls = fs::read_to_string(self.path("bin/calls")).unwrap_or_default();
        fs::write(self.path("bin/calls"), "").unwrap();
        calls.lines().map(str::to_owned).collect()
    }

    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = command();
        let path = format!("{}:/usr/bin:/bin", self.path("bin").display());
        command.args(arguments).current_dir(self.place.path()).env("PATH", path);
        command
    }

    pub(crate) fn gs(&self, arguments: &[&str]) -> Run {
        Run::of(&mut self.command(arguments))
    }

    /// What COLMAP prints as help about a command, or without one about itself.
    pub(crate) fn help(&self, command: &str, text: &str) {
        fs::write(self.path(&format!("bin/{command}.help")), text).unwrap();
    }

    /// All that COLMAP was called with and said.
    pub(crate) fn log(&self) -> String {
        fs::read_to_string(self.path("set/poses.log")).unwrap()
    }

    /// The model that COLMAP finds.
    pub(crate) fn write_model(&self, names: &[&str]) {
        self.write_model_as("model", names);
    }

    /// Cameras side by side that look along z, and 200 points in front of them.
    fn write_model_as(&self, kind: &str, names: &[&str]) {
        let folder = self.path("bin").join(kind);
        fs::create_dir_all(&folder).unwrap();
        let (images, points) = (names.len() as u64, 200_u64);
        let mut bytes = images.to_le_bytes().to_vec();
        for (id, name) in (1_u32..).zip(names) {
            bytes.extend(id.to_le_bytes());
            let pose = [1.0, 0.0, 0.0, 0.0, -0.5 * f64::from(id), 0.0, 0.0];
            pose.iter().for_each(|value: &f64| bytes.extend(value.to_le_bytes()));
            bytes.extend(1_u32.to_le_bytes());
            bytes.extend(name.bytes().chain([0]));
            bytes.extend(points.to_le_bytes());
            (0..points).for_each(|point| {
                bytes.extend([1.0_f64, 1.0].iter().flat_map(|value| value.to_le_bytes()).chain(point.to_le_bytes()));
            });
        }
        fs::write(folder.join("images.bin"), bytes).unwrap();
        let mut bytes = points.to_le_bytes().to_vec();
        for point in 0..points {
            bytes.extend(point.to_le_bytes());
            let position = [point as f64 / 50.0 - 2.0, (point % 7) as f64 / 7.0, 4.0];
            position.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
            bytes.extend([90, 90, 90].into_iter().chain(0.75_f64.to_le_bytes()).chain(0_u64.to_le_bytes()));
        }
        fs::write(folder.join("points3D.bin"), bytes).unwrap();
        let mut bytes = 1_u64.to_le_bytes().to_vec();
        bytes.extend(1_u32.to_le_bytes().into_iter().chain(0_u32.to_le_bytes()));
        bytes.extend([64_u64, 48].iter().flat_map(|side| side.to_le_bytes()));
        bytes.extend([60.0_f64, 32.0, 24.0].iter().flat_map(|value| value.to_le_bytes()));
        fs::write(folder.join("cameras.bin"), bytes).unwrap();
    }
}

pub(crate) fn last_line(run: &Run) -> &str {
    run.stderr.lines().last().unwrap_or_default()
}

#[test]
fn photographs_become_a_data_set_with_a_verdict() {
    let scene = Scene::textured();
    fs::create_dir(scene.path("photos/masks")).unwrap();
    fs::copy(scene.path("photos/z.png"), scene.path("photos/masks/a b.png")).unwrap();
    let run = scene.gs(&["poses", "photos", "-o", "set"]).done();
    assert!(run.stdout.starts_with("usable: 4 of 5 photographs have poses, with 200 points"), "{run:?}");
    assert!(
        run.stdout.contains("0.75 px") && run.stdout.contains("left out: z.png, because it matches too few"),
        "{run:?}"
    );
    assert!(run.stdout.ends_with("the data set is set: gs train set -o gs-out trains a scene of it\n"), "{run:?}");
    assert_eq!(names_in(&scene.path("set")), ["images", "masks", "poses.json", "poses.log", "sparse"]);
    assert!(scene.path("set/masks/a b.png.png").is_file());
    let info = scene.gs(&["info", "set", "--json"]).json();
    assert_eq!((&info["made_by"], &info["views"], &info["masks"]), (&"colmap".into(), &4.into(), &1.into()));
    // Without EXIF data, folders are cameras.
    assert_eq!(scene.calls(), ["feature_extractor", "feature_extractor", "exhaustive_matcher", "mapper"]);
    let log = fs::read_to_string(scene.path("set/poses.log")).unwrap();
    assert!(
        log.contains("$ colmap feature_extractor --database_path ") && log.contains("--ImageReader.mask_path"),
        "{log}"
    );

    // With --resume, poses that were found are kept; without it, they are found again.
    let verdict = scene.gs(&["poses", "photos", "-o", "set", "--resume", "--json"]).json();
    assert_eq!((&verdict["quality"], &verdict["left_out"][0]["name"]), (&"usable".into(), &"z.png".into()));
    assert_eq!(scene.calls().len(), 0);
    fs::remove_file(scene.path("photos/z.png")).unwrap();
    let verdict = scene.gs(&["poses", "photos", "-o", "set", "--json"]).json();
    assert_eq!((&verdict["quality"], &verdict["registered"]), (&"good".into(), &4.into()));
    assert!(!scene.path("set/images/z.png").exists() && scene.path("set/images/inner/写真.png").is_file());
}

#[test]
fn pieces_that_share_photographs_are_joined() {
    let scene = Scene::textured();
    // Three of its four photographs are also in the first piece.
    scene.write_model_as("second", &NAMES[1..]);
    scene.write_model_as("joined", &NAMES);
    let run = scene.gs(&["poses", "photos", "-o", "set"]).done();
    assert!(run.stdout.starts_with("good: 5 of 5 photographs"), "{run:?}");
    assert_eq!(scene.calls()[3..], ["mapper", "model_merger", "bundle_adjuster"]);
    // Where that fails, the pieces stay.
    scene.before("model_merger", "exit 1");
    let verdict = scene.gs(&["poses", "photos", "-o", "set", "--json"]).json();
    assert_eq!((&verdict["registered"], &verdict["pieces"][0]), (&4.into(), &1.into()));
    assert_eq!(scene.calls()[3..], ["mapper", "model_merger"]);
}

#[test]
fn the_largest_connected_piece_of_photographs_is_used() {
    let scene = Scene::textured();
    scene.write_model(&NAMES[..3]);
    scene.write_model_as("second", &NAMES[3..]);
    let run = scene.gs(&["poses", "photos", "-o", "set"]).done();
    assert!(run.stdout.starts_with("usable: 3 of 5 photographs"), "{run:?}");
    for part in [
        "left out: m.png, z.png, because it belongs to another piece",
        "advice: the photographs fall into pieces that share no matches, of which the largest was taken (others: 2 photographs)",
    ] {
        assert!(run.stdout.contains(part), "{run:?}");
    }
    assert_eq!(scene.calls().len(), 4, "neither a second attempt nor a merger");
}

#[test]
fn photographs_that_colmap_cannot_read_are_left_out() {
    let scene = Scene::textured();
    let unreadable = "z.png) echo '  ERROR: Failed to read image file format.' ;;";
    let script = format!(
        "while read -r name; do echo \"  Name: $name\"; case $name in {unreadable} *) echo '  Features: 900' ;; esac; \
         done < \"$list\"; exit 0"
    );
    scene.before("feature_extractor", &script);
    // A list of COLMAP, a name in each line, cannot hold these.
    for name in [" blank.png", "#number.png"] {
        fs::copy(scene.path("photos/m.png"), scene.path("photos").join(name)).unwrap();
    }
    let run = scene.gs(&["poses", "photos", "-o", "set"]).done();
    for name in [" blank.png", "#number.png"] {
        let expected = format!("note: left out: photos/{name}: its name is not one that COLMAP reads");
        assert!(run.stderr.contains(&expected), "{run:?}");
        assert!(!scene.path("set/images").join(name).exists());
    }
    assert!(run.stdout.contains("4 of 5 photographs"), "{run:?}");
    assert!(run.stdout.contains("left out: z.png, because COLMAP cannot read it"), "{run:?}");
}

#[test]
fn versions_that_are_slow_are_named() {
    let scene = Scene::textured();
    let slow = "note: COLMAP 4.0.2 compares photographs 4 to 6 times more slowly than 4.1.1 does";
    for (version, is_slow) in [("4.0.2", true), ("4.1.1", false)] {
        scene.help("", &format!("COLMAP {version} -- Structure-from-Motion"));
        let run = scene.gs(&["poses", "photos", "-o", "set"]).done();
        assert_eq!(run.stderr.contains(slow), is_slow, "{run:?}");
    }
}

#[test]
fn a_run_that_was_killed_is_resumed() {
    let scene = Scene::textured();
    scene.before("exhaustive_matcher", "echo 'E20260101 x.cc:1] not enough memory'; kill -9 $$");
    let run = scene.gs(&["poses", "photos", "-o", "set"]);
    assert_eq!(run.status, Some(1), "{run:?}");
    let line = last_line(&run);
    let expected = "error: COLMAP was killed by signal 9 (out of memory?) while matching the photographs (not enough memory): see ";
    assert!(line.starts_with(expected) && line.contains("set/poses.log") && line.contains("--resume"), "{line}");
    assert!(!scene.path("set/sparse").exists());
    fs::remove_file(scene.path("bin/exhaustive_matcher.sh")).unwrap();
    scene.calls();
    scene.gs(&["poses", "photos", "-o", "set", "--resume"]).done();
    assert_eq!(scene.calls(), ["exhaustive_matcher", "mapper"]);
    assert!(!scene.path("set/.gs-poses").exists());
}

#[test]
fn ctrl_c_ends_colmap_and_names_the_command_that_continues() {
    let scene = Scene::textured();
    scene.before("mapper", "touch \"$here/begun\"; exec sleep 60");
    let mut program = scene.command(&["poses", "photos", "-o", "set"]);
    let child = program.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let started = Instant::now();
    while !scene.path("bin/begun").exists() && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(20));
    }
    signal(&child, "-INT", 1);
    let run = Run::ended(child.wait_with_output().unwrap());
    assert_eq!(run.status, Some(130), "{run:?}");
    assert_eq!(
        last_line(&run),
        "stopped while finding the poses; what is done so far is kept: gs poses photos -o set --resume continues"
    );
}

#[test]
fn unusable_photographs_outputs_or_colmap_are_refused() {
    let scene = Scene::textured();
    let none = Run::of(scene.command(&["poses", "photos", "-o", "set"]).env("PATH", "/nowhere"));
    let line = none.refusal();
    assert!(
        ["not installed", "apt install colmap", "brew install colmap", "Windows"]
            .iter()
            .all(|part| line.contains(part)),
        "{line}"
    );
    fs::create_dir(scene.path("one")).unwrap();
    fs::copy(scene.path("photos/z.png"), scene.path("one/z.png")).unwrap();
    let line = scene.gs(&["poses", "one", "-o", "set"]).refusal().to_owned();
    assert!(line.contains("one: holds 1 photograph, but poses need at least 2"), "{line}");
    fs::write(scene.path("one/broken.png"), "no image").unwrap();
    let line = scene.gs(&["poses", "one", "-o", "set"]).refusal().to_owned();
    assert!(line.contains("broken.png"), "{line}");
    assert!(!scene.path("set").exists(), "nothing is begun");
    fs::create_dir(scene.path("mine")).unwrap();
    fs::write(scene.path("mine/poses.json"), "mine").unwrap();
    let line = scene.gs(&["poses", "photos", "-o", "mine"]).refusal().to_owned();
    assert!(line.contains("poses.json: is in the way"), "{line}");
    fs::write(scene.path("mine/transforms.json"), "mine").unwrap();
    fs::remove_file(scene.path("mine/poses.json")).unwrap();
    let line = scene.gs(&["poses", "photos", "-o", "mine"]).refusal().to_owned();
    assert!(line.contains("transforms.json: has camera poses already"), "{line}");
    fs::write(scene.path("bin/colmap"), "#!/bin/sh\necho COLMAP 3.1 -- old\n").unwrap();
    let line = scene.gs(&["poses", "photos", "-o", "set"]).refusal().to_owned();
    assert!(line.contains("is COLMAP 3.1, but 3.7 or later is needed"), "{line}");
}

#[test]
fn photographs_without_poses_say_why() {
    let black = Scene::new(|_, _, _| [0.0; 3]);
    let same = Scene::new(|_, x, y| [((x * 7 + y * 13) % 17) as f32 / 16.0; 3]);
    let others = Scene::textured();
    for (scene, why) in
        [(black, "are dark"), (same, "all show the same view"), (others, "too few of the photographs match")]
    {
        fs::remove_dir_all(scene.path("bin/model")).unwrap();
        let run = scene.gs(&["poses", "photos", "-o", "set"]);
        let line = last_line(&run);
        assert!(line.starts_with("error: photos: no poses were found: ") && line.contains(why), "{run:?}");
        assert!(line.contains("set/poses.log") && scene.path("set/poses.log").is_file(), "{line}");
        assert_eq!(scene.calls().len(), 8, "a second attempt was made");
        assert!(fs::read_to_string(scene.path("set/poses.log")).unwrap().contains("peak_threshold 0.003"));
    }
}

#[test]
fn a_mapper_that_fails_is_not_one_that_finds_nothing() {
    let scene = Scene::textured();
    let nothing = "echo 'ERROR: failed to create sparse model' >&2; exit 1";
    scene.before("mapper", nothing);
    let run = scene.gs(&["poses", "photos", "-o", "set"]);
    assert!(last_line(&run).contains("no poses were found"), "{run:?}");
    scene.calls();
    for (said, shown) in [
        ("terminate called\n  what():  std::bad_alloc", "std::bad_alloc: out of memory"),
        ("ERROR: first\nERROR: unrecognised option", "ERROR: unrecognised option"),
        ("SQLite error [database.cc, line 1]: no database", "SQLite error [database.cc, line 1]: no database"),
    ] {
        scene.before("mapper", &format!("printf '%b\\n' '{said}' >&2; exit 1"));
        let run = scene.gs(&["poses", "photos", "-o", "set"]);
        let expected = format!("error: COLMAP ended with status 1 while finding the poses ({shown}): see ");
        let line = last_line(&run);
        assert!(run.status == Some(1) && line.starts_with(&expected) && line.contains("set/poses.log"), "{run:?}");
        assert_eq!(scene.calls().iter().filter(|call| *call == "mapper").count(), 1, "no second attempt");
    }
}

#[test]
fn a_training_finds_the_poses_of_photographs_once() {
    let scene = Scene::textured();
    let words =
        ["train", "photos", "-o", "out", "-i", "2", "-n", "20", "--start", "random", "--no-report", "--backend", "cpu"];
    let run = scene.gs(&words).done();
    assert!(run.stderr.contains("photos holds 5 photographs without camera poses: COLMAP finds them first"), "{run:?}");
    assert!(run.stderr.contains("training on 3 of 4 views of out/dataset"), "{run:?}");
    assert_eq!(scene.calls().len(), 4);
    scene.gs(&words).done();
    assert_eq!(scene.calls().len(), 0);
    // Photographs next to a model are no matter for COLMAP.
    let line = scene.gs(&["train", "out/dataset/images", "-o", "other"]).refusal().to_owned();
    assert!(line.contains("it is part of the data set"), "{line}");
    assert!(gs(["info", text(&scene.path("photos"))]).refusal().contains("gs poses "));
}

#[test]
fn a_training_refuses_poor_poses() {
    let scene = Scene::textured();
    scene.write_model(&NAMES[..2]);
    let run = scene.gs(&["train", "photos", "-o", "out", "--backend", "cpu"]);
    let expected =
        "error: photos: too few poses were found to train a scene: gs train out/dataset does so nevertheless";
    assert!(run.status == Some(1) && last_line(&run) == expected, "{run:?}");
    assert!(run.stderr.contains("poor: 2 of 5 photographs have poses"), "{run:?}");
    assert!(scene.path("out/dataset/sparse/0/cameras.bin").is_file());
}

#[test]
fn heic_photographs_are_converted_into_the_data_set() {
    let scene = Scene::textured();
    let convert = "[ $1 = -version ] && exit; echo convert >> \"${0%/*}/calls\"; grep -q broken \"$3\" && exit 1; cp \"$3\" \"$4\"";
    scene.program("heif-dec", &format!("#!/bin/sh\n{convert}"));
    fs::rename(scene.path("photos/m.png"), scene.path("photos/inner/m.HEIC")).unwrap();
    fs::copy(scene.path("photos/z.png"), scene.path("photos/y.heic")).unwrap();
    fs::write(scene.path("photos/z.heif"), "broken").unwrap();
    // An original of a photograph that was exported.
    fs::rename(scene.path("photos/z.png"), scene.path("photos/Z.JPG")).unwrap();
    fs::write(scene.path("photos/z.heic"), "broken").unwrap();
    fs::write(scene.path("photos/x.heic"), "broken").unwrap();
    fs::write(scene.path("photos/y.heif"), "broken").unwrap();
    fs::create_dir(scene.path("photos/masks")).unwrap();
    fs::copy(scene.path("photos/a b.png"), scene.path("photos/masks/y.heic.png")).unwrap();
    let run = scene.gs(&["poses", "photos", "-o", "set"]).done();
    assert!(run.stderr.contains("note: left out: photos/x.heic: heif-dec cannot convert it"), "{run:?}");
    assert_eq!(names_in(&scene.path("set/images")), ["Z.JPG", "a b.png", "inner", "y.jpg"]);
    assert_eq!(names_in(&scene.path("set/images/inner")), ["m.jpg", "é.png", "写真.png"]);
    assert!(scene.path("set/masks/y.jpg.png").is_file() && !scene.path("set/.gs-poses").exists());
    assert_eq!(names_in(&scene.path("photos/inner")), ["m.HEIC", "é.png", "写真.png"], "nothing is put beside them");
    assert_eq!(scene.calls().iter().filter(|call| *call == "convert").count(), 3);
    scene.gs(&["poses", "photos", "-o", "set", "--resume"]).done();
    assert_eq!(scene.calls(), ["convert"], "only what could not be converted");
    assert!(!scene.path("set/.gs-poses").exists());
    // Another photograph of the same name, older than the JPEG.
    fs::copy(scene.path("photos/a b.png"), scene.path("photos/y.heic")).unwrap();
    let file = fs::File::options().write(true).open(scene.path("photos/y.heic")).unwrap();
    file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000)).unwrap();
    for resume in [&["--resume"][..], &[]] {
        scene.gs(&[&["poses", "photos", "-o", "set"], resume].concat()).done();
        assert_eq!(fs::read(scene.path("set/images/y.jpg")).unwrap(), fs::read(scene.path("photos/y.heic")).unwrap());
        // With --resume, that one and the broken one; without it, all.
        let converted = scene.calls().iter().filter(|call| *call == "convert").count();
        assert_eq!(converted, if resume.is_empty() { 3 } else { 2 });
    }
    fs::remove_file(scene.path("bin/heif-dec")).unwrap();
    let run = Run::of(scene.command(&["poses", "photos", "-o", "other"]).env("PATH", scene.path("bin")));
    let line = run.refusal();
    assert!(
        ["apt install libheif-examples", "brew install", "winget"].iter().all(|part| line.contains(part)),
        "{line}"
    );
}

#[test]
fn too_few_heic_photographs_say_why() {
    let scene = Scene::textured();
    scene.program("heif-dec", "#!/bin/sh\n[ $1 = -version ] && exit\necho 'no such codec' >&2; exit 1\n");
    fs::create_dir(scene.path("few")).unwrap();
    fs::write(scene.path("few/a.heic"), "").unwrap();
    let line = scene.gs(&["poses", "few", "-o", "set"]).refusal().to_owned();
    assert!(line.contains("few: holds 1 photograph, but poses need"), "{line}");
    fs::write(scene.path("few/b.HEIC"), "").unwrap();
    let run = scene.gs(&["poses", "few", "-o", "set"]);
    let why = "few: holds no photograph (few/a.heic: heif-dec cannot convert it (no such codec)), but poses need";
    assert!(run.status == Some(1) && last_line(&run).contains(why), "{run:?}");
}
