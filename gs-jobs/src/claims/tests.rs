//! Claims and queues without fits: many processes, dead ones, and clocks that are wrong.

use std::{
    collections::HashMap,
    fs::{self, File},
    path::{Path, PathBuf},
    sync::atomic::{AtomicUsize, Ordering},
    thread,
};

use super::*;
use crate::{
    files::{self, Listing},
    queue::{Overseer, Queue},
    work::{AtEnd, Shard, WorkSettings},
};

const LEASE: Duration = Duration::from_secs(60);

fn address(run: usize) -> String {
    format!("{run:032x}")
}

/// A folder for jobs.
fn place() -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    fs::create_dir(place.path().join(RUNS)).unwrap();
    place
}

fn claims(folder: &Path) -> Claims {
    Claims::new(JobStore::new(folder), "a test".to_owned(), LEASE)
}

fn claimed(attempt: Attempt<'_>) -> Claim<'_> {
    match attempt {
        Attempt::Claimed(claim) => claim,
        other => panic!("{other:?}"),
    }
}

/// Stores what counts as a record. Fails where there is one.
fn store(to: &JobStore, address: &str) {
    let created = to.create(&files::record(address), |_| system::token().into_bytes()).unwrap();
    created.expect("no run is done twice");
}

fn names(of: &JobStore) -> Vec<String> {
    let mut names: Vec<String> = of.names(RUNS).unwrap().iter().map(|name| format!("{RUNS}/{name}")).collect();
    names.sort();
    names
}

/// Makes a claim that nobody has locked, as that of a process on another machine, written at this
/// time of the file server.
fn foreign(folder: &Path, address: &str, generation: u32, written: SystemTime) -> PathBuf {
    let path = folder.join(files::claim(address, generation));
    let note = ClaimNote {
        worker: "elsewhere".to_owned(),
        job: "a job".to_owned(),
        lease: LEASE.as_secs_f64(),
        system: "another system".to_owned(),
        locked: true,
        token: system::token(),
    };
    fs::write(&path, [WORKING, &serde_json::to_vec(&note).unwrap()].concat()).unwrap();
    File::options().write(true).open(&path).unwrap().set_modified(written).unwrap();
    path
}

#[test]
fn a_run_is_claimed_once_and_is_free_again_when_given_back() {
    let place = place();
    let (one, other) = (claims(place.path()), claims(place.path()));
    let run = address(1);
    let claim = claimed(one.attempt(&run, "a job").unwrap());
    for claims in [&one, &other] {
        assert!(matches!(claims.attempt(&run, "a job").unwrap(), Attempt::Taken));
    }
    let State::Live { note: Some(note), age } = other.state(&files::claim(&run, 0)).unwrap() else { panic!("alive") };
    assert_eq!((note.worker.as_str(), note.job.as_str(), note.lease), ("a test", "a job", 60.0));
    assert!(age < LEASE);
    drop(claim);
    let second = claimed(other.attempt(&run, "a job").unwrap());
    assert_eq!(names(&JobStore::new(place.path())).len(), 2, "claims are only added");
    store(&JobStore::new(place.path()), &run);
    second.finish();
    assert!(matches!(one.attempt(&run, "a job").unwrap(), Attempt::Ended));
    assert_eq!(names(&JobStore::new(place.path())), [files::record(&run)]);
}

#[test]
fn a_dead_process_of_this_system_is_recognised_at_once() {
    let place = place();
    let (dead, other) = (claims(place.path()), claims(place.path()));
    let mut claim = claimed(dead.attempt(&address(1), "a job").unwrap());
    // The end of a process closes its files and writes nothing.
    drop(claim.close());
    assert!(matches!(other.state(&files::claim(&address(1), 0)).unwrap(), State::Expired { note: Some(_) }));
    assert_eq!(claimed(other.attempt(&address(1), "a job").unwrap()).generation, 1);
}

#[test]
fn claims_expire_by_the_servers_clock_and_are_taken_over_once() {
    let place = place();
    let (one, other) = (claims(place.path()), claims(place.path()));
    let now = one.store.now(RUNS).unwrap();
    let (second, hour) = (Duration::from_secs(1), Duration::from_secs(3600));
    for (written, is_live) in [
        (now, true),
        (now + second - LEASE, true),
        (now - second - LEASE, false),
        (now - hour, false),
        // A server whose clock was set back: the claim lives until its time has come.
        (now + hour, true),
    ] {
        let path = foreign(place.path(), &address(1), 0, written);
        let state = one.state(&files::claim(&address(1), 0)).unwrap();
        assert_eq!(matches!(state, State::Live { .. }), is_live, "{written:?} {now:?} {state:?}");
        fs::remove_file(path).unwrap();
    }
    foreign(place.path(), &address(1), 0, now - hour);
    foreign(place.path(), &address(1), 1, now - hour);
    let taken = claimed(one.attempt(&address(1), "a job").unwrap());
    assert_eq!(taken.generation, 2);
    assert!(matches!(other.attempt(&address(1), "a job").unwrap(), Attempt::Taken));
    // A claim without a note is of a process that has just begun, or died then.
    fs::write(place.path().join(files::claim(&address(2), 0)), "").unwrap();
    assert!(matches!(one.attempt(&address(2), "a job").unwrap(), Attempt::Taken));
    File::options()
        .write(true)
        .open(place.path().join(files::claim(&address(2), 0)))
        .unwrap()
        .set_modified(now - hour)
        .unwrap();
    assert_eq!(claimed(one.attempt(&address(2), "a job").unwrap()).generation, 1);
}

#[test]
fn a_heartbeat_renews_a_claim() {
    let place = place();
    let one = claims(place.path());
    let claim = claimed(one.attempt(&address(1), "a job").unwrap());
    let path = place.path().join(files::claim(&address(1), 0));
    let old = one.now().unwrap() - LEASE * 2;
    File::options().write(true).open(&path).unwrap().set_modified(old).unwrap();
    one.beat();
    assert_eq!(claim.generation, 0);
    assert!(fs::metadata(&path).unwrap().modified().unwrap() > old + LEASE);
    let note = fs::read(&path).unwrap();
    assert!(note.starts_with(WORKING) && serde_json::from_slice::<ClaimNote>(&note[WORKING.len()..]).is_ok());
}

#[test]
fn a_run_that_ended_while_it_was_claimed_is_not_done_again() {
    let place = place();
    let claims = claims(place.path());
    let run = address(1);
    // The record appears between the first look and the claim: another process is between storing
    // it and removing its claim.
    foreign(place.path(), &run, 0, claims.now().unwrap() - LEASE * 2);
    thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| match claims.attempt(&run, "a job").unwrap() {
                Attempt::Claimed(claim) => {
                    store(&JobStore::new(place.path()), &run);
                    claim.finish();
                }
                Attempt::Ended | Attempt::Taken => {}
            });
        }
    });
    assert!(matches!(claims.attempt(&run, "a job").unwrap(), Attempt::Ended));
    claims.sweep().unwrap();
    assert_eq!(names(&JobStore::new(place.path())), [files::record(&run)]);
}

