//! The choices: which photographs share a camera, its lens, how many features, which pairs.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::PathBuf,
};

use serde::{Deserialize, Serialize};

use crate::{
    input::photographs::{Exif, Photograph},
    model::Registered,
    settings::{LensKind, Pairs, Settings},
};

/// Photographs before and after each by which it is compared if not all pairs are.
pub(crate) const OVERLAP: usize = 10;

/// The most photographs of which all pairs are compared by default.
const ALL_PAIRS: usize = 150;

/// The fewest and the most features of a photograph that are looked for.
const FEATURES: [f64; 2] = [1024.0, 8192.0];

/// Features times the root of the number of pairs, which COLMAP 3.8 compares in some minutes of a CPU: a
/// pair takes time by about the square of the features.
const WORK: f64 = 66_000.0;

/// Pairs of 29 photographs. With more pairs, a slow COLMAP first compares them in one direction only, and there are fewer
/// features still, by this power of the number of pairs, because all else takes longer with more photographs, too.
const MANY_PAIRS: f64 = 406.0;
const FEWER: f64 = 0.3;

/// Size up to which features are also looked for in an image of twice the size, px.
const SMALL: u32 = 1000;

/// Features from which they are also looked for in larger images of twice the size: COLMAP keeps the
/// coarsest, so that the finest, which make poses precise, are only among many.
const MANY: f64 = 4096.0;

/// Photographs of a camera from which its lens is described by eight numbers instead of four.
const FULL_LENS: usize = 8;

/// Relative difference of widths and heights below which photographs of one camera have the same focal length.
const SIMILAR: f64 = 0.05;

/// The longest focal length of a fish-eye, mm on 35 mm film, of a camera that is made for sports.
const ACTION_MM: u32 = 19;

/// What COLMAP is asked to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Plan {
    /// The photographs by camera.
    pub(crate) groups: Vec<Group>,
    /// Whether all pairs are compared.
    pub(crate) all_pairs: bool,
    /// Features of a photograph that are looked for.
    pub(crate) features: u32,
    /// Whether features are also looked for in an image of twice the size.
    pub(crate) doubled: bool,
    /// The longer side of the images in which features are looked for, px.
    pub(crate) max_size: u32,
    /// Whether only the nearest feature of the second photograph is looked for, and not also whether that one's nearest
    /// is the feature of the first. Takes half of the time.
    pub(crate) one_way: bool,
    /// Whether features of less contrast count, too.
    pub(crate) faint: bool,
    /// The vocabulary tree that complements neighbours.
    #[serde(default)]
    pub(crate) vocabulary: Option<PathBuf>,
}

/// Photographs that one camera took.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Group {
    /// COLMAP's model of the camera.
    pub(crate) model: String,
    /// The camera's name, focal length and folder: equal for groups that differ in size alone.
    kind: String,
    /// Columns and rows of the photographs.
    size: (u32, u32),
    /// The focal length as a share of the longer side, if an attempt before has found it.
    focal: Option<f64>,
    /// The names of the photographs.
    pub(crate) names: Vec<String>,
}

