//! Claims in an object store.

use std::{sync::atomic::Ordering, thread, time::Duration};

use object_store::{RetryConfig, aws::AmazonS3Builder};

use super::{
    objects::ObjectRuns,
    test_server::{BUCKET, Server, address},
    *,
};
use crate::{claims::tests::check_that_each_run_is_done_once, files::RUNS, system};

#[test]
fn an_object_is_created_once_and_renewed_by_its_owner_alone() {
    let server = Server::start(None);
    let (one, other) = (server.store("a/b"), server.store("a/b"));
    ObjectRuns::check_on(&address("a/b"), server.builder()).unwrap();
    let content = |word: &'static str| move |_: Locked| word.as_bytes().to_vec();
    assert_eq!((one.names(RUNS).unwrap().len(), one.look("runs/x").unwrap().is_none()), (0, true));
    let own = one.create("runs/x", &content("first ")).unwrap().unwrap();
    assert!(other.create("runs/x", &content("second")).unwrap().is_none());
    let before = other.look("runs/x").unwrap().unwrap();
    assert_eq!((before.content.as_slice(), before.is_free(), own.locked()), (&b"first "[..], false, Locked::No));
    thread::sleep(Duration::from_millis(1100));
    own.rewrite(b"third ").unwrap();
    let after = other.look("runs/x").unwrap().unwrap();
    assert!(after.content == b"third " && after.written > before.written, "{after:?}");
    let now = other.now(RUNS).unwrap();
    let age = now.duration_since(before.written.unwrap()).unwrap_or_default();
    assert!(age < Duration::from_secs(5), "{age:?}");
    assert_eq!(other.names(RUNS).unwrap(), ["x"], "the file for the time is gone");
    // Removed by another process, and created anew: the first owner cannot write any more.
    other.remove("runs/x").unwrap();
    other.remove("runs/x").unwrap();
    other.create("runs/x", &content("second")).unwrap().unwrap();
    own.rewrite(b"fourth").unwrap_err();
    assert_eq!(one.read("runs/x").unwrap().unwrap(), b"second");
    one.write("pictures/y", Keep::AfterCrash, &mut |to| to.write_all(b"0123456789")).unwrap();
    assert_eq!((one.end("pictures/y", 3).unwrap().unwrap(), one.has("pictures/z").unwrap()), (b"789".to_vec(), false));
    assert!(one.end("pictures/z", 3).unwrap().is_none() && one.read("pictures/z").unwrap().is_none());
    assert_eq!(server.store("a").names(RUNS).unwrap().len(), 0, "another prefix");
    assert!(server.root.join(BUCKET).join("a/b/runs/x").is_file());
}

#[test]
fn an_answer_that_is_lost_makes_no_claim_ones_own_or_another() {
    let server = Server::start(Some(2));
    let store = server.store("lost");
    for run in 0..4 {
        let token = system::token().into_bytes();
        let name = format!("runs/{run}");
        let own = store.create(&name, &|_| token.clone()).unwrap().expect("nobody else creates it");
        assert!(store.create(&name, &|_| system::token().into_bytes()).unwrap().is_none());
        for word in [b"0123456789abcdef", b"fedcba9876543210", b"0123456789abcdef"] {
            own.rewrite(word).unwrap();
            assert_eq!(store.read(&name).unwrap().unwrap(), word);
        }
    }
}

#[test]
fn of_150_tasks_that_die_and_give_up_none_loses_a_run_or_does_it_twice_in_an_object_store() {
    let server = Server::start(Some(50));
    let store = server.store("many");
    check_that_each_run_is_done_once(|| store.clone(), (150, 300), true, Duration::from_secs(5));
    assert!(server.answered.load(Ordering::Relaxed) > 300 * 5);
}

#[test]
fn what_is_wrong_with_a_store_is_said_in_one_line() {
    let server = Server::start(None);
    let quick = RetryConfig { max_retries: 0, ..RetryConfig::default() };
    // The server makes a bucket that is not there, so that mistake is not tried.
    let failed = |builder: AmazonS3Builder| {
        ObjectRuns::check_on(&address("x"), builder.with_retry(quick.clone())).unwrap_err().to_string()
    };
    for (message, start, expected) in [
        (
            failed(server.builder().with_secret_access_key("wrong")),
            "s3://studies/x: cannot be written to: SignatureDoesNotMatch",
            "check AWS_ACCESS_KEY_ID",
        ),
        (
            failed(server.builder().with_endpoint("http://127.0.0.1:9")),
            "s3://studies/x: cannot be written to: ",
            "check AWS_ENDPOINT",
        ),
    ] {
        assert!(message.starts_with(start) && message.contains(expected) && !message.contains('\n'), "{message}");
    }
}
