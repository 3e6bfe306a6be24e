//! Verdicts on made-up runs. Each test is a way in which a comparison could be unfair.

use crate::{
    Places, Plan, Results, Study, report,
    result::{Difference, Metric, ResultRemark, Verdict},
    run::{Finished, Record, RunOutcome},
    study::{Matching, Run},
};
use gs_core::{Culled, Image, edit::EditCounts};
use gs_train::MetricsRow;

/// A study with the given numbers of images, seeds and arms. Arms are called `a`, `b`, ….
struct Scenario {
    plan: Plan,
    _place: tempfile::TempDir,
}

const STEPS: u32 = 100;

impl Scenario {
    fn new(images: usize, seeds: u32, arms: usize) -> Self {
        let place = tempfile::tempdir().unwrap();
        let names: Vec<String> = (0..images).map(|i| format!("{i}.png")).collect();
        for (i, name) in names.iter().enumerate() {
            let image = Image::filled(4, 4, [i as f32 / images as f32; 3]).unwrap();
            gs_io::write_png(place.path().join(name), &image).unwrap();
        }
        let arms: String =
            (0..arms).map(|arm| format!("[[arm]]\nname = '{}'\n", char::from(b'a' + arm as u8))).collect();
        let seeds: Vec<u32> = (0..seeds).collect();
        let text =
            format!("name = 'x'\nimages = {names:?}\nbudgets = [100]\nseeds = {seeds:?}\npreset = 'paper'\n{arms}");
        let places = Places { data: Some(place.path().to_owned()), ..Places::default() };
        let plan = Plan::new(Study::from_toml(&text, "x.toml").unwrap(), &places, "test").unwrap();
        Self { plan, _place: place }
    }

    /// Results in which each run has the given outcome.
    fn results(&self, outcome: impl Fn(&Run) -> Option<RunOutcome>) -> Results<'_> {
        let record = |run: &Run| {
            Some(Record {
                address: run.address.clone(),
                version: String::new(),
                machine: "test".into(),
                image: String::new(),
                target: String::new(),
                policy: None,
                settings: String::new(),
                outcome: outcome(run)?,
            })
        };
        Results { plan: &self.plan, records: self.plan.runs.iter().map(record).collect() }
    }
}

pub(crate) fn failed() -> Option<RunOutcome> {
    Some(RunOutcome::Failed { error: "no luck".to_owned() })
}

pub(crate) fn finished(end: Finished) -> Option<RunOutcome> {
    Some(RunOutcome::Finished(Box::new(end)))
}

/// A run whose PSNR rises linearly from 0 dB to `psnr` in `seconds`.
pub(crate) fn rising(psnr: f64, seconds: f64) -> Finished {
    let row = |tenth: u32| {
        let part = f64::from(tenth) / 10.0;
        MetricsRow {
            step: tenth * STEPS / 10,
            seconds: part * seconds,
            count: 100,
            edits: EditCounts::default(),
            loss: 0.5,
            l1: None,
            psnr: Some(part * psnr),
            culled: None,
            clamped: None,
            fresh_start: None,
        }
    };
    Finished {
        gaussians: 100,
        bytes: 3200,
        iterations: STEPS,
        psnr,
        ssim: 0.5,
        ms_ssim: None,
        l1: 0.1,
        loss: None,
        edits: EditCounts::default(),
        culled: Culled::default(),
        scene: String::new(),
        seconds,
        backend: "test".to_owned(),
        side_by_side: 1,
        trajectory: (0..=10).map(row).collect(),
        views: Vec::new(),
        measured: Default::default(),
    }
}

/// A small variation of quality from run to run.
fn wobble(run: &Run) -> f64 {
    0.02 * f64::from((7 * run.seed + 3 * run.target as u32 + run.arm as u32) % 5)
}

fn at(results: &Results<'_>, matching: Matching, arm: usize, against: usize) -> Difference {
    results.difference(matching, Metric::Psnr, 100, arm, against)
}

#[test]
fn a_machine_that_stalls_in_a_few_runs_decides_nothing_at_equal_time() {
    let scenario = Scenario::new(6, 5, 2);
    // Both arms take 2 s, except that a run of each was slowed down and another was faster.
    let jitter = |run: &Run| match (run.arm, run.seed) {
        (0, 1) | (1, 3) => 7.0,
        (0, 2) | (1, 0) => 0.5,
        _ => 2.0,
    };
    let results = scenario.results(|run| finished(rising(30.0 + run.arm as f64 + wobble(run), jitter(run))));
    let (by_time, by_end) = (at(&results, Matching::Time, 1, 0), at(&results, Matching::Count, 1, 0));
    let same = (by_time.mean.unwrap() - by_end.mean.unwrap()).abs() < 1e-9;
    assert!(same && by_time.verdict == Verdict::Better, "{by_time:?}");
    let lines = report::headlines(&results);
    assert!(lines[2].contains("b leads with 31.0"), "nobody is judged before the end: {lines:?}");
}