impl Plan {
    /// The plan for a COLMAP that compares `pace` times as many features as version 3.8 on a CPU.
    pub(crate) fn new(photographs: &[Photograph], settings: &Settings, pace: u32) -> Self {
        type Key<'a> = (&'a str, Option<u32>, (u32, u32), &'a str);
        let mut groups: BTreeMap<Key<'_>, Vec<&Photograph>> = BTreeMap::new();
        for photograph in photographs {
            let Photograph { exif, size, name, .. } = photograph;
            // Without EXIF data, folders are cameras.
            let folder =
                if exif.camera.is_empty() { name.rsplit_once('/').map_or("", |(folder, _)| folder) } else { "" };
            groups.entry((&exif.camera, exif.focal, *size, folder)).or_default().push(photograph);
        }
        let longest = photographs.iter().map(|photograph| photograph.size.0.max(photograph.size.1)).max().unwrap_or(0);
        let groups = groups.into_iter().map(|(key, of_camera)| Group {
            model: model(&of_camera[0].exif, of_camera.len(), settings.lens).to_owned(),
            kind: format!("{} {:?} {}", key.0, key.1, key.3),
            size: key.2,
            focal: None,
            names: of_camera.iter().map(|photograph| photograph.name.clone()).collect(),
        });
        let count = photographs.len();
        let all_pairs = match settings.pairs {
            Pairs::Auto => count <= ALL_PAIRS,
            Pairs::All => true,
            Pairs::Neighbours => false,
        };
        let pairs = pairs(count, all_pairs) as f64;
        let features = WORK / pairs.max(1.0).sqrt() * (MANY_PAIRS / pairs.max(MANY_PAIRS)).powf(FEWER);
        let features = features.clamp(FEATURES[0], FEATURES[1]) * f64::from(pace);
        Self {
            groups: groups.collect(),
            all_pairs,
            features: features as u32,
            doubled: longest.min(settings.max_size) <= SMALL || features >= MANY,
            max_size: settings.max_size,
            one_way: pairs > MANY_PAIRS,
            faint: false,
            vocabulary: settings.vocabulary.clone().filter(|_| !all_pairs),
        }
    }

    /// The plan for a second attempt, where few photographs match: with more features, of less contrast too, and
    /// with the focal lengths of the cameras of which the first attempt has `registered` enough photographs. Matches
    /// must be mutual, and agree with the focal length: among many features that look alike, others hang parts of
    /// the scene where they don't belong.
    pub(crate) fn thorough(&self, registered: &[Registered]) -> Self {
        let measured = |group: &Group| {
            let mut images = registered.iter().filter(|image| group.names.contains(&image.name));
            let focal = images.next()?.focal;
            Some((1 + images.count(), focal))
        };
        let focal = |group: &Group| {
            let similar = self.groups.iter().filter(|other| group.is_similar(other)).filter_map(measured);
            let (images, focal) = similar.max_by_key(|(images, _)| *images)?;
            (images >= FULL_LENS).then_some(focal)
        };
        let groups = self.groups.iter().map(|group| Group { focal: focal(group), ..group.clone() });
        Self {
            groups: groups.collect(),
            features: self.features * 2,
            doubled: true,
            one_way: false,
            faint: true,
            ..self.clone()
        }
    }

    pub(crate) fn photographs(&self) -> usize {
        self.groups.iter().map(|group| group.names.len()).sum()
    }
}

impl Group {
    /// Whether another group is of the same camera, and of nearly the same size.
    fn is_similar(&self, other: &Self) -> bool {
        let near = |a: u32, b: u32| (f64::from(a) / f64::from(b) - 1.0).abs() < SIMILAR;
        self.kind == other.kind && near(self.size.0, other.size.0) && near(self.size.1, other.size.1)
    }

    /// The parameters of the camera's model, px, if the focal length is known.
    pub(crate) fn parameters(&self) -> Option<String> {
        let [width, height] = [self.size.0, self.size.1].map(f64::from);
        let (focal, x, y) = (self.focal? * width.max(height), 0.5 * width, 0.5 * height);
        Some(match self.model.as_str() {
            "SIMPLE_RADIAL" => format!("{focal},{x},{y},0"),
            _ => format!("{focal},{focal},{x},{y},0,0,0,0"),
        })
    }
}

/// The pairs of neighbours by time, one in a line, as far from each other as COLMAP's neighbours by name: up to
/// [`OVERLAP`], and powers of two. `None` where these are neighbours by name, too, where a time is missing, or where a
/// name has a blank, which separates the two names of a line.
pub(crate) fn pairs_by_time(photographs: &[Photograph]) -> Option<String> {
    let taken = |photograph: &'_ Photograph| Some((photograph.exif.taken.clone()?, photograph.name.clone()));
    let mut sorted: Vec<(String, String)> = photographs.iter().map(taken).collect::<Option<_>>()?;
    if sorted.is_sorted() || sorted.iter().any(|(_, name)| name.contains(' ')) {
        return None;
    }
    sorted.sort_unstable();
    let steps: BTreeSet<usize> = (1..=OVERLAP).chain((0..OVERLAP).map(|power| 1 << power)).collect();
    let pair = |at: usize, step: &usize| Some(format!("{} {}\n", sorted[at].1, sorted.get(at + step)?.1));
    Some((0..sorted.len()).flat_map(|at| steps.iter().filter_map(move |step| pair(at, step))).collect())
}

