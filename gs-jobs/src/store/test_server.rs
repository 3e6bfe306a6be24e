//! An object store for tests: s3s-fs, a server of the crate s3s, on this machine.

use std::{
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

use hyper::{
    Method, Response,
    body::Incoming,
    service::{Service, service_fn},
};
use hyper_util::rt::TokioIo;
use object_store::aws::AmazonS3Builder;
use s3s::{Body, auth::SimpleAuth, service::S3ServiceBuilder};
use tokio::{net::TcpListener, sync::RwLock};

use super::{JobStore, StoreAddress, objects::ObjectRuns};

/// The server's bucket.
pub(super) const BUCKET: &str = "studies";

/// A server with an empty bucket. Its thread ends with the process.
#[derive(Debug)]
pub struct Server {
    _place: tempfile::TempDir,
    /// The folder of its buckets.
    pub root: PathBuf,
    endpoint: String,
    /// Requests that it has answered.
    pub answered: Arc<AtomicUsize>,
}

impl Server {
    /// A server that loses the answer to every `losing`th request that writes: the object is written,
    /// and the client is told to try again.
    ///
    /// # Panics
    /// If no server can be started.
    pub fn start(losing: Option<usize>) -> Self {
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

    pub(super) fn builder(&self) -> AmazonS3Builder {
        let builder = AmazonS3Builder::new().with_endpoint(&self.endpoint).with_allow_http(true);
        builder.with_access_key_id("key").with_secret_access_key("secret")
    }

    /// A store with this prefix.
    ///
    /// # Panics
    /// If it cannot be opened.
    pub fn store(&self, prefix: &str) -> Arc<dyn JobStore> {
        Arc::new(ObjectRuns::on(&address(prefix), self.builder()).unwrap())
    }
}

/// The address of a prefix on the server.
pub(super) fn address(prefix: &str) -> StoreAddress {
    format!("s3://{BUCKET}/{prefix}").parse().unwrap()
}
