//! `gs info`: what is in a scene, a checkpoint or a data set, or which GPUs there are.

mod dataset;
mod spatial;

use std::{
    collections::BTreeMap,
    fmt::Write,
    path::{Path, PathBuf},
};

use clap::Args;
use gs_core::{
    PlanarScene, Rasterizer, RenderSettings, Scene, SpatialScene, counted, scene::sigmoid, state::CloudState,
};
use gs_io::{Checkpoint, SpatialFormat};
use gs_train::{RunSettings, SpatialSettings, experiments::Cell};
use serde::Serialize;

use crate::{
    backend::{Backend, BackendArgs, Choice, SpatialTask, Task},
    commands::adapters,
    dataset::ReadingArgs,
    failure::Failure,
    output::{self, Format, printable},
};

/// The flags of `gs info`.
#[derive(Debug, Clone, Args)]
pub(crate) struct InfoArgs {
    /// A scene, planar or spatial (PLY, .splat, SPZ, glTF), a checkpoint, or a data set of posed photographs
    #[arg(required_unless_present = "adapters")]
    file: Option<PathBuf>,
    /// List the GPUs that were found instead, and what --backend auto takes
    #[arg(long, conflicts_with = "file")]
    adapters: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    reading: ReadingArgs,
}

/// What `gs info --json` prints.
#[derive(Debug, Serialize)]
struct Info {
    kind: Kind,
    /// Size of the file.
    bytes: u64,
    bytes_per_gaussian: Option<f64>,
    gaussians: usize,
    /// Of the image that the scene was made for, px; `null` in a checkpoint, whose metadata tell it.
    width: Option<u32>,
    height: Option<u32>,
    /// How it is rendered; `null` in a checkpoint.
    render: Option<RenderSettings>,
    /// Ranges over all values that are finite, by parameter.
    ranges: BTreeMap<&'static str, Range>,
    /// How many Gaussians have a parameter that is NaN or infinite (an opacity of exactly 0 or 1 is neither).
    not_finite: usize,
    /// What a checkpoint says of itself.
    metadata: BTreeMap<String, String>,
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

/// Tells what is in a file, or lists the adapters.
///
/// # Errors
/// Where it is none of these.
pub(crate) fn run(args: &InfoArgs) -> Result<(), Failure> {
    let format = if args.json { Format::Json } else { Format::Text };
    // The command line has one of the two, the file or --adapters.
    let Some(file) = &args.file else {
        return adapters::run(format);
    };
    if gs_io::dataset::may_be_dataset(file) {
        return dataset::run(file, &args.reading, format);
    }
    if gs_io::spatial_format(file)?.is_some() {
        return spatial::run(file, format);
    }
    let bytes = std::fs::metadata(file).map_or(0, |file| file.len());
    let info = match read(file)? {
        Content::Scene(planar) => {
            let about = Info::of(Kind::Scene, bytes, &planar.scene);
            let (width, height) = (Some(planar.width), Some(planar.height));
            Info { width, height, render: Some(planar.settings), ..about }
        }
        Content::Checkpoint(checkpoint) => {
            let backend = Backend::start(&BackendArgs { backend: Choice::Cpu, ..BackendArgs::default() })?;
            let broken = |error: gs_core::Error| Failure::failed(error).at(file.display());
            if is_spatial(&checkpoint) {
                let scene = backend.run_spatial(Restore(&checkpoint.state)).map_err(broken)?;
                return spatial::of_checkpoint(&scene, checkpoint.metadata, bytes, format);
            }
            let scene = backend.run(Restore(&checkpoint.state)).map_err(broken)?;
            Info { metadata: checkpoint.metadata, ..Info::of(Kind::Checkpoint, bytes, &scene) }
        }
    };
    match format {
        Format::Json => output::json(&info),
        Format::Text => output::result(text(&info)),
    }
}

/// What a file holds that is no spatial scene.
enum Content {
    Scene(Box<gs_io::PlanarFile>),
    Checkpoint(Box<Checkpoint>),
}

fn read(path: &Path) -> Result<Content, Failure> {
    let not_a_scene = match gs_io::read_scene(path) {
        Ok(file) => return Ok(Content::Scene(Box::new(file))),
        Err(error) => error,
    };
    match gs_io::read_checkpoint(path) {
        Ok(checkpoint) => Ok(Content::Checkpoint(Box::new(checkpoint))),
        // What is called a spatial scene is meant to be one; its bytes say why it is none.
        Err(_) if SpatialFormat::to_write(path).is_some() => match gs_io::read_spatial_unchecked(path) {
            Err(not_spatial) => Err(not_spatial.into()),
            Ok(_) => Err(not_a_scene.into()),
        },
        Err(_) => Err(not_a_scene.into()),
    }
}

/// Whether a checkpoint is of a training in space; any other is taken for one of a planar fit.
fn is_spatial(checkpoint: &Checkpoint) -> bool {
    checkpoint
        .metadata
        .get("format")
        .is_some_and(|format| format == <SpatialSettings as RunSettings<SpatialScene>>::FORMAT)
}

/// The scene that a backend's state holds.
struct Restore<'a>(&'a CloudState);

