//! The folder of a training in blocks.
//!
//! `blocks.json` has the plan, `starts/N.ply` the Gaussians that block N begins with, `runs` the records, claims and
//! checkpoints of the blocks, and `scenes/N.ply` their results. Blocks are counted from 1 in names and messages.

use std::{
    fmt, fs,
    path::{Path, PathBuf},
};

use gs_core::{Camera, Optimizer, RenderSettings, Scene as _, Scene3d, counted};
use gs_io::{TrainedWith, WorldFrame, WriteOptions3d, read_3d, write_3d, write_durably};
use gs_jobs::{
    Claims, Holder, JobStore, Keep, WorkSettings,
    files::{self, RUNS},
};
use gs_train::{
    blocks::{BlockPlan, BlockView, BlocksPlan, block_views, own},
    limits::Speed,
    train::{Start, Views},
};
use serde::{Deserialize, Serialize};

use crate::{
    error::Error,
    run::Job,
    study::{Machine, VERSION, digest},
};

const PLAN: &str = "blocks.json";
const STARTS: &str = "starts";
const SCENES: &str = "scenes";

/// What a training in blocks was prepared from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct BlocksOrigin {
    /// The machine whose backend all blocks use.
    pub machine: Machine,
    /// The data set's path.
    pub dataset: PathBuf,
    /// How the data set is read, in the form of who reads it.
    pub reading: serde_json::Value,
    /// The frame of cameras and scene.
    pub frame: WorldFrame,
}

/// The content of `blocks.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Content {
    version: String,
    origin: BlocksOrigin,
    /// Digests of the Gaussians that the blocks begin with.
    starts: Vec<String>,
    plan: BlocksPlan,
}

/// How the training of a block ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "outcome", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum BlockOutcome {
    /// It has a result.
    Finished {
        /// Number of Gaussians of the result.
        gaussians: usize,
        /// Steps done.
        steps: u32,
        /// Training time, s.
        seconds: f64,
        /// Digest of the result.
        scene: String,
    },
    /// It failed, and would fail again.
    Failed {
        /// Why.
        error: String,
    },
}

/// A block by its number from 0.
impl Job for usize {
    type Outcome = BlockOutcome;
}

impl fmt::Display for BlockOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Finished { gaussians, seconds, .. } => {
                write!(f, "{} after {seconds:.1} s", counted(*gaussians, "Gaussian"))
            }
            Self::Failed { error } => write!(f, "failed: {error}"),
        }
    }
}

/// The record of a block.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BlockRecord {
    /// The address of the job.
    pub address: String,
    /// How it ended.
    #[serde(flatten)]
    pub outcome: BlockOutcome,
}

/// The folder of a training in blocks. Any number of processes may do its blocks at the same time.
#[derive(Debug)]
pub struct BlocksFolder {
    path: PathBuf,
    store: JobStore,
    content: Content,
    addresses: Vec<String>,
}

/// Stores what blocks begin with, while a plan is made.
#[derive(Debug)]
pub struct Preparing {
    path: PathBuf,
    options: WriteOptions3d,
    starts: Vec<String>,
    /// The most blocks of any plan that was tried.
    stored: usize,
}

impl Preparing {
    /// Stores the Gaussians that a block begins with. Block 0 begins another plan.
    ///
    /// # Errors
    /// Those of writing a scene.
    pub fn store(&mut self, block: usize, scene: &Scene3d) -> Result<(), gs_io::Error> {
        self.stored = self.stored.max(block + 1);
        write_3d(self.path.join(ply(STARTS, block)), scene, &self.options)?;
        self.starts.truncate(block);
        self.starts.push(digest::of_scene_3d(scene));
        Ok(())
    }

    /// Ends the preparation without a plan: removes what was stored.
    pub fn abandon(&self) {
        self.remove_from(0);
    }

    /// Removes what was stored for this block and later ones.
    fn remove_from(&self, first: usize) {
        (first..self.stored).for_each(|block| _ = fs::remove_file(self.path.join(ply(STARTS, block))));
    }

    /// Ends the preparation by storing the plan.
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be written.
    pub fn finish(self, origin: BlocksOrigin, plan: BlocksPlan) -> Result<BlocksFolder, Error> {
        self.remove_from(self.starts.len());
        let content = Content { version: VERSION.to_owned(), origin, starts: self.starts, plan };
        let text = serde_json::to_string_pretty(&content).unwrap_or_default() + "\n";
        write_durably(self.path.join(PLAN), |file| file.write_all(text.as_bytes()))?;
        Ok(BlocksFolder::of(self.path, content))
    }
}

