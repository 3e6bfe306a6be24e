//! `gs fit` from end to end: what it writes, what it says, and how it goes on.

use std::{fs, path::Path};
#[cfg(unix)]
use std::{
    io::{BufRead, BufReader, Lines},
    process::{Child, ChildStderr, Stdio},
};

use serde_json::Value;

#[cfg(unix)]
use crate::process::signal;
use crate::process::{Run, command, folder, gs, names_in, picture};

/// Result files of a fit by default.
const RESULTS: [&str; 7] = [
    "curve.svg",
    "ellipses.png",
    "metrics.csv",
    "reconstruction.png",
    "scene.gs2d.safetensors",
    "settings.toml",
    "summary.json",
];

/// The arguments of a small fit of `image` into `output`, on the processor even where there is a
/// GPU.
fn small<'a>(image: &'a Path, output: &'a Path) -> Vec<&'a str> {
    let (image, output) = (image.to_str().unwrap(), output.to_str().unwrap());
    vec!["fit", image, "-o", output, "-n", "60", "--iterations", "20", "--seed", "7", "--backend", "cpu"]
}

#[test]
fn an_image_becomes_results_and_a_summary() {
    let place = folder();
    let image = picture(place.path(), 32, 24);
    let output = place.path().join("made/on/demand");
    let run = gs(small(&image, &output).into_iter().chain(["--json", "--threads", "1"]));
    assert!(run.stderr.starts_with("cpu ("), "the first line names the backend: {}", run.stderr);
    let summary = run.json();
    for (key, expected) in
        [("width", 32), ("height", 24), ("gaussians", 60), ("iterations", 20), ("threads", 1), ("seed", 7)]
    {
        assert_eq!(summary[key], expected, "{key} of {summary}");
    }
    assert_eq!((&summary["backend"], &summary["adapter"]), (&"cpu".into(), &Value::Null));
    assert!(summary["simd"].is_string(), "{summary}");
    for key in ["seconds", "total_seconds", "l1", "psnr", "ssim"] {
        assert!(summary[key].as_f64().is_some_and(|value| value > 0.0), "{key} of {summary}");
    }
    assert_eq!(summary["ms_ssim"], Value::Null, "too small for it");
    assert!(summary["psnr"].as_f64().unwrap() > 20.0, "{summary}");

    assert_eq!(names_in(&output), RESULTS);
    let stored: Value = serde_json::from_slice(&fs::read(output.join("summary.json")).unwrap()).unwrap();
    assert_eq!(stored, summary);
    let metrics = fs::read_to_string(output.join("metrics.csv")).unwrap();
    let mut rows = metrics.lines();
    assert_eq!(
        rows.next().unwrap(),
        "step,seconds,count,cloned,split,seeded,pruned_transparent,pruned_too_large,pruned_not_finite,\
         pruned_unimportant,loss,l1,psnr,culled_not_finite,culled_near,culled_degenerate,culled_transparent,culled_outside,\
         clamped_smallest,clamped_largest,began_again_at_loss,\
         first_loss"
    );
    assert!(rows.next_back().unwrap().starts_with("20,"), "{metrics}");
    assert_eq!(gs_io::read_image(output.join("reconstruction.png")).unwrap().image.size(), (32, 24));
    assert_eq!(gs_io::read_image(output.join("ellipses.png")).unwrap().image.size(), (256, 192));
}

#[test]
fn the_paper_needs_no_file() {
    let place = folder();
    let arguments = ["fit", "-o", place.path().to_str().unwrap(), "--iterations", "30", "--json"];
    gs(arguments).done();
    let mut expected = RESULTS.to_vec();
    assert_eq!(names_in(place.path()), expected);
    // The pictures of the earlier fit go.
    let summary = gs(arguments.iter().chain(&["--no-report"])).json();
    assert_eq!((&summary["width"], &summary["height"]), (&128.into(), &128.into()));
    assert_eq!(summary["settings"]["loss"], serde_json::json!({ "l1-dssim": { "lambda": 0.2 } }));
    let pictures = ["curve.svg", "ellipses.png"];
    expected.retain(|name| !pictures.contains(name));
    assert_eq!(names_in(place.path()), expected);
}

