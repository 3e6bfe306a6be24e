//! The verdict on the poses that were found, in plain words.

use std::collections::{BTreeMap, BTreeSet};

use gs_core::counted;
use serde::{Deserialize, Serialize};

use crate::{
    gps::Gps,
    input::photographs::{Photograph, Photographs},
    inspection::Inspection,
    model::Model,
};

/// Features below which a photograph has too few.
const FEW_FEATURES: u32 = 300;

/// Features of a photograph that belong to points, below which poses are doubtful.
const FEW_OBSERVATIONS: f64 = 150.0;

/// Mean reprojection error above which poses are doubtful, px.
const LARGE_ERROR: f64 = 1.5;

/// Shares of the photographs from which poses are good, and usable.
const SHARES: [f64; 2] = [0.95, 0.6];

/// Names that are listed in one line.
const NAMES_SHOWN: usize = 5;

/// How good the poses are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// Nearly all photographs have poses that fit.
    Good,
    /// Enough for a scene, with gaps.
    Usable,
    /// Most photographs are missing, or poses do not fit.
    Poor,
}

/// A photograph without a pose.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut {
    /// Its name.
    pub name: String,
    /// Why, in words.
    pub why: String,
}

/// What was found, and how good it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// How good the poses are.
    pub quality: Quality,
    /// Number of photographs.
    pub photographs: usize,
    /// Number of those with a pose.
    pub registered: usize,
    /// Photographs without a pose.
    pub left_out: Vec<LeftOut>,
    /// Number of points.
    pub points: usize,
    /// Mean distance of points from their features, px.
    pub error_px: f64,
    /// Mean number of features of a photograph that belong to points.
    pub observations: f64,
    /// Number of photographs of each other piece, which hangs together with the first by nothing.
    pub pieces: Vec<usize>,
    /// GPS positions that gave the model its scale (metres) and directions (x east, z north); `None` if there were too
    /// few.
    #[serde(default)]
    pub gps: Option<Gps>,
    /// What could be better, and what to do.
    pub advice: Vec<String>,
    /// COLMAP's version.
    pub colmap: String,
}

impl Verdict {
    /// Judges the largest of the models, which are sorted by size and not empty.
    pub(crate) fn new(
        photographs: &Photographs,
        models: &[Model],
        features: &BTreeMap<String, u32>,
        colmap: String,
    ) -> Self {
        let model = &models[0];
        let names = |model: &Model| model.images.iter().map(|image| image.name.clone()).collect::<BTreeSet<_>>();
        let registered = names(model);
        let missing: Vec<&Photograph> =
            photographs.files.iter().filter(|photograph| !registered.contains(&photograph.name)).collect();
        let others: Vec<BTreeSet<String>> = models[1..].iter().map(names).collect();
        let inspection = Inspection::of(photographs, &registered, &missing);
        let why = |photograph: &Photograph| {
            let found = features.get(&photograph.name);
            if others.iter().any(|piece| piece.contains(&photograph.name)) {
                return "it belongs to another piece".to_owned();
            }
            if let Some(why) = inspection.fault(&photograph.name) {
                return why.to_owned();
            }
            match found {
                Some(count) if *count < FEW_FEATURES => format!("it has only {}", counted(*count, "feature")),
                _ => "it matches too few of the others".to_owned(),
            }
        };
        let left_out: Vec<LeftOut> =
            missing.iter().map(|photograph| LeftOut { name: photograph.name.clone(), why: why(photograph) }).collect();
        let mean = |sum: f64, count: usize| if count > 0 { sum / count as f64 } else { 0.0 };
        let observations = model.images.iter().map(|image| image.observations as f64).sum();
        let own = |piece: &BTreeSet<String>| piece.difference(&registered).count();
        let mut verdict = Self {
            quality: Quality::Good,
            photographs: photographs.files.len(),
            registered: registered.len(),
            left_out,
            points: model.errors.len(),
            error_px: mean(model.errors.iter().filter(|error| **error >= 0.0).sum(), model.errors.len()),
            observations: mean(observations, model.images.len()),
            pieces: others.iter().map(own).filter(|count| *count > 0).collect(),
            gps: None,
            advice: Vec::new(),
            colmap,
        };
        verdict.quality = verdict.rate();
        verdict.advice = verdict.advise(&inspection);
        verdict
    }

