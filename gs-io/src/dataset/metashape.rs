//! The cameras of Agisoft Metashape, exported as Agisoft XML.
//!
//! A *camera* is an image by its label, the sensor that took it, and a 4×4 matrix by rows from its axes
//! right, down, forward to the world of its component. A component's transform, or the chunk's in older
//! files, leads from there to the world of the project. A sensor's *calibration* has the focal length
//! f, the principal point (cx, cy) from the image's centre, px, and coefficients. With p = (x, y) =
//! (X/Z, Y/Z), or that times θ/r for a fish-eye, and r = ‖p‖:
//!
//! x′ = x (1 + k₁r² + k₂r⁴ + k₃r⁶ + k₄r⁸) + p₁(r² + 2x²) + 2p₂xy, y′ likewise with p₂(r² + 2y²) + 2p₁xy,
//! u = w/2 + cx + x′f + x′b₁ + y′b₂, v = h/2 + cy + y′f.
//!
//! So p₁ and p₂ are OpenCV's p₂ and p₁. Files have no points.
//!
//! *Source:* the user manual of Metashape Pro, appendix "Camera models"; the structure of the file by
//!   exports of versions 1.5 to 2.1, and what Nerfstudio's `metashape_utils.py` reads of it.

use std::{collections::BTreeMap, path::Path};

use glam::{DMat3, DMat4, DVec3, dvec2};
use roxmltree::{Document, Node};

use super::{
    BrownConrady, Dataset, DatasetKind, DatasetSettings, Distortion, FILE, Fisheye, Skip,
    camera::{Intrinsics, Pose},
    read::{Draft, Parts, Place, Refusal, Stated, assemble_named},
};
use crate::{atomic::read_file, error::Error, text::utf8_text};

/// Types of sensors.
const FRAME: &str = "frame";
const FISHEYE: [&str; 2] = ["fisheye", "equidistant_fisheye"];
const SPHERICAL: &str = "spherical";

/// Names of a calibration's numbers.
const NUMBERS: [&str; 13] = ["f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4"];

/// Whether text begins as such a file does.
pub(super) fn begins(text: &str) -> bool {
    text.split_once("<document").is_some_and(|(_, rest)| rest.contains("<chunk"))
}

/// Reads the data set of such a file.
pub(super) fn read(root: &Path, file: &Path, settings: &DatasetSettings) -> Result<Dataset, Error> {
    let wrong = |problem: String| Error::unusable(file, problem, "export the cameras again, as Agisoft XML");
    let bytes = read_file(file, FILE)?;
    let text = std::str::from_utf8(utf8_text(file, &bytes)?).map_err(|error| wrong(error.to_string()))?;
    let document = Document::parse(text).map_err(|error| wrong(error.to_string()))?;
    let chunk = document.root_element().children().find(|node| node.has_tag_name("chunk"));
    let chunk = chunk.ok_or_else(|| wrong("it has no element chunk".to_owned()))?;
    let cameras: Vec<Node<'_, '_>> = child(chunk, "cameras")
        .map(|all| all.descendants().filter(|node| node.has_tag_name("camera")).collect())
        .unwrap_or_default();
    let worlds = Worlds::of(chunk);
    let apart = worlds.apart(&cameras);
    if apart > 1 {
        let problem = format!("its cameras are in {apart} components that are not aligned with each other");
        return Err(Error::unusable(file, problem, "align them in Metashape, or export the cameras of one component"));
    }
    let mut sensors = BTreeMap::new();
    for node in chunk.descendants().filter(|node| node.has_tag_name("sensor")) {
        let sensor = Sensor(node);
        sensors.insert(node.attribute("id"), (sensor.intrinsics(file)?, sensor.stated(file)));
    }
    let missing = || (Err(Skip::NoCamera.into()), Stated::default());
    let draft = |camera: &Node<'_, '_>| {
        let (intrinsics, stated) = sensors.get(&camera.attribute("sensor_id")).cloned().unwrap_or_else(missing);
        let is_off = camera.attribute("enabled").is_some_and(|value| matches!(value, "false" | "0"));
        let intrinsics = if is_off { Err(Skip::MarkedBad.into()) } else { intrinsics };
        let name = camera.attribute("label").unwrap_or_default();
        Draft::of_image(root, name, intrinsics, stated, worlds.pose(*camera))
    };
    let drafts = cameras.iter().map(draft).collect();
    let (places, points, remarks) = (Place::usual(root, settings)?, Vec::new(), Vec::new());
    let parts = Parts { kind: DatasetKind::Metashape, root, drafts, points, places, split: None, remarks };
    assemble_named(parts, file, settings)
}

/// The first child of this name.
fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|child| child.has_tag_name(name))
}

/// The `N` numbers of a child's text, if it is there; NaN where it has something else.
fn numbers<const N: usize>(node: Node<'_, '_>, name: &str) -> Option<[f64; N]> {
    let text = child(node, name)?.text().unwrap_or_default();
    let found: Vec<f64> = text.split_whitespace().map(|word| word.parse().unwrap_or(f64::NAN)).take(N + 1).collect();
    Some(found.try_into().unwrap_or([f64::NAN; N]))
}

/// From the worlds of components to that of the project.
struct Worlds<'a> {
    components: BTreeMap<Option<&'a str>, DMat4>,
    chunk: Option<DMat4>,
}

impl<'a> Worlds<'a> {
    fn of(chunk: Node<'a, '_>) -> Self {
        let components = chunk.descendants().filter(|node| node.has_tag_name("component"));
        let world = |node: Node<'a, '_>| Some((node.attribute("id"), transform(node)?));
        Self { components: components.filter_map(world).collect(), chunk: transform(chunk) }
    }

