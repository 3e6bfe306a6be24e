//! What a reader of a difference must know besides its numbers, and whether anything may be said at all.

use std::fmt;

use crate::statistics::FEWEST;
use gs_core::counted;
use serde::{Serialize, Serializer};

/// With fewer seeds a difference may be one of luck with them, which no interval over images shows.
pub const FEWEST_SEEDS: usize = 5;

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
    /// In a word, for several.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Images => "images",
            Self::Seeds => "seeds",
        }
    }

    const fn word(self) -> &'static str {
        match self {
            Self::Images => "image",
            Self::Seeds => "seed",
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
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ImagesMissing { missing, of } => {
                write!(f, "no pair of finished runs on {missing} of {}", counted(*of, "image"))
            }
            Self::TooFew { pairs, pairing } => {
                let verb = if *pairs == 1 { "is" } else { "are" };
                write!(f, "{} {verb} too few: {FEWEST} at least", counted(*pairs, pairing.word()))
            }
            Self::CountsDiffer { arm, against, image } => {
                write!(f, "counts differ: {arm:.0} against {against:.0}")?;
                image.as_ref().map_or(Ok(()), |image| write!(f, " on image {image}"))
            }
            Self::ClocksDiffer { clocks } => write!(f, "timed in different ways: {}", clocks.join("; ")),
            Self::Infinite { pairs } => write!(f, "PSNR is infinite in {}", counted(*pairs, "pair")),
            Self::Incomplete { pairs, of } => {
                write!(f, "{pairs} of {}: other runs failed or are missing", counted(*of, "pair"))
            }
            Self::FewSeeds { seeds } => write!(f, "few seeds: {seeds}, {FEWEST_SEEDS} would do"),
        }
    }
}

impl Serialize for Remark {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}
