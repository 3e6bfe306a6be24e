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
pub enum PoseQuality {
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
    pub quality: PoseQuality,
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
        let is_logged = registered.iter().any(|name| features.contains_key(name));
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
                None if is_logged => "COLMAP cannot read it".to_owned(),
                _ => "it matches too few of the others".to_owned(),
            }
        };
        let left_out: Vec<LeftOut> =
            missing.iter().map(|photograph| LeftOut { name: photograph.name.clone(), why: why(photograph) }).collect();
        let mean = |sum: f64, count: usize| if count > 0 { sum / count as f64 } else { 0.0 };
        let observations = model.images.iter().map(|image| image.observations as f64).sum();
        let own = |piece: &BTreeSet<String>| piece.difference(&registered).count();
        let mut verdict = Self {
            quality: PoseQuality::Good,
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

    fn rate(&self) -> PoseQuality {
        let is_doubtful = self.error_px > LARGE_ERROR || self.observations < FEW_OBSERVATIONS;
        match self.share() {
            share if share < SHARES[1] || self.registered < 3 => PoseQuality::Poor,
            share if share < SHARES[0] || is_doubtful => PoseQuality::Usable,
            _ => PoseQuality::Good,
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
            PoseQuality::Good => "good",
            PoseQuality::Usable => "usable",
            PoseQuality::Poor => "poor",
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

#[cfg(test)]
mod tests {
    use gs_core::Image;
    use tempfile::TempDir;

    use super::*;
    use crate::{input::photographs::Exif, model};

    /// Photographs of stripes that are so many pixels wide.
    fn photographs(widths: &[f32]) -> (TempDir, Photographs) {
        let folder = tempfile::tempdir().unwrap();
        let photograph = |(number, width): (usize, &f32)| {
            let (name, size) = (format!("{number}.png"), (200, 50));
            let path = folder.path().join(&name);
            let value = |x: u32| 0.5 + 0.4 * (x as f32 * std::f32::consts::PI / width).sin();
            gs_io::write_png(&path, &Image::from_fn(size.0, size.1, |x, _| [value(x); 3]).unwrap()).unwrap();
            Photograph { name, path, mask: None, size, exif: Exif::default() }
        };
        let files = widths.iter().enumerate().map(photograph).collect();
        let found = Photographs { folder: folder.path().to_owned(), files, left_out: Vec::new(), heic: Vec::new() };
        (folder, found)
    }

    /// A model of the photographs with these numbers, which see so many points.
    fn model(numbers: std::ops::Range<usize>, points: usize) -> Model {
        let folder = tempfile::tempdir().unwrap();
        let names: Vec<String> = numbers.map(|number| format!("{number}.png")).collect();
        let images: Vec<_> =
            names.iter().map(|name| (name.as_str(), glam::DQuat::IDENTITY, glam::DVec3::ZERO)).collect();
        for (name, bytes) in model::tests::files(&images, &vec![glam::DVec3::Z; points]) {
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        Model::read(folder.path()).unwrap()
    }

    /// The verdict on photographs of sharp stripes, except for the last.
    fn judged(last: f32, models: &[Model], features: &[(&str, u32)]) -> Verdict {
        let (_folder, photographs) = photographs(&[3.0, 3.0, 3.0, 3.0, last]);
        let features = features.iter().map(|(name, count)| ((*name).to_owned(), *count)).collect();
        Verdict::new(&photographs, models, &features, "3.8".to_owned())
    }

    fn reasons(verdict: &Verdict) -> Vec<(&str, &str)> {
        verdict.left_out.iter().map(|left_out| (left_out.name.as_str(), left_out.why.as_str())).collect()
    }

    #[test]
    fn good_poses_need_no_advice() {
        let verdict = judged(3.0, &[model(0..5, 200)], &[]);
        assert_eq!((verdict.quality, verdict.registered, verdict.points), (PoseQuality::Good, 5, 200));
        assert_eq!((reasons(&verdict), verdict.advice.len()), (Vec::new(), 0));
        assert_eq!(
            verdict.to_string(),
            "good: 5 of 5 photographs have poses, with 200 points that miss their features by 0.50 px on average; a \
             photograph sees 200 of them"
        );
    }

    #[test]
    fn few_poses_are_poor() {
        let verdict = judged(3.0, &[model(0..2, 100)], &[]);
        assert_eq!(verdict.quality, PoseQuality::Poor);
        let why = "it matches too few of the others";
        assert_eq!(reasons(&verdict), [("2.png", why), ("3.png", why), ("4.png", why)]);
        assert!(verdict.advice[0].starts_with("neighbours should show the same place"), "{verdict}");
        assert!(verdict.advice[1].starts_with("a photograph sees only 100 points"), "{verdict}");
    }

    #[test]
    fn a_photograph_is_left_out_for_what_is_wrong_with_it() {
        let verdict = judged(30.0, &[model(0..4, 200)], &[("4.png", 120)]);
        assert_eq!((verdict.quality, reasons(&verdict)), (PoseQuality::Usable, vec![("4.png", "it is blurred")]));
        assert!(verdict.advice[0].starts_with("1 photograph is blurred: take them again"), "{verdict}");
        let found = |features: &[(&str, u32)]| judged(3.0, &[model(0..4, 200)], features).left_out[0].why.clone();
        assert_eq!(found(&[("4.png", 120)]), "it has only 120 features");
        assert_eq!(found(&[("4.png", 900)]), "it matches too few of the others");
        assert_eq!(found(&[("3.png", 900)]), "COLMAP cannot read it");
    }

    #[test]
    fn other_pieces_are_counted() {
        let verdict = judged(3.0, &[model(0..3, 200), model(2..5, 200)], &[]);
        let why = "it belongs to another piece";
        assert_eq!((verdict.quality, reasons(&verdict)), (PoseQuality::Usable, vec![("3.png", why), ("4.png", why)]));
        assert_eq!(verdict.pieces, [2]);
        assert!(verdict.advice[0].contains("the largest was taken (others: 2 photographs)"), "{verdict}");
        assert!(verdict.to_string().contains("\nleft out: 3.png, 4.png, because it belongs to another piece"));
    }
}