    fn get(&self, camera: Node<'_, '_>) -> Option<DMat4> {
        self.components.get(&camera.attribute("component_id")).copied().or(self.chunk)
    }

    /// The number of components of these cameras, if one is not placed in the project; or else 0.
    fn apart(&self, cameras: &[Node<'_, '_>]) -> usize {
        let posed = cameras.iter().filter(|camera| child(**camera, "transform").is_some());
        let placed = posed.map(|camera| (camera.attribute("component_id"), self.get(*camera).is_some()));
        let components: BTreeMap<_, _> = placed.collect();
        if components.values().all(|placed| *placed) { 0 } else { components.len() }
    }

    fn pose(&self, camera: Node<'_, '_>) -> Result<Pose, Skip> {
        let rows = DMat4::from_cols_array(&numbers(camera, "transform").ok_or(Skip::NoPose)?).transpose();
        let whole = self.get(camera).unwrap_or(DMat4::IDENTITY) * rows;
        // From (right, down, forward) to (right, up, back).
        let row = |i: usize| {
            let row = whole.row(i);
            vec![row.x, -row.y, -row.z, row.w]
        };
        Pose::camera_to_world(&[row(0), row(1), row(2), row(3)])
    }
}

/// The transform of a component or a chunk: scale · rotation · x + translation.
fn transform(node: Node<'_, '_>) -> Option<DMat4> {
    let transform = child(node, "transform")?;
    let rotation =
        numbers(transform, "rotation").map_or(DMat3::IDENTITY, |rows| DMat3::from_cols_array(&rows).transpose());
    let translation = numbers(transform, "translation").map_or(DVec3::ZERO, DVec3::from_array);
    let [scale] = numbers(transform, "scale").unwrap_or([1.0]);
    Some(DMat4::from_translation(translation) * DMat4::from_mat3(rotation * scale))
}

/// A sensor of the file.
struct Sensor<'a, 'i>(Node<'a, 'i>);

impl<'a, 'i> Sensor<'a, 'i> {
    /// The adjusted calibration, or else the first.
    fn calibration(&self) -> Option<Node<'a, 'i>> {
        let all = || self.0.children().filter(|node| node.has_tag_name("calibration"));
        all().find(|node| node.attribute("class") == Some("adjusted")).or_else(|| all().next())
    }

    /// A number of the calibration; 0 if it has none of the name.
    fn number(&self, name: &str) -> f64 {
        self.calibration().and_then(|node| numbers(node, name)).map_or(0.0, |[number]| number)
    }

    /// The intrinsics; inside, why the camera is impossible, with the name of the number.
    ///
    /// # Errors
    /// [`Error::Unusable`] for an unknown type.
    fn intrinsics(&self, file: &Path) -> Result<Result<Intrinsics, Refusal>, Error> {
        let of = |node: Node<'a, 'i>| node.attribute("type");
        let kind = self.calibration().and_then(of).or_else(|| of(self.0)).unwrap_or(FRAME);
        if kind != FRAME && kind != SPHERICAL && !FISHEYE.contains(&kind) {
            let known = [&[FRAME, SPHERICAL][..], &FISHEYE].concat().join(", ");
            return Err(Error::unknown_camera_model(file, kind, &known));
        }
        let sensor = self.0.attribute("id").unwrap_or_default();
        let refused = |fault| Refusal::new(Skip::BadCamera, format!("in sensor {sensor}, {fault}"));
        Ok(self.lens(kind).map_err(refused))
    }

    fn lens(&self, kind: &str) -> Result<Intrinsics, String> {
        let resolution = self.calibration().into_iter().chain([self.0]).find_map(|node| child(node, "resolution"));
        let side = |name| resolution?.attribute(name)?.parse().ok().filter(|side: &f64| *side > 0.0);
        let (Some(width), Some(height)) = (side("width"), side("height")) else {
            return Err("there is no resolution".to_owned());
        };
        let size = dvec2(width, height);
        if kind == SPHERICAL {
            return Ok(Intrinsics::panorama(Some(size)));
        }
        if let Some(name) = NUMBERS.into_iter().find(|name| !self.number(name).is_finite()) {
            return Err(format!("{name} is not a finite number"));
        }
        let [f, cx, cy, b1, b2, k1, k2, k3, k4, p1, p2, p3, p4] = NUMBERS.map(|name| self.number(name));
        if !(f > 0.0 && f + b1 > 0.0) {
            return Err(format!("there is no calibration with a focal length f (f is {f})"));
        }
        let is_fisheye = FISHEYE.contains(&kind);
        let unsupported = [("p3", p3), ("p4", p4), ("b2", if is_fisheye { b2 } else { 0.0 })];
        if let Some((name, value)) = unsupported.into_iter().find(|(_, value)| *value != 0.0) {
            return Err(format!("{name} is {value}, which is not supported: optimize the cameras without it"));
        }
        let (radial, tangential) = ([k1, k2, k3, k4], [p2, p1]);
        let brown = BrownConrady { radial, tangential, skew: b2 / (f + b1), ..BrownConrady::default() };
        let distortion = match is_fisheye {
            true => Distortion::Fisheye(Fisheye { radial, tangential, ..Fisheye::default() }),
            false if brown == BrownConrady::default() => Distortion::None,
            false => Distortion::BrownConrady(brown),
        };
        Ok(Intrinsics::new(dvec2(f + b1, f), Some(0.5 * size + dvec2(cx, cy)), size, distortion))
    }

    /// The numbers with their names, for messages.
    fn stated(&self, file: &Path) -> Stated {
        let file = file.file_name().unwrap_or_default().display();
        let place = format!("sensor {} of {file}", self.0.attribute("id").unwrap_or_default());
        Stated { place, numbers: NUMBERS.map(|name| (name, self.number(name))).to_vec() }
    }
}
