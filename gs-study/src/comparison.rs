//! An arm held against another: paired differences, their interval, what may be said, and what speaks against saying more.

use std::{collections::BTreeSet, fmt};

use gs_train::statistics::{FEWEST, Interval, bootstrap_interval, mean};
use serde::{Deserialize, Serialize, Serializer};

use crate::{
    plan::Run,
    reach::Reach,
    record::Finished,
    study::Matching,
    tables::{Metric, Results},
};

/// Counts that differ by more than this share are not equal counts.
pub const EQUAL_COUNT: f64 = 0.01;

/// With fewer seeds a difference may be one of luck with them, which no interval over images shows.
pub const FEWEST_SEEDS: usize = 5;

/// What may be said of a difference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The whole interval lies above 0.
    Better,
    /// The whole interval lies below 0.
    Worse,
    /// 0 lies in the interval, or there is none, or a remark forbids to say more.
    CannotTell,
}

impl Verdict {
    /// What an interval says of a difference of which more is better.
    pub fn of(interval: Interval) -> Self {
        if interval.low > 0.0 {
            Self::Better
        } else if interval.high < 0.0 {
            Self::Worse
        } else {
            Self::CannotTell
        }
    }

    /// In words.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Better => "better",
            Self::Worse => "worse",
            Self::CannotTell => "can't tell",
        }
    }
}

/// What is paired in a comparison, and so what its interval generalises to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pairing {
    /// Images, each with its mean over seeds: other images of the same kind.
    Images,
    /// Seeds, where there is one image only: other seeds, for this image.
    Seeds,
}

impl Pairing {
    /// In a word.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Images => "images",
            Self::Seeds => "seeds",
        }
    }
}

/// What a reader of a difference must know besides its numbers.
#[derive(Debug, Clone, PartialEq)]
pub enum Remark {
    /// Of some images there is no seed from which both arms have finished. Forbids a verdict.
    ImagesMissing {
        /// How many.
        missing: usize,
        /// Images of the study.
        of: usize,
    },
    /// Images or seeds are fewer than a verdict needs. Forbids it.
    TooFew {
        /// How many there are.
        pairs: usize,
        /// Of what.
        pairing: Pairing,
    },
    /// The arms end with other counts. Forbids a verdict at equal count.
    CountsDiffer {
        /// Mean count of the arm, on the image where they differ the most.
        arm: f64,
        /// That of the arm it is held against.
        against: f64,
        /// The image's name; nothing where there is one only.
        image: Option<String>,
    },
    /// Runs were timed on other backends, or with others beside them. Forbids a verdict at equal time.
    ClocksDiffer {
        /// Each way in which runs were timed.
        clocks: Vec<String>,
    },
    /// Some images were met exactly, where PSNR is infinite. Forbids a verdict.
    Infinite {
        /// Pairs with such a run.
        pairs: usize,
    },
    /// Some runs have failed or are missing; the comparison is over the rest.
    Incomplete {
        /// Pairs of finished runs.
        pairs: usize,
        /// Pairs of the study.
        of: usize,
    },
    /// Seeds are fewer than [`FEWEST_SEEDS`].
    FewSeeds {
        /// How many.
        seeds: usize,
    },
}

impl Remark {
    /// Whether nothing may be said, whatever the interval.
    pub const fn forbids_verdict(&self) -> bool {
        !matches!(self, Self::Incomplete { .. } | Self::FewSeeds { .. })
    }

