//! Names of the files with the results of a study, which its folder protects.

/// The table of held-out views.
pub(crate) const VIEWS: &str = "views.csv";
/// The verdicts on the study's claims.
pub(crate) const CLAIMS: &str = "claims.csv";

/// File names of the tables.
pub(crate) const TABLES: [&str; 9] = [
    "runs.csv",
    "quality.csv",
    "differences.csv",
    "differences-at-time.csv",
    VIEWS,
    CLAIMS,
    "effects.csv",
    "effects-at-time.csv",
    "times.csv",
];

/// The page of the report.
pub(crate) const PAGE: &str = "report.html";

/// The folder of the report's figures.
pub(crate) const PLOTS: &str = "plots";
