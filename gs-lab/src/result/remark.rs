//! Remarks on a difference: what a reader must know besides its numbers, and what forbids a
//! verdict.

use std::fmt;

use super::statistics::FEWEST;
use gs_core::counted;

/// The number of seeds below which a difference may be due to the choice of seeds, which an
/// interval over images does not show.
pub(crate) const FEWEST_SEEDS: usize = 5;

/// What is paired in a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pairing {
    /// Images, each with its mean over seeds. The interval generalises to other images of the same
    /// kind.
    Images,
    /// Seeds, where the study has one image only. The interval generalises to other seeds on this
    /// image.
    Seeds,
    /// Held-out views in scenes, each with its mean over seeds: scenes are drawn, and then views in
    /// them. The interval generalises to other scenes of the same kind.
    Scenes,
    /// Held-out views in runs, where the study has fewer than six scenes: for each scene seeds are
    /// drawn, and then views. The interval generalises to other seeds and views of these scenes.
    SeedsOfScenes,
}

impl Pairing {
    /// The plural noun.
    pub(crate) const fn words(self) -> &'static str {
        match self {
            Self::Images => "images",
            Self::Seeds => "seeds",
            Self::Scenes => "views in scenes",
            Self::SeedsOfScenes => "views in seeds of scenes",
        }
    }

    const fn word(self) -> &'static str {
        match self {
            Self::Images => "image",
            Self::Seeds | Self::SeedsOfScenes => "seed",
            Self::Scenes => "scene",
        }
    }
}

/// A remark on a difference.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum ResultRemark {
    /// Some images have no seed with which both arms finished. Forbids a verdict.
    ImagesMissing {
        /// Number of such images.
        missing: usize,
        /// Images of the study.
        of: usize,
    },
    /// Some scenes have no seed with which both arms finished. Forbids a verdict.
    ScenesMissing {
        /// Number of such scenes.
        missing: usize,
        /// Scenes of the study.
        of: usize,
    },
    /// A study of few scenes has fewer seeds than an interval over these scenes needs. Forbids a
    /// verdict.
    TooFewSeeds {
        /// Seeds of the scene that has fewest.
        seeds: usize,
        /// Scenes of the study.
        scenes: usize,
        /// Seeds that would do.
        needed: usize,
    },
    /// The study has fewer images or seeds than a verdict needs. Forbids a verdict.
    TooFew {
        /// Number of pairs.
        pairs: usize,
        /// What is paired.
        pairing: Pairing,
    },
    /// The arms end with different counts. Forbids a verdict at equal count.
    CountsDiffer {
        /// Mean count of the arm that is judged, on the image or scene with the largest difference.
        arm: f64,
        /// Mean count of the other arm.
        against: f64,
        /// The image or scene, such as "image kodim04"; `None` where the study has one only.
        place: Option<String>,
    },
    /// Runs were timed on different backends, or with different numbers of runs side by side.
    /// Forbids a verdict at equal time.
    ClocksDiffer {
        /// The different conditions.
        clocks: Vec<String>,
    },
    /// Some runs reproduce their image exactly, so that PSNR is infinite. Forbids a verdict.
    Infinite {
        /// Pairs with such a run.
        pairs: usize,
    },
    /// Some runs failed or are missing; the comparison covers the others.
    Incomplete {
        /// Pairs of finished runs.
        pairs: usize,
        /// Pairs of the study.
        of: usize,
    },
    /// The study has fewer than six scenes, so that the interval is about these scenes only.
    FewScenes {
        /// Number of scenes.
        scenes: usize,
    },
    /// The study has fewer than five seeds.
    FewSeeds {
        /// Number of seeds.
        seeds: usize,
    },
}

impl ResultRemark {
    /// Whether the remark is about the whole study, so that it need not stand at each difference.
    pub(crate) const fn is_of_study(&self) -> bool {
        matches!(self, Self::FewScenes { .. } | Self::FewSeeds { .. })
    }

    /// Whether the remark forbids a verdict, whatever the interval.
    pub(crate) const fn forbids_verdict(&self) -> bool {
        !matches!(self, Self::Incomplete { .. } | Self::FewScenes { .. } | Self::FewSeeds { .. })
    }
}

impl fmt::Display for ResultRemark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ImagesMissing { missing, of } => {
                write!(f, "there is no pair of finished runs on {missing} of {}", counted(*of, "image"))
            }
            Self::ScenesMissing { missing, of } => {
                write!(f, "there is no pair of finished runs on {missing} of {}", counted(*of, "scene"))
            }
            Self::TooFewSeeds { seeds, scenes, needed } => {
                let verb = if *seeds == 1 { "is" } else { "are" };
                let (seeds, scenes) = (counted(*seeds, "seed"), counted(*scenes, "scene"));
                write!(f, "{seeds} on {scenes} {verb} too few (an interval needs {needed} seeds, or {FEWEST} scenes)")
            }
            Self::TooFew { pairs, pairing } => {
                let verb = if *pairs == 1 { "is" } else { "are" };
                write!(f, "{} {verb} too few (an interval needs {FEWEST})", counted(*pairs, pairing.word()))
            }
            Self::CountsDiffer { arm, against, place } => {
                write!(f, "counts differ ({arm:.0} against {against:.0})")?;
                place.as_ref().map_or(Ok(()), |place| write!(f, " on {place}"))
            }
            Self::ClocksDiffer { clocks } => write!(f, "runs were timed in different ways ({})", clocks.join("; ")),
            Self::Infinite { pairs } => write!(f, "PSNR is infinite in {}", counted(*pairs, "pair")),
            Self::Incomplete { pairs, of } => {
                write!(f, "{pairs} of {}, because other runs failed or are missing", counted(*of, "pair"))
            }
            Self::FewScenes { scenes } => {
                write!(f, "only {}; verdicts about other scenes need {FEWEST}", counted(*scenes, "scene"))
            }
            Self::FewSeeds { seeds } => write!(f, "only {}; use {FEWEST_SEEDS} or more", counted(*seeds, "seed")),
        }
    }
}
