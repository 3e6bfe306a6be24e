//! COLMAP's version, and the names of its options.

pub(crate) mod process;
pub(crate) mod program;

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use self::program::{Program, dotted, said};
use crate::{
    error::Error,
    plan::{Group, Plan},
    settings::Settings,
};

/// The oldest version that is used, and that of PyCOLMAP.
const OLDEST: [u32; 3] = [3, 7, 0];
const OLDEST_PYTHON: [u32; 3] = FAST;

/// The version from which comparing photographs does not need time by the square of the features.
const FAST: [u32; 3] = [4, 1, 1];

/// Versions between which comparing photographs is slow: the first, and the one that repairs it.
const SLOW: [[u32; 3]; 2] = [[4, 0, 0], FAST];

/// The version from which each kind of features has its own vocabulary tree, which the help does not name.
const TREES: [u32; 3] = [4, 0, 0];

/// The most photographs that are added one by one, where COLMAP can also take all at once.
const ONE_BY_ONE: usize = 250;

/// The least contrast of faint features, less than half of COLMAP's 0.0067.
const FAINT: f64 = 0.003;

/// The option by which matches must be mutual.
const CROSS_CHECK: &str = "SiftMatching.cross_check";

/// The command that finds all cameras at once.
const GLOBAL: &str = "global_mapper";

/// The fewest photographs of a piece that is kept.
const LEAST_PIECE: usize = 3;

/// COLMAP, or PyCOLMAP of a Python.
#[derive(Debug, Clone)]
pub struct Colmap {
    pub(crate) program: Program,
    version: [u32; 3],
    /// Whether it computes on a GPU, and there is one.
    gpu: bool,
    /// The help of its commands, for the names of options.
    extraction: String,
    matching: String,
    /// That of the mapper that finds all cameras at once, if there is one.
    global_mapper: Option<String>,
}

impl Colmap {
    /// Finds COLMAP on the `PATH`, or else PyCOLMAP of the Python that `GS_PYTHON` names (`python3`).
    ///
    /// # Errors
    /// [`Error::NoColmap`], [`Error::TooOld`].
    pub fn find() -> Result<Self, Error> {
        Self::first(Program::candidates(None))
    }

    /// As [`Self::find`], but without `GS_PYTHON` this Python takes the place of `python3`.
    ///
    /// # Errors
    /// Those of [`Self::find`].
    pub fn find_or(python: PathBuf) -> Result<Self, Error> {
        Self::first(Program::candidates(Some(python.into())))
    }

    /// The first program that is there.
    fn first(mut candidates: impl Iterator<Item = Program>) -> Result<Self, Error> {
        let help = |program: &Program| {
            let (succeeds, help) = program.said(&["help"]).ok()?;
            (succeeds || matches!(program, Program::Colmap(_))).then_some(help)
        };
        let mut python = String::new();
        let found = candidates.find_map(|program| {
            if let Program::Python(name) = &program {
                python = name.to_string_lossy().into_owned();
            }
            Some((help(&program)?, program))
        });
        let (help, program) = found.ok_or(Error::NoColmap { python })?;
        let version = version(&help);
        let oldest = if matches!(program, Program::Python(_)) { OLDEST_PYTHON } else { OLDEST };
        let Some(numbers) = version.filter(|version| *version >= oldest) else {
            return Err(Error::too_old(&program, version, oldest));
        };
        let help_of = |command| program.said(&[command, "-h"]).map(|(_, help)| help).unwrap_or_default();
        let (extraction, matching) = (help_of("feature_extractor"), help_of("exhaustive_matcher"));
        let built_for_gpu = [&help, &extraction].iter().any(|text| text.contains("with CUDA"));
        let gpu =
            built_for_gpu && said(Command::new("nvidia-smi").arg("-L")).is_ok_and(|(_, list)| list.contains("GPU "));
        let global_mapper = help.contains(GLOBAL).then(|| help_of(GLOBAL));
        Ok(Self { program, version: numbers, gpu, extraction, matching, global_mapper })
    }

    /// The version: "3.8".
    pub fn version(&self) -> String {
        dotted(self.version)
    }

    /// Whether this version compares photographs several times more slowly than the next ones.
    pub(crate) fn is_slow(&self) -> bool {
        (SLOW[0]..SLOW[1]).contains(&self.version)
    }

    /// How many times as many features it compares in the same time as version 3.8 on a CPU.
    pub(crate) fn pace(&self) -> u32 {
        if self.gpu || self.version >= FAST { 2 } else { 1 }
    }

