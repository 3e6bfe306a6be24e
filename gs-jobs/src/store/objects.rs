//! The files of jobs as objects of a store with the interface of Amazon's S3.
//!
//! A claim is created with `If-None-Match: *` and renewed with `If-Match` and the tag of its last
//! version, so the server decides who has it. Times are those that the server gives to objects.
//!
//! Nothing outside is asynchronous: each call waits for its answer on a runtime of this store, which
//! has no thread of its own.

use std::{
    fmt::Display,
    future::Future,
    io,
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, SystemTime},
};

use object_store::{
    ClientConfigKey, Error as ObjectError, GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt as _, PutMode,
    PutOptions, PutPayload, PutResult, RetryConfig, UpdateVersion, WriteMultipart,
    aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey},
    path::Path,
};
use tokio::runtime::Runtime;

use super::{Content, JobStore, Keep, Locked, OwnFile, Seen, StoreAddress};
use crate::{error::Error, system};

/// Requests at the same time: they wait for the network, not for a processor.
const WIDTH: usize = 32;

/// Servers round the times of objects down to whole seconds.
const RESOLUTION: Duration = Duration::from_secs(1);

/// Longest time without a byte of an answer.
const SILENCE: &str = "30 seconds";

/// Longest time for a request; a checkpoint may be large.
const LONGEST: &str = "10 minutes";

/// Content that is longer is sent in parts, bytes.
const ONE_PART: usize = 16 << 20;

/// A place in an object store.
#[derive(Debug)]
pub(super) struct ObjectRuns {
    address: StoreAddress,
    client: Arc<Client>,
}

/// A connection, and what waits for its answers.
#[derive(Debug)]
struct Client {
    store: AmazonS3,
    runtime: Runtime,
}

impl Client {
    fn wait<T>(&self, answer: impl Future<Output = T>) -> T {
        self.runtime.block_on(answer)
    }

    /// Creates an object, or replaces the version with this tag.
    fn put(&self, path: &Path, content: &[u8], mode: PutMode) -> Result<PutResult, ObjectError> {
        let payload = PutPayload::from(content.to_vec());
        self.wait(self.store.put_opts(path, payload, PutOptions::from(mode)))
    }

    /// The content of an object and its version; `None` where there is none.
    fn get(&self, path: &Path) -> Result<Option<(Vec<u8>, ObjectMeta)>, ObjectError> {
        self.wait(async {
            let found = self.store.get(path).await?;
            let meta = found.meta.clone();
            Ok((found.bytes().await?.to_vec(), meta))
        })
        .map(Some)
        .or_else(missing)
    }
}

impl ObjectRuns {
    /// Opens the store of an address. Credentials, region and endpoint are those of the environment:
    /// `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_REGION`, `AWS_ENDPOINT` and so on.
    pub(super) fn open(address: &StoreAddress) -> Result<Self, Error> {
        Self::on(address, AmazonS3Builder::from_env())
    }

    /// Fails where the store of an address cannot be reached, or does not keep two processes from
    /// creating the same object or from replacing a version that is gone.
    pub(super) fn check(address: &StoreAddress) -> Result<(), Error> {
        // A mistyped endpoint is not worth many attempts.
        let retry = RetryConfig { max_retries: 2, ..RetryConfig::default() };
        Self::check_on(address, AmazonS3Builder::from_env().with_retry(retry))
    }

