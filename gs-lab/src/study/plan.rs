//! The plan of a study: all its runs in a fixed order, each with all its settings and its address.

use std::collections::BTreeMap;

use gs_core::{Scene2d, Scene3d, counted};
use gs_train::RunSettings as _;
use rayon::prelude::*;

use super::{
    arm::{AnyPolicy, Arm},
    clock::Clock,
    definition::Study,
    digest,
    machine::Machine,
    overrides::{self, applied},
    settings::{ArmSettings, Asked, Planned},
    target::{Places, StudyTarget, TargetContent},
};
use crate::error::Error;

/// The version of this program, such as "0.1.0+1f0c9d2a7b3e". Results of another version are never
/// reused. In a checkout it contains a digest of all sources that a result depends on.
pub const VERSION: &str = env!("GS_LAB_VERSION");

/// A study with its images or scenes and all its runs.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The study.
    pub study: Study,
    /// The images or scenes of the study, in its order.
    pub(crate) targets: Vec<StudyTarget>,
    /// The machine that computes.
    pub machine: Machine,
    /// All runs, ordered by seed, then budget, then image or scene, then arm. Runs that are compared with
    /// each other are neighbours, so that a study that was stopped early contains complete
    /// comparisons.
    pub runs: Vec<Run>,
}

/// One fit or training of a study.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Row in the tables, counted from 1.
    pub row: usize,
    /// Index into [`Study::arms`].
    pub(crate) arm: usize,
    /// Index into [`Plan::targets`].
    pub(crate) target: usize,
    /// The largest number of Gaussians allowed.
    pub(crate) budget: u32,
    /// The seed of all random numbers.
    pub(crate) seed: u32,
    /// All settings of the fit or training.
    pub(crate) settings: ArmSettings,
    /// Digest of everything that the result depends on: settings, target, own policy, machine and
    /// version.
    pub address: String,
}

impl Plan {
    /// Reads the images or data sets of a study and plans its runs. `machine` names what computes:
    /// see [`Machine::name`].
    ///
    /// # Errors
    /// [`Error::Study`], [`Error::Arm`] where settings are not possible, [`Error::NotFound`],
    /// and [`Error::Io`] for images and data sets.
    pub fn new(study: Study, places: &Places, machine: impl Into<Machine>) -> Result<Self, Error> {
        study.validate()?;
        let machine = machine.into();
        let images = study.images.iter().map(|name| StudyTarget::load_image(name, places));
        let scenes = study.scenes.iter().map(|name| StudyTarget::load_scene(name, places, &study.dataset));
        let targets = images.chain(scenes).collect::<Result<Vec<_>, _>>()?;
        let (arms, budgets) = (study.arms.len(), study.budgets.len());
        let run = |index: usize| {
            let (place, arm) = (index / arms, index % arms);
            let (place, target) = (place / targets.len(), place % targets.len());
            let (seed, budget) = (study.seeds[place / budgets], study.budgets[place % budgets]);
            let (of, content) = (&study.arms[arm], &targets[target]);
            let settings = settings(&Asked { study: &study, arm: of, budget }, content, seed)?;
            let address =
                address(&study, of, &settings, content, &machine.name).map_err(|message| wrong(&study, of, message))?;
            Ok(Run { row: index + 1, arm, target, budget, seed, settings, address })
        };
        let count = study.seeds.len() * budgets * targets.len() * arms;
        let runs: Vec<Result<Run, Error>> = (0..count).into_par_iter().map(run).collect();
        // The first error in the order of the rows.
        let runs = runs.into_iter().collect::<Result<_, _>>()?;
        Ok(Self { study, targets, machine, runs })
    }

    /// Indices of the runs at a budget: for each seed, those of all arms on all targets. Empty for a
    /// budget that the study does not have.
    pub(crate) fn at_budget(&self, budget: u32) -> impl Iterator<Item = usize> + use<> {
        let (budgets, runs) = (self.study.budgets.len(), self.targets.len() * self.study.arms.len());
        let place = self.study.budgets.iter().position(|&of| of == budget);
        let seeds = place.map_or(0, |_| self.study.seeds.len());
        (0..seeds).flat_map(move |seed| {
            let first = (seed * budgets + place.unwrap_or_default()) * runs;
            first..first + runs
        })
    }

    /// Indices of an arm's runs at a budget, one for each seed and target.
    pub(crate) fn of_arm(&self, arm: usize, budget: u32) -> impl Iterator<Item = usize> + use<> {
        self.at_budget(budget).skip(arm).step_by(self.study.arms.len().max(1))
    }

    /// The arm of a run.
    pub(crate) fn arm(&self, run: &Run) -> &Arm {
        &self.study.arms[run.arm]
    }

    /// The image or scene of a run.
    pub(crate) fn target(&self, run: &Run) -> &StudyTarget {
        &self.targets[run.target]
    }

