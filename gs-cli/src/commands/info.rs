//! `gs info`: the content of a scene, a checkpoint or a data set, or the GPUs of the machine.

mod adapters;
mod dataset;
mod measure;
mod scene3d;
mod values;

use std::{collections::BTreeMap, fmt::Write, path::PathBuf};

use clap::Args;
use gs_core::{RenderSettings, Scene, counted, sigmoid};
use gs_io::{
    AnyScene, File2d, SceneFile, Values,
    dataset::{may_be_dataset, read_dataset},
    readable_in,
};
use gs_lab::report::significant;
use serde::Serialize;

use self::measure::Measure;
use self::values::{ValueQuantiles, not_finite_2d};
use crate::{
    failure::Failure,
    files::scene,
    flags::dataset::DatasetArgs,
    terminal::output::{self, printable},
};

/// The flags of `gs info`.
#[derive(Debug, Clone, Args)]
pub(crate) struct InfoArgs {
    /// A scene file, a checkpoint, the output folder of gs fit or gs train, or a data set of posed
    /// images
    #[arg(required_unless_present = "adapters")]
    file: Option<PathBuf>,
    /// List the GPUs and software drivers of this machine, and the choice of --backend auto
    #[arg(long, conflicts_with = "file")]
    adapters: bool,
    /// Measure in a 3D scene: the distance of two points X,Y,Z,X,Y,Z, or the area of a polygon
    /// polygon:X,Z,X,Z,X,Z as seen from above and the heights of the scene in it
    #[arg(long, value_name = "PLACES", allow_hyphen_values = true)]
    measure: Option<Measure>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    images: DatasetArgs,
}

/// What `gs info --json` prints.
#[derive(Debug, Serialize)]
struct Info {
    kind: Kind,
    /// Size of the file.
    bytes: u64,
    bytes_per_gaussian: Option<f64>,
    gaussians: usize,
    /// Width of the image that the scene was made for, px.
    width: u32,
    height: u32,
    /// How the scene is rendered.
    render: RenderSettings,
    /// Whether the file has alpha; the scene is the picture on white then.
    alpha: bool,
    /// ICC profile of the colours; `null` for sRGB.
    profile: Option<Profile>,
    /// Ranges of the finite values, by parameter.
    ranges: BTreeMap<&'static str, Range>,
    /// Gaussians with a parameter that is NaN or infinite (an opacity of exactly 0 or 1 is
    /// neither).
    not_finite: usize,
    /// The metadata of a checkpoint.
    metadata: BTreeMap<String, String>,
}

/// An ICC profile.
#[derive(Debug, Serialize)]
struct Profile {
    name: String,
    bytes: usize,
}

#[derive(Debug, Clone, Copy, Serialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Scene,
    Checkpoint,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Range {
    min: f32,
    median: f32,
    max: f32,
}

/// Prints the content of a file, or lists the adapters.
pub(crate) fn run(args: &InfoArgs) -> Result<(), Failure> {
    // The command line has either the file or --adapters.
    let Some(file) = &args.file else {
        return adapters::run(args.json);
    };
    if may_be_dataset(file) {
        match read_dataset(file, &args.images.settings()) {
            Err(gs_io::Error::NotADataset { .. }) if readable_in(file).is_some() => {}
            dataset => return dataset::print(&dataset?, args.json),
        }
    }
    let SceneFile { path, scene, metadata, has_alpha, .. } = scene::read(file, Values::Any)?;
    let scene_2d = match (scene, &args.measure) {
        (AnyScene::ThreeD(file), Some(measure)) => return measure.print(&file, args.json),
        (AnyScene::TwoD(_), Some(_)) => {
            return Err(Failure::usage("is a 2D scene, and --measure measures 3D scenes").at(file.display()));
        }
        (AnyScene::ThreeD(file), None) => return scene3d::print(&path, *file, metadata, args.json),
        (AnyScene::TwoD(scene_2d), None) => scene_2d,
    };
    let bytes = std::fs::metadata(&path).map_or(0, |file| file.len());
    let kind = if metadata.is_some() { Kind::Checkpoint } else { Kind::Scene };
    if metadata.is_none() {
        scene_2d.validate().map_err(|source| Failure::of_scene(gs_io::Error::Content { path, source }))?;
    }
    let info = Info { alpha: has_alpha, metadata: metadata.unwrap_or_default(), ..Info::of(kind, bytes, &scene_2d) };
    output::answer(args.json, &info, || text(&info))
}

