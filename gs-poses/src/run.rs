//! Finds poses in a folder, stage by stage.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use gs_io::OutputFolder;
use serde::{Deserialize, Serialize};

use crate::{
    colmap::{
        Arguments, Colmap, Compared, Place,
        process::{Log, features_in, finds_nothing, fraction, lacks_tree},
    },
    error::Error,
    gps::align,
    input::Input,
    input::photographs::{Exif, Identity, Photograph, Photographs, identity},
    inspection::why_none,
    model::{self, Model, models_in},
    plan::{OVERLAP, Plan, pairs_by_time},
    reporter::{Reporter, Stage},
    settings::Settings,
    upright::upright,
    verdict::Verdict,
    work::{FILES, WORK, remove},
};

/// What is done, in [`WORK`].
const STATE: &str = "state.json";

/// Share of the photographs with a pose below which a second, more thorough attempt is made.
const ENOUGH: f64 = 0.8;

/// Share of the poses of a first attempt, by matches in one direction, that a second attempt must have to be taken:
/// its matches are mutual, so that its poses are right more often.
const TRUSTED: f64 = 0.7;

/// Images that two pieces must share to be joined.
const SHARED: usize = 3;

/// Files that are put into the data set between two writes of its index, which lists all of them.
const BLOCK: usize = 256;

/// What is done, for a run that resumes it.
#[derive(Debug, Serialize, Deserialize, PartialEq)]
struct State {
    /// The photographs by name, size and time, and the choices.
    photographs: Vec<Identity>,
    plan: Plan,
    extracted: bool,
    matched: bool,
}

/// What is stored as `poses.json`.
#[derive(Debug, Serialize, Deserialize)]
struct Stored {
    verdict: Verdict,
    /// As in [`State`].
    photographs: Vec<Identity>,
}

/// Finds the poses of photographs and makes a data set of them: `images` (links where the file system has
/// them, else copies; frames of a video), `masks`, and the model in `sparse/0`, whose −y is up. `poses.json` has the
/// verdict, and `poses.log` all that COLMAP said.
///
/// The folder must have claimed [`FILES`]. With `resume`, stages that an earlier run finished for the same
/// photographs and settings are not repeated, nor is anything where it found the poses.
///
/// # Errors
/// Those of COLMAP, of its model, of the video and of the files; [`Error::NoPoses`] where there are none to be
/// found.
pub fn find_poses(
    input: &Input,
    settings: &Settings,
    colmap: &Colmap,
    (folder, resume): (&OutputFolder, bool),
    reporter: &mut dyn Reporter,
) -> Result<Verdict, Error> {
    let photographs = &input.photographs((folder, resume), reporter)?;
    photographs.left_out.iter().for_each(|what| reporter.note(&format!("left out: {what}")));
    if let Some(verdict) = found_before(photographs, folder.path()).filter(|_| resume) {
        // Photographs may have been converted in it.
        let _ = fs::remove_dir(folder.path().join(WORK));
        return Ok(verdict);
    }
    if colmap.is_slow() {
        let version = colmap.version();
        reporter.note(&format!("COLMAP {version} compares photographs 4 to 6 times more slowly than 4.1.1 does"));
    }
    let root = std::path::absolute(folder.path()).map_err(Error::at(folder.path()))?;
    let work = root.join(WORK);
    let plan = Plan::new(&photographs.files, settings, colmap.pace());
    let mut state = State { photographs: identities(&photographs.files), plan, extracted: false, matched: false };
    let stored = fs::read(work.join(STATE)).ok().and_then(|bytes| serde_json::from_slice::<State>(&bytes).ok());
    let is_same = |stored: &State| stored.photographs == state.photographs && stored.plan == state.plan;
    let is_resumed = resume && stored.as_ref().is_some_and(is_same);
    match stored.filter(|_| is_resumed) {
        Some(stored) => state = stored,
        None => remove(&work)?,
    }
    fs::create_dir_all(&work).map_err(Error::at(&work))?;
    let masked = place_files(photographs, folder)?;
    let log = Log::open(folder.file(FILES[1]), is_resumed)?;
    let mut run = Run { photographs, settings, colmap, root, work, masked, log, reporter };
    let models = run.models(state)?;
    run.finish(models, folder)
}

/// Fails where the folder has a model that [`find_poses`] would not replace: it would still be read.
///
/// # Errors
/// [`Error::HasPoses`].
pub fn refuse_other_models(folder: &Path) -> Result<(), Error> {
    let names = [
        "transforms.json",
        "transforms_train.json",
        "cameras.txt",
        "cameras.bin",
        "sparse/cameras.bin",
        "sparse/0/cameras.txt",
    ];
    let mut files = names.iter().map(|name| folder.join(name));
    files.find(|file| fs::symlink_metadata(file).is_ok()).map_or(Ok(()), |path| Err(Error::HasPoses { path }))
}

