//! PLY: reads and writes that of 3DGS, and reads PlayCanvas's compressed one.
//!
//! Vertices of the 3DGS kind have, by name: `x y z` (mean), `nx ny nz` (unused), `f_dc_0..2` (SH of
//! degree 0, RGB), `f_rest_*` (the others, all of red first, then green, then blue), `opacity`
//! (logit), `scale_0..2` (logarithms), `rot_0..3` (quaternion w, x, y, z). Order does not matter to
//! us, and properties that are not known are passed over; what is written has them in 3DGS's order.
//! Comments say how a scene was trained: see [`TrainedWith`].

mod compressed;
mod header;
mod rows;

use std::io::{self, Write};

use gs_core::{Scene, Scene3d, check_size};

use self::header::{Element, Header};
use super::{
    Format3d, TrainedWith,
    conversion_loss::ConversionLoss,
    quantity::finite_logit,
    sh_degree::{MAX_DEGREE, degree_of_rest},
    source::Source,
};
use crate::error::Error;

/// The properties that every Gaussian must have, in the order of [`Columns::gaussian`].
const REQUIRED: [&str; 14] = [
    "x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "opacity", "f_dc_0", "f_dc_1",
    "f_dc_2",
];

/// The start of the comment with the size of the picture that the scene shows.
const PICTURE: &str = "gs picture ";

/// The content of a PLY.
pub(crate) struct Read {
    pub(crate) scene: Scene3d,
    pub(crate) format: Format3d,
    pub(crate) losses: Vec<ConversionLoss>,
    pub(crate) trained_with: TrainedWith,
    /// Columns and rows of the picture that the scene shows, if a comment says so.
    pub(crate) picture: Option<(u32, u32)>,
}

/// Reads a PLY of either kind.
pub(crate) fn read(source: &Source<'_>) -> Result<Read, Error> {
    let header = Header::parse(source)?;
    let Some(vertex) = header.find("vertex") else {
        return Err(source.damaged(0, "an element `vertex`", "none"));
    };
    if header.find("chunk").is_some() && header.elements[vertex].find("packed_position").is_some() {
        return compressed::read(source, &header);
    }
    let element = &header.elements[vertex];
    let columns = columns(source, element, &REQUIRED)?;
    let rest = rest_columns(source, element)?;
    let file_degree = degree_of_rest(rest.len()).unwrap_or(0);
    let degree = file_degree.min(MAX_DEGREE);
    let start = element_start(source, &header, vertex)?;
    let wanted: Vec<usize> = columns.into_iter().chain(rest.iter().copied()).collect();
    let mut scene = Scene3d { sh_degree: degree, ..Scene3d::default() };
    let (kept, per_channel) = (scene.sh_len() - 1, rest.len() / 3);
    rows::read(source, &header, element, start, &wanted, |row| {
        let value = |k: usize| row[k] as f32;
        scene.means.push([value(0), value(1), value(2)].into());
        scene.log_scales.push([value(3), value(4), value(5)].into());
        scene.rotations.push([value(6), value(7), value(8), value(9)]);
        scene.opacity_logits.push(value(10));
        scene.sh.push([value(11), value(12), value(13)].into());
        let rest = |channel: usize, k: usize| value(14 + channel * per_channel + k);
        scene.sh.extend((0..kept).map(|k| glam::Vec3::new(rest(0, k), rest(1, k), rest(2, k))));
    })?;
    let losses =
        if degree < file_degree { vec![ConversionLoss::Sh { from: file_degree, to: degree }] } else { Vec::new() };
    let picture = header.comments.iter().find_map(|comment| picture_of(comment));
    Ok(Read { scene, format: Format3d::Ply, losses, trained_with: header.trained_with(), picture })
}

/// The comment with the size of the picture that a flat scene shows.
pub(crate) fn picture_comment(width: u32, height: u32) -> String {
    format!("{PICTURE}{width}x{height}")
}

/// The size in such a comment; `None` for other comments and impossible sizes.
fn picture_of(comment: &str) -> Option<(u32, u32)> {
    let (width, height) = comment.strip_prefix(PICTURE)?.split_once('x')?;
    let size = (width.parse().ok()?, height.parse().ok()?);
    check_size(size.0, size.1).is_ok().then_some(size)
}

/// Position of the first row of an element, after the rows of all earlier elements.
fn element_start(source: &Source<'_>, header: &Header, element: usize) -> Result<usize, Error> {
    let before = &header.elements[..element];
    before.iter().try_fold(header.data_start, |start, e| rows::read(source, header, e, start, &[], |_| {}))
}

/// Indices of the properties with these names.
fn columns(source: &Source<'_>, element: &Element, names: &[&str]) -> Result<Vec<usize>, Error> {
    let missing = names.iter().filter(|name| element.find(name).is_none());
    let missing: Vec<String> = missing.map(|&name| name.to_owned()).collect();
    if missing.is_empty() {
        return Ok(names.iter().filter_map(|name| element.find(name)).collect());
    }
    Err(Error::MissingProperties { path: source.path.to_owned(), names: missing })
}

/// Indices of `f_rest_0`, `f_rest_1`, …, as many as some degree has.
fn rest_columns(source: &Source<'_>, element: &Element) -> Result<Vec<usize>, Error> {
    let numbers = element.properties.iter().filter_map(|p| p.name.strip_prefix("f_rest_")?.parse::<usize>().ok());
    let Some(last) = numbers.max() else { return Ok(Vec::new()) };
    let count = last.saturating_add(1);
    if degree_of_rest(count).is_none() {
        let names = if count > element.properties.len() { "too few".to_owned() } else { count.to_string() };
        let expected = "0, 9, 24, 45 or 72 properties f_rest_0, f_rest_1, …";
        return Err(source.damaged(0, expected, format!("{names} up to f_rest_{last}")));
    }
    let names: Vec<String> = (0..count).map(|k| format!("f_rest_{k}")).collect();
    columns(source, element, &names.iter().map(String::as_str).collect::<Vec<_>>())
}

/// Writes a scene in the layout of 3DGS: 62 properties at degree 3, fewer `f_rest` below.
pub(crate) fn write(scene: &Scene3d, comments: &[String], file: &mut dyn Write) -> io::Result<()> {
    let rest = scene.sh_len() - 1;
    let mut names: Vec<String> =
        ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(str::to_owned).to_vec();
    names.extend((0..3 * rest).map(|k| format!("f_rest_{k}")));
    names.extend(["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"].map(str::to_owned));
    writeln!(file, "ply\nformat binary_little_endian 1.0")?;
    comments.iter().try_for_each(|comment| writeln!(file, "comment {comment}"))?;
    writeln!(file, "element vertex {}", scene.len())?;
    names.iter().try_for_each(|name| writeln!(file, "property float {name}"))?;
    writeln!(file, "end_header")?;
    let mut row = Vec::with_capacity(4 * names.len());
    for i in 0..scene.len() {
        row.clear();
        let mut put = |value: f32| row.extend(value.to_le_bytes());
        scene.means[i].to_array().into_iter().chain([0.0; 3]).for_each(&mut put);
        let (dc, higher) = scene.sh[i * scene.sh_len()..][..scene.sh_len()].split_at(1);
        dc[0].to_array().into_iter().for_each(&mut put);
        (0..3).for_each(|channel| higher.iter().for_each(|c| put(c[channel])));
        put(finite_logit(scene.opacity_logits[i]));
        scene.log_scales[i].to_array().into_iter().chain(scene.rotations[i]).for_each(&mut put);
        file.write_all(&row)?;
    }
    Ok(())
}
