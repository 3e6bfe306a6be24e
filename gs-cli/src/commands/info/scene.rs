//! `gs info` of a scene or a checkpoint, 2D or 3D: the number of its Gaussians, the spread of their values,
//! and how it is rendered.

use std::{collections::BTreeMap, path::Path};

use gs_core::{
    RenderSettings, Scene as _, counted,
    effects::{Antialias, Order},
    sigmoid,
};
use gs_io::{AnyScene, File2d, File3d, LodFile3d, SceneFile, WorldFrame};
use serde::Serialize;

use super::{number, rows_text};
use crate::{failure::Failure, terminal::output};

/// What `gs info --json` prints of a scene.
#[derive(Debug, Default, Serialize)]
struct Info {
    kind: &'static str,
    /// The format of a file with a 3D scene.
    format: Option<String>,
    /// Size of the file, with the buffers of a glTF.
    bytes: u64,
    /// `null` without Gaussians.
    bytes_per_gaussian: Option<f64>,
    gaussians: usize,
    /// Columns and rows of the image that a 2D scene was made for, px.
    picture: Option<(u32, u32)>,
    /// Quantiles of the finite values, by parameter: px in 2D, units of the scene in 3D.
    quantiles: BTreeMap<&'static str, Quantiles>,
    /// How a 2D scene is rendered.
    render: Option<RenderSettings>,
    /// Whether a 2D scene's file has alpha; the scene is the picture on white then.
    alpha: bool,
    /// ICC profile of a 2D scene's colours; `null` for sRGB.
    profile: Option<Profile>,
    sh_degree: Option<u8>,
    /// Antialiasing in training, if the file of a 3D scene names it.
    antialias: Option<&'static str>,
    /// Order of blending in training, likewise.
    order: Option<&'static str>,
    /// The frame of the coordinates, if it is not the world itself.
    frame: Option<WorldFrame>,
    /// What the scene lacks of the file.
    losses: Vec<String>,
    /// Gaussians of each level of detail, the finest first.
    levels: Vec<usize>,
    /// The metadata of a checkpoint.
    metadata: BTreeMap<String, String>,
}

/// An ICC profile.
#[derive(Debug, Serialize)]
struct Profile {
    name: String,
    bytes: usize,
}

/// Quantiles of the finite ones of some values. Each is one of the values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Quantiles {
    min: f32,
    #[serde(rename = "5 %")]
    low: f32,
    /// Of two values in the middle, the larger.
    median: f32,
    #[serde(rename = "95 %")]
    high: f32,
    max: f32,
}

impl Quantiles {
    /// `None` where no value is finite.
    fn of(values: impl Iterator<Item = f32>) -> Option<Self> {
        let mut values: Vec<f32> = values.filter(|value| value.is_finite()).collect();
        let last = values.len().checked_sub(1)?;
        let at = |share: f32| (share * last as f32).round() as usize;
        let places = [0, at(0.05), values.len() / 2, at(0.95), last];
        let [min, low, median, high, max] = places.map(|at| *values.select_nth_unstable_by(at, f32::total_cmp).1);
        Some(Self { min, low, median, high, max })
    }
}

/// Prints what is in a scene.
pub(super) fn print(file: SceneFile, json: bool) -> Result<(), Failure> {
    let SceneFile { path, scene, metadata, has_alpha, .. } = file;
    let is_checkpoint = metadata.is_some();
    let info = match scene {
        AnyScene::TwoD(file) => Info { alpha: has_alpha, ..Info::of_2d(&path, &file, is_checkpoint) },
        AnyScene::ThreeD(file) => Info::of_3d(&path, *file, is_checkpoint)?,
    };
    let info = Info { metadata: metadata.unwrap_or_default(), ..info };
    output::answer(json, &info, || info.text())
}

impl Info {
    fn of_2d(path: &Path, file: &File2d, is_checkpoint: bool) -> Self {
        let File2d { scene, width, height, settings, profile, .. } = file;
        let values: [(_, &mut dyn Iterator<Item = f32>); 8] = [
            ("x (px)", &mut scene.means.iter().map(|m| m.x)),
            ("y (px)", &mut scene.means.iter().map(|m| m.y)),
            ("larger scale (px)", &mut scene.log_scales.iter().map(|s| s.max_element().exp())),
            ("smaller scale (px)", &mut scene.log_scales.iter().map(|s| s.min_element().exp())),
            ("opacity", &mut scene.opacity_logits.iter().map(|&logit| sigmoid(logit))),
            ("red", &mut scene.colors.iter().map(|c| c.x)),
            ("green", &mut scene.colors.iter().map(|c| c.y)),
            ("blue", &mut scene.colors.iter().map(|c| c.z)),
        ];
        Self {
            kind: if is_checkpoint { "checkpoint of a 2D fit" } else { "2D scene" },
            picture: Some((*width, *height)),
            render: Some(*settings),
            profile: profile.as_ref().map(|profile| Profile { name: profile.name(), bytes: profile.bytes().len() }),
            ..Self::of(std::fs::metadata(path).map_or(0, |file| file.len()), scene.len(), values)
        }
    }