#[test]
fn a_single_pixel_is_an_image() {
    let place = folder();
    let image = picture(place.path(), 1, 1);
    let output = place.path().join("out");
    let run = gs(["fit", image.to_str().unwrap(), "-o", output.to_str().unwrap(), "--iterations", "20", "--json"]);
    let summary = run.json();
    assert_eq!((&summary["width"], &summary["gaussians"]), (&1.into(), &1.into()));
    assert_eq!(names_in(&output), RESULTS);
}

#[test]
fn equal_settings_give_equal_bytes_whatever_the_threads() {
    let place = folder();
    let image = picture(place.path(), 32, 32);
    let (first, again) = (place.path().join("first"), place.path().join("again"));
    gs(small(&image, &first).into_iter().chain(["--threads", "1"])).done();
    let settings = first.join("settings.toml");
    let arguments =
        ["fit", image.to_str().unwrap(), "-o", again.to_str().unwrap(), "--backend", "cpu", "--threads", "3"];
    gs(arguments.into_iter().chain(["--settings", settings.to_str().unwrap()])).done();
    for name in ["scene.gs2d.safetensors", "reconstruction.png", "settings.toml"] {
        assert!(fs::read(first.join(name)).unwrap() == fs::read(again.join(name)).unwrap(), "{name} differs");
    }
    let other = place.path().join("other");
    gs(small(&image, &other).into_iter().chain(["--loss", "l1"])).done();
    let scene = |folder: &Path| fs::read(folder.join("scene.gs2d.safetensors")).unwrap();
    assert!(scene(&first) != scene(&other), "another loss gives another scene");
}

#[test]
fn a_resumed_fit_ends_as_if_it_had_never_stopped() {
    let place = folder();
    let image = picture(place.path(), 32, 32);
    let (whole, resumed) = (place.path().join("whole"), place.path().join("resumed"));
    let checkpoint = place.path().join("state");
    let flags = ["--checkpoint", checkpoint.to_str().unwrap(), "--checkpoint-every", "8"];
    gs(small(&image, &whole).into_iter().chain(flags)).done();
    let info = gs(["info", checkpoint.to_str().unwrap(), "--json"]).json();
    assert_eq!((&info["kind"], &info["metadata"]["step"]), (&"checkpoint of a 2D fit".into(), &"16".into()));

    // The second run continues the table of the first, which the checkpoint holds, whatever another
    // fit has left in the folder.
    fs::create_dir(&resumed).unwrap();
    let foreign = fs::read_to_string(whole.join("metrics.csv")).unwrap().replace(",60,", ",59,");
    fs::write(resumed.join("metrics.csv"), foreign).unwrap();
    let arguments = ["fit", image.to_str().unwrap(), "-o", resumed.to_str().unwrap(), "--backend", "cpu"];
    gs(arguments.into_iter().chain(["--resume", checkpoint.to_str().unwrap(), "--overwrite"])).done();
    for name in ["scene.gs2d.safetensors", "reconstruction.png", "settings.toml"] {
        assert!(fs::read(whole.join(name)).unwrap() == fs::read(resumed.join(name)).unwrap(), "{name} differs");
    }
    // All but the times.
    let rows = |folder: &Path| {
        let text = fs::read_to_string(folder.join("metrics.csv")).unwrap();
        let rows = text
            .lines()
            .map(|row| row.split(',').enumerate().filter(|(k, _)| *k != 1).map(|(_, v)| v.to_owned()).collect());
        rows.collect::<Vec<Vec<String>>>()
    };
    assert_eq!(rows(&whole), rows(&resumed));

    let other = picture(place.path(), 32, 31);
    let output = place.path().join("nothing");
    let wrong =
        gs(["fit", other.to_str().unwrap(), "-o", output.to_str().unwrap(), "--resume", checkpoint.to_str().unwrap()]);
    assert!(wrong.refusal().contains("32x31"), "{wrong:?}");
    assert!(!output.exists());
}

/// A pipe can be read once only.
#[cfg(unix)]
#[test]
fn settings_may_come_through_a_pipe() {
    let place = folder();
    let image = picture(place.path(), 32, 24);
    let output = place.path().join("out");
    let fit = ["fit", image.to_str().unwrap(), "-o", output.to_str().unwrap(), "--settings", "/dev/stdin", "--json"];
    let own = Run::fed(&fit, "gaussians = 25\niterations = 12\n").json();
    assert_eq!((&own["settings"]["gaussians"], &own["iterations"]), (&25.into(), &12.into()));
}

