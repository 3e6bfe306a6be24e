//! Folders that a study may not use, and files in them that it may not replace.

use std::fs;

use crate::{Existing, Plan, StudyFolder, run::Preparation, study::VERSION};

use super::{laid_out, place, study};

#[test]
fn a_folder_is_for_one_study() {
    let place = place();
    let output = place.path().join("out");
    let plan = laid_out(study(), place.path());
    let folder = StudyFolder::prepare(&output, &plan, Existing::Refuse).unwrap();
    let before = fs::read_to_string(output.join("study.toml")).unwrap();
    let other = laid_out(study().with(|s| s.name = "other".to_owned()), place.path());
    let taken = StudyFolder::prepare(&output, &other, Existing::Resume).unwrap_err().to_string();
    assert!(taken.contains("holds another study than `other`: `small`: choose another folder"), "{taken}");
    assert_eq!(fs::read_to_string(output.join("study.toml")).unwrap(), before);
    // Another process may resume it while this one has it.
    StudyFolder::prepare(&output, &plan, Existing::Resume).unwrap().check(&plan).unwrap();
    drop(folder);
}

#[test]
fn a_folder_prepared_for_something_else_is_refused() {
    let place = place();
    let output = place.path().join("out");
    let plan = laid_out(study(), place.path());
    let folder = StudyFolder::prepare(&output, &plan, Existing::Refuse).unwrap();
    let refused = |plan: &Plan| folder.check(plan).unwrap_err().to_string();
    let elsewhere = Plan { machine: "cpu avx2".into(), ..plan.clone() };
    assert!(
        refused(&elsewhere).contains("is a study on test, but this is cpu avx2: a study has one "),
        "{elsewhere:?}"
    );
    let grey = gs_core::Image::filled(48, 40, [0.5; 3]).unwrap();
    gs_io::write_png(place.path().join("stripes.png"), &grey).unwrap();
    let line = refused(&laid_out(study(), place.path()));
    assert!(
        line.contains("image stripes.png (") && line.contains(") is not the one that the study began with"),
        "{line}"
    );
    let file = output.join("machine.json");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text.replace(VERSION, "0.0.9")).unwrap();
    let line = refused(&plan);
    assert!(
        line.contains("is a study by version 0.0.9 of gs, but this is 0.") && line.contains("use that version"),
        "{line}"
    );
    fs::write(&file, &text[..20]).unwrap();
    assert!(refused(&plan).contains("machine.json is missing or damaged"));
}

#[test]
fn a_study_replaces_no_file_that_is_not_a_studys() {
    let place = place();
    let output = place.path().join("out");
    let plan = laid_out(study(), place.path());
    fs::create_dir(&output).unwrap();
    fs::write(output.join("report.html"), "mine").unwrap();
    let prepare = |existing: Existing, overwrite| {
        StudyFolder::prepare(&output, &plan, Preparation { overwrite, ..existing.into() })
    };
    let refused = prepare(Existing::Refuse, false).unwrap_err().to_string();
    assert!(refused.contains("report.html: is in the way"), "{refused}");
    assert_eq!(fs::read_dir(&output).unwrap().count(), 1, "nothing is begun");
    drop(prepare(Existing::Refuse, true).unwrap());
    // The refused run did not write the report, so it is still the user's.
    prepare(Existing::Resume, false).unwrap_err();
    fs::remove_file(output.join("report.html")).unwrap();
    drop(prepare(Existing::Resume, false).unwrap());

    // A study that is resumed from the file in its own folder does not change that file.
    let own = output.join("study.toml");
    let text = format!("# mine\n{}", fs::read_to_string(&own).unwrap());
    fs::write(&own, &text).unwrap();
    let how = Preparation { inputs: vec![own.clone()], ..Existing::Resume.into() };
    StudyFolder::prepare(&output, &plan, how).unwrap();
    assert_eq!(fs::read_to_string(&own).unwrap(), text);
}
