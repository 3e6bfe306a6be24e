//! What the records of a study say: qualities, differences between arms and effects of factors, with
//! their intervals, verdicts and remarks.
//!
//! [`Results`] are read from a study's folder; [`write_tables`] writes them as files.

mod claim;
mod claims;
mod comparison;
mod contrast;
mod export;
mod factorial;
mod reach;
mod remark;
mod statistics;
mod tables;
mod text_tables;
mod verdict;

pub(crate) use self::{
    claim::significant,
    contrast::EQUAL_COUNT,
    export::csv_row,
    reach::Reach,
    remark::FEWEST_SEEDS,
    statistics::{CONFIDENCE, FEWEST, RESAMPLES, mean, median},
};
pub use self::{
    claim::{Circumstance, Claim, ClaimVerdict, Number, claims_csv, verdicts},
    comparison::Difference,
    export::write_tables,
    factorial::{Effect, EffectOf},
    remark::{Pairing, ResultRemark},
    statistics::Interval,
    tables::{Metric, Results, RunQuality, Spread},
    verdict::Verdict,
};
