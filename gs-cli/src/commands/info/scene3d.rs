//! `gs info` of a 3D scene or a checkpoint of one: number, positions, sizes and opacities of its
//! Gaussians.

use std::{collections::BTreeMap, path::Path};

use gs_core::{
    Scene, Scene3d,
    effects::{Antialias, Order},
    sigmoid,
};
use gs_io::{File3d, Format3d, StreamedSog, WorldFrame};
use serde::Serialize;

use super::{
    number, rows_text,
    values::{NotFinite3d, ValueQuantiles, bounds, without_rotation},
};
use crate::{failure::Failure, terminal::output};

/// What `gs info --json` prints of a 3D scene.
#[derive(Debug, Serialize)]
struct Info {
    kind: &'static str,
    /// `null` for a checkpoint.
    format: Option<String>,
    /// Size of the file, including the buffers of a glTF.
    bytes: u64,
    /// `null` without Gaussians.
    bytes_per_gaussian: Option<f64>,
    gaussians: usize,
    sh_degree: u8,
    /// Columns and rows of a flat scene's image, px.
    picture: Option<(u32, u32)>,
    /// Bounds of the finite means, world units; `null` if no mean is finite.
    bounds: Option<Bounds>,
    /// Quantiles of the finite values, by parameter.
    quantiles: BTreeMap<&'static str, ValueQuantiles>,
    /// Gaussians with a parameter that is NaN or infinite, by parameter (an opacity of exactly 0 or
    /// 1 is neither).
    not_finite: NotFinite3d,
    /// Gaussians whose quaternion is too short for a rotation. They are never drawn.
    without_rotation: usize,
    /// Antialiasing in training, if the file names it.
    antialias: Option<&'static str>,
    /// Order of blending in training, if the file names it.
    order: Option<&'static str>,
    /// The frame of the coordinates, if it is not the world itself.
    frame: Option<WorldFrame>,
    /// What the scene lacks of the file.
    losses: Vec<String>,
    /// Gaussians of each level of detail of a streamed SOG, the finest first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    levels: Vec<usize>,
    /// The metadata of a checkpoint.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    metadata: BTreeMap<String, String>,
}

#[derive(Debug, PartialEq, Serialize)]
struct Bounds {
    min: [f32; 3],
    max: [f32; 3],
}

/// Prints the content of a 3D scene, or of a checkpoint with this metadata.
pub(super) fn print(
    path: &Path,
    file: File3d,
    metadata: Option<BTreeMap<String, String>>,
    json: bool,
) -> Result<(), Failure> {
    let File3d { scene, format: kind, bytes, losses, picture, trained_with, .. } = file;
    let losses = losses.iter().map(ToString::to_string).collect();
    let info = match metadata {
        Some(metadata) => Info { metadata, ..Info::of("checkpoint of a training in 3D", bytes, &scene) },
        None => Info { format: Some(kind.to_string()), ..Info::of("3D scene", bytes, &scene) },
    };
    let (antialias, order) = (trained_with.antialias.map(Antialias::name), trained_with.order.map(Order::name));
    let frame = Some(trained_with.frame).filter(|frame| !frame.is_world());
    let levels = match kind {
        Format3d::StreamedSog => StreamedSog::open(path)?.counts(),
        _ => Vec::new(),
    };
    let info = Info { antialias, order, frame, losses, levels, picture, ..info };
    output::answer(json, &info, || text(&info))
}

impl Info {
    fn of(kind: &'static str, bytes: u64, scene: &Scene3d) -> Self {
        let mut quantiles = BTreeMap::new();
        let mut add = |name, values: Vec<f32>| _ = ValueQuantiles::of(values).map(|q| quantiles.insert(name, q));
        add("opacity", scene.opacity_logits.iter().map(|&logit| sigmoid(logit)).collect());
        add("largest scale", scene.log_scales.iter().map(|s| s.max_element().exp()).collect());
        add("smallest scale", scene.log_scales.iter().map(|s| s.min_element().exp()).collect());
        Self {
            kind,
            format: None,
            bytes,
            bytes_per_gaussian: (!scene.is_empty()).then(|| bytes as f64 / scene.len() as f64),
            gaussians: scene.len(),
            sh_degree: scene.sh_degree,
            picture: None,
            bounds: bounds(scene).map(|(min, max)| Bounds { min: min.to_array(), max: max.to_array() }),
            quantiles,
            not_finite: NotFinite3d::of(scene),
            without_rotation: without_rotation(scene),
            antialias: None,
            order: None,
            frame: None,
            losses: Vec::new(),
            levels: Vec::new(),
            metadata: BTreeMap::new(),
        }
    }
}