fn pairs(photographs: usize, all: bool) -> usize {
    if all { photographs * photographs.saturating_sub(1) / 2 } else { photographs * OVERLAP }
}

/// COLMAP's model of a camera.
fn model(exif: &Exif, photographs: usize, lens: LensKind) -> &'static str {
    let name = exif.camera.to_lowercase();
    let is_named = ["fisheye", "fish-eye", "fish eye"].iter().any(|word| name.contains(word));
    let is_action = ["gopro", "insta360"].iter().any(|maker| name.contains(maker));
    let is_wide = exif.focal_35mm.is_some_and(|focal| focal <= ACTION_MM);
    match lens {
        LensKind::Fisheye => "OPENCV_FISHEYE",
        LensKind::Auto if is_named || is_action && is_wide => "OPENCV_FISHEYE",
        _ if photographs >= FULL_LENS => "OPENCV",
        _ => "SIMPLE_RADIAL",
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    fn photograph(name: &str, camera: &str, focal: u32, size: (u32, u32)) -> Photograph {
        let exif =
            Exif { camera: camera.to_owned(), focal: (focal > 0).then_some(focal), orientation: 1, ..Exif::default() };
        Photograph { name: name.to_owned(), path: name.into(), mask: None, size, exif }
    }

    #[test]
    fn photographs_of_one_camera_share_intrinsics() {
        let mut photographs = vec![
            photograph("a.jpg", "Nikon", 3500, (4000, 3000)),
            photograph("b.jpg", "Nikon", 3500, (4000, 3000)),
            photograph("c.jpg", "Nikon", 5000, (4000, 3000)),
            photograph("d.jpg", "Nikon", 3500, (3000, 4000)),
            photograph("e.jpg", "Canon", 3500, (4000, 3000)),
            photograph("left/f.jpg", "", 0, (4000, 3000)),
            photograph("right/f.jpg", "", 0, (4000, 3000)),
        ];
        let names = |photographs: &[Photograph]| -> Vec<Vec<String>> {
            let mut groups: Vec<_> =
                Plan::new(photographs, &Settings::default(), 1).groups.into_iter().map(|group| group.names).collect();
            groups.sort();
            groups
        };
        let expected = [&["a.jpg", "b.jpg"][..], &["c.jpg"], &["d.jpg"], &["e.jpg"], &["left/f.jpg"], &["right/f.jpg"]];
        assert_eq!(names(&photographs), expected);
        // Pixels are used as they are stored: how they are turned to be shown makes no other camera.
        photographs[1].exif.orientation = 6;
        assert_eq!(names(&photographs), expected);
    }

    /// Nine photographs of one camera, and their poses.
    pub(crate) fn nine() -> (Vec<Photograph>, Vec<Registered>) {
        let names: Vec<String> = (0..9).map(|i| format!("{i}.jpg")).collect();
        let registered = |name: &String| {
            let (rotation, translation) = (glam::DQuat::IDENTITY, glam::DVec3::ZERO);
            Registered { name: name.clone(), rotation, translation, observations: 0, focal: 0.8 }
        };
        let photographs = names.iter().map(|name| photograph(name, "", 0, (375, 500)));
        (photographs.collect(), names.iter().map(registered).collect())
    }

    #[test]
    fn a_second_attempt_knows_the_focal_length_of_the_first() {
        let (mut photographs, registered) = nine();
        photographs.push(photograph("narrow.jpg", "", 0, (371, 500)));
        photographs.push(photograph("cropped.jpg", "", 0, (375, 375)));
        photographs.push(photograph("larger.jpg", "", 0, (750, 1000)));
        let plan = Plan::new(&photographs, &Settings::default(), 1);
        let parameters = |registered: &[Registered]| -> Vec<Option<String>> {
            plan.thorough(registered).groups.iter().map(Group::parameters).collect()
        };
        let shared = [Some("400,185.5,250,0"), None, Some("400,400,187.5,250,0,0,0,0"), None];
        assert_eq!(parameters(&registered), shared.map(|text| text.map(str::to_owned)));
        assert_eq!(parameters(&registered[..7]), vec![None; 4], "seven photographs are too few");
    }

    #[test]
    fn the_number_of_photographs_decides_pairs_features_and_lens() {
        let plan = |count: usize, settings: &Settings| {
            let photographs: Vec<_> =
                (0..count).map(|i| photograph(&format!("{i:04}.jpg"), "", 0, (2000, 1500))).collect();
            Plan::new(&photographs, settings, 1)
        };
        let settings = Settings::default();
        let [three, many, most] = [3, 150, 151].map(|count| plan(count, &settings));
        assert_eq!((three.groups[0].model.as_str(), three.features), ("SIMPLE_RADIAL", 8192));
        assert_eq!((many.groups[0].model.as_str(), many.features), ("OPENCV", 1024));
        assert!(many.all_pairs && !most.all_pairs);
        assert!(three.doubled && !many.doubled);
        assert!(!plan(29, &settings).one_way && plan(30, &settings).one_way);
        assert!(plan(400, &settings.clone().with(|s| s.pairs = Pairs::All)).all_pairs);
        let fisheye = settings.with(|s| s.lens = LensKind::Fisheye);
        assert_eq!(plan(3, &fisheye).groups[0].model, "OPENCV_FISHEYE");
    }

    #[test]
    fn neighbours_by_time_are_as_many_as_by_name() {
        let times = |times: &[Option<u32>]| -> Vec<Photograph> {
            let named = |(i, time): (usize, &Option<u32>)| {
                let mut photograph = photograph(&format!("{i:02}.jpg"), "", 0, (400, 300));
                photograph.exif.taken = time.map(|time| format!("2026:01:02 03:04:{time:02}."));
                photograph
            };
            times.iter().enumerate().map(named).collect()
        };
        // Names decide ties.
        assert_eq!(
            pairs_by_time(&times(&[Some(2), Some(1), Some(1)])).as_deref(),
            Some("01.jpg 02.jpg\n01.jpg 00.jpg\n02.jpg 00.jpg\n")
        );
        let backwards: Vec<Option<u32>> = (0..20).rev().map(Some).collect();
        let pairs = pairs_by_time(&times(&backwards)).unwrap();
        let of_first: Vec<usize> =
            pairs.lines().filter_map(|line| line.strip_prefix("19.jpg ")?[..2].parse().ok()).collect();
        assert_eq!(of_first, [18, 17, 16, 15, 14, 13, 12, 11, 10, 9, 3]);
        assert_eq!(pairs_by_time(&times(&[Some(1), Some(2), Some(3)])), None, "the order of the names");
        assert_eq!(pairs_by_time(&times(&[Some(3), None, Some(1)])), None, "a time is missing");
        let mut blank = times(&[Some(2), Some(1)]);
        blank[0].name = "a b.jpg".to_owned();
        assert_eq!(pairs_by_time(&blank), None, "a name has a blank");
    }

    #[test]
    fn fish_eyes_are_known_by_their_names() {
        let model = |camera: &str, focal_35mm| {
            model(&Exif { camera: camera.to_owned(), focal_35mm, ..Exif::default() }, 20, LensKind::Auto)
        };
        assert_eq!(model("NIKON D60 AF DX Fisheye-Nikkor 10.5mm", Some(16)), "OPENCV_FISHEYE");
        assert_eq!(model("GoPro HERO9 Black", Some(15)), "OPENCV_FISHEYE");
        assert_eq!((model("GoPro HERO9 Black", Some(27)), model("Apple iPhone 13", Some(13))), ("OPENCV", "OPENCV"));
    }
}