#[test]
fn a_transparent_image_is_resumed_and_repeated_on_its_background() {
    let place = folder();
    let image = place.path().join("transparent.pam");
    let pixels: Vec<u8> = (0..=255).flat_map(|k: u8| [200, 100, k, k]).collect();
    let heading = b"P7\nWIDTH 16\nHEIGHT 16\nDEPTH 4\nMAXVAL 255\nTUPLTYPE RGB_ALPHA\nENDHDR\n";
    fs::write(&image, [&heading[..], &pixels].concat()).unwrap();
    let path = |name: &str| place.path().join(name).to_str().unwrap().to_owned();
    let (whole, resumed, repeated, white) = (path("whole"), path("resumed"), path("repeated"), path("white"));
    let (state, settings) = (path("state"), path("whole/settings.toml"));
    let red = ["--background", "1,0,0"];
    let stored = ["--checkpoint", &state, "--checkpoint-every", "8"];
    gs(small(&image, whole.as_ref()).into_iter().chain(red).chain(stored)).done();

    let fit = |output| ["fit", image.to_str().unwrap(), "-o", output, "--backend", "cpu"];
    gs(fit(&resumed).into_iter().chain(red).chain(["--resume", &state])).done();
    gs(fit(&repeated).into_iter().chain(["--settings", &settings])).done();
    let scene = |folder: &str| fs::read(Path::new(folder).join("scene.gs2d.safetensors")).unwrap();
    assert!(scene(&whole) == scene(&resumed) && scene(&whole) == scene(&repeated));
    let wrong = gs(fit(&white).into_iter().chain(["--resume", &state]));
    assert!(wrong.refusal().ends_with("give the same image and --background"), "{wrong:?}");

    // Front to back, the colour behind all Gaussians is the one that transparent pixels are put on:
    // white, where nothing is said.
    let (over, again, settings) = (path("over"), path("again"), path("over/settings.toml"));
    gs(small(&image, over.as_ref()).into_iter().chain(["--blend", "over"])).done();
    assert!(fs::read_to_string(&settings).unwrap().contains("background = [1.0, 1.0, 1.0]"));
    let repeated = gs(fit(&again).into_iter().chain(["--settings", &settings])).done();
    assert!(repeated.stderr.contains("as they look on white "), "{repeated:?}");
    assert!(scene(&over) == scene(&again));
}

#[test]
fn a_fit_that_ends_with_no_gaussian_leaves_all_its_results() {
    let place = folder();
    let (first, empty) = (place.path().join("first"), place.path().join("empty"));
    let flags = ["--blend", "over", "--policy", "absolute", "--iterations", "400", "-n", "50"];
    gs(["fit", "-o", first.to_str().unwrap()].into_iter().chain(flags)).done();
    let text = fs::read_to_string(first.join("settings.toml")).unwrap();
    let prune = "[policy.actions.prune]\nopacity = 0.005";
    assert!(text.contains(prune), "{text}");
    let settings = place.path().join("prune-all.toml");
    fs::write(&settings, text.replace(prune, "[policy.actions.prune]\nopacity = 0.99")).unwrap();

    fs::create_dir(&empty).unwrap();
    fs::write(empty.join("scene.ply"), "of a training, so it must go").unwrap();
    let words = ["fit", "-o", empty.to_str().unwrap(), "--settings", settings.to_str().unwrap(), "--json"];
    let run = gs(words.into_iter().chain(["--overwrite"]));
    assert_eq!(run.json()["gaussians"], 0);
    assert_eq!(names_in(&empty), RESULTS);
}

#[test]
fn each_round_of_density_control_is_printed_with_verbose() {
    let place = folder();
    let image = picture(place.path(), 32, 32);
    let rounds = |flags: &[&str]| {
        let run = gs(small(&image, &place.path().join("out")).into_iter().chain(flags.iter().copied())).done();
        run.stderr.lines().filter(|line| line.contains(" seeded") && line.ends_with(" Gaussians")).count()
    };
    let silent = rounds(&[]);
    let printed = rounds(&["--verbose"]);
    let table = fs::read_to_string(place.path().join("out/metrics.csv")).unwrap();
    let seeding = table.lines().skip(1).filter(|row| row.split(',').nth(5).is_some_and(|seeded| seeded != "0"));
    assert_eq!((silent, printed), (0, seeding.count()));
    assert!(printed > 0);
}