#[test]
fn a_slower_arm_is_judged_before_the_end_of_its_schedule() {
    let scenario = Scenario::new(6, 5, 2);
    let results =
        scenario.results(|run| finished(rising(30.0 + 3.0 * run.arm as f64 + wobble(run), 1.0 + run.arm as f64)));
    assert_eq!(at(&results, Matching::Iterations, 1, 0).verdict, Verdict::Better);
    let by_time = at(&results, Matching::Time, 1, 0);
    assert!((by_time.mean.unwrap() + 13.5).abs() < 0.1, "half of 33 dB against 30 dB: {by_time:?}");
    assert_eq!(by_time.verdict, Verdict::Worse);
}

#[test]
fn runs_that_were_timed_in_other_ways_are_not_compared_by_time() {
    let scenario = Scenario::new(6, 5, 2);
    let other_ways: [fn(&mut Finished); 2] =
        [|end| end.side_by_side = 2, |end| end.backend = "test, 8 threads".to_owned()];
    for other_way in other_ways {
        let results = scenario.results(|run| {
            let mut end = rising(30.0 + run.arm as f64 + wobble(run), 2.0);
            if (run.seed, run.target, run.arm) == (4, 5, 1) {
                other_way(&mut end);
            }
            finished(end)
        });
        let by_time = at(&results, Matching::Time, 1, 0);
        assert_eq!(by_time.verdict, Verdict::None);
        assert!(
            matches!(&by_time.remarks[..], [ResultRemark::ClocksDiffer { clocks }] if clocks.len() == 2),
            "{by_time:?}"
        );
        assert_eq!(at(&results, Matching::Iterations, 1, 0).verdict, Verdict::Better);
        let line = report::headlines(&results).pop().unwrap();
        assert!(line.contains("; no verdict, because runs were timed in different ways ("), "{line}");
    }
}

#[test]
fn a_headline_compares_the_leader_where_it_leads() {
    let scenario = Scenario::new(6, 5, 3);
    // `c` ends after a fifth of the time and of the steps. Up to there `a` is ahead of `b`, later
    // behind.
    let results = scenario.results(|run| {
        let mut end = rising([30.0, 36.0, 3.0][run.arm] + wobble(run), [5.0, 5.0, 1.0][run.arm]);
        if run.arm == 0 {
            end.trajectory[1].psnr = Some(20.0);
            end.trajectory[2].psnr = Some(20.0);
        }
        if run.arm == 2 {
            end.iterations = STEPS / 5;
        }
        finished(end)
    });
    for (line, matching) in [(1, Matching::Iterations), (2, Matching::Time)] {
        let headline = report::headlines(&results)[line].clone();
        let difference = at(&results, matching, 0, 1);
        let ahead = format!("a leads with 20.00 dB, {:.2} dB ahead", difference.mean.unwrap());
        assert!(headline.ends_with(&ahead), "{headline}: {difference:?}");
        assert_eq!(difference.verdict, Verdict::Better);
    }
    assert!(report::headlines(&results)[0].contains("b leads"));
}

#[test]
fn a_headline_without_a_verdict_has_the_reason_that_the_tables_have() {
    let scenario = Scenario::new(2, 5, 3);
    let results = scenario.results(|run| finished(rising(30.0 + run.arm as f64 + wobble(run), 2.0)));
    let reason = at(&results, Matching::Count, 1, 0).remarks[0].to_string();
    assert_eq!(reason, "2 images are too few (an interval needs 6)");
    for line in report::headlines(&results) {
        assert!(line.contains("c leads") && line.ends_with(&format!("; no verdict, because {reason}")), "{line}");
    }
}