/// The options to write scenes with that are drawn with these settings.
fn write_options(render: &RenderSettings, origin: &BlocksOrigin) -> WriteOptions3d {
    let trained_with = TrainedWith::default().with(|s| {
        s.antialias = Some(render.effects.antialias);
        s.order = Some(render.effects.order);
        s.frame = origin.frame;
    });
    WriteOptions3d::default().with(|s| s.trained_with = trained_with)
}

fn ply(folder: &str, block: usize) -> String {
    format!("{folder}/{}.ply", block + 1)
}

impl BlocksFolder {
    /// The subfolders for what blocks begin with, their results, and their records.
    pub const FOLDERS: [&str; 3] = [STARTS, SCENES, RUNS];

    /// Begins to prepare a folder in which there are no blocks yet. `render` draws the scenes.
    ///
    /// # Errors
    /// [`Error::Folder`] where there are; [`Error::Path`] where it cannot be made.
    pub fn prepare(path: &Path, render: &RenderSettings, origin: &BlocksOrigin) -> Result<Preparing, Error> {
        Self::refuse_existing(path)?;
        for part in Self::FOLDERS {
            let part = path.join(part);
            fs::create_dir_all(&part).map_err(|source| Error::Path { path: part, source })?;
        }
        let options = write_options(render, origin);
        Ok(Preparing { path: path.to_owned(), options, starts: Vec::new(), stored: 0 })
    }

    /// Fails where a folder contains blocks.
    ///
    /// # Errors
    /// [`Error::Folder`].
    pub fn refuse_existing(path: &Path) -> Result<(), Error> {
        match path.join(PLAN).exists() {
            false => Ok(()),
            true => Err(Error::Folder {
                folder: path.to_owned(),
                what: "contains blocks already".to_owned(),
                hint: "do them with gs blocks work, or choose another folder with --output",
            }),
        }
    }