#[test]
fn the_sweep_removes_stale_files_and_leaves_the_rest() {
    let place = place();
    let claims = claims(place.path());
    let old = claims.now().unwrap() - LEASE * 2;
    let write = |name: &str, time: SystemTime| {
        let path = place.path().join(RUNS).join(name);
        fs::write(&path, "x").unwrap();
        File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
    };
    store(&JobStore::new(place.path()), &address(1));
    foreign(place.path(), &address(1), 0, old);
    foreign(place.path(), &address(2), 0, old);
    for run in [1, 2] {
        write(&format!("{}.safetensors", address(run)), old);
    }
    write(".gs-dEaD00.tmp", old);
    write("0011223344556677.now", old);
    write(".gs-aLiVe0.tmp", old + LEASE * 2);
    write("notes.txt", old);
    claims.sweep().unwrap();
    let kept = [
        "runs/.gs-aLiVe0.tmp",
        &files::record(&address(1)),
        &files::claim(&address(2), 0),
        &files::checkpoint(&address(2)),
        "runs/notes.txt",
    ];
    assert_eq!(names(&JobStore::new(place.path())), kept);
}

/// A process that dies, gives up or goes on, at random but for its seed.
struct Fate(u64);

impl Fate {
    /// A number below `limit`.
    fn draw(&mut self, limit: u64) -> u64 {
        // Knuth's linear congruential generator.
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % limit
    }
}

/// Does jobs as one process of many: some are given back, and some processes die. Returns whether it
/// died.
fn take_part(
    store_of_runs: &JobStore,
    addresses: &[String],
    settings: &WorkSettings,
    fate: &mut Fate,
    done: &AtomicUsize,
) -> bool {
    let queue = Queue::new(addresses.iter().map(String::as_str).collect(), store_of_runs.clone(), settings);
    queue.keep_alive(|| {
        while let Some((index, mut claim)) = queue.next(|index| index.to_string(), &()).unwrap() {
            match fate.draw(40) {
                0 => drop(claim.close()),
                1 => {}
                _ => {
                    store(store_of_runs, &addresses[index]);
                    claim.finish();
                    done.fetch_add(1, Ordering::Relaxed);
                    continue;
                }
            }
            return true;
        }
        false
    })
}

