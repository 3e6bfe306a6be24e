//! A folder of very many jobs, done by processes that sleep in place of computing: the time of each job's
//! claim, record and end of the claim, and of listings of the folder meanwhile.
//!
//! `cargo bench -p gs-jobs --bench folder -- [FOLDER]`: in a folder within FOLDER, by default that of
//! temporary files.

#![allow(clippy::print_stdout)]

use std::{
    collections::HashMap,
    env,
    error::Error,
    fs,
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use gs_jobs::{
    AtEnd, JobStore, Keep, Listing, Queue, Shard, WorkSettings,
    files::{RUNS, record},
};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Time that a job takes.
const SLEEP: Duration = Duration::from_millis(40);

/// What a record contains next to its worker's number: as many bytes as the record of a block.
const CONTENT: &str = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef\
0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";

/// A number of jobs and how they are done.
struct Case {
    jobs: usize,
    workers: u32,
    /// Whether each worker begins with a share of its own.
    shares: bool,
    /// Workers that are killed when half of the jobs have ended.
    killed: usize,
}

fn main() -> Outcome<()> {
    let words: Vec<String> = env::args().skip(1).collect();
    if let [mode, folder, jobs, index, count] = &words[..]
        && mode == "work"
    {
        return work(folder, jobs.parse()?, index.parse()?, count.parse()?);
    }
    let is_whole = words.iter().any(|word| word == "--bench");
    let place = words.iter().find(|word| !word.starts_with("--")).map_or_else(env::temp_dir, Into::into);
    let case = |jobs, workers, shares, killed| Case { jobs, workers, shares, killed };
    println!("{} ms of sleep a job; median (10 % to 90 %; most) and mean, ms\n", SLEEP.as_millis());
    println!("| jobs | workers | shares | killed | wall time a job | CPU time a job | a listing, wall | jobs/s |");
    println!("|---|---|---|---|---|---|---|---|");
    if !is_whole {
        return measure(&case(200, 4, true, 2), &place);
    }
    for (jobs, shares, killed) in [(1000, true, 0), (100_000, true, 0), (100_000, true, 2), (100_000, false, 2)] {
        measure(&case(jobs, 32, shares, killed), &place)?;
    }
    Ok(())
}

fn address(job: usize) -> String {
    // Spread as digests are.
    format!("{:032x}", (job as u128 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c835))
}

/// CPU time of this thread, where the system shows it.
fn cpu() -> Duration {
    let shown = fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    Duration::from_nanos(shown.split(' ').next().and_then(|first| first.parse().ok()).unwrap_or_default())
}

/// A worker: does jobs until none is left, then prints wall and CPU time of the coordination of each, ns. `count` is 0
/// for a worker without a share.
fn work(folder: &str, jobs: usize, index: u32, count: u32) -> Outcome<()> {
    let addresses: Vec<String> = (0..jobs).map(address).collect();
    let settings = WorkSettings::default().with(|s| {
        s.shard = (count > 0).then_some(Shard { index, count });
        s.at_end = AtEnd::Leave;
    });
    let store = JobStore::new(folder);
    let queue = Queue::new(addresses.iter().map(String::as_str).collect(), store.clone(), &settings);
    let mut times = Vec::new();
    queue.keep_alive(|| -> Result<(), gs_jobs::Error> {
        let (mut wall, mut used) = (Instant::now(), cpu());
        while let Some((job, claim)) = queue.next(|job| format!("job {job}"), &())? {
            let (claimed, used_to_claim) = (wall.elapsed(), cpu() - used);
            thread::sleep(SLEEP);
            (wall, used) = (Instant::now(), cpu());
            store
                .write(&record(&addresses[job]), Keep::AfterPowerCut, &mut |file| write!(file, "{index} {CONTENT}"))?;
            claim.finish();
            times.push((claimed + wall.elapsed(), used_to_claim + cpu() - used));
            (wall, used) = (Instant::now(), cpu());
        }
        Ok(())
    })?;
    times.iter().for_each(|(wall, cpu)| println!("{} {}", wall.as_nanos(), cpu.as_nanos()));
    Ok(())
}

/// Does the jobs of a case in a new folder, and prints a row. Fails where a job has been done twice or not at all.
fn measure(case: &Case, place: &std::path::Path) -> Outcome<()> {
    let Case { jobs, workers, shares, killed } = *case;
    let folder = tempfile::tempdir_in(place)?;
    fs::create_dir(folder.path().join(RUNS))?;
    let store = JobStore::new(folder.path());
    let started = Instant::now();
    let start = |index: u32| {
        let count = if shares { workers } else { 0 };
        let words = [jobs.to_string(), index.to_string(), count.to_string()];
        Command::new(env::current_exe()?).arg("work").arg(folder.path()).args(words).stdout(Stdio::piped()).spawn()
    };
    let mut children = (0..workers).map(start).collect::<Result<Vec<Child>, _>>()?;
    let (mut listings, mut left) = (Vec::new(), killed);
    loop {
        let none_is_left = children.iter_mut().all(|child| matches!(child.try_wait(), Ok(Some(_))));
        let listed = Instant::now();
        let ended = Listing::of(&store)?.ended.len();
        listings.push(listed.elapsed().as_secs_f64() * 1e3);
        while left > 0 && 2 * ended >= jobs {
            left -= 1;
            children[left].kill()?;
        }
        if ended == jobs {
            break;
        }
        if none_is_left {
            return Err(format!("all workers have left after {ended} of {jobs} jobs").into());
        }
        thread::sleep(Duration::from_millis(500));
    }
    let rate = jobs as f64 / started.elapsed().as_secs_f64();
    let mut done = HashMap::<u32, usize>::new();
    for job in 0..jobs {
        let content = String::from_utf8(store.read(&record(&address(job)))?.ok_or("a job has no record")?)?;
        *done.entry(content.split(' ').next().unwrap_or_default().parse()?).or_default() += 1;
    }
    let (mut wall, mut cpu) = (Vec::new(), Vec::new());
    for (index, child) in (0..).zip(children) {
        let output = child.wait_with_output()?;
        let times = String::from_utf8(output.stdout)?;
        let before = wall.len();
        for (of_wall, of_cpu) in times.lines().filter_map(|line| line.split_once(' ')) {
            wall.push(of_wall.parse::<f64>()? / 1e6);
            cpu.push(of_cpu.parse::<f64>()? / 1e6);
        }
        let found = done.get(&index).copied().unwrap_or_default();
        if output.status.success() && found != wall.len() - before {
            return Err(format!("worker {index} did {} jobs, and {found} have its record", wall.len() - before).into());
        }
    }
    let shares = if shares { "yes" } else { "no" };
    let [wall, cpu, listings] = [wall, cpu, listings].map(spread);
    println!("| {jobs} | {workers} | {shares} | {killed} | {wall} | {cpu} | {listings} | {rate:.0} |");
    Ok(())
}

/// Median, quantiles, largest and mean.
fn spread(mut of: Vec<f64>) -> String {
    of.sort_by(f64::total_cmp);
    let at = |share: f64| of[(share * (of.len() - 1) as f64).round() as usize];
    let mean = of.iter().sum::<f64>() / of.len() as f64;
    format!("{:.2} ({:.2} to {:.2}; {:.1}), {mean:.2}", at(0.5), at(0.1), at(0.9), at(1.0))
}