#[test]
fn every_override_fits() {
    let place = folder();
    let image = picture(place.path(), 24, 24);
    let cases: [&[&str]; 12] = [
        &["--policy", "absolute"],
        &["--policy", "percentile"],
        &["--policy", "percentile", "--blend", "over"],
        &["--policy", "paper"],
        &["--policy", "residual", "--preset", "paper"],
        &["--policy", "none"],
        &["--init", "random", "--blend", "over", "--background", "0,0,0"],
        &["--init", "periphery", "--parameterization", "scale-rotation"],
        &["--init", "random", "--loss", "l1-dssim"],
        &["--init", "periphery", "--preset", "best"],
        &["--simd", "baseline", "--preset", "quick"],
        &["--iterations", "0"],
    ];
    for flags in cases {
        let output = place.path().join("out");
        let output = output.to_str().unwrap();
        let mut arguments = vec!["fit", image.to_str().unwrap(), "-o", output, "-n", "40", "--no-report", "--json"];
        if !flags.contains(&"--iterations") {
            arguments.extend(["--iterations", "12"]);
        }
        let summary = gs(arguments.iter().chain(flags)).json();
        let count = summary["gaussians"].as_u64().unwrap();
        assert!((1..=40).contains(&count), "{flags:?}: {summary}");
        assert!(summary["psnr"].as_f64().is_some_and(|psnr| psnr > 5.0), "{flags:?}: {summary}");
    }
}

/// A fit under way into `out` that would not end by itself.
#[cfg(unix)]
pub(crate) struct Endless {
    fit: Child,
    lines: Lines<BufReader<ChildStderr>>,
}

#[cfg(unix)]
impl Endless {
    pub(crate) fn start(place: &Path, flags: &[&str]) -> Self {
        let image = picture(place, 24, 24);
        let output = place.join("out");
        let arguments = ["fit", image.to_str().unwrap(), "-o", output.to_str().unwrap(), "-n", "30", "-i", "4000000"];
        let mut fit = command();
        fit.args(arguments).args(flags).env("TMPDIR", place).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut fit = fit.spawn().unwrap();
        let mut lines = BufReader::new(fit.stderr.take().unwrap()).lines();
        assert!(lines.any(|line| line.unwrap().starts_with("fitting ")));
        std::thread::sleep(std::time::Duration::from_millis(300)); // the handler is set right after that line
        Self { fit, lines }
    }

    /// Signals it so often, lets it come to its end, and returns its status and its lines.
    pub(crate) fn end(mut self, kind: &str, times: usize) -> (Option<i32>, Vec<String>) {
        signal(&self.fit, kind, times);
        let said = self.lines.map(Result::unwrap).collect();
        (self.fit.wait().unwrap().code(), said)
    }
}

/// Interrupts a fit that runs.
#[cfg(unix)]
fn interrupted(place: &Path, flags: &[&str]) -> (Option<i32>, Vec<String>) {
    Endless::start(place, flags).end("-INT", 1)
}

/// Signals as `timeout` sends them: to its child, and then to its whole group.
#[cfg(unix)]
#[test]
fn two_signals_in_quick_succession_are_one_request() {
    let place = folder();
    let (status, said) = Endless::start(place.path(), &[]).end("-TERM", 2);
    assert_eq!(status, Some(130), "{said:?}");
    let output = place.path().join("out");
    gs_io::read_2d(output.join("scene.gs2d.safetensors")).unwrap();
    gs_io::read_checkpoint(output.join("checkpoint.safetensors")).unwrap();
}