/// The verdict on these photographs of an earlier run that is finished.
fn found_before(photographs: &Photographs, folder: &Path) -> Option<Verdict> {
    let stored: Stored = serde_json::from_slice(&fs::read(folder.join(FILES[0])).ok()?).ok()?;
    let is_there = FILES[2..].iter().all(|name| folder.join(name).is_file());
    (is_there && stored.photographs == identities(&photographs.files)).then_some(stored.verdict)
}

/// Name, size and time of photographs.
fn identities(photographs: &[Photograph]) -> Vec<Identity> {
    photographs.iter().map(|photograph| identity(&photograph.name, &photograph.path)).collect()
}

/// Puts the photographs and masks into the data set; returns whether there are masks.
fn place_files(photographs: &Photographs, folder: &OutputFolder) -> Result<bool, Error> {
    let images = photographs.files.iter().map(|photograph| (format!("images/{}", photograph.name), &photograph.path));
    let mask = |photograph: &'_ Photograph| Some((format!("masks/{}.png", photograph.name), photograph.mask.clone()?));
    let masks: Vec<(String, PathBuf)> = photographs.files.iter().filter_map(mask).collect();
    let mut wanted: BTreeMap<String, &PathBuf> =
        images.chain(masks.iter().map(|(name, path)| (name.clone(), path))).collect();
    for stale in ["images/", "masks/"].iter().flat_map(|part| folder.claimed(part)) {
        if !wanted.contains_key(&stale) {
            folder.remove(&stale)?;
        }
    }
    wanted.retain(|name, path| !is_placed(&folder.path().join(name), path));
    folder.claim(wanted.keys().cloned())?;
    for block in wanted.into_iter().collect::<Vec<_>>().chunks(BLOCK) {
        folder.announce(block.iter().map(|(name, _)| name.clone()));
        block.iter().try_for_each(|(name, path)| place_file(folder, name, path))?;
    }
    Ok(!masks.is_empty())
}

/// Whether a file is in its place already, as a link or a copy.
fn is_placed(target: &Path, path: &Path) -> bool {
    let is_same_copy = || {
        let (old, new) = (fs::metadata(target).ok()?, fs::metadata(path).ok()?);
        Some(old.len() == new.len() && fs::read(target).ok()? == fs::read(path).ok()?)
    };
    gs_io::Inputs::from_iter([path]).contain(target) || is_same_copy() == Some(true)
}

/// Puts a file into the data set as a link or a copy.
fn place_file(folder: &OutputFolder, name: &str, path: &Path) -> Result<(), Error> {
    let target = folder.file(name);
    if let Some(parent) = target.parent() {
        fs::create_dir_all(parent).map_err(Error::at(parent))?;
    }
    folder.remove(name)?;
    if fs::hard_link(path, &target).is_ok() {
        return Ok(());
    }
    let mut source = fs::File::open(path).map_err(Error::at(path))?;
    Ok(gs_io::write_atomically(target, |mut file| std::io::copy(&mut source, &mut file).map(drop))?)
}

/// A run of COLMAP.
struct Run<'a> {
    photographs: &'a Photographs,
    settings: &'a Settings,
    colmap: &'a Colmap,
    root: PathBuf,
    work: PathBuf,
    /// Whether there are masks.
    masked: bool,
    log: Log,
    reporter: &'a mut dyn Reporter,
}