impl SpatialTask for Restore<'_> {
    type Output = Result<SpatialScene, gs_core::Error>;

    fn run<R: Rasterizer<SpatialScene>>(self, rasterizer: &R) -> Self::Output {
        rasterizer.download(&rasterizer.restore(self.0)?)
    }
}

impl Task for Restore<'_> {
    type Output = Result<PlanarScene, gs_core::Error>;

    fn run<R: Rasterizer<PlanarScene>>(self, rasterizer: &R) -> Self::Output {
        rasterizer.download(&rasterizer.restore(self.0)?)
    }
}

impl Info {
    fn of(kind: Kind, bytes: u64, scene: &PlanarScene) -> Self {
        let gaussians = scene.len();
        let mut ranges = BTreeMap::new();
        let mut add = |name, values: Vec<f32>| {
            if let Some(range) = Range::of(values) {
                ranges.insert(name, range);
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
        let finite = scene.iter().filter(|g| {
            let shape = g.mean.is_finite() && g.log_scale.is_finite() && g.rotation.is_finite();
            shape && g.color.is_finite() && !g.opacity_logit.is_nan()
        });
        Self {
            kind,
            bytes,
            bytes_per_gaussian: (gaussians > 0).then(|| bytes as f64 / gaussians as f64),
            gaussians,
            width: None,
            height: None,
            render: None,
            ranges,
            not_finite: gaussians - finite.count(),
            metadata: BTreeMap::new(),
        }
    }
}

impl Range {
    fn of(mut values: Vec<f32>) -> Option<Self> {
        values.retain(|v| v.is_finite());
        values.sort_by(f32::total_cmp);
        Some(Self { min: *values.first()?, median: values[values.len() / 2], max: *values.last()? })
    }
}

fn text(info: &Info) -> String {
    let kind = match info.kind {
        Kind::Scene => "planar scene",
        Kind::Checkpoint => "checkpoint of a planar fit",
    };
    let mut rows = vec![("kind", kind.to_owned()), ("Gaussians", info.gaussians.to_string())];
    if let (Some(width), Some(height)) = (info.width, info.height) {
        rows.push(("canvas", format!("{width}x{height} px")));
    }
    let each = info.bytes_per_gaussian.map_or_else(String::new, |each| format!(", {each:.1} a Gaussian"));
    rows.push(("size", format!("{}{each}", counted(info.bytes, "byte"))));
    if let Some(render) = &info.render {
        rows.push(("blend", render.effects.blend.name().to_owned()));
        rows.push(("background", format!("{:?}", render.backdrop())));
    }
    rows.push(("not finite", info.not_finite.to_string()));
    let mut text = String::new();
    for (name, value) in &rows {
        let _ = writeln!(text, "{name:<20}{value}");
    }
    for (name, Range { min, median, max }) in &info.ranges {
        let [min, median, max] = [min, median, max].map(|value| number(*value));
        let _ = writeln!(text, "{name:<20}{min} to {max}, median {median}");
    }
    text += &metadata_text(&info.metadata);
    text.truncate(text.trim_end().len());
    text
}

/// A value of a parameter, in as many digits as tell anything.
fn number(value: f32) -> String {
    Cell::Significant(value.into(), 5).to_string()
}

/// What a checkpoint says of itself, a line for each entry.
fn metadata_text(metadata: &BTreeMap<String, String>) -> String {
    let mut text = String::new();
    for (name, value) in metadata {
        let name = printable(name);
        if name == "metrics" {
            let _ = writeln!(text, "{name:<20}{}", counted(value.lines().skip(1).count(), "row"));
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
    use gs_core::PlanarGaussian;

    #[test]
    fn what_is_not_finite_is_counted_and_left_out_of_the_ranges() {
        let gaussian = |x, red| PlanarGaussian {
            mean: Vec2::new(x, 1.0),
            log_scale: Vec2::ZERO,
            rotation: 0.0,
            opacity_logit: f32::INFINITY,
            color: Vec3::new(red, 0.5, 0.5),
        };
        let scene = [gaussian(3.0, 0.1), gaussian(f32::NAN, 0.2), gaussian(5.0, f32::INFINITY)].into_iter().collect();
        let info = Info::of(Kind::Scene, 300, &scene);
        assert_eq!((info.gaussians, info.not_finite, info.bytes_per_gaussian), (3, 2, Some(100.0)));
        assert_eq!(info.ranges["x (px)"], Range { min: 3.0, median: 5.0, max: 5.0 });
        assert_eq!(info.ranges["red"], Range { min: 0.1, median: 0.2, max: 0.2 });
        assert!(!info.ranges.contains_key("opacity"), "every Gaussian is opaque");
    }

    #[test]
    fn an_empty_scene_has_no_ranges() {
        let info = Info::of(Kind::Scene, 100, &PlanarScene::default());
        assert!(info.ranges.is_empty() && info.bytes_per_gaussian.is_none());
        assert!(text(&info).contains("Gaussians           0"));
    }
}