    /// Its kind, in a few words.
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::ImagesMissing { .. } => "images without finished runs",
            Self::TooFew { pairing: Pairing::Images, .. } => "too few images",
            Self::TooFew { pairing: Pairing::Seeds, .. } => "too few seeds",
            Self::CountsDiffer { .. } => "counts differ",
            Self::ClocksDiffer { .. } => "timed in different ways",
            Self::Infinite { .. } => "PSNR is infinite",
            Self::Incomplete { .. } => "runs failed or missing",
            Self::FewSeeds { .. } => "few seeds",
        }
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ImagesMissing { missing, of } => write!(f, "no pair of finished runs on {missing} of {of} images"),
            Self::TooFew { pairs, pairing } => write!(f, "{pairs} {} are too few: {FEWEST} at least", pairing.words()),
            Self::CountsDiffer { arm, against, image } => {
                write!(f, "counts differ: {arm:.0} against {against:.0}")?;
                image.as_ref().map_or(Ok(()), |image| write!(f, " on {image}"))
            }
            Self::ClocksDiffer { clocks } => write!(f, "timed in different ways: {}", clocks.join("; ")),
            Self::Infinite { pairs } => write!(f, "PSNR is infinite in {pairs} pairs"),
            Self::Incomplete { pairs, of } => write!(f, "{pairs} of {of} pairs: other runs failed or are missing"),
            Self::FewSeeds { seeds } => write!(f, "few seeds: {seeds}, {FEWEST_SEEDS} would do"),
        }
    }
}

impl Serialize for Remark {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// How much better an arm is than another.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Difference {
    /// What is equal.
    pub matching: Matching,
    /// What is measured.
    pub metric: Metric,
    /// The most Gaussians there might be.
    pub budget: u32,
    /// The arm judged.
    pub arm: String,
    /// The arm it is held against.
    pub against: String,
    /// What is paired.
    pub pairing: Pairing,
    /// How many pairs there are.
    pub pairs: usize,
    /// Mean difference, in the metric's unit; nothing without pairs, and where it is not finite.
    pub mean: Option<f64>,
    /// Where the mean difference of all images (or seeds) probably lies.
    pub interval: Option<Interval>,
    /// What may be said.
    pub verdict: Verdict,
    /// What must be known besides, most of it why nothing may be said.
    pub remarks: Vec<Remark>,
}

impl Difference {
    /// The remark for which nothing may be said.
    pub fn obstacle(&self) -> Option<&Remark> {
        self.remarks.iter().find(|remark| remark.forbids_verdict())
    }
}

/// Two finished runs of one image and seed.
struct Pair<'a> {
    run: &'a Run,
    twin: &'a Run,
    arm: &'a Finished,
    against: &'a Finished,
}