    /// Where the study found its images and data sets, by their names; synthetic ones are nowhere.
    pub(crate) fn places(&self) -> BTreeMap<&String, &std::path::PathBuf> {
        self.targets.iter().filter_map(|target| Some((&target.name, target.path.as_ref()?))).collect()
    }

    /// The work of a run, to estimate the time that is left: steps times pixels, with about fifty
    /// pixels for each Gaussian.
    pub fn work(&self, run: &Run) -> f64 {
        let pixels = self.target(run).pixels_per_step();
        f64::from(run.settings.iterations().max(1)) * (pixels + 50.0 * f64::from(run.settings.gaussians()))
    }

    /// The error that this program does not have the policy of an arm.
    pub(crate) fn policy_is_elsewhere(&self, arm: &Arm) -> Error {
        let message = "its policy is code that this program does not have: do its runs with the program \
                       that has it, such as gaussian_splats.Study of Python";
        wrong(&self.study, arm, message.to_owned())
    }

    /// The runs of this plan in words. The plan may be a part of a study, which has `all` runs:
    /// "small: 8 of 16 runs (2 arms, 1 image, 2 budgets, 2 seeds)".
    pub fn summary(&self, all: usize) -> String {
        let runs = match self.runs.len() {
            part if part == all => counted(all, "run"),
            part => format!("{part} of {}", counted(all, "run")),
        };
        let Study { name, arms, budgets, seeds, .. } = &self.study;
        let (arms, targets) = (counted(arms.len(), "arm"), counted(self.targets.len(), self.study.target_word()));
        let (budgets, seeds) = (counted(budgets.len(), "budget"), counted(seeds.len(), "seed"));
        format!("{name}: {runs} ({arms}, {targets}, {budgets}, {seeds})")
    }

    /// A description of the run: "percentile, kodim04, 3000 Gaussians, seed 0".
    pub fn describe(&self, run: &Run) -> String {
        let Run { budget, seed, .. } = run;
        let budget = counted(*budget, "Gaussian");
        format!("{}, {}, {budget}, seed {seed}", self.arm(run).name, self.target(run).label())
    }
}

/// The settings of a run.
fn settings(asked: &Asked<'_>, target: &StudyTarget, seed: u32) -> Result<ArmSettings, Error> {
    match target.content {
        TargetContent::Image(_) => Ok(settings_of::<Scene2d>(asked, target, seed)?.into()),
        TargetContent::Scene(_) => Ok(settings_of::<Scene3d>(asked, target, seed)?.into()),
    }
}

/// The settings of a run on one kind of target.
fn settings_of<S: Planned>(asked: &Asked<'_>, target: &StudyTarget, seed: u32) -> Result<S::Settings, Error> {
    let Asked { study, arm, .. } = *asked;
    let is_of_other_kind = |own: &AnyPolicy| !matches!(own, AnyPolicy::Elsewhere) && S::own(own).is_none();
    if arm.own_policy.as_ref().is_some_and(|own| is_of_other_kind(&own.policy)) {
        return Err(wrong(study, arm, "its own policy is for the other kind of scene".to_owned()));
    }
    let start = S::start_settings(asked, target).map_err(|message| wrong(study, arm, message))?;
    let mut over = study.settings.clone();
    overrides::lay_upon(&mut over, &arm.settings);
    let possible = || {
        let settings = S::completed(applied(&start, &over)?, seed);
        settings.validate().map_err(|error| error.to_string())?;
        Ok(settings)
    };
    possible().map_err(|message: String| wrong(study, arm, format!("settings: {message}")))
}

fn wrong(study: &Study, arm: &Arm, message: String) -> Error {
    Error::Arm { study: study.name.clone(), arm: arm.name.clone(), message }
}

