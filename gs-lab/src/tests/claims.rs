//! Claims of study files, judged by made-up runs. Each verdict has a control that refutes it.

use crate::{
    Places, Plan, Results, Study,
    result::{Claim, ClaimVerdict, claims_csv, verdicts},
    run::{Finished, Record, RunOutcome},
    study::{Column, Run},
};

use super::comparisons::{failed, finished, rising};

const STUDY: &str = "name = 'x'\nimages = ['paper', 'thin-lines', 'paper-64px']\nbudgets = [600]\nseeds = [0, 1, 2, 3, 4, 5, 6]\n\
                     preset = 'paper'\nmeasure = ['start']\n[[arm]]\nname = 'a'\n[[arm]]\nname = 'b'\n[[arm]]\nname = 'c'\n";

/// The claims of a study, judged by runs that end as given.
fn judged(claims: &str, outcome: impl Fn(&Run) -> Option<RunOutcome>) -> Vec<Claim> {
    let plan = Plan::new(Study::from_toml(&format!("{STUDY}{claims}"), "x.toml").unwrap(), &Places::default(), "test")
        .unwrap();
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
    Results { plan: &plan, records: plan.runs.iter().map(record).collect() }.claims()
}

/// How often each condition holds among runs of which each ends with the given PSNR.
fn counted(conditions: &[&str], psnr: impl Fn(&Run) -> f64) -> Vec<(usize, usize)> {
    let conditions: String = conditions.iter().map(|condition| format!("{{ of = 'psnr', {condition} }}, ")).collect();
    let claims = format!("[[claim]]\nname = 'c'\nstatement = 's'\ncircumstances = [{conditions}]\n");
    let claims = judged(&claims, |run| finished(rising(psnr(run), 1.0)));
    claims[0].circumstances.iter().map(|circumstance| (circumstance.held, circumstance.of)).collect()
}

#[test]
fn a_verdict_follows_from_the_runs_and_its_control_refutes_it() {
    let claims = "[[claim]]\nname = 'better'\nstatement = 's'\nsection = '1, 2'\nnote = 'Mind.'\n\
                  circumstances = [{ what = 'w', arm = 'b', of = 'psnr', less = { arms = ['a'] }, above = 0 }]\n\
                  numbers = [{ what = 'gain', arm = 'b', of = 'psnr', less = { arms = ['a'] }, unit = 'dB' }, \
                  { what = 'PSNR', arm = 'a', of = 'psnr', take = 'interval' }]\n";
    let verdict = |gain: &dyn Fn(&Run) -> f64| {
        let psnr = |run: &Run| if run.arm == 1 { 30.0 + gain(run) } else { 30.0 };
        let claims = judged(claims, |run| finished(rising(psnr(run), 1.0)));
        (claims[0].verdict(), claims[0].circumstances[0].held, claims[0].measured.clone())
    };
    assert_eq!(
        verdict(&|_| 1.5),
        (ClaimVerdict::Confirmed, 21, "gain: 1.500 dB; PSNR: 30 (95 % interval 30 to 30). Mind.".to_owned())
    );
    assert_eq!(
        verdict(&|_| -1.5),
        (ClaimVerdict::Refuted, 0, "gain: -1.500 dB; PSNR: 30 (95 % interval 30 to 30). Mind.".to_owned())
    );
    assert_eq!(verdict(&|_| 0.0).0, ClaimVerdict::Refuted);
    assert_eq!(verdict(&|run| if run.target == 0 { 1.0 } else { -1.0 }).1, 7);
    let claims = judged(claims, |_| finished(rising(30.0, 1.0)));
    assert_eq!(verdicts(&claims), "1 claim: 1 refuted");
    assert_eq!(
        claims_csv([("x", claims.as_slice())]),
        "experiment,claim,section,verdict,number,value,unit\nx,better,\"1, 2\",refuted,w,0,of 21\n\
         x,better,\"1, 2\",refuted,gain,0,dB\nx,better,\"1, 2\",refuted,PSNR,30,\n\
         x,better,\"1, 2\",refuted,\"its 95 % interval, from\",30,\nx,better,\"1, 2\",refuted,\"its 95 % interval, to\",30,\n"
    );
}