impl Info {
    fn of(kind: Kind, bytes: u64, file: &File2d) -> Self {
        let File2d { scene, width, height, settings, profile, .. } = file;
        let gaussians = scene.len();
        let mut ranges = BTreeMap::new();
        let mut add = |name, values: Vec<f32>| {
            if let Some(quantiles) = ValueQuantiles::of(values) {
                ranges.insert(name, quantiles.into());
            }
        };
        add("x (px)", scene.means.iter().map(|m| m.x).collect());
        add("y (px)", scene.means.iter().map(|m| m.y).collect());
        add("larger scale (px)", scene.log_scales.iter().map(|s| s.max_element().exp()).collect());
        add("smaller scale (px)", scene.log_scales.iter().map(|s| s.min_element().exp()).collect());
        add("opacity", scene.opacity_logits.iter().map(|&logit| sigmoid(logit)).collect());
        add("red", scene.colors.iter().map(|c| c.x).collect());
        add("green", scene.colors.iter().map(|c| c.y).collect());
        add("blue", scene.colors.iter().map(|c| c.z).collect());
        Self {
            kind,
            bytes,
            bytes_per_gaussian: (gaussians > 0).then(|| bytes as f64 / gaussians as f64),
            gaussians,
            width: *width,
            height: *height,
            render: *settings,
            alpha: false,
            profile: profile.as_ref().map(|profile| Profile { name: profile.name(), bytes: profile.bytes().len() }),
            ranges,
            not_finite: not_finite_2d(scene),
            metadata: BTreeMap::new(),
        }
    }
}

impl From<ValueQuantiles> for Range {
    fn from(ValueQuantiles { min, median, max, .. }: ValueQuantiles) -> Self {
        Self { min, median, max }
    }
}

fn text(info: &Info) -> String {
    let kind = match info.kind {
        Kind::Scene => "2D scene",
        Kind::Checkpoint => "checkpoint of a 2D fit",
    };
    let mut rows = vec![("kind", kind.to_owned()), ("Gaussians", info.gaussians.to_string())];
    rows.push(("canvas", format!("{}x{} px", info.width, info.height)));
    let each = info.bytes_per_gaussian.map_or_else(String::new, |each| format!(", {each:.1} a Gaussian"));
    rows.push(("size", format!("{}{each}", counted(info.bytes, "byte"))));
    rows.push(("blend", info.render.effects.blend.name().to_owned()));
    rows.push(("background", format!("{:?}", info.render.background_color())));
    if info.alpha {
        rows.push(("alpha", "yes; the values here are those of the picture on white".to_owned()));
    }
    if let Some(Profile { name, bytes }) = &info.profile {
        rows.push(("profile", format!("{name}, {}", counted(*bytes, "byte"))));
    }
    rows.push(("not finite", info.not_finite.to_string()));
    for (name, Range { min, median, max }) in &info.ranges {
        let [min, median, max] = [min, median, max].map(|value| number(*value));
        rows.push((name, format!("{min} to {max}, median {median}")));
    }
    rows_text(&rows, &info.metadata)
}

/// A line for each fact, and those of a checkpoint's metadata.
fn rows_text(rows: &[(&str, String)], metadata: &BTreeMap<String, String>) -> String {
    let lines: String = rows.iter().map(|(name, value)| format!("{name:<20}{}\n", printable(value))).collect();
    (lines + &metadata_text(metadata)).trim_end().to_owned()
}

/// A value of a parameter, to five significant digits.
fn number(value: f32) -> String {
    significant(value.into(), 5)
}

/// The metadata of a checkpoint, a line for each entry.
fn metadata_text(metadata: &BTreeMap<String, String>) -> String {
    let mut text = String::new();
    for (name, value) in metadata {
        let name = printable(name);
        if name == "metrics" {
            let _ = writeln!(text, "{name:<20}{}", counted(value.matches("[[row]]").count(), "row"));
            continue;
        }
        for (i, line) in value.lines().enumerate() {
            let _ = writeln!(text, "{:<20}{}", if i == 0 { name.as_ref() } else { "" }, printable(line));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec2, Vec3};
    use gs_core::{Gaussian2d, Scene2d};

    fn file(scene: Scene2d) -> File2d {
        File2d { scene, width: 8, height: 8, settings: RenderSettings::default(), profile: None }
    }

    #[test]
    fn values_that_are_not_finite_are_counted_and_left_out_of_the_ranges() {
        let gaussian = |x, red| Gaussian2d {
            mean: Vec2::new(x, 1.0),
            log_scale: Vec2::ZERO,
            rotation: 0.0,
            opacity_logit: f32::INFINITY,
            color: Vec3::new(red, 0.5, 0.5),
        };
        let scene = [gaussian(3.0, 0.1), gaussian(f32::NAN, 0.2), gaussian(5.0, f32::INFINITY)].into_iter().collect();
        let info = Info::of(Kind::Scene, 300, &file(scene));
        assert_eq!((info.gaussians, info.not_finite, info.bytes_per_gaussian), (3, 2, Some(100.0)));
        assert_eq!(info.ranges["x (px)"], Range { min: 3.0, median: 5.0, max: 5.0 });
        assert_eq!(info.ranges["red"], Range { min: 0.1, median: 0.2, max: 0.2 });
        assert!(!info.ranges.contains_key("opacity"), "every Gaussian is opaque");
    }

    #[test]
    fn an_empty_scene_has_no_ranges() {
        let info = Info::of(Kind::Scene, 100, &file(Scene2d::default()));
        assert!(info.ranges.is_empty() && info.bytes_per_gaussian.is_none());
        assert!(text(&info).contains("Gaussians           0"));
    }
}