impl Run<'_> {
    /// The models of the photographs, the largest first, after a second, more thorough attempt where the first
    /// finds few poses.
    fn models(&mut self, mut state: State) -> Result<Vec<Model>, Error> {
        let count = self.photographs.files.len() as f64;
        let share = |models: &[Model]| models.first().map_or(0.0, |model| model.images.len() as f64 / count);
        let names = |model: &'_ Model| model.images.iter().map(|image| image.name.clone()).collect::<Vec<_>>();
        let in_any = |models: &[Model]| models.iter().flat_map(names).collect::<BTreeSet<_>>().len() as f64 / count;
        let database = self.work.join("database.db");
        self.attempt(&mut state, &database, 0)?;
        let mut models = self.map(&state.plan, &database, 0)?;
        let features = self.mean_features();
        if in_any(&models) < ENOUGH && features >= 1.0 {
            self.reporter.note("few photographs have poses so far: trying again more thoroughly");
            let least = if self.colmap.looks_one_way(&state.plan) { TRUSTED * share(&models) } else { share(&models) };
            let registered = models.first().map_or(&[][..], |model| &model.images);
            let mut thorough =
                State { plan: state.plan.thorough(registered), extracted: false, matched: false, ..state };
            let database = self.work.join("thorough.db");
            self.attempt(&mut thorough, &database, 1)?;
            let second = self.map(&thorough.plan, &database, 1)?;
            if share(&second) > least {
                models = second;
            }
        }
        match models.is_empty() {
            false => Ok(models),
            true => Err(Error::NoPoses {
                folder: self.photographs.folder.clone(),
                why: why_none(self.photographs, features),
                log: self.log.path.clone(),
            }),
        }
    }

    /// Mean number of features of a photograph.
    fn mean_features(&self) -> f64 {
        let features = features_in(&self.log.path);
        features.values().map(|count| f64::from(*count)).sum::<f64>() / features.len().max(1) as f64
    }

    /// Finds features and compares the photographs, as far as that is not done.
    fn attempt(&mut self, state: &mut State, database: &Path, attempt: usize) -> Result<(), Error> {
        let (images, masks, none) = (self.root.join("images"), self.root.join("masks"), PathBuf::new());
        let place = Place { database, images: &images, masks: &masks, models: &none };
        if !state.extracted {
            let total = state.plan.photographs();
            let mut before = 0;
            for (number, group) in state.plan.groups.iter().enumerate() {
                let list = self.work.join(format!("camera-{number}.txt"));
                fs::write(&list, group.names.join("\n") + "\n").map_err(Error::at(&list))?;
                let camera = (group, list.as_path(), self.masked);
                let arguments = self.colmap.extract(&place, &state.plan, camera, self.settings);
                let shown =
                    |line: &str| Some((before + fraction(line).filter(|_| line.contains("rocessed file"))?.0, total));
                self.run(&arguments, Stage::Features, shown)?;
                before += group.names.len();
            }
            state.extracted = true;
            self.store(state, attempt)?;
        }
        if !state.matched {
            if state.plan.all_pairs {
                self.compare(&place, &state.plan, Compared::All)?;
            } else {
                self.compare_neighbours(&place, &state.plan, attempt)?;
            }
            state.matched = true;
            self.store(state, attempt)?;
        }
        Ok(())
    }

    /// Compares neighbours, and what looks alike if there is a vocabulary tree.
    fn compare_neighbours(&mut self, place: &Place<'_>, plan: &Plan, attempt: usize) -> Result<(), Error> {
        let by_time = pairs_by_time(&self.photographs.files);
        if let Some(pairs) = &by_time {
            let list = self.work.join("pairs.txt");
            fs::write(&list, pairs).map_err(Error::at(&list))?;
            self.compare(place, plan, Compared::Listed(&list))?;
        }
        // After those by time, neighbours by name are of no use, but COLMAP compares at least one.
        let overlap = if by_time.is_some() { 1 } else { OVERLAP };
        let is_named = self.settings.vocabulary.is_some();
        if is_named || self.colmap.fetches_tree() {
            match self.compare(place, plan, Compared::Neighbours { overlap, alike: true }) {
                Err(Error::Failed { said: Some(why), .. }) if !is_named && lacks_tree(&why) => {
                    if attempt == 0 {
                        self.reporter.note(&format!("COLMAP cannot use the vocabulary tree that it fetches: {why}"));
                    }
                }
                ended => return ended,
            }
        }
        if attempt == 0 {
            self.reporter.note(
                "photographs are compared with their neighbours only, and places visited twice are not recognised: \
                 gs poses --vocabulary FILE finds them by a vocabulary tree of COLMAP",
            );
        }
        match by_time {
            Some(_) => Ok(()),
            None => self.compare(place, plan, Compared::Neighbours { overlap, alike: false }),
        }
    }

    fn compare(&mut self, place: &Place<'_>, plan: &Plan, pairs: Compared<'_>) -> Result<(), Error> {
        let arguments = self.colmap.compare(place, plan, pairs, self.settings);
        let shown = |line: &str| fraction(line).filter(|_| line.contains("ing block") || line.contains("ing image"));
        self.run(&arguments, Stage::Matching, shown)
    }

    /// Finds the poses.
    fn map(&mut self, plan: &Plan, database: &Path, attempt: usize) -> Result<Vec<Model>, Error> {
        let (images, models) = (self.root.join("images"), self.work.join(format!("models-{attempt}")));
        remove(&models)?;
        fs::create_dir_all(&models).map_err(Error::at(&models))?;
        let place = Place { database, images: &images, masks: &images, models: &models };
        let arguments = self.colmap.map(&place, plan, attempt > 0, self.settings);
        let total = plan.photographs();
        let shown = |line: &str| Some((registered(line)?.min(total), total));
        match self.run(&arguments, Stage::Mapping, shown) {
            // Versions differ in whether finding nothing is a failure.
            Err(Error::Failed { said: Some(said), .. }) if finds_nothing(&said) => return Ok(Vec::new()),
            ended => ended?,
        }
        let found = models_in(&models)?;
        self.joined(found, &models)
    }

    /// The pieces, joined where they share photographs.
    fn joined(&mut self, mut found: Vec<Model>, models: &Path) -> Result<Vec<Model>, Error> {
        let mut at = 1;
        while at < found.len() {
            let has = |name: &str| found[0].images.iter().any(|image| image.name == name);
            let shared = found[at].images.iter().filter(|image| has(&image.name)).count();
            if shared < SHARED || shared == found[at].images.len() {
                at += 1;
                continue;
            }
            let [first, second, both] = ["a", "b", "both"].map(|name| models.join("joining").join(name));
            remove(&models.join("joining"))?;
            for (model, folder) in [(&found[0], &first), (&found[at], &second)] {
                fs::create_dir_all(folder).map_err(Error::at(folder))?;
                model.write(folder)?;
            }
            fs::create_dir_all(&both).map_err(Error::at(&both))?;
            let mut merge = Arguments::new("model_merger");
            merge.path("input_path1", &first).path("input_path2", &second).path("output_path", &both);
            let mut adjust = Arguments::new("bundle_adjuster");
            adjust.path("input_path", &both).path("output_path", &both);
            let joined =
                self.run(&merge, Stage::Joining, |_| None).and_then(|()| self.run(&adjust, Stage::Joining, |_| None));
            match joined.and_then(|()| Model::read(&both)) {
                Ok(model) if model.images.len() > found[0].images.len() => {
                    found[0] = model;
                    found.remove(at);
                }
                Err(error @ Error::Cancelled { .. }) => return Err(error),
                _ => at += 1,
            }
        }
        Ok(found)
    }

    fn run(
        &mut self,
        arguments: &Arguments,
        stage: Stage,
        progress: impl Fn(&str) -> Option<(usize, usize)>,
    ) -> Result<(), Error> {
        let reporter = std::cell::RefCell::new(&mut *self.reporter);
        reporter.borrow_mut().progress(stage, 0, self.photographs.files.len());
        let mut each = |line: &str| {
            if let Some((done, total)) = progress(line) {
                reporter.borrow_mut().progress(stage, done, total);
            }
        };
        let cancelled = || reporter.borrow().is_cancelled();
        self.log.run(&self.colmap.program, arguments, stage.words(), &mut each, &cancelled)
    }

    /// Stores what is done of the first attempt.
    fn store(&self, state: &State, attempt: usize) -> Result<(), Error> {
        if attempt > 0 {
            return Ok(());
        }
        let path = self.work.join(STATE);
        let text = serde_json::to_vec(state).unwrap_or_default();
        Ok(gs_io::write_durably(path, |file| file.write_all(&text))?)
    }

    /// Writes the largest model, upright, and the verdict, and removes the unfinished work.
    fn finish(self, mut models: Vec<Model>, folder: &OutputFolder) -> Result<Verdict, Error> {
        let exif: BTreeMap<&str, &Exif> =
            self.photographs.files.iter().map(|photograph| (&*photograph.name, &photograph.exif)).collect();
        let turn = upright(&models[0].images, |name| exif.get(name).map_or(1, |exif| exif.orientation));
        models[0].turn(turn, 1.0);
        let aligned = align(&models[0].images, |name| exif.get(name)?.gps);
        aligned.iter().for_each(|aligned| models[0].turn(aligned.rotation, aligned.scale));
        let features = features_in(&self.log.path);
        let mut verdict = Verdict::new(self.photographs, &models, &features, self.colmap.version());
        verdict.gps = aligned.map(|aligned| aligned.gps);
        let sparse = folder.path().join("sparse/0");
        fs::create_dir_all(&sparse).map_err(Error::at(&sparse))?;
        for (name, bytes) in models[0].files() {
            gs_io::write_atomically(folder.file(&format!("sparse/0/{name}")), |file| file.write_all(bytes))?;
        }
        let stored = Stored { verdict, photographs: identities(&self.photographs.files) };
        let text = serde_json::to_vec_pretty(&stored).unwrap_or_default();
        gs_io::write_durably(folder.file(FILES[0]), |file| file.write_all(&text))?;
        remove(&self.work)?;
        Ok(stored.verdict)
    }
}

/// Number of images in a line such as "Registering image #5 (4)" or "... (num_reg_frames=4)".
fn registered(line: &str) -> Option<usize> {
    let inside = line.strip_prefix("Registering image")?.split_once('(')?.1;
    let digits: String = inside.chars().skip_while(|c| !c.is_ascii_digit()).take_while(char::is_ascii_digit).collect();
    digits.parse().ok()
}

const _: () = assert!(model::FILES.len() + 2 == FILES.len());

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mapper_says_how_many_images_it_has() {
        assert_eq!(registered("Registering image #5 (4)"), Some(4));
        assert_eq!(registered("Registering image #12 (num_reg_frames=33)"), Some(33));
        assert_eq!((registered("Registering image #12"), registered("Retriangulation")), (None, None));
    }
}