fn text(info: &Info) -> String {
    let kind = info.format.as_ref().map_or_else(|| info.kind.to_owned(), |format| format!("{}, {format}", info.kind));
    let each = info.bytes_per_gaussian.map_or_else(String::new, |each| format!(", {each:.1} a Gaussian"));
    let mut rows = vec![
        ("kind", kind),
        ("Gaussians", info.gaussians.to_string()),
        ("SH degree", info.sh_degree.to_string()),
        ("size", format!("{} bytes{each}", info.bytes)),
    ];
    if !info.levels.is_empty() {
        rows.push(("levels of detail", format!("{:?} Gaussians", info.levels)));
    }
    if let Some((width, height)) = info.picture {
        rows.push(("picture", format!("{width}x{height} px, in a plane")));
    }
    if let Some(Bounds { min, max }) = &info.bounds {
        let side = |axis: usize| format!("{} to {}", number(min[axis]), number(max[axis]));
        rows.extend([("x", side(0)), ("y", side(1)), ("z", side(2))]);
    }
    for (name, ValueQuantiles { min, low, median, high, max }) in &info.quantiles {
        let [min, low, median, high, max] = [min, low, median, high, max].map(|value| number(*value));
        let quantiles = format!("{min} to {max}; 5 % {low}, median {median}, 95 % {high}");
        rows.push((name, quantiles));
    }
    let NotFinite3d { gaussians, means, scales, rotations, opacities, colors } = info.not_finite;
    let parts =
        [("means", means), ("scales", scales), ("rotations", rotations), ("opacities", opacities), ("colours", colors)];
    let parts: Vec<String> =
        parts.iter().filter(|(_, count)| *count > 0).map(|(name, count)| format!("{name} {count}")).collect();
    let parts = if parts.is_empty() { String::new() } else { format!(": {}", parts.join(", ")) };
    rows.push(("not finite", format!("{gaussians}{parts}")));
    rows.push(("without rotation", info.without_rotation.to_string()));
    let trained_with = [("antialias", info.antialias), ("order", info.order)];
    rows.extend(trained_with.into_iter().filter_map(|(name, value)| Some((name, format!("{} in training", value?)))));
    rows.extend(info.frame.map(|frame| ("frame", frame.to_string())));
    rows.extend(info.losses.iter().map(|loss| ("lost in reading", loss.clone())));
    rows_text(&rows, &info.metadata)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use gs_core::Gaussian3d;

    fn scene(gaussians: impl IntoIterator<Item = (f32, f32, [f32; 4])>) -> Scene3d {
        let mut scene = Scene3d::default();
        for (x, opacity_logit, rotation) in gaussians {
            let (mean, log_scale) = (Vec3::new(x, 1.0, 2.0), Vec3::new(0.0, x, -1.0));
            scene.push(Gaussian3d { mean, log_scale, rotation, opacity_logit, sh: vec![Vec3::ZERO] });
        }
        scene
    }

    #[test]
    fn broken_values_are_counted_and_left_out_of_the_rest() {
        let unit = [1.0, 0.0, 0.0, 0.0];
        let broken = scene([(0.0, f32::INFINITY, unit), (f32::NAN, 0.0, [f32::NAN; 4]), (1.0, f32::NAN, [0.0; 4])]);
        let info = Info::of("3D scene", 300, &broken);
        let expected = NotFinite3d { gaussians: 2, means: 1, scales: 1, rotations: 1, opacities: 1, colors: 0 };
        assert_eq!((info.not_finite, info.without_rotation, info.bytes_per_gaussian), (expected, 1, Some(100.0)));
        assert_eq!(info.bounds, Some(Bounds { min: [0.0, 1.0, 2.0], max: [1.0, 1.0, 2.0] }));
        let ValueQuantiles { min, median, max, .. } = info.quantiles["opacity"];
        assert_eq!((min, median, max), (0.5, 1.0, 1.0));
    }

    #[test]
    fn numbers_of_any_size_are_short() {
        let unit = [1.0, 0.0, 0.0, 0.0];
        let far = scene([(-2.2e37, 0.0, unit), (12.345_678, 0.0, unit)]);
        let text = text(&Info::of("3D scene", 300, &far));
        assert!(text.contains("-2.2000e37 to 12.346"), "{text}");
    }
}