    fn of_3d(path: &Path, file: File3d, is_checkpoint: bool) -> Result<Self, Failure> {
        let File3d { scene, format, bytes, losses, trained_with, .. } = file;
        let values: [(_, &mut dyn Iterator<Item = f32>); 6] = [
            ("x", &mut scene.means.iter().map(|m| m.x)),
            ("y", &mut scene.means.iter().map(|m| m.y)),
            ("z", &mut scene.means.iter().map(|m| m.z)),
            ("largest scale", &mut scene.log_scales.iter().map(|s| s.max_element().exp())),
            ("smallest scale", &mut scene.log_scales.iter().map(|s| s.min_element().exp())),
            ("opacity", &mut scene.opacity_logits.iter().map(|&logit| sigmoid(logit))),
        ];
        Ok(Self {
            kind: if is_checkpoint { "checkpoint of a training in 3D" } else { "3D scene" },
            format: (!is_checkpoint).then(|| format.to_string()),
            sh_degree: Some(scene.sh_degree),
            antialias: trained_with.antialias.map(Antialias::name),
            order: trained_with.order.map(Order::name),
            frame: Some(trained_with.frame).filter(|frame| !frame.is_world()),
            losses: losses.iter().map(ToString::to_string).collect(),
            levels: match format.may_have_levels() {
                true => LodFile3d::open(path)?.map_or_else(Vec::new, |file| file.counts()),
                false => Vec::new(),
            },
            ..Self::of(bytes, scene.len(), values)
        })
    }

    fn of<const N: usize>(
        bytes: u64,
        gaussians: usize,
        values: [(&'static str, &mut dyn Iterator<Item = f32>); N],
    ) -> Self {
        Self {
            bytes,
            bytes_per_gaussian: (gaussians > 0).then(|| bytes as f64 / gaussians as f64),
            gaussians,
            quantiles: values.into_iter().filter_map(|(name, of)| Some((name, Quantiles::of(of)?))).collect(),
            ..Self::default()
        }
    }

    fn text(&self) -> String {
        let format = self.format.as_ref().map_or_else(String::new, |format| format!(", {format}"));
        let each = self.bytes_per_gaussian.map_or_else(String::new, |each| format!(", {each:.1} a Gaussian"));
        let mut rows = vec![
            ("kind", format!("{}{format}", self.kind)),
            ("Gaussians", self.gaussians.to_string()),
            ("size", format!("{}{each}", counted(self.bytes, "byte"))),
        ];
        rows.extend(self.picture.map(|(width, height)| ("picture", format!("{width}x{height} px"))));
        if let Some(render) = &self.render {
            rows.push(("blend", render.effects.blend.name().to_owned()));
            rows.push(("background", format!("{:?}", render.background_color())));
        }
        if self.alpha {
            rows.push(("alpha", "yes; these are values of the picture on white".to_owned()));
        }
        if let Some(Profile { name, bytes }) = &self.profile {
            rows.push(("profile", format!("{name}, {}", counted(*bytes, "byte"))));
        }
        rows.extend(self.sh_degree.map(|degree| ("SH degree", degree.to_string())));
        if !self.levels.is_empty() {
            rows.push(("levels of detail", format!("{:?} Gaussians", self.levels)));
        }
        for (name, Quantiles { min, low, median, high, max }) in &self.quantiles {
            let [min, low, median, high, max] = [min, low, median, high, max].map(|value| number(*value));
            rows.push((name, format!("{min} to {max}; 5 % {low}, median {median}, 95 % {high}")));
        }
        let trained_with = [("antialias", self.antialias), ("order", self.order)];
        rows.extend(
            trained_with.into_iter().filter_map(|(name, value)| Some((name, format!("{} in training", value?)))),
        );
        rows.extend(self.frame.map(|frame| ("frame", frame.to_string())));
        rows.extend(self.losses.iter().map(|loss| ("lost in reading", loss.clone())));
        rows_text(&rows, &self.metadata)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use gs_core::{Gaussian3d, Scene3d};

    fn info(scene: Scene3d) -> Info {
        let file = File3d {
            scene,
            format: gs_io::Format3d::Ply,
            bytes: 300,
            beside: Vec::new(),
            losses: Vec::new(),
            trained_with: gs_io::TrainedWith::default(),
            settings: None,
        };
        Info::of_3d(Path::new("a.ply"), file, false).unwrap()
    }

    fn scene(gaussians: impl IntoIterator<Item = (f32, f32)>) -> Scene3d {
        let gaussian = |(x, opacity_logit)| Gaussian3d {
            mean: Vec3::new(x, 1.0, 2.0),
            log_scale: Vec3::new(0.0, x, -1.0),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit,
            sh: vec![Vec3::ZERO],
        };
        gaussians.into_iter().map(gaussian).collect()
    }

    #[test]
    fn values_that_are_not_finite_are_left_out() {
        let info = info(scene([(0.0, f32::INFINITY), (f32::NAN, 0.0), (1.0, f32::NAN)]));
        assert_eq!((info.gaussians, info.bytes_per_gaussian), (3, Some(100.0)));
        let Quantiles { min, median, max, .. } = info.quantiles["opacity"];
        assert_eq!((min, median, max), (0.5, 1.0, 1.0));
        assert_eq!((info.quantiles["x"].min, info.quantiles["x"].max), (0.0, 1.0));
    }

    #[test]
    fn numbers_of_any_size_are_short() {
        let text = info(scene([(-2.2e37, 0.0), (12.345_678, 0.0)])).text();
        assert!(text.contains("-2.2000e37 to 12.346"), "{text}");
    }

    #[test]
    fn an_empty_scene_has_no_values() {
        let info = Info::of_2d(Path::new("none"), &File2d::default(), false);
        assert!(info.quantiles.is_empty() && info.bytes_per_gaussian.is_none());
        assert!(info.text().contains("Gaussians           0"));
    }

    #[test]
    fn quantiles_are_values_of_the_scene() {
        let quantiles = Quantiles::of((0..101).rev().map(|v| v as f32)).unwrap();
        assert_eq!(quantiles, Quantiles { min: 0.0, low: 5.0, median: 50.0, high: 95.0, max: 100.0 });
        assert_eq!(Quantiles::of([2.0, f32::INFINITY, 1.0].into_iter()).unwrap().median, 2.0);
        assert_eq!(Quantiles::of([f32::NAN].into_iter()), None);
    }
}