    /// Opens the folder of blocks.
    ///
    /// # Errors
    /// [`Error::Folder`] where there are none in it, and where they were prepared by another version of the program.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let wrong = |what: String, hint| Error::Folder { folder: path.to_owned(), what, hint };
        let text = fs::read(path.join(PLAN)).map_err(|error| {
            wrong(
                format!("contains no blocks: {PLAN} cannot be read ({error})"),
                "name the --output of a gs blocks prepare",
            )
        })?;
        let damaged =
            |error| wrong(format!("{PLAN} is damaged ({error})"), "prepare the blocks again in another folder");
        let any: serde_json::Value = serde_json::from_slice(&text).map_err(damaged)?;
        let version = any["version"].as_str().unwrap_or("(not stored)");
        if version != VERSION {
            let what = format!("was prepared by version {version} of gs, but this is {VERSION}");
            return Err(wrong(what, "use that version, or prepare the blocks again in another folder"));
        }
        Ok(Self::of(path.to_owned(), serde_json::from_slice(&text).map_err(damaged)?))
    }

    fn of(path: PathBuf, content: Content) -> Self {
        let plan = &content.plan;
        let address = |(block, start): (&BlockPlan, &String)| {
            let views: Vec<_> = block.views.iter().map(|view| &plan.views[view.view]).collect();
            let parts = (&plan.settings, &plan.ground, &content.origin.reading, block, views);
            let parts = serde_json::to_string(&parts).unwrap_or_default();
            digest::of_texts([VERSION, &content.origin.machine.name, start, &parts])
        };
        let addresses = plan.blocks.iter().zip(&content.starts).map(address).collect();
        Self { store: JobStore::new(&path), path, content, addresses }
    }

    /// Fails where another machine's results would not be those of the machine that the blocks were prepared for.
    ///
    /// # Errors
    /// [`Error::Folder`] with the difference.
    pub fn check(&self, machine: &Machine) -> Result<(), Error> {
        let prepared = &self.content.origin.machine.name;
        if *prepared == machine.name {
            return Ok(());
        }
        let what = format!("was prepared for {prepared}, but this is {}", machine.name);
        let hint = "blocks have one backend and SIMD level for all machines: leave out flags that choose others";
        Err(Error::Folder { folder: self.path.clone(), what, hint })
    }

    /// The plan.
    pub fn plan(&self) -> &BlocksPlan {
        &self.content.plan
    }

    /// What the blocks were prepared from.
    pub fn origin(&self) -> &BlocksOrigin {
        &self.content.origin
    }

    /// The folder's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn store(&self) -> &JobStore {
        &self.store
    }

    pub(super) fn addresses(&self) -> &[String] {
        &self.addresses
    }

    /// The options to write its scenes with.
    pub fn write_options(&self) -> WriteOptions3d {
        write_options(&self.plan().settings.render, &self.content.origin)
    }

    /// The Gaussians that a block begins with.
    ///
    /// # Errors
    /// [`Error::Io`] where they cannot be read, [`Error::Folder`] where they have changed.
    pub fn start(&self, block: usize) -> Result<Scene3d, Error> {
        self.scene(&ply(STARTS, block), &self.content.starts[block], "prepare the blocks again in another folder")
    }

    /// Seconds that the training of each block is expected to take with this backend, by a trial of about `most_seconds`
    /// on the block that takes most memory. `views` has all views of the data set, at the size for the blocks.
    ///
    /// # Errors
    /// Those of [`Self::start`], of reading images and of training.
    pub async fn expected_seconds<R: Optimizer<Scene3d>>(
        &self,
        on: &R,
        views: &Views,
        most_seconds: f64,
    ) -> Result<Vec<f64>, Error> {
        let plan = self.plan();
        let blocks = 0..plan.blocks.len();
        let tried = blocks.clone().max_by_key(|&block| plan.blocks[block].memory).unwrap_or_default();
        // The trial begins with fewer Gaussians, so the first ones are not those that are fixed.
        let settings = plan.settings_of(tried).with(|s| s.fixed = 0);
        let (start, views_of_trial) = (Start::Scene(self.start(tried)?), block_views(plan, tried, views)?);
        let speed = Speed::measure(on, views_of_trial, start, &settings, most_seconds).await?;
        let pixels = |block: &BlockPlan| {
            let of_view = |used: &BlockView| {
                let Camera { width, height, .. } = views.train[used.view].camera;
                let (width, height) = used.window.map_or((width, height), |window| (window.width, window.height));
                f64::from(width) * f64::from(height)
            };
            block.views.iter().map(of_view).sum::<f64>() / block.views.len() as f64
        };
        let seconds = |block: usize| {
            let (settings, block) = (plan.settings_of(block), &plan.blocks[block]);
            let first = (block.fixed + block.own) as usize;
            let speed = speed.with_views(first, block.views.len(), pixels(block) / pixels(&plan.blocks[tried]));
            speed.seconds(&settings, [0, 0])
        };
        Ok(blocks.map(seconds).collect())
    }

    fn scene(&self, name: &str, expected: &str, hint: &'static str) -> Result<Scene3d, Error> {
        let scene = read_3d(self.path.join(name))?.scene.with_degree(self.plan().settings.render.effects.sh_degree);
        match digest::of_scene_3d(&scene) == expected {
            true => Ok(scene),
            false => {
                Err(Error::Folder { folder: self.path.join(name), what: "is not what was stored".to_owned(), hint })
            }
        }
    }

    /// The record of a block, if it has ended. One that is damaged counts as missing.
    ///
    /// # Errors
    /// [`Error::Jobs`] where it cannot be read.
    pub fn record(&self, block: usize) -> Result<Option<BlockRecord>, Error> {
        let Some(text) = self.store.read(&files::record(&self.addresses[block]))? else { return Ok(None) };
        let record = serde_json::from_slice::<BlockRecord>(&text).ok();
        Ok(record.filter(|record| record.address == self.addresses[block]))
    }

    /// Stores the result of a block, then its record. If another process has ended the block, its result stays. A block
    /// without a Gaussian of its own has no file.
    ///
    /// # Errors
    /// [`Error::Folder`] where the other process came to another result; those of writing.
    pub(crate) fn store_result(
        &self,
        block: usize,
        steps: u32,
        seconds: f64,
        scene: Scene3d,
    ) -> Result<BlockOutcome, Error> {
        let result = own(self.plan(), block, scene);
        let found = digest::of_scene_3d(&result);
        if let Some(ended @ BlockOutcome::Finished { .. }) = self.outcome(block)? {
            return match ended {
                BlockOutcome::Finished { scene: recorded, .. } if recorded != found => {
                    let what = format!(
                        "has another result (scene {recorded}) than this process found ({found}), though nothing that \
                         is known differs"
                    );
                    let hint = "repeat it on both machines in other folders, and leave out the one that is wrong";
                    Err(Error::Folder { folder: self.path.join(ply(SCENES, block)), what, hint })
                }
                ended => Ok(ended),
            };
        }
        if !result.is_empty() {
            write_3d(self.path.join(ply(SCENES, block)), &result, &self.write_options())?;
        }
        let outcome = BlockOutcome::Finished { gaussians: result.len(), steps, seconds, scene: found };
        self.store_outcome(block, outcome)
    }

    /// Stores how a block ended, and returns it. If another process has finished the block, that stays, and is returned.
    pub(crate) fn store_outcome(&self, block: usize, outcome: BlockOutcome) -> Result<BlockOutcome, Error> {
        if let Some(finished @ BlockOutcome::Finished { .. }) = self.outcome(block)? {
            return Ok(finished);
        }
        let record = BlockRecord { address: self.addresses[block].clone(), outcome };
        let name = files::record(&record.address);
        self.store.write(&name, Keep::AfterPowerCut, &mut |file| Ok(serde_json::to_writer(file, &record)?))?;
        Ok(record.outcome)
    }

    fn outcome(&self, block: usize) -> Result<Option<BlockOutcome>, Error> {
        Ok(self.record(block)?.map(|record| record.outcome))
    }

    /// Removes the records of blocks that failed, and of those whose record or scene is damaged, so that the blocks are
    /// done again, and what processes that died have left.
    ///
    /// # Errors
    /// [`Error::Jobs`] where the folder cannot be read or written to.
    pub fn forget_failures(&self) -> Result<(), Error> {
        self.claims().sweep()?;
        for (block, address) in self.addresses.iter().enumerate() {
            // A block that has no record may just be getting one.
            let has_record = self.store.read(&files::record(address))?.is_some();
            if has_record && self.finished(block)?.is_none_or(|scene| scene.is_err()) {
                self.store.remove(&files::record(address))?;
            }
        }
        Ok(())
    }

    fn claims(&self) -> Claims {
        let settings = WorkSettings::default();
        Claims::new(self.store.clone(), settings.worker, settings.lease)
    }

    /// Who is doing each block that has not ended, `[blocks]`; `None` for blocks that nobody has claimed.
    ///
    /// # Errors
    /// [`Error::Jobs`] where the folder cannot be read.
    pub fn running(&self) -> Result<Vec<Option<Holder>>, Error> {
        Ok(self.claims().holders(self.addresses.iter().map(String::as_str))?)
    }

    /// The numbers of Gaussians of all blocks' results.
    ///
    /// # Errors
    /// [`Error::Folder`] where a block has no result; [`Error::Jobs`] where a record cannot be read.
    pub fn counts(&self) -> Result<Vec<usize>, Error> {
        let count = |block: usize| match self.outcome(block)? {
            Some(BlockOutcome::Finished { gaussians, .. }) => Ok(gaussians),
            Some(BlockOutcome::Failed { error }) => {
                Err(self.unfinished(format!("block {} failed: {error}", block + 1)))
            }
            None => Err(self.unfinished(format!("block {} has not been done", block + 1))),
        };
        (0..self.addresses.len()).map(count).collect()
    }

    /// The result of a block: its Gaussians of the whole scene.
    ///
    /// # Errors
    /// [`Error::Folder`] where the block has no result; [`Error::Io`] where it cannot be read.
    pub fn result(&self, block: usize) -> Result<Scene3d, Error> {
        let none = || self.unfinished(format!("block {} has no result", block + 1));
        self.finished(block)?.ok_or_else(none)?
    }

    /// The scene of all blocks, in their order.
    ///
    /// # Errors
    /// Those of [`Self::counts`] and [`Self::result`].
    pub fn merged(&self) -> Result<Scene3d, Error> {
        let mut merged = self.nothing();
        for block in 0..self.counts()?.len() {
            merged.append(self.result(block)?);
        }
        Ok(merged)
    }

    fn unfinished(&self, what: String) -> Error {
        Error::Folder { folder: self.path.clone(), what, hint: "do it with gs blocks work --retry" }
    }

    /// A scene without a Gaussian.
    fn nothing(&self) -> Scene3d {
        Scene3d { sh_degree: self.plan().settings.render.effects.sh_degree, ..Scene3d::default() }
    }

    /// The Gaussians of a finished block; `None` for others. The inner error is that of reading them.
    fn finished(&self, block: usize) -> Result<Option<Result<Scene3d, Error>>, Error> {
        Ok(match self.outcome(block)? {
            Some(BlockOutcome::Finished { gaussians: 0, .. }) => Some(Ok(self.nothing())),
            Some(BlockOutcome::Finished { scene, .. }) => {
                Some(self.scene(&ply(SCENES, block), &scene, "do the block again with gs blocks work --retry"))
            }
            _ => None,
        })
    }
}
