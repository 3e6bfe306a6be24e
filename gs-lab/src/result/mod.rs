//! What the records of a study say: qualities, differences between arms and effects of factors, with
//! their intervals, verdicts and remarks.
//!
//! [`Results`] are read from a study's folder; `write_tables` writes them as files.

mod claim;
mod claims;
mod comparison;
mod contrast;
mod export;
mod factorial;
mod reach;
pub(crate) mod remark;
mod statistics;
mod tables;
mod verdict;

#[cfg(test)]
pub(crate) use self::claim::Number;
pub use self::{claim::significant, tables::Results};
pub(crate) use self::{
    claim::{Circumstance, Claim, ClaimVerdict, claims_csv, verdicts},
    comparison::Difference,
    contrast::{EQUAL_COUNT, Judged},
    export::{csv_row, write_tables},
    factorial::{Effect, EffectOf},
    reach::Reach,
    remark::{FEWEST_SEEDS, ResultRemark},
    statistics::{FEWEST, Interval, mean, median},
    tables::{Metric, RunQuality, Spread},
    verdict::Verdict,
};
