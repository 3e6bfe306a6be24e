//! A study's folder with very many runs: the time to plan them, to claim one, and to write tables
//! and report. All records but a few are copies of the first, with other numbers.
//!
//! `cargo bench -p gs-lab --bench shared_folder -- [--threads N] [--quick]`

#![allow(clippy::print_stdout)]

mod measure;

use std::{
    error::Error,
    fs,
    path::Path,
    sync::Mutex,
    time::{Duration, Instant},
};

use clap::Parser;
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_lab::{
    Existing, Places, Plan, Results, Study, StudyFolder, conduct, report,
    result::write_tables,
    run::{Record, RunOutcome, Watcher},
    study::Run,
};
use measure::{Options, Outcome, Quantiles, memory, ms, print_columns, print_head, print_row};

/// 100 runs for each seed, of fits that are as short as they can be and have a whole trajectory.
const STUDY: &str = "\
name = 'many'
images = ['paper-64px', 'paper', 'paper-contrast-50', 'paper-contrast-25', 'thin-lines']
budgets = [10, 20, 30, 40]
seeds = [0]
preset = 'paper'
iterations = 100
arm = [{ name = 'a' }, { name = 'b', settings.policy.percent = 6 }, { name = 'c', settings.policy.percent = 7 }, \
{ name = 'd', settings.policy.percent = 8 }, { name = 'e', settings.policy.percent = 9 }]
[settings]
policy.kind = 'percentile'
";

/// Runs that are done in the folder, one claim each.
const CLAIMS: usize = 40;

/// Measures the time between the end of a run and the beginning of the next, which is that of a
/// claim.
#[derive(Default)]
struct Claims(Mutex<(Option<Instant>, Vec<f64>)>);

impl Watcher for Claims {
    fn begun(&self, _: &Run) {
        let mut state = self.0.lock().expect("one thread");
        let taken = state.0.take().map(|ended| ended.elapsed().as_secs_f64());
        state.1.extend(taken);
    }

    fn ended(&self, _: &Run, _: &RunOutcome) {
        self.0.lock().expect("one thread").0 = Some(Instant::now());
    }
}

/// Stops after the first run.
#[derive(Default)]
struct First(Mutex<bool>);

impl Watcher for First {
    fn ended(&self, _: &Run, _: &RunOutcome) {
        *self.0.lock().expect("one thread") = true;
    }

    fn wants_stop(&self) -> bool {
        *self.0.lock().expect("one thread")
    }
}

/// Stores records for all runs but the last ones: copies of the first run's.
fn fill(plan: &Plan, folder: &Path) -> Result<u64, Box<dyn Error>> {
    let path = |run: &Run| folder.join("runs").join(format!("{}.json", run.address));
    let text = fs::read(path(&plan.runs[0]))?;
    let mut record: Record = serde_json::from_slice(&text)?;
    for run in &plan.runs[1..plan.runs.len() - CLAIMS] {
        record.address.clone_from(&run.address);
        if let RunOutcome::Finished(finished) = &mut record.outcome {
            // Arms differ, and so do seeds.
            finished.psnr = 20.0 + 0.1 * run.arm as f64 + 0.01 * f64::from(run.seed % 17);
            finished.seconds = 1.0 + 0.1 * run.arm as f64;
        }
        fs::write(path(run), serde_json::to_vec(&record)?)?;
    }
    Ok(text.len() as u64)
}

fn main() -> Outcome {
    let options = Options::parse();
    print_head("A study's folder with many runs", &options, &[options.threads()], "copies of one record");
    print_columns(&["step", "time", "peak memory"]);
    let row = |step: &str, time: Duration| {
        let peak = memory::peak().map_or_else(String::new, |bytes| format!("{:.0} MB", bytes as f64 / 1e6));
        print_row(&[step.to_owned(), format!("{:.1} s", time.as_secs_f64()), peak]);
    };
    let place = tempfile::tempdir()?;
    let mut study = Study::from_toml(STUDY, "many.toml")?;
    study.seeds = (0..options.pick(1000, 10)).collect();
    let start = Instant::now();
    let plan = Plan::new(study, &Places::default(), "a benchmark")?;
    row(&format!("plan {} runs", plan.runs.len()), start.elapsed());

    let cpu = CpuRasterizer::new(CpuSettings::default().with(|s| s.threads = Some(options.threads())))?;
    let folder = StudyFolder::prepare(place.path(), &plan, Existing::Refuse)?;
    conduct(&plan, &[&cpu], &folder, &First::default())?;
    let bytes = fill(&plan, place.path())?;
    let start = Instant::now();
    let folder = StudyFolder::prepare(place.path(), &plan, Existing::Resume)?;
    row(&format!("resume, records of {} kB", bytes / 1000), start.elapsed());

    let claims = Claims::default();
    conduct(&plan, &[&cpu], &folder, &claims)?;
    let waits = claims.0.into_inner().expect("one thread").1;
    let longest = waits.iter().copied().fold(0.0, f64::max);
    let each = format!("{} ms, at most {:.3} ms", ms(Quantiles::of(&waits)), longest * 1e3);
    print_row(&[format!("claim a run, of {}", waits.len()), each, String::new()]);

    memory::forget_peak();
    let start = Instant::now();
    let results = Results::read(&plan, &folder)?;
    row("read the records", start.elapsed());
    let start = Instant::now();
    write_tables(&results, &folder)?;
    row("write the tables", start.elapsed());
    let start = Instant::now();
    report::write(&results, &folder, "gs study work many")?;
    row("write the report", start.elapsed());
    Ok(())
}