    /// The command that finds the features of a group of photographs.
    pub(crate) fn extract(
        &self,
        place: &Place<'_>,
        plan: &Plan,
        (group, list, masks): (&Group, &Path, bool),
        settings: &Settings,
    ) -> Arguments {
        let mut arguments = Arguments::new("feature_extractor");
        arguments.path("database_path", place.database).path("image_path", place.images).path("image_list_path", list);
        arguments.set("ImageReader.single_camera", 1).set("ImageReader.camera_model", &group.model);
        if let Some(parameters) = group.parameters() {
            arguments.set("ImageReader.camera_params", parameters);
        }
        if masks {
            arguments.path("ImageReader.mask_path", place.masks);
        }
        let named = |name: &str| renamed(&self.extraction, ["FeatureExtraction", "SiftExtraction"], name);
        arguments.set(&named("use_gpu"), u8::from(self.gpu)).set(&named("max_image_size"), plan.max_size);
        arguments.set("SiftExtraction.max_num_features", plan.features);
        arguments.set("SiftExtraction.first_octave", if plan.doubled { "-1" } else { "0" });
        if plan.faint {
            arguments.set("SiftExtraction.peak_threshold", FAINT);
        }
        if let Some(threads) = settings.threads {
            arguments.set(&named("num_threads"), threads);
        }
        arguments
    }

    /// Whether it fetches a vocabulary tree where none is named, as its help says since version 3.12.
    pub(crate) fn fetches_tree(&self) -> bool {
        let is_fetched = |line: &str| line.contains("--SequentialMatching.vocab_tree_path") && line.contains("=http");
        let help = || self.program.said(&["sequential_matcher", "-h"]).map(|(_, help)| help).unwrap_or_default();
        self.version >= TREES || help().lines().any(is_fetched)
    }

    /// The command that compares the photographs of these pairs.
    pub(crate) fn compare(
        &self,
        place: &Place<'_>,
        plan: &Plan,
        pairs: Compared<'_>,
        settings: &Settings,
    ) -> Arguments {
        let mut arguments = Arguments::new(match pairs {
            Compared::All => "exhaustive_matcher",
            Compared::Neighbours { .. } => "sequential_matcher",
            Compared::Listed(_) => "matches_importer",
        });
        arguments.path("database_path", place.database);
        let named = |name: &str| renamed(&self.matching, ["FeatureMatching", "SiftMatching"], name);
        arguments.set(&named("use_gpu"), u8::from(self.gpu));
        if let Some(threads) = settings.threads {
            arguments.set(&named("num_threads"), threads);
        }
        if self.looks_one_way(plan) {
            arguments.set(CROSS_CHECK, 0);
        }
        match pairs {
            // Smaller blocks show more of the progress.
            Compared::All => _ = arguments.set("ExhaustiveMatching.block_size", 20),
            Compared::Listed(list) => _ = arguments.path("match_list_path", list).set("match_type", "pairs"),
            Compared::Neighbours { overlap, alike } => {
                arguments.set("SequentialMatching.overlap", overlap);
                if alike {
                    arguments.set("SequentialMatching.loop_detection", 1);
                }
                if let Some(tree) = settings.vocabulary.as_ref().filter(|_| alike) {
                    arguments.path("SequentialMatching.vocab_tree_path", tree);
                }
            }
        }
        arguments
    }

    /// Whether features are only looked for in one direction.
    pub(crate) fn looks_one_way(&self, plan: &Plan) -> bool {
        plan.one_way && self.pace() == 1 && self.matching.contains(CROSS_CHECK)
    }

    /// The command that finds the poses, and puts each piece into a folder of `models`. A lenient one
    /// also takes what few matches suggest.
    pub(crate) fn map(&self, place: &Place<'_>, plan: &Plan, lenient: bool, settings: &Settings) -> Arguments {
        let at_once = self.global_mapper.as_ref().filter(|_| plan.photographs() > ONE_BY_ONE && !lenient);
        let mut arguments = Arguments::new(if at_once.is_some() { GLOBAL } else { "mapper" });
        arguments
            .path("database_path", place.database)
            .path("image_path", place.images)
            .path("output_path", place.models);
        let threads = if at_once.is_some() { "GlobalMapper.num_threads" } else { "Mapper.num_threads" };
        if let Some(number) = settings.threads.filter(|_| at_once.is_none_or(|help| help.contains(threads))) {
            arguments.set(threads, number);
        }
        if at_once.is_some() {
            return arguments;
        }
        // By default, COLMAP throws pieces of fewer than ten photographs away.
        arguments.set("Mapper.min_model_size", LEAST_PIECE);
        // Stops when the cost changes by less than a millionth instead of never.
        arguments.set("Mapper.ba_global_function_tolerance", "0.000001");
        if lenient {
            arguments.set("Mapper.init_min_tri_angle", 4).set("Mapper.init_min_num_inliers", 50);
            arguments.set("Mapper.abs_pose_min_num_inliers", 15).set("Mapper.min_num_matches", 10);
        }
        arguments
    }
}

/// The pairs of photographs that a command compares.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Compared<'a> {
    All,
    /// So many neighbours by name, and with `alike`, what looks alike by a vocabulary tree.
    Neighbours {
        overlap: usize,
        alike: bool,
    },
    /// The pairs in a list.
    Listed(&'a Path),
}

/// Where COLMAP works; absolute paths.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place<'a> {
    pub(crate) database: &'a Path,
    pub(crate) images: &'a Path,
    pub(crate) masks: &'a Path,
    pub(crate) models: &'a Path,
}