    /// Opens the store of an address on a server.
    pub(super) fn on(address: &StoreAddress, server: AmazonS3Builder) -> Result<Self, Error> {
        let wrong = |what: String| Error::Store { place: address.to_string(), what };
        // Fails where the program has one already, which serves as well.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let with =
            |builder: AmazonS3Builder, key, time: &str| builder.with_config(AmazonS3ConfigKey::Client(key), time);
        let server = with(server, ClientConfigKey::ReadTimeout, SILENCE);
        let server = with(server, ClientConfigKey::Timeout, LONGEST);
        let store = server.with_bucket_name(address.bucket()).build().map_err(|error| wrong(words(&error)))?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|error| wrong(format!("cannot be used: {error}")))?;
        Ok(Self { address: address.clone(), client: Arc::new(Client { store, runtime }) })
    }

    /// [`Self::check`] on a server.
    pub(super) fn check_on(address: &StoreAddress, server: AmazonS3Builder) -> Result<(), Error> {
        let runs = Self::on(address, server)?;
        let path = runs.path(&format!("{}.probe", system::token()));
        let wrong = |error: &ObjectError| runs.failed("", "cannot be written to", error);
        let put = |content: &str, mode: PutMode| runs.client.put(&path, content.as_bytes(), mode);
        let first = put("1", PutMode::Create).map_err(|error| wrong(&error))?;
        let second = put("2", PutMode::Create);
        let current = put("3", PutMode::Update(version(&first)));
        let stale = put("4", PutMode::Update(version(&first)));
        let removed = runs.client.wait(runs.client.store.delete(&path));
        if second.is_ok() || stale.is_ok() {
            let what = "ignores If-None-Match or If-Match, so claims on runs would not be safe: use a server that has \
                        conditional writes";
            return Err(Error::Store { place: address.to_string(), what: what.to_owned() });
        }
        current.map_err(|error| wrong(&error))?;
        removed.map_err(|error| runs.failed("", "objects cannot be removed", &error))
    }

    fn path(&self, name: &str) -> Path {
        Path::from(format!("{}/{name}", self.address.prefix()))
    }

    fn failed(&self, name: &str, what: &str, error: &ObjectError) -> Error {
        let slash = if name.is_empty() { "" } else { "/" };
        Error::Store { place: format!("{}{slash}{name}", self.address), what: format!("{what}: {}", words(error)) }
    }
}

impl JobStore for ObjectRuns {
    fn create(&self, name: &str, content: &dyn Fn(Locked) -> Vec<u8>) -> Result<Option<Box<dyn OwnFile>>, Error> {
        let (path, content) = (self.path(name), content(Locked::No));
        let version = match self.client.put(&path, &content, PutMode::Create) {
            Ok(created) => version(&created),
            Err(error) => {
                // The answer to a request that succeeded may have been lost. No other process writes
                // the same content.
                let found = self.client.get(&path).map_err(|error| self.failed(name, "cannot be created", &error))?;
                match (found, error) {
                    (Some((held, meta)), _) if held == content => {
                        UpdateVersion { e_tag: meta.e_tag, version: meta.version }
                    }
                    (_, ObjectError::AlreadyExists { .. }) | (Some(_), _) => return Ok(None),
                    (None, error) => return Err(self.failed(name, "cannot be created", &error)),
                }
            }
        };
        Ok(Some(Box::new(OwnObject {
            client: self.client.clone(),
            path,
            state: Mutex::new(Version { version, content }),
        })))
    }

    fn has(&self, name: &str) -> Result<bool, Error> {
        let found = self.client.wait(self.client.store.head(&self.path(name))).map(Some).or_else(missing);
        Ok(found.map_err(|error| self.failed(name, "cannot be read", &error))?.is_some())
    }

    fn look(&self, name: &str) -> Result<Option<Seen>, Error> {
        let found = self.client.get(&self.path(name)).map_err(|error| self.failed(name, "cannot be read", &error))?;
        Ok(found.map(|(content, meta)| Seen { content, written: Some(meta.last_modified.into()), file: None }))
    }

    fn read(&self, name: &str) -> Result<Option<Vec<u8>>, Error> {
        let found = self.client.get(&self.path(name)).map_err(|error| self.failed(name, "cannot be read", &error))?;
        Ok(found.map(|(content, _)| content))
    }

    fn end(&self, name: &str, bytes: usize) -> Result<Option<Vec<u8>>, Error> {
        let range = GetOptions { range: Some(GetRange::Suffix(bytes as u64)), ..GetOptions::default() };
        let found = self.client.wait(async {
            let found = self.client.store.get_opts(&self.path(name), range).await?;
            Ok(found.bytes().await?.to_vec())
        });
        found.map(Some).or_else(missing).map_err(|error| self.failed(name, "cannot be read", &error))
    }

    fn write(&self, name: &str, _: Keep, content: &mut Content<'_>) -> Result<(), Error> {
        let mut bytes = Vec::new();
        content(&mut bytes).map_err(|error| Error::Store {
            place: format!("{}/{name}", self.address),
            what: format!("cannot be written: {error}"),
        })?;
        let (path, Client { store, .. }) = (self.path(name), &*self.client);
        let put = self.client.wait(async {
            if bytes.len() <= ONE_PART {
                return store.put(&path, PutPayload::from(bytes)).await;
            }
            let mut parts = WriteMultipart::new(store.put_multipart(&path).await?);
            parts.put(bytes.into());
            parts.finish().await
        });
        put.map(drop).map_err(|error| self.failed(name, "cannot be written", &error))
    }