#[test]
fn runs_that_fail_leave_complete_pairs_and_a_remark() {
    let scenario = Scenario::new(6, 5, 2);
    // The arm fails where it would have been bad: averaged over its finished runs it would seem
    // better.
    let results = scenario.results(|run| match (run.arm, run.seed) {
        (1, 0) if run.target == 2 => failed(),
        (0, 3) if run.target == 4 => None,
        (_, 0) if run.target == 2 => finished(rising(10.0, 2.0)),
        _ => finished(rising(30.0 - 0.5 * run.arm as f64 + wobble(run), 2.0)),
    });
    let difference = at(&results, Matching::Count, 1, 0);
    assert_eq!(difference.remarks, [ResultRemark::Incomplete { pairs: 28, of: 30 }]);
    assert_eq!(difference.verdict, Verdict::Worse);
    assert!((-0.6..-0.4).contains(&difference.mean.unwrap()), "{difference:?}");
    let headline = report::headlines(&results)[0].clone();
    let ahead = format!(" dB, {:.2} dB ahead", -difference.mean.unwrap());
    assert!(headline.contains("a leads with 30.0") && headline.ends_with(&ahead), "{headline}: {difference:?}");
    let quality = &results.qualities()[1];
    assert_eq!((quality.finished, quality.failed, quality.missing, quality.images), (29, 1, 0, 6));
}

#[test]
fn an_arm_that_fails_on_an_image_is_neither_judged_nor_ranked() {
    let scenario = Scenario::new(8, 5, 3);
    // The image on which `c` fails is the hardest, so its mean over the others would be the best.
    let results = scenario.results(|run| match (run.arm, run.target) {
        (2, 3) => failed(),
        (_, 3) => finished(rising(12.0 + run.arm as f64 + wobble(run), 2.0)),
        _ => finished(rising(30.0 + run.arm as f64 + wobble(run), 2.0)),
    });
    for against in [0, 1] {
        let difference = at(&results, Matching::Count, 2, against);
        assert_eq!(difference.verdict, Verdict::None);
        assert_eq!(difference.remarks, [ResultRemark::ImagesMissing { missing: 1, of: 8 }]);
    }
    let headline = report::headlines(&results)[0].clone();
    assert!(
        headline.contains(": b leads with 28.")
            && headline.ends_with("; no verdict on c, because there is no pair of finished runs on 1 of 8 images"),
        "{headline}"
    );
    assert_eq!(results.qualities().iter().map(|quality| quality.images).collect::<Vec<_>>(), [8, 8, 7]);
}

#[test]
fn an_image_that_is_met_exactly_is_not_too_few_images() {
    let scenario = Scenario::new(6, 5, 2);
    let psnr =
        |run: &Run| if (run.arm, run.target, run.seed) == (1, 1, 1) { f64::INFINITY } else { 30.0 + wobble(run) };
    let results = scenario.results(|run| finished(Finished { psnr: psnr(run), ..rising(30.0, 2.0) }));
    let difference = at(&results, Matching::Count, 1, 0);
    assert_eq!((difference.mean, difference.verdict), (None, Verdict::None));
    assert_eq!(difference.remarks, [ResultRemark::Infinite { pairs: 1 }]);
}

#[test]
fn more_gaussians_in_one_run_do_not_make_up_for_fewer_in_another() {
    let scenario = Scenario::new(6, 6, 2);
    let results = scenario.results(|run| {
        let more = if run.seed.is_multiple_of(2) { 10 } else { 0 };
        let gaussians = if run.arm == 0 { 95 } else { 90 + more };
        finished(Finished { gaussians, ..rising(30.0 + run.arm as f64 + wobble(run), 2.0) })
    });
    let difference = at(&results, Matching::Count, 1, 0);
    assert!(matches!(difference.remarks[..], [ResultRemark::CountsDiffer { .. }]), "{difference:?}");
    assert_eq!(difference.verdict, Verdict::None);
    assert_eq!(at(&results, Matching::Iterations, 1, 0).verdict, Verdict::Better);
}

#[test]
fn few_seeds_are_remarked_upon() {
    let scenario = Scenario::new(6, 2, 2);
    let results = scenario.results(|run| finished(rising(30.0 + run.arm as f64 + wobble(run), 2.0)));
    let difference = at(&results, Matching::Count, 1, 0);
    assert_eq!(
        (difference.verdict, &difference.remarks[..]),
        (Verdict::Better, &[ResultRemark::FewSeeds { seeds: 2 }][..])
    );
    let alone = Scenario::new(1, 5, 2);
    let results = alone.results(|run| finished(rising(30.0 + run.arm as f64 + wobble(run), 2.0)));
    let words = at(&results, Matching::Count, 1, 0).remarks[0].to_string();
    assert_eq!(words, "5 seeds are too few (an interval needs 6)");
}