#[test]
fn failed_runs_hold_nothing_and_missing_ones_do_not_count() {
    let claims = "[[claim]]\nname = 'c'\nstatement = 's'\ncircumstances = [{ arm = 'a', of = 'psnr', at-least = 1 }, \
                  { arm = 'a', of = 'failed', above = 0 }]\n";
    let of_seed = |run: &Run| match run.seed {
        0 => None,
        1 => failed(),
        _ => finished(rising(20.0, 1.0)),
    };
    let claim = &judged(claims, of_seed)[0];
    let counts: Vec<_> = claim.circumstances.iter().map(|c| (c.held, c.of)).collect();
    assert_eq!(counts, [(15, 18), (3, 18)]);
    assert_eq!(judged(claims, |_| None)[0].verdict(), ClaimVerdict::Refuted, "nothing was measured");
}

#[test]
fn cases_are_put_together_as_the_condition_says() {
    // 10 dB on the first image, 20 and 30 on the others, and one more for each seed.
    let psnr = |run: &Run| 10.0 * (run.target + 1) as f64 + f64::from(run.seed);
    let cases = [
        ("arm = 'a', above = 16", (14, 21)),
        ("arm = 'a', images = ['paper'], above = 14", (2, 7)),
        // The mean of the first image is 13.
        ("arm = 'a', per = 'image', above = 13", (2, 3)),
        ("arm = 'a', per = 'image', at-least = 13", (3, 3)),
        ("arm = 'a', per = 'image', join = 'every', above = 25", (1, 3)),
        ("arm = 'a', per = 'image', join = 'some', above = 25", (2, 3)),
        ("arm = 'a', per = 'image', join = 'lowest', at-most = 10", (1, 3)),
        ("arm = 'a', per = 'seed', join = 'median', at-least = 24", (3, 7)),
        ("arm = 'a', per = 'study', join = 'highest', at-least = 36", (1, 1)),
        (
            "arm = 'a', per = 'image', above = 0, given = [{ arm = 'a', of = 'psnr', per = 'image', above = 15 }]",
            (2, 2),
        ),
        ("arm = 'a', above = 16, and = [{ arm = 'b', of = 'psnr', below = 21 }]", (1, 21)),
        ("arm = 'a', over = { at = 0.5 }, at-least = 1.9", (21, 21)),
        ("arm = 'a', over = { at = 0.5 }, below = 1.9", (0, 21)),
    ];
    let found = counted(&cases.map(|(condition, _)| condition), psnr);
    for ((condition, expected), found) in cases.iter().zip(found) {
        assert_eq!(found, *expected, "{condition}");
    }
}

#[test]
fn an_interval_holds_only_as_a_whole() {
    let within = |spread: f64| {
        let psnr = move |run: &Run| 20.0 + spread * (f64::from(run.seed) - 3.0) + 0.5 * run.arm as f64;
        counted(
            &["images = ['paper'], arm = 'b', less = { of = 'ssim' }, per = 'study', join = 'interval', above = 19.5"],
            psnr,
        )
    };
    assert_eq!((within(0.01), within(3.0)), (vec![(1, 1)], vec![(0, 1)]), "the mean is 20 in both");
    let of_images = "arm = 'a', per = 'seed', join = 'interval', above = 0";
    assert_eq!(counted(&[of_images], |_| 20.0), [(0, 7)], "three values are too few");
}