    fn remove(&self, name: &str) -> Result<(), Error> {
        let removed = self.client.wait(self.client.store.delete(&self.path(name))).map(Some).or_else(missing);
        removed.map(drop).map_err(|error| self.failed(name, "cannot be removed", &error))
    }

    fn names(&self, folder: &str) -> Result<Vec<String>, Error> {
        let listed = self.client.wait(self.client.store.list_with_delimiter(Some(&self.path(folder))));
        let listed = listed.map_err(|error| self.failed(folder, "cannot be listed", &error))?;
        Ok(listed.objects.iter().filter_map(|object| Some(object.location.filename()?.to_owned())).collect())
    }

    /// The time of an object that is written now.
    fn now(&self, folder: &str) -> Result<SystemTime, Error> {
        let name = format!("{folder}/{}.now", system::token());
        let (path, Client { store, .. }) = (self.path(&name), &*self.client);
        let found = self.client.wait(async {
            store.put(&path, PutPayload::from_static(b"now")).await?;
            let found = store.head(&path).await;
            // The next report removes what is left.
            let _ = store.delete(&path).await;
            found
        });
        let found = found.map_err(|error| self.failed(&name, "cannot be written", &error))?;
        Ok(SystemTime::from(found.last_modified) - RESOLUTION)
    }

    fn system(&self) -> Option<String> {
        None
    }

    fn width(&self) -> Option<usize> {
        Some(WIDTH)
    }
}

/// An object that this process has created.
#[derive(Debug)]
struct OwnObject {
    client: Arc<Client>,
    path: Path,
    state: Mutex<Version>,
}

/// The last version of an object that this process knows.
#[derive(Debug)]
struct Version {
    version: UpdateVersion,
    content: Vec<u8>,
}

impl OwnFile for OwnObject {
    fn locked(&self) -> Locked {
        Locked::No
    }

    fn rewrite(&self, content: &[u8]) -> io::Result<()> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let put = |version: &UpdateVersion| self.client.put(&self.path, content, PutMode::Update(version.clone()));
        let mut written = put(&state.version);
        if written.is_err() {
            // The answer to an earlier request may have been lost, so that the object has a version of
            // this process that it does not know of.
            let found = self.client.get(&self.path).map_err(io::Error::other)?;
            if let Some((held, meta)) = found.filter(|(held, _)| *held == state.content || held == content) {
                state.version = UpdateVersion { e_tag: meta.e_tag, version: meta.version };
                if held == content && content != state.content {
                    state.content = held;
                    return Ok(());
                }
                written = put(&state.version);
            }
        }
        let written = written.map_err(io::Error::other)?;
        *state = Version { version: version(&written), content: content.to_vec() };
        Ok(())
    }
}

fn version(put: &PutResult) -> UpdateVersion {
    UpdateVersion { e_tag: put.e_tag.clone(), version: put.version.clone() }
}

/// An object that is missing is no error.
fn missing<T>(error: ObjectError) -> Result<Option<T>, ObjectError> {
    match error {
        ObjectError::NotFound { .. } => Ok(None),
        error => Err(error),
    }
}

/// An error in one line, with what to do.
fn words(error: &ObjectError) -> String {
    let text = error.to_string();
    let tagged = |tag: &str| {
        let (_, rest) = text.split_once(&format!("<{tag}>"))?;
        Some(rest.split_once('<')?.0.trim().to_owned())
    };
    let said = match (tagged("Code"), tagged("Message")) {
        (Some(code), Some(message)) => format!("{code}: {message}"),
        (Some(code), None) => code,
        _ => deepest(error),
    };
    let code = tagged("Code").unwrap_or_default();
    let hint = match error {
        ObjectError::NotFound { .. } => ": is there such a bucket at AWS_ENDPOINT?",
        _ if code == "RequestTimeTooSkewed" => ": set the clock of this machine",
        ObjectError::PermissionDenied { .. } | ObjectError::Unauthenticated { .. } => {
            ": check AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and what they allow"
        }
        ObjectError::Generic { .. } if code.is_empty() => {
            ": check AWS_ENDPOINT, AWS_REGION, AWS_ALLOW_HTTP for http, and the connection"
        }
        _ => "",
    };
    one_line(format_args!("{said}{hint}"))
}

/// The cause of an error that no other error has caused.
fn deepest(error: &dyn std::error::Error) -> String {
    let mut cause = error;
    while let Some(source) = cause.source() {
        cause = source;
    }
    cause.to_string()
}

fn one_line(text: impl Display) -> String {
    text.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}
