//! `gs popping`: what it prints and writes, and what it refuses.

use gs_io::{WriteOptions3d, write_3d};
use gs_lab::price::popping::discs;

use crate::process::{folder, gs, names_in};

#[test]
fn both_orders_stand_side_by_side() {
    let place = folder();
    let (scene, output) = (place.path().join("discs.ply"), place.path().join("out"));
    write_3d(&scene, &discs(), &WriteOptions3d::default()).unwrap();
    let (scene, out) = (scene.to_str().unwrap(), output.to_str().unwrap());
    let flags = ["--size", "48x40", "--places", "2", "--step", "1", "--frames", "9", "--backend", "cpu"];
    let run = gs(["popping", scene, "-o", out].into_iter().chain(flags)).done();
    let lines: Vec<&str> = run.stdout.lines().collect();
    assert!(lines[0].contains("discs, 2 Gaussians") && lines.len() == 8, "{}", run.stdout);
    assert!(lines[2].contains("0.250") && lines[2].contains("global") && lines[3].contains("per-pixel"));
    assert_eq!(
        names_in(&output),
        ["flicker-chart.csv", "flicker-chart.png", "flicker-chart.svg", "popping.csv", "popping.png"]
    );
    let csv = std::fs::read_to_string(output.join("popping.csv")).unwrap();
    assert!(csv.starts_with("\"step, °\",order,") && csv.lines().count() == 7, "{csv}");
    // Three columns and two rows of the whole picture, which is smaller than the part that would be
    // shown.
    assert_eq!(gs_io::read_image(output.join("popping.png")).unwrap().image.size(), (3 * 384 + 16, 2 * 320 + 8));
}

#[test]
fn what_is_not_possible_is_refused_in_one_line() {
    let place = folder();
    let scene = place.path().join("discs.ply");
    write_3d(&scene, &discs(), &WriteOptions3d::default()).unwrap();
    let scene = scene.to_str().unwrap();
    for (flags, part) in [
        (["--order", "global"], "both orders are compared"),
        (["--step", "0"], "above 0"),
        (["--step", "NaN"], "above 0"),
        (["--frames", "3"], "--frames"),
        (["--size", "99999x9"], "--size"),
        (["--size", "16384x16384"], "pixels of a frame"),
    ] {
        let run = gs(["popping", scene].into_iter().chain(flags));
        assert_eq!(run.status, Some(2), "{flags:?}: {}", run.stderr);
        assert!(run.refusal().contains(part), "{flags:?}: {}", run.stderr);
    }
    assert_eq!(gs(["popping", place.path().join("none.ply").to_str().unwrap()]).status, Some(1));
}
