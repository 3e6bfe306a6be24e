//! `gs paper`: what it writes, and what it refuses.

use std::fs;

use crate::process::{folder, gs, names_in};

#[test]
fn an_experiment_becomes_a_page_and_tables() {
    let place = folder();
    let output = place.path().join("made/on/demand");
    let words = ["paper", "--quick", "--only", "edges", "--backend", "cpu", "-o", output.to_str().unwrap()];
    let run = gs(words).done();
    assert_eq!(run.stdout, "");
    // With two seeds, rounding may change the result of one: one or both of these claims are
    // confirmed.
    let printed = ["edges: 2 claims: 2 confirmed", "edges: 2 claims: 1 confirmed, 1 partly"];
    assert!(printed.iter().any(|line| run.stderr.contains(line)), "{}", run.stderr);
    assert_eq!(names_in(&output), ["claims.csv", "edges", "index.html"]);
    let of_study = names_in(&output.join("edges"));
    for name in ["claims.csv", "quality.csv", "report.html", "plots", "study.toml"] {
        assert!(of_study.iter().any(|of_study| of_study == name), "{name} in {of_study:?}");
    }
    let page = fs::read_to_string(output.join("index.html")).unwrap();
    for part in ["gs paper --quick --only edges", "The paper says", "confirmed", "edges/report.html"] {
        assert!(page.contains(part), "{part}");
    }
    let claims = fs::read_to_string(output.join("claims.csv")).unwrap();
    let rows: Vec<&str> = claims.lines().collect();
    assert_eq!(rows[0], "experiment,claim,section,verdict,number,value,unit");
    assert!(
        rows.len() > 8 && rows[1].starts_with("edges,edges-are-dense-and-stretched,\"§3.3, Fig. 7\",confirmed,"),
        "{claims}"
    );
    assert_eq!(fs::read_to_string(output.join("edges/claims.csv")).unwrap(), claims);
    // The same command finds its runs done.
    let again = gs(words).done();
    assert!(!again.stderr.contains("running"), "{}", again.stderr);
    assert_eq!(fs::read_to_string(output.join("claims.csv")).unwrap(), claims);
}

#[test]
fn unknown_experiments_and_unwritable_outputs_are_refused() {
    let unknown = gs(["paper", "--only", "warm-start"]);
    assert_eq!(unknown.status, Some(2));
    let line = unknown.refusal();
    for name in ["warm-start", "set-up", "cold-start", "lazy-convergence", "instability", "edges", "gs paper --help"] {
        assert!(line.contains(name), "{name} in {line}");
    }
    let place = folder();
    let file = place.path().join("file");
    fs::write(&file, "in the way").unwrap();
    let blocked = gs(["paper", "--quick", "--backend", "cpu", "-o", file.to_str().unwrap()]);
    assert_eq!(blocked.status, Some(1));
    assert!(blocked.refusal().contains("cannot be written to"), "{blocked:?}");
    let help = gs(["paper", "--help"]).done().stdout;
    assert!(help.contains("--quick") && !help.contains("seconds"), "no machine's time is promised: {help}");
}
