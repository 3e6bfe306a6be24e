//! The "Internal/External Camera Parameters" of RealityScan, once RealityCapture: a CSV.
//!
//! A row has the name of an image, its position in a world with z up, angles in degrees, and a lens.
//! From the camera with axes right, up, back to the world, the rotation is
//! Rz(−heading) Rx(pitch) Ry(roll). f is the focal length of a film 36 mm wide, px and py are the
//! principal point from the image's centre relative to the longer side of the image, t1 and t2 are OpenCV's p₂ and
//! p₁. Newer versions call heading `yaw`, and f, px and py `f_35mm`, `px_norm` and `py_norm`. People
//! leave out columns of the lens, which are then 0. Files have no points.
//!
//! *Source:* the columns and the order of t1 and t2 by the program's templates of exports
//!   (`calibration.xml`), units and the order also by `DHInputOutput` of Epic's MetaHuman library; the
//!   rotation by Nerfstudio's `realitycapture_utils.py` and, which agrees, Camera Projection Painter.

use std::path::Path;

use glam::{DMat3, dvec2};

use super::{
    BrownConrady, Dataset, DatasetKind, DatasetSettings, Distortion, FILE, Skip,
    camera::{Focal, Intrinsics, Pose},
    read::{Draft, Parts, Place, Refusal, Stated, assemble_named},
};
use crate::{atomic::read_file, error::Error, text::utf8_text};

/// The width of the film to which focal lengths refer, mm.
const FILM: f64 = 36.0;

/// Columns by their names in older and newer versions, and whether a file must have them.
const COLUMNS: [([&str; 2], bool); 15] = [
    (["x", "x"], true),
    (["y", "y"], true),
    (["alt", "z"], true),
    (["heading", "yaw"], true),
    (["pitch", "pitch"], true),
    (["roll", "roll"], true),
    (["f", "f_35mm"], true),
    (["px", "px_norm"], false),
    (["py", "py_norm"], false),
    (["k1", "k1"], false),
    (["k2", "k2"], false),
    (["k3", "k3"], false),
    (["k4", "k4"], false),
    (["t1", "t1"], false),
    (["t2", "t2"], false),
];

/// The names of an image's column.
const NAME: [&str; 2] = ["name", "name"];

/// The places of columns in a row.
struct Header {
    name: usize,
    columns: [Option<usize>; COLUMNS.len()],
    count: usize,
}

impl Header {
    /// The header in a line; an error names the first column that is missing.
    fn of(line: &str) -> Result<Self, &'static str> {
        let titles: Vec<String> =
            line.trim_start_matches('#').split(',').map(|title| title.trim().to_lowercase()).collect();
        let find = |names: [&str; 2]| titles.iter().position(|title| names.contains(&title.as_str()));
        let name = find(NAME).ok_or(NAME[0])?;
        let columns = COLUMNS.map(|(names, _)| find(names));
        let missing = COLUMNS.iter().zip(&columns).find(|((_, needed), column)| *needed && column.is_none());
        match missing {
            Some(((names, _), _)) => Err(names[0]),
            None => Ok(Self { name, columns, count: titles.len() }),
        }
    }
}

/// The lines of a file with their numbers, without the empty ones and the count of cameras that
/// some versions begin with.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    lines.filter(|(_, line)| !line.is_empty() && !line.starts_with("#cameras "))
}

/// Whether text begins as such a file does.
pub(super) fn begins(text: &str) -> bool {
    let text = text.trim_start_matches('\u{feff}');
    lines(text).next().is_some_and(|(_, line)| Header::of(line).is_ok())
}

/// Reads the data set of such a file.
pub(super) fn read(root: &Path, file: &Path, settings: &DatasetSettings) -> Result<Dataset, Error> {
    let wrong = |problem: String| {
        Error::unusable(file, problem, "export Internal/External Camera Parameters with RealityScan again")
    };
    let bytes = read_file(file, FILE)?;
    let text = String::from_utf8_lossy(utf8_text(file, &bytes)?);
    let mut lines = lines(&text);
    let (_, first) = lines.next().unwrap_or_default();
    let header = Header::of(first).map_err(|column| wrong(format!("it has no column {column}")))?;
    let place = file.file_name().unwrap_or_default().display().to_string();
    let draft = |(number, line): (usize, &str)| {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        if fields.len() != header.count {
            let (found, count) = (fields.len(), header.count);
            return Err(wrong(format!("line {number} has {found} fields, but the header {count}")));
        }
        let value = |column: &Option<usize>| column.map_or(0.0, |at| fields[at].parse().unwrap_or(f64::NAN));
        let [x, y, alt, heading, pitch, roll, lens @ ..] = header.columns.each_ref().map(value);
        let numbers = COLUMNS.iter().map(|(names, _)| names[0]).skip(6).zip(lens).collect();
        let stated = Stated { place: format!("line {number} of {place}"), numbers };
        let pose = pose([x, y, alt], [heading, pitch, roll].map(f64::to_radians));
        let intrinsics = intrinsics(lens).ok_or_else(|| Refusal::new(Skip::BadCamera, stated.to_string()));
        Ok(Draft::of_image(root, fields[header.name], intrinsics, stated, pose))
    };
    let drafts = lines.map(draft).collect::<Result<_, Error>>()?;
    let (places, points, remarks) = (Place::usual(root, settings)?, Vec::new(), Vec::new());
    let parts = Parts { kind: DatasetKind::RealityScan, root, drafts, points, places, split: None, remarks };
    assemble_named(parts, file, settings)
}

/// The pose of a position and angles, rad.
fn pose(position: [f64; 3], [heading, pitch, roll]: [f64; 3]) -> Result<Pose, Skip> {
    let turned = DMat3::from_rotation_z(-heading) * DMat3::from_rotation_x(pitch) * DMat3::from_rotation_y(roll);
    let row = |i: usize| turned.row(i).to_array().into_iter().chain([position[i]]).collect();
    Pose::camera_to_world(&[row(0), row(1), row(2)])
}

/// The intrinsics of a lens; `None` for numbers that no camera has.
fn intrinsics([f, px, py, k1, k2, k3, k4, t1, t2]: [f64; 9]) -> Option<Intrinsics> {
    let is_possible = [f, px, py, k1, k2, k3, k4, t1, t2].iter().all(|value| value.is_finite()) && f > 0.0;
    let brown = BrownConrady { radial: [k1, k2, k3, k4], tangential: [t2, t1], ..BrownConrady::default() };
    let distortion = if brown == BrownConrady::default() { Distortion::None } else { Distortion::BrownConrady(brown) };
    is_possible.then(|| Intrinsics {
        focal: Focal::Relative { length: f / FILM, offset: dvec2(px, py) },
        center: None,
        size: None,
        distortion,
        circle: None,
    })
}