/// The arguments of a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Arguments(pub(crate) Vec<std::ffi::OsString>);

impl Arguments {
    pub(crate) fn new(command: &str) -> Self {
        Self(vec![command.into()])
    }

    pub(crate) fn set(&mut self, name: &str, value: impl ToString) -> &mut Self {
        self.0.extend([format!("--{name}").into(), value.to_string().into()]);
        self
    }

    pub(crate) fn path(&mut self, name: &str, value: &Path) -> &mut Self {
        self.0.extend([format!("--{name}").into(), value.into()]);
        self
    }
}

/// The name of an option: in the first of two groups if the help has it there, as since version 4, else in
/// the second.
fn renamed(help: &str, [new, old]: [&str; 2], name: &str) -> String {
    let newer = format!("{new}.{name}");
    if help.contains(&format!("--{newer}")) { newer } else { format!("{old}.{name}") }
}

/// The version in COLMAP's help: "COLMAP 3.8 -- Structure-from-Motion and Multi-View Stereo".
fn version(help: &str) -> Option<[u32; 3]> {
    let mut words = help.split_whitespace().skip_while(|word| *word != "COLMAP").skip(1);
    let mut numbers = words.next()?.split(['.', '-']).map_while(|part| part.parse().ok());
    Some([numbers.next()?, numbers.next()?, numbers.next().unwrap_or(0)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read() {
        let debian = "COLMAP 3.8 -- Structure-from-Motion and Multi-View Stereo\n (Commit Unknown without CUDA)";
        assert_eq!(version(debian), Some([3, 8, 0]));
        assert_eq!(version("COLMAP 4.1.1 -- Structure\n"), Some([4, 1, 1]));
        assert_eq!(version("COLMAP 3.12.0.dev0 -- Structure\n"), Some([3, 12, 0]));
        assert_eq!(version("COLMAP 4.2.1 -- PyCOLMAP (without CUDA)"), Some([4, 2, 1]));
        assert_eq!((version("bash: colmap"), version("COLMAP\n")), (None, None));
    }

    fn colmap(version: [u32; 3], gpu: bool, matching: &str) -> Colmap {
        let matching = matching.to_owned();
        let program = Program::Colmap("colmap");
        Colmap { program, version, gpu, extraction: String::new(), matching, global_mapper: None }
    }

    fn has(Arguments(words): &Arguments, name: &str, value: &str) -> bool {
        words.windows(2).any(|pair| pair[0] == name && pair[1] == value)
    }

    #[test]
    fn only_a_first_attempt_of_a_slow_version_compares_in_one_direction() {
        let plan = |one_way| Plan { one_way, ..Plan::new(&[], &Settings::default(), 1) };
        let compares_in_one = |version, gpu, help: &str, plan: &Plan| {
            let here = Path::new("");
            let place = Place { database: here, images: here, masks: here, models: here };
            let arguments = colmap(version, gpu, help).compare(&place, plan, Compared::All, &Settings::default());
            has(&arguments, "--SiftMatching.cross_check", "0")
        };
        let help = "  --SiftMatching.cross_check arg (=1)";
        assert!(compares_in_one([3, 8, 0], false, help, &plan(true)));
        assert!(!compares_in_one([3, 8, 0], false, help, &plan(true).thorough(&[])));
        assert!(!compares_in_one([3, 8, 0], false, help, &plan(false)));
        assert!(!compares_in_one([3, 8, 0], true, help, &plan(true)));
        assert!(!compares_in_one([4, 1, 1], false, help, &plan(true)));
        assert!(!compares_in_one([3, 8, 0], false, "", &plan(true)));
    }

    #[test]
    fn a_second_attempt_looks_for_faint_features_with_a_known_lens() {
        let (photographs, registered) = crate::plan::tests::nine();
        let first = Plan::new(&photographs, &Settings::default(), 1);
        let [first, second] = [&first, &first.thorough(&registered)].map(|plan| {
            let here = Path::new("");
            let place = Place { database: here, images: here, masks: here, models: here };
            let group = (&plan.groups[0], here, false);
            colmap([3, 8, 0], false, "").extract(&place, plan, group, &Settings::default())
        });
        let lens = ("--ImageReader.camera_params", "400,400,187.5,250,0,0,0,0");
        let faint = ("--SiftExtraction.peak_threshold", "0.003");
        for (name, value) in [lens, faint] {
            assert!(has(&second, name, value) && !has(&first, name, value), "{second:?}");
        }
    }

    #[test]
    fn options_have_the_names_of_the_version() {
        let options = ["FeatureExtraction", "SiftExtraction"];
        assert_eq!(renamed("  --SiftExtraction.use_gpu arg", options, "use_gpu"), "SiftExtraction.use_gpu");
        let newer = "  --FeatureExtraction.use_gpu arg\n  --SiftExtraction.max_num_features arg";
        assert_eq!(renamed(newer, options, "use_gpu"), "FeatureExtraction.use_gpu");
    }
}
