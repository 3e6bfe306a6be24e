//! Differences between arms, and the report.

use std::fs;

use crate::{
    Results,
    result::{Metric, ResultRemark, Verdict},
    study::{Matching, VERSION},
};

use super::{conducted, laid_out, place, study};

#[test]
fn equal_arms_show_no_difference_and_different_counts_are_not_compared() {
    let place = place();
    // Six images are the fewest for an interval.
    for i in 0..6 {
        let waves =
            |x: u32, y: u32| [0.0, 1.0, 2.0].map(|c| 0.5 + 0.4 * ((x + 2 * y) as f32 / (3 + i) as f32 + c).sin());
        let name = format!("{i}.png");
        gs_io::write_png(place.path().join(name), &gs_core::Image::from_fn(24, 20, waves).unwrap()).unwrap();
    }
    let mut twins = study().with(|s| s.images = (0..6).map(|i| format!("{i}.png")).collect());
    twins.arms.push(twins.arms[0].clone().with(|arm| arm.name = "none-again".to_owned()));
    let plan = laid_out(twins, place.path());
    let folder = conducted(&plan, &place.path().join("out"), 1, 1);
    let results = Results::read(&plan, &folder).unwrap();
    let twins = results.difference(Matching::Count, Metric::Psnr, 60, 2, 0);
    assert_eq!((twins.mean, twins.verdict), (Some(0.0), Verdict::CannotTell));
    assert_eq!(twins.remarks, [ResultRemark::FewSeeds { seeds: 2 }]);
    let grown = results.difference(Matching::Count, Metric::Psnr, 60, 1, 0);
    assert_eq!(grown.verdict, Verdict::None);
    assert!(grown.remarks.iter().any(|remark| remark.to_string().starts_with("counts differ (")), "{grown:?}");
    let after_steps = results.difference(Matching::Iterations, Metric::Psnr, 60, 1, 0);
    assert_eq!((after_steps.pairs, after_steps.verdict), (6, Verdict::Better), "{after_steps:?}");
    let differences = fs::read_to_string(folder.file("differences.csv")).unwrap();
    assert_eq!(
        differences.lines().count(),
        1 + 2 * 3 * (2 + 1),
        "2 budgets, 3 pairs; PSNR and SSIM at equal count, PSNR"
    );
}

#[test]
fn the_report_is_one_page_with_all_its_pictures() {
    let place = place();
    let plan = laid_out(study(), place.path());
    let folder = conducted(&plan, &place.path().join("out"), 1, 2);
    let page = fs::read_to_string(folder.file("report.html")).unwrap();
    for expected in [
        VERSION,
        "Only 2 seeds: use 5 or more.",
        "2 images are too few (an interval needs 6)",
        "tr class=\"remark\"",
        "Which arm wins",
        "Does growth help?",
        "gs study small.toml",
        "percentile",
        "<svg",
        "data:image/jpeg;base64,",
    ] {
        assert!(page.contains(expected), "{expected}");
    }
    let linked = page.matches("src=\"").count();
    assert_eq!(linked, 2 * (1 + 2 * 2), "two images, each with two arms and their errors");
    assert_eq!(page.matches("src=\"data:").count(), linked, "nothing from elsewhere");
    assert!(!page.contains("href=") && !page.contains("<script"));
    for plot in ["quality-over-count", "quality-over-time-60", "growth-30", "differences-at-equal-time"] {
        assert!(folder.file("plots").join(format!("{plot}.svg")).is_file(), "{plot}");
    }
}
