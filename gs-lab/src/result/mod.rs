//! What the records of a study say: qualities, differences between arms and effects of factors, with
//! their intervals, verdicts and remarks.
//!
//! [`Results`] are read from a study's folder; [`write_tables`] writes them as files.

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

pub use self::{
    comparison::Difference,
    export::write_tables,
    factorial::{Effect, EffectOf},
    remark::{Pairing, ResultRemark},
    statistics::Interval,
    tables::{Metric, Results, RunQuality, Spread},
    verdict::Verdict,
};
pub(crate) use self::{
    contrast::EQUAL_COUNT,
    export::quoted,
    reach::Reach,
    remark::FEWEST_SEEDS,
    statistics::{CONFIDENCE, FEWEST, RESAMPLES, bootstrap_interval, mean, median},
};