fn address(
    study: &Study,
    arm: &Arm,
    settings: &ArmSettings,
    target: &StudyTarget,
    machine: &str,
) -> Result<String, String> {
    let start = match settings {
        ArmSettings::Scene(settings) => target.dataset().map(|dataset| arm.start(dataset, settings).name()),
        ArmSettings::Image(_) => None,
    };
    let settings = settings.to_toml().map_err(|error| error.to_string())?;
    let policy = arm.own_policy.as_ref().map_or("", |own| own.fingerprint.as_str());
    let all = ["gs-lab run 1", VERSION, machine, &target.digest, policy, &settings];
    // Times of two clocks are never mixed.
    let clock = (study.clock != Clock::Wall).then(|| study.clock.unit());
    let measured = study.measure.iter().map(|measure| measure.name());
    let poses = arm.pose_error.map(|error| format!("{error:?}"));
    let aligned = study.align_poses.then_some("aligned poses");
    let rest = start.into_iter().chain(clock).chain(measured).chain(poses.as_deref()).chain(aligned);
    Ok(digest::of_texts(all.into_iter().chain(rest)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs_density::Policy;
    use std::collections::HashSet;

    fn plan(text: &str) -> Result<Plan, Error> {
        Plan::new(Study::from_toml(text, "a.toml")?, &Places::default(), "test")
    }

    const TWO_ARMS: &str = "name = 'x'\nimages = ['paper']\nbudgets = [10, 600]\nseeds = [3, 4]\npreset = 'paper'\niterations = 50\n\
                            settings.policy.actions.densify.shrink = 2.0\n[[arm]]\nname = 'a'\n[[arm]]\nname = 'b'\n\
                            settings.policy.kind = 'percentile'\n";

    #[test]
    fn runs_are_all_combinations_in_a_fixed_order_each_with_its_address() {
        let plan = plan(TWO_ARMS).unwrap();
        let order: Vec<_> = plan.runs.iter().map(|r| (r.row, r.seed, r.budget, r.arm)).collect();
        let expected = [(1, 3, 10, 0), (2, 3, 10, 1), (3, 3, 600, 0), (4, 3, 600, 1), (5, 4, 10, 0)];
        assert_eq!((order.len(), &order[..5]), (8, &expected[..]));
        for (arm, budget) in [(0, 10), (1, 10), (0, 600), (1, 600), (0, 7)] {
            let expected = plan.runs.iter().filter(|run| (run.arm, run.budget) == (arm, budget)).map(|run| run.row - 1);
            assert_eq!(plan.of_arm(arm, budget).collect::<Vec<_>>(), expected.collect::<Vec<_>>());
        }
        let addresses: HashSet<_> = plan.runs.iter().map(|r| &r.address).collect();
        assert_eq!(addresses.len(), 8);
        let first = plan.runs[0].settings.of_image();
        assert_eq!((first.seed, first.gaussians, first.iterations, first.initial.resolve(10)), (3, 10, 50, 10));
        for run in &plan.runs {
            let text = toml::to_string(&run.settings.of_image().policy).unwrap();
            assert!(text.contains("shrink = 2.0"), "what all arms have in common: {text}");
        }
    }

    #[test]
    fn a_policy_by_its_name_is_what_settings_differ_from() {
        let named =
            TWO_ARMS.replace("settings.policy.kind = 'percentile'", "policy = 'paper'\nsettings.policy.percent = 25");
        let Policy::Grow(paper) = plan(&named).unwrap().runs[1].settings.of_image().policy.clone() else {
            panic!("another policy")
        };
        assert_eq!((paper.percent, paper.actions.densify.shrink), (25.0, 2.0));
    }

    #[test]
    fn an_address_follows_all_that_the_result_depends_on() {
        let base = plan(TWO_ARMS).unwrap().runs[0].address.clone();
        assert_eq!(
            plan(&TWO_ARMS.replace("'x'", "'another name'".replace(' ', "-").as_str())).unwrap().runs[0].address,
            base
        );
        assert_ne!(plan(&TWO_ARMS.replace("shrink = 2.0", "shrink = 2.1")).unwrap().runs[0].address, base);
        let other_machine = Plan::new(Study::from_toml(TWO_ARMS, "").unwrap(), &Places::default(), "other").unwrap();
        assert_ne!(other_machine.runs[0].address, base);
    }

    #[test]
    fn study_errors_give_the_place_and_the_remedy() {
        for (from, to, expected) in [
            ("seeds = [3, 4]", "seeds = []", "study `x`: seeds: there are none: name at least one"),
            ("seeds = [3, 4]", "seeds = [3, 3]", "seeds: 3 is listed twice"),
            ("seeds = [3, 4]", "seed = [3]", "a.toml: line 4: unknown key `seed`: did you mean `seeds`?"),
            ("seeds = [3, 4]", "seeds = [-1]", "line 4"),
            ("budgets = [10, 600]", "budgets = [0]", "0 Gaussians draw nothing"),
            ("'paper']", "\"a\\nb.png\"]", r#"images: "a\nb.png" has a control character"#),
            ("'paper']", "'no/such.png']", "no/such.png: no such file in any folder: name the folder"),
            (
                "name = 'b'",
                "name = 'b'\npolicy = 'percentil'",
                "study `x`: arm `b`: policy: policy is `percentil`, but must be one of absolute",
            ),
            ("name = 'b'", "name = 'a'", "\"a\" is listed twice"),
            ("name = 'b'", "name = 'a/b'", "its name is not a word"),
            ("name = 'x'", "name = 'x'\nbaseline = 'c'", "there is no arm `c`"),
            ("'percentile'", "'percentil'", "study `x`: arm `b`: settings: unknown name `percentil`"),
            ("shrink = 2.0", "shrink = 0.5", "study `x`: arm `a`: settings: densify.shrink is 0.5"),
            ("shrink = 2.0", "shrunk = 2.0", "shrunk"),
            ("settings.policy.actions", "settings.gaussians = 3\nsettings.policy.actions", "list it under budgets"),
            ("name = 'x'", "name = = 'x'", "a.toml: line 1: "),
        ] {
            let message = plan(&TWO_ARMS.replace(from, to)).map(|plan| plan.runs.len()).unwrap_err().to_string();
            assert!(message.contains(expected), "{to}: {message}");
        }
    }
}