/// Lets `processes` at a time work on `runs`; those that die are replaced.
fn check_that_each_run_is_done_once(processes: usize, runs: usize, shares: bool) {
    let place = place();
    let store = JobStore::new(place.path());
    let addresses: Vec<String> = (0..runs).map(address).collect();
    let done = AtomicUsize::new(0);
    thread::scope(|scope| {
        for process in 0..processes {
            let (addresses, done, store) = (&addresses, &done, &store);
            let shard = shares.then_some(Shard { index: process as u32, count: processes as u32 });
            let settings = WorkSettings::default().with(|s| (s.shard, s.at_end, s.lease) = (shard, AtEnd::Wait, LEASE));
            let mut fate = Fate(process as u64 + 1);
            let body = move || while take_part(store, addresses, &settings, &mut fate, done) {};
            thread::Builder::new().stack_size(256 << 10).spawn_scoped(scope, body).unwrap();
        }
    });
    assert_eq!(done.into_inner(), runs);
    assert_eq!(Listing::of(&store).unwrap().ended.len(), runs);
    assert_eq!(names(&store).len(), runs, "nothing else is left");
}

#[test]
fn crashed_or_stopped_workers_do_each_run_once() {
    check_that_each_run_is_done_once(150, 600, true);
}

#[test]
#[ignore = "slow: a thousand threads; `cargo xtask test --slow` runs it"]
fn crashed_workers_lose_no_run() {
    check_that_each_run_is_done_once(1000, 2000, true);
}

#[test]
fn without_shares_all_begin_at_the_same_run_and_none_is_done_twice() {
    check_that_each_run_is_done_once(40, 600, false);
}

/// Counts what it is shown.
#[derive(Default)]
struct Seen(Mutex<Vec<usize>>);

impl Overseer for Seen {
    fn counted(&self, ended: usize) {
        self.0.lock().unwrap().push(ended);
    }
}

#[test]
fn a_process_begins_with_its_share_and_leaves_what_others_are_doing() {
    let place = place();
    let addresses: Vec<String> = (0..7).map(address).collect();
    let settings = WorkSettings::default().with(|s| {
        (s.shard, s.at_end) = (Some(Shard { index: 1, count: 3 }), AtEnd::Leave);
        s.lease = Duration::from_secs(1);
    });
    let others = claims(place.path());
    let held = claimed(others.attempt(&addresses[4], "a job").unwrap());
    let queue = Queue::new(addresses.iter().map(String::as_str).collect(), JobStore::new(place.path()), &settings);
    let (mut order, seen) = (Vec::new(), Seen::default());
    while let Some((index, claim)) = queue.next(|index| index.to_string(), &seen).unwrap() {
        order.push(index);
        store(&JobStore::new(place.path()), &addresses[index]);
        claim.finish();
    }
    assert_eq!(order, [1, 0, 2, 3, 5, 6]);
    assert_eq!(queue.left().unwrap(), 1);
    assert_eq!(seen.0.into_inner().unwrap().last(), Some(&6));
    drop(held);
    // What was given back is done, though the process was about to leave.
    assert_eq!(queue.next(|index| index.to_string(), &()).unwrap().map(|(index, _)| index), Some(4));
}

#[test]
fn shares_are_interleaved_and_cover_all_jobs() {
    let count = 3;
    let mut of = HashMap::<u32, Vec<usize>>::new();
    for place in 0..8 {
        for index in (0..count).filter(|&index| (Shard { index, count }).contains(place)) {
            of.entry(index).or_default().push(place);
        }
    }
    assert_eq!((&of[&0], &of[&1], &of[&2]), (&vec![0, 3, 6], &vec![1, 4, 7], &vec![2, 5]));
    let wrong = |change: &dyn Fn(&mut WorkSettings)| {
        let mut settings = WorkSettings::default();
        change(&mut settings);
        settings.validate().unwrap_err().to_string()
    };
    assert!(wrong(&|s| s.shard = Some(Shard { index: 3, count })).contains("shard is 3/3"));
    assert!(wrong(&|s| s.lease = Duration::ZERO).contains("lease is 0 s"));
}
