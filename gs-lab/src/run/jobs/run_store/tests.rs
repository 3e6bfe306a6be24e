//! Claims and studies in an object store: s3s-fs, a server of the crate s3s, on this machine.

use std::{
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::Duration,
};

use hyper::{
    Method, Response,
    body::Incoming,
    service::{Service, service_fn},
};
use hyper_util::rt::TokioIo;
use object_store::{RetryConfig, aws::AmazonS3Builder};
use s3s::{Body, auth::SimpleAuth, service::S3ServiceBuilder};
use tokio::{net::TcpListener, sync::RwLock};

use super::{objects::ObjectRuns, *};
use crate::{
    result::{Results, write_tables},
    run::{
        conduct::{Conducted, conduct},
        folder::{Existing, StudyFolder},
        jobs::{claims::tests::check_that_each_run_is_done_once, job_files::RUNS, system},
    },
    study::{Places, Plan, Study},
};

const BUCKET: &str = "studies";

/// A server with an empty bucket. Its thread ends with the process.
struct Server {
    /// Its files.
    _place: tempfile::TempDir,
    root: PathBuf,
    endpoint: String,
    /// Requests that it has answered.
    answered: Arc<AtomicUsize>,
}

impl Server {
    /// A server that loses the answer to every `losing`th request that writes: the object is written,
    /// and the client is told to try again.
    fn start(losing: Option<usize>) -> Self {
        let place = tempfile::tempdir().unwrap();
        let root = place.path().join("objects");
        std::fs::create_dir_all(root.join(BUCKET)).unwrap();
        let mut builder = S3ServiceBuilder::new(s3s_fs::FileSystem::new(&root).unwrap());
        builder.set_auth(SimpleAuth::from_single("key", "secret"));
        let service = builder.build();
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let endpoint = format!("http://{}", listener.local_addr().unwrap());
        let answered = Arc::new(AtomicUsize::new(0));
        let counter = answered.clone();
        thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
            runtime.block_on(async {
                let listener = TcpListener::from_std(listener).unwrap();
                // s3s-fs checks a condition and then writes: one at a time, as a server does.
                let turns = Arc::new(RwLock::new(()));
                let writes = Arc::new(AtomicUsize::new(0));
                loop {
                    let Ok((socket, _)) = listener.accept().await else { continue };
                    let (service, turns, writes, counter) =
                        (service.clone(), turns.clone(), writes.clone(), counter.clone());
                    let answer = service_fn(move |request: hyper::Request<Incoming>| {
                        let (service, turns, writes, counter) =
                            (service.clone(), turns.clone(), writes.clone(), counter.clone());
                        async move {
                            counter.fetch_add(1, Ordering::Relaxed);
                            let is_put = request.method() == Method::PUT;
                            if !is_put && request.method() != Method::DELETE {
                                let _turn = turns.read().await;
                                return Service::call(&service, request).await;
                            }
                            let _turn = turns.write().await;
                            let answer = Service::call(&service, request).await;
                            let count = writes.fetch_add(usize::from(is_put), Ordering::Relaxed) + 1;
                            match losing.is_some_and(|every| is_put && count.is_multiple_of(every)) {
                                true => Ok(Response::builder().status(503).body(Body::empty()).unwrap()),
                                false => answer,
                            }
                        }
                    });
                    tokio::spawn(async move {
                        let http = hyper::server::conn::http1::Builder::new();
                        let _ = http.serve_connection(TokioIo::new(socket), answer).await;
                    });
                }
            })
        });
        Self { _place: place, root, endpoint, answered }
    }

    fn builder(&self) -> AmazonS3Builder {
        let builder = AmazonS3Builder::new().with_endpoint(&self.endpoint).with_allow_http(true);
        builder.with_access_key_id("key").with_secret_access_key("secret")
    }

    fn store(&self, prefix: &str) -> Arc<dyn RunStore> {
        Arc::new(ObjectRuns::on(&address(prefix), self.builder()).unwrap())
    }
}

fn address(prefix: &str) -> StoreAddress {
    format!("s3://{BUCKET}/{prefix}").parse().unwrap()
}

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
fn the_tables_of_a_study_in_an_object_store_are_those_of_one_in_a_folder() {
    let text = "name = 'x'\nimages = ['paper-64px']\nbudgets = [40]\nseeds = [0, 1]\npreset = 'paper'\niterations = 60\n\
        [[arm]]\nname = 'none'\nsettings.policy.kind = 'none'\n[[arm]]\nname = 'grown'\nsettings.policy.kind = 'percentile'\n";
    let plan = Plan::new(Study::from_toml(text, "x.toml").unwrap(), &Places::default(), "test").unwrap();
    let place = tempfile::tempdir().unwrap();
    let server = Server::start(None);
    let cpu = || gs_cpu::CpuRasterizer::new(gs_cpu::CpuSettings::default().with(|s| s.threads = Some(1))).unwrap();
    let prepared = |name: &str| StudyFolder::prepare(&place.path().join(name), &plan, Existing::Refuse).unwrap();
    let (alone, shared) = (prepared("alone"), prepared("shared").with_store(server.store("study")));
    assert_eq!(conduct(&plan, &[&cpu()], &alone, &()).unwrap(), Conducted::Whole);
    assert_eq!(conduct(&plan, &[&cpu(), &cpu()], &shared, &()).unwrap(), Conducted::Whole);
    let written = |folder: &StudyFolder| {
        let results = Results::read(&plan, folder).unwrap();
        assert!(results.is_whole());
        write_tables(&results, folder).unwrap();
        crate::report::write(&results, folder, "gs study x.toml").unwrap();
        let read = |name: &str| std::fs::read_to_string(folder.file(name)).unwrap();
        let page = read("report.html");
        (["runs.csv", "quality.csv", "differences.csv", "results.json"].map(read), page.matches("src=\"data:").count())
    };
    assert_eq!(written(&shared), written(&alone));
    assert_eq!(std::fs::read_dir(shared.file(RUNS)).unwrap().count(), 0);
    assert_eq!(shared.ended().unwrap().len(), 4);
    shared.sweep().unwrap();
    assert_eq!(server.store("study").names(RUNS).unwrap().len(), 4, "records and nothing else");
}

#[test]
fn what_is_wrong_with_a_store_is_said_in_one_line() {
    let server = Server::start(None);
    let quick = RetryConfig { max_retries: 0, ..RetryConfig::default() };
    let failed = |bucket: &str, builder: AmazonS3Builder| {
        let address: StoreAddress = format!("s3://{bucket}/x").parse().unwrap();
        ObjectRuns::check_on(&address, builder.with_retry(quick.clone())).unwrap_err().to_string()
    };
    for (message, start, expected) in [
        (
            failed("none", server.builder()),
            "s3://none/x: cannot be written to: ",
            "is there such a bucket at AWS_ENDPOINT?",
        ),
        (
            failed(BUCKET, server.builder().with_secret_access_key("wrong")),
            "s3://studies/x: cannot be written to: SignatureDoesNotMatch",
            "check AWS_ACCESS_KEY_ID",
        ),
        (
            failed(BUCKET, server.builder().with_endpoint("http://127.0.0.1:9")),
            "s3://studies/x: cannot be written to: ",
            "check AWS_ENDPOINT",
        ),
    ] {
        assert!(message.starts_with(start) && message.contains(expected) && !message.contains('\n'), "{message}");
    }
}