    fn share(&self) -> f64 {
        self.registered as f64 / self.photographs.max(1) as f64
    }

    fn rate(&self) -> Quality {
        let is_doubtful = self.error_px > LARGE_ERROR || self.observations < FEW_OBSERVATIONS;
        match self.share() {
            share if share < SHARES[1] || self.registered < 3 => Quality::Poor,
            share if share < SHARES[0] || is_doubtful => Quality::Usable,
            _ => Quality::Good,
        }
    }

    fn advise(&self, inspection: &Inspection) -> Vec<String> {
        let mut advice = Vec::new();
        if !self.pieces.is_empty() {
            let sizes: Vec<String> = self.pieces.iter().map(|count| counted(*count, "photograph")).collect();
            advice.push(format!(
                "the photographs fall into pieces that share no matches, of which the largest was taken (others: {}): take \
                 photographs that lead from one to the other, or give each place its own folder",
                sizes.join(", ")
            ));
        }
        let blurred = inspection.blurred();
        if blurred > 0 {
            advice
                .push(format!("{} blurred: take them again, with a shorter exposure or a steadier hand", are(blurred)));
        }
        let dark = inspection.dark();
        if dark > 0 {
            advice.push(format!("{} dark: take them again with more light or a longer exposure", are(dark)));
        }
        let matchless = self.left_out.iter().filter(|left_out| left_out.why.contains("matches too few")).count();
        if matchless > 0 && self.share() < SHARES[0] {
            advice.push(
                "neighbours should show the same place from nearby: take photographs between those that were left out \
                 and the others, so that each overlaps the next by two thirds"
                    .to_owned(),
            );
        }
        if self.observations < FEW_OBSERVATIONS {
            advice.push(format!(
                "a photograph sees only {:.0} points on average: add photographs, and avoid walls without texture, \
                 reflections and things that move",
                self.observations
            ));
        }
        if self.error_px > LARGE_ERROR {
            advice.push(format!(
                "points miss their features by {:.1} px on average: name the kind of lens with --lens, and avoid zooming and \
                 things that move",
                self.error_px
            ));
        }
        advice
    }
}

fn are(count: usize) -> String {
    format!("{} {}", counted(count, "photograph"), if count == 1 { "is" } else { "are" })
}

impl std::fmt::Display for Verdict {
    /// Several lines, without a line break at the end.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let word = match self.quality {
            Quality::Good => "good",
            Quality::Usable => "usable",
            Quality::Poor => "poor",
        };
        write!(
            f,
            "{word}: {} of {} have poses, with {} that miss their features by {:.2} px on average; a photograph sees {:.0} of them",
            self.registered,
            counted(self.photographs, "photograph"),
            counted(self.points, "point"),
            self.error_px,
            self.observations
        )?;
        let mut by_reason: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        self.left_out.iter().for_each(|LeftOut { name, why }| by_reason.entry(why).or_default().push(name));
        for (why, names) in by_reason {
            let more = names.len().saturating_sub(NAMES_SHOWN);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            let shown: Vec<String> =
                names.iter().take(NAMES_SHOWN).map(|name| name.escape_debug().to_string()).collect();
            write!(f, "\nleft out: {}{more}, because {why}", shown.join(", "))?;
        }
        if let Some(Gps { positions, fitting, residual_m }) = &self.gps {
            write!(
                f,
                "\na unit is 1 m, x is east and z is north by GPS: {fitting} of {positions} positions fit, and miss the cameras \
                 by {residual_m:.1} m (median)"
            )?;
        }
        self.advice.iter().try_for_each(|advice| write!(f, "\nadvice: {advice}"))
    }
}