#[test]
fn the_last_arm_that_meets_the_bound_is_chosen() {
    let choices = "[[choice]]\nname = 'own'\namong = ['a', 'b', 'c']\nof = 'gaussians'\nat-least = 50\n\
                   [[choice]]\nname = 'of-paper'\namong = ['a', 'b', 'c']\nof = 'gaussians'\nat-least = 50\nimage = 'paper'\n";
    // On the first image the first two arms meet it, on the second the first, on the third none.
    let outcome = |run: &Run| {
        let gaussians = if run.arm + run.target < 2 { 60 } else { 40 };
        finished(Finished { gaussians, ..rising(10.0 * (run.arm + 1) as f64, 1.0) })
    };
    let numbers = "numbers = [{ what = 'place', arm = 'own', of = 'place', images = ['paper'] }, \
                   { what = 'second', arm = 'own', of = 'place', images = ['thin-lines'] }, \
                   { what = 'none', arm = 'own', of = 'place', images = ['paper-64px'] }, \
                   { what = 'psnr', arm = 'own', of = 'psnr', images = ['thin-lines'] }, \
                   { what = 'transferred', arm = 'of-paper', of = 'psnr', images = ['paper-64px'] }, \
                   { what = 'nothing', arm = 'own', of = 'psnr', images = ['paper-64px'] }]\n";
    let lower =
        "{ arm = 'own', of = 'place', less = { arms = ['of-paper'] }, per = 'image', join = 'every', below = 0 }";
    let text = format!("{choices}[[claim]]\nname = 'c'\nstatement = 's'\ncircumstances = [{lower}]\n{numbers}");
    let claim = &judged(&text, outcome)[0];
    let numbers: Vec<_> = claim.numbers.iter().map(|number| (number.what.as_str(), number.value)).collect();
    assert_eq!(numbers, [("place", 2.0), ("second", 1.0), ("none", 0.0), ("psnr", 10.0), ("transferred", 20.0)]);
    assert_eq!((claim.circumstances[0].held, claim.circumstances[0].of), (2, 3));
}

#[test]
fn columns_are_read_from_the_course_of_a_run() {
    let mut end = rising(40.0, 1.0);
    // Rows at 0, 10, … 100; two rounds of growth, at 20 and 60. ln loss falls three times as fast
    // between them as elsewhere.
    let mut ln_loss = 0.0;
    for (index, row) in end.trajectory.iter_mut().enumerate() {
        row.count = [20, 60, 600][usize::from(index >= 2) + usize::from(index >= 6)];
        row.loss = f64::exp(ln_loss) as f32;
        ln_loss -= if (2..6).contains(&index) { 0.3 } else { 0.1 };
    }
    end.measured = [(Column::StartPull, 0.25)].into();
    // After the first round -2.5 over 50 steps and -1 before it; after the second -1, and -2.6.
    let change = 0.5 * (-1.5 + 1.6);
    let columns = [
        ("of = 'step-at-budget'", Some(60.0)),
        ("of = 'last-growth'", Some(60.0)),
        ("of = 'gaussians', at = 0.0", Some(20.0)),
        ("of = 'gaussians', at = 0.25", Some(60.0)),
        ("of = 'psnr', at = 0.5", Some(20.0)),
        ("of = 'ln-loss', at = 0.4", Some(-0.8)),
        ("of = 'slope-change'", Some(change)),
        ("of = 'start-pull'", Some(0.25)),
        ("of = 'start-pulled'", None),
        ("of = 'psnr', take = 'sum'", Some(21.0 * 40.0)),
    ];
    let numbers: String = columns.iter().map(|(of, _)| format!("{{ what = \"{of}\", arm = 'a', {of} }}, ")).collect();
    let text = format!(
        "[[claim]]\nname = 'c'\nstatement = 's'\ncircumstances = [{{ arm = 'a', of = 'psnr', above = 0 }}]\nnumbers = [{numbers}]\n"
    );
    let found = judged(&text, |_| finished(end.clone())).remove(0).numbers;
    for (of, expected) in columns {
        let number = found.iter().find(|number| number.what == of).map(|number| number.value);
        let is_so = number.zip(expected).map_or(number.is_none() && expected.is_none(), |(a, b)| (a - b).abs() < 1e-5);
        assert!(is_so, "{of}: {number:?}");
    }
}