#[cfg(unix)]
#[test]
fn ctrl_c_saves_a_checkpoint_and_what_there_is() {
    let place = folder();
    let (status, said) = interrupted(place.path(), &[]);
    assert_eq!(status, Some(130), "{said:?}");

    let output = place.path().join("out");
    let checkpoint = output.join("checkpoint.safetensors");
    let way_on = format!("--resume {}", checkpoint.display());
    assert!(said.last().unwrap().contains(&way_on), "{said:?}");
    let info = gs(["info", checkpoint.to_str().unwrap(), "--json"]).json();
    assert!(info["metadata"]["step"].as_str().unwrap().parse::<u32>().unwrap() > 0, "{info}");
    let names = names_in(&output);
    assert!(RESULTS.iter().all(|name| names.contains(&(*name).to_owned())), "{names:?}");
}

/// A file name that no system accepts: as with a full disk, the first checkpoint is the first to
/// fail.
fn file_of_a_too_long_name(place: &Path) -> String {
    place.join("long".repeat(100)).to_str().unwrap().to_owned()
}

#[test]
fn a_checkpoint_that_cannot_be_stored_does_not_take_the_fit_with_it() {
    let place = folder();
    let (image, output) = (picture(place.path(), 32, 24), place.path().join("out"));
    let file = file_of_a_too_long_name(place.path());
    let flags = ["--checkpoint", &file, "--checkpoint-every", "1"];
    let run = gs(small(&image, &output).into_iter().chain(flags));
    assert_eq!(run.status, Some(1), "{run:?}");
    assert_eq!(run.stderr.matches("note: no checkpoint was stored: ").count(), 1, "{run:?}");
    let line = run.stderr.lines().last().unwrap();
    assert!(line.starts_with("error: ") && line.contains(&file) && line.contains("all results are written"), "{line}");
    assert_eq!(names_in(&output), RESULTS);
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_results_even_without_a_checkpoint() {
    let place = folder();
    let file = file_of_a_too_long_name(place.path());
    let (status, said) = interrupted(place.path(), &["--checkpoint", &file]);
    assert_eq!(status, Some(1), "{said:?}");
    let line = said.last().unwrap();
    assert!(line.contains("with results, but without this checkpoint") && line.ends_with("go on from"), "{line}");
    assert_eq!(names_in(&place.path().join("out")), RESULTS);
}

/// The folders are put in the way of results after the fit has begun: in the way of its beginning,
/// they would stop it there.
#[cfg(unix)]
#[test]
fn results_that_cannot_be_written_do_not_take_the_others_with_them() {
    let place = folder();
    let output = place.path().join("out");
    let fit = Endless::start(place.path(), &[]);
    ["reconstruction.png", "settings.toml"].iter().for_each(|name| fs::create_dir(output.join(name)).unwrap());
    let (status, said) = fit.end("-INT", 1);
    assert_eq!(status, Some(1), "{said:?}");
    let line = said.last().unwrap();
    assert!(line.contains("reconstruction.png") && line.ends_with("1 more of the results failed, too"), "{line}");
    gs_io::read_2d(output.join("scene.gs2d.safetensors")).unwrap();
    for name in ["curve.svg", "ellipses.png", "metrics.csv", "summary.json"] {
        assert!(output.join(name).is_file(), "{name}");
    }
    let image = picture(place.path(), 24, 24);
    assert!(gs(small(&image, &output)).refusal().contains("reconstruction.png: is a folder, but must be a file"));
    ["reconstruction.png", "settings.toml"].iter().for_each(|name| fs::remove_dir(output.join(name)).unwrap());

    // The scene itself is saved wherever there is room.
    let fit = Endless::start(place.path(), &[]);
    fs::remove_file(output.join("scene.gs2d.safetensors")).unwrap();
    fs::create_dir(output.join("scene.gs2d.safetensors")).unwrap();
    let (_, said) = fit.end("-INT", 1);
    let (_, saved) = said.last().unwrap().split_once("it has been saved as ").unwrap_or_else(|| panic!("{said:?}"));
    let saved = Path::new(saved.split_once(" instead").unwrap().0);
    assert!(saved.starts_with(place.path()) && !gs_io::read_2d(saved).unwrap().scene.means.is_empty());
}

#[test]
fn a_fit_that_diverges_says_where_and_leaves_its_table() {
    let place = folder();
    let (image, output) = (picture(place.path(), 32, 24), place.path().join("out"));
    let settings = place.path().join("wild.toml");
    fs::write(&settings, "gaussians = 40\niterations = 500\nrebin-every = 1\n[adam.color]\nlearning-rate = 1e38\n")
        .unwrap();
    let state = place.path().join("state");
    let words =
        ["fit", image.to_str().unwrap(), "-o", output.to_str().unwrap(), "--settings", settings.to_str().unwrap()];
    let checkpoints = ["--checkpoint", state.to_str().unwrap(), "--checkpoint-every", "1", "--backend", "cpu"];
    let run = gs(words.into_iter().chain(checkpoints));
    assert_eq!(run.status, Some(1), "{run:?}");
    let line = run.stderr.lines().last().unwrap();
    for part in [
        "error: the training diverged: the loss is ",
        " at step ",
        "Gaussian ",
        "colour [",
        "the last good checkpoint is ",
    ] {
        assert!(line.contains(part), "{part}: {line}");
    }
    gs_io::read_checkpoint(&state).unwrap();
    assert_eq!(names_in(&output), ["metrics.part.csv"]);
    assert!(fs::read_to_string(output.join("metrics.part.csv")).unwrap().lines().nth(1).unwrap().starts_with("1,"));

    // An earlier fit's results stay whole beside it, until there are others.
    gs(small(&image, &output)).done();
    assert_eq!(names_in(&output), RESULTS);
    let table = fs::read(output.join("metrics.csv")).unwrap();
    assert_eq!(gs(words.into_iter().chain(["--backend", "cpu"])).status, Some(1));
    assert!(fs::read(output.join("metrics.csv")).unwrap() == table && output.join("metrics.part.csv").exists());
}

#[test]
fn lost_gaussians_are_reported_during_the_fit_and_at_its_end() {
    let place = folder();
    let (image, output) = (picture(place.path(), 32, 24), place.path().join("out"));
    let settings = place.path().join("wild.toml");
    // In the covariance factor no step is so long. A fit that went back to its first Gaussians
    // would have lost none of them.
    let wild = "gaussians = 20\niterations = 30\nrecovery = \"never\"\nparameterization = \"scale-rotation\"\n[adam.mean]\nlearning-rate = 2e38\n";
    fs::write(&settings, wild).unwrap();
    let words =
        ["fit", image.to_str().unwrap(), "-o", output.to_str().unwrap(), "--settings", settings.to_str().unwrap()];
    let run = gs(words.into_iter().chain(["--backend", "cpu"])).done();
    let printed = run.stderr.lines().filter(|line| line.contains(" removed as not finite")).count();
    assert!(printed >= 2, "the last line of progress and the summary: {run:?}");
    let summary: Value = serde_json::from_slice(&fs::read(output.join("summary.json")).unwrap()).unwrap();
    let removed = summary["edits"]["pruned_not_finite"].as_u64().unwrap();
    let metrics = fs::read_to_string(output.join("metrics.csv")).unwrap();
    let column = metrics.lines().next().unwrap().split(',').position(|name| name == "pruned_not_finite").unwrap();
    let rows = metrics.lines().skip(1).map(|row| row.split(',').nth(column).unwrap().parse::<u64>().unwrap());
    assert!(removed > 0 && rows.sum::<u64>() == removed, "{metrics}");
}

#[test]
fn details_are_printed_with_verbose_only() {
    let place = folder();
    let (image, output) = (picture(place.path(), 32, 24), place.path().join("out"));
    let always = ["fit", image.to_str().unwrap(), "-o", output.to_str().unwrap(), "--backend", "cpu", "--no-report"];
    let fit = |flags: &[&str]| gs(always.iter().chain(flags)).done().stderr;
    let brief = fit(&["-n", "1", "-i", "1"]);
    assert!(brief.contains(" with at most 1 Gaussian in 1 step, into "), "{brief}");
    assert!(brief.contains("1 Gaussian after 1 step in "), "{brief}");
    assert!(!brief.contains("effects") && !brief.contains("size allowed"), "{brief}");
    let verbose = fit(&["-n", "60", "-i", "60", "--verbose"]);
    assert!(verbose.contains("effects: none; the Gaussians at a pixel are added up, in no order"), "{verbose}");
    assert!(verbose.contains("PSNR ~"), "an estimate is marked as one: {verbose}");
}