impl Results<'_> {
    /// Every arm held against every other that stands before it, in each of these respects.
    pub fn differences(&self, matchings: &[Matching]) -> Vec<Difference> {
        let arms = self.plan.study.arms.len();
        let mut differences = Vec::new();
        for &matching in self.plan.study.matchings.iter().filter(|matching| matchings.contains(matching)) {
            let metrics = if matching == Matching::Count { &Metric::ALL[..] } else { &Metric::ALL[..1] };
            for &metric in metrics.iter().filter(|metric| self.is_measured(**metric)) {
                for &budget in &self.plan.study.budgets {
                    for arm in 1..arms {
                        for against in 0..arm {
                            differences.push(self.difference(matching, metric, budget, arm, against));
                        }
                    }
                }
            }
        }
        differences
    }

    /// An arm held against another, over the pairs of runs that have both finished.
    pub fn difference(
        &self,
        matching: Matching,
        metric: Metric,
        budget: u32,
        arm: usize,
        against: usize,
    ) -> Difference {
        let images = self.plan.targets.len();
        let pairs = self.pairs(arm, against, budget);
        let reach = Reach::of_images(self, budget);
        let gain = |pair: &Pair<'_>| {
            let measured = |run, end| reach[pair.run.target].measured(matching, metric, run, end);
            Some((pair.run.target, measured(pair.run, pair.arm)? - measured(pair.twin, pair.against)?))
        };
        let gains: Vec<(usize, f64)> = pairs.iter().filter_map(gain).collect();
        let of_image = |target: usize| gains.iter().filter(move |gain| gain.0 == target).map(|gain| gain.1);
        let pairing = if images > 1 { Pairing::Images } else { Pairing::Seeds };
        let units: Vec<f64> = match pairing {
            Pairing::Seeds => gains.iter().map(|gain| gain.1).collect(),
            Pairing::Images => {
                (0..images).filter(|&target| of_image(target).next().is_some()).map(|t| mean(of_image(t))).collect()
            }
        };
        let interval = if units.len() < FEWEST { None } else { bootstrap_interval(&units) };
        let infinite = gains.iter().filter(|gain| !gain.1.is_finite()).count();
        let mut remarks = self.gaps(&pairs, pairing);
        remarks.extend((infinite > 0).then_some(Remark::Infinite { pairs: infinite }));
        remarks.extend(match matching {
            Matching::Count => self.counts_differ(&pairs),
            Matching::Time => self.clocks_differ(budget),
            Matching::Iterations => None,
        });
        let seeds = self.plan.study.seeds.len();
        if units.len() < FEWEST {
            remarks.push(Remark::TooFew { pairs: units.len(), pairing });
        } else if seeds < FEWEST_SEEDS {
            remarks.push(Remark::FewSeeds { seeds });
        }
        let verdict = match interval {
            Some(interval) if !remarks.iter().any(Remark::forbids_verdict) => Verdict::of(interval),
            _ => Verdict::CannotTell,
        };
        Difference {
            matching,
            metric,
            budget,
            arm: self.plan.study.arms[arm].name.clone(),
            against: self.plan.study.arms[against].name.clone(),
            pairing,
            pairs: units.len(),
            mean: Some(mean(&units)).filter(|mean| mean.is_finite()),
            interval,
            verdict,
            remarks,
        }
    }

    /// Finished runs of two arms at a budget that agree in image and seed.
    fn pairs(&self, arm: usize, against: usize, budget: u32) -> Vec<Pair<'_>> {
        let others: Vec<_> = self.finished(against, budget).collect();
        self.finished(arm, budget)
            .filter_map(|(run, end)| {
                let twin = others.iter().find(|(other, _)| (other.target, other.seed) == (run.target, run.seed))?;
                Some(Pair { run, twin: twin.0, arm: end, against: twin.1 })
            })
            .collect()
    }

    /// Images, or else pairs, that are not there since runs have failed or are missing.
    fn gaps(&self, pairs: &[Pair<'_>], pairing: Pairing) -> Vec<Remark> {
        let images = self.plan.targets.len();
        let is_missing = |target: &usize| pairs.iter().all(|pair| pair.run.target != *target);
        let missing = (0..images).filter(is_missing).count();
        let asked = images * self.plan.study.seeds.len();
        match pairing {
            Pairing::Images if missing > 0 => vec![Remark::ImagesMissing { missing, of: images }],
            _ if pairs.len() < asked => vec![Remark::Incomplete { pairs: pairs.len(), of: asked }],
            _ => Vec::new(),
        }
    }

    /// Where two arms end with other counts, on the image where they do the most. Counts are compared run by run: more here does not
    /// make up for less there.
    fn counts_differ(&self, pairs: &[Pair<'_>]) -> Option<Remark> {
        let of_image = |target: usize| {
            let counts = || {
                let of_target = pairs.iter().filter(move |pair| pair.run.target == target);
                of_target.map(|pair| (f64::from(pair.arm.gaussians), f64::from(pair.against.gaussians)))
            };
            let (arm, against) = (mean(counts().map(|c| c.0)), mean(counts().map(|c| c.1)));
            let share = mean(counts().map(|(a, b)| (a - b).abs())) / arm.max(against);
            (share, arm, against, target)
        };
        let shares = (0..self.plan.targets.len()).map(of_image).filter(|found| found.0 > EQUAL_COUNT);
        let (_, arm, against, target) = shares.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let image = (self.plan.targets.len() > 1).then(|| self.plan.targets[target].label().to_owned());
        Some(Remark::CountsDiffer { arm, against, image })
    }

    /// Where the runs at a budget, which set the common time, were not all timed in one way.
    fn clocks_differ(&self, budget: u32) -> Option<Remark> {
        let clock = |end: &Finished| match end.side_by_side {
            1 => end.backend.clone(),
            n => format!("{}, {n} side by side", end.backend),
        };
        let clocks: BTreeSet<String> = self.all_finished(budget).map(|(_, end)| clock(end)).collect();
        (clocks.len() > 1).then(|| Remark::ClocksDiffer { clocks: clocks.into_iter().collect() })
    }
}
