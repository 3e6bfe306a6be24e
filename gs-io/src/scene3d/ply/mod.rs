//! PLY: [`read`]s and [`write()`]s that of 3DGS, and reads PlayCanvas's compressed one.
//!
//! Vertices of the 3DGS kind have, by name: `x y z` (mean), `nx ny nz` (unused), `f_dc_0..2` (SH of
//! degree 0, RGB), `f_rest_*` (the others, all of red first, then green, then blue), `opacity`
//! (logit), `scale_0..2` (logarithms), `rot_0..3` (quaternion w, x, y, z). Order does not matter to
//! us, and properties that are not known are passed over; what is written has them in 3DGS's order.
//! Comments say how a scene was trained: see [`TrainedWith`](crate::TrainedWith).

mod compressed;
mod header;
mod rows;

use std::{
    io::{self, Write},
    path::Path,
};

use glam::DVec3;
use gs_core::{Scene, Scene3d};

pub(crate) use self::header::{Element, Header, Value};
use super::{
    Encoded3d, File3d, Format3d, WriteOptions3d,
    conversion_loss::ConversionLoss,
    options::ToWrite,
    source::Source,
    values::{MAX_DEGREE, Number, degree_of_rest, finite_logit, rest_of_degree},
};
use crate::{WorldFrame, error::Error};

/// The properties that every Gaussian must have, in the order in which [`read`] takes them.
const REQUIRED: [&str; 14] = [
    "x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "opacity", "f_dc_0", "f_dc_1",
    "f_dc_2",
];

/// Reads a PLY of either kind.
pub(crate) fn read(source: &Source<'_>, _: Format3d) -> Result<File3d, Error> {
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
    let wanted: Vec<usize> = columns.into_iter().chain(rest.iter().copied()).collect();
    let mut scene = Scene3d { sh_degree: degree, ..Scene3d::default() };
    let (kept, per_channel) = (scene.sh_len() - 1, rest.len() / 3);
    let mut means = Vec::new();
    read_rows(source, &header, vertex, &wanted, |row| {
        let value = |k: usize| row[k] as f32;
        means.push(DVec3::new(row[0], row[1], row[2]));
        scene.log_scales.push([value(3), value(4), value(5)].into());
        scene.rotations.push([value(6), value(7), value(8), value(9)]);
        scene.opacity_logits.push(value(10));
        scene.sh.push([value(11), value(12), value(13)].into());
        let rest = |channel: usize, k: usize| value(14 + channel * per_channel + k);
        scene.sh.extend((0..kept).map(|k| glam::Vec3::new(rest(0, k), rest(1, k), rest(2, k))));
    })?;
    let mut losses = Vec::from_iter(ConversionLoss::of_degree(file_degree, degree));
    let mut trained_with = header.trained_with();
    match header.comments.iter().find_map(|comment| world_frame_of(comment)) {
        Some(frame) => trained_with.frame = take_to_frame(&mut scene, &means, frame),
        // A `float` in text may have more digits, but they mean nothing.
        None if [0, 1, 2].iter().all(|&k| !is_double(element, wanted[k])) => {
            scene.means.extend(means.iter().map(|mean| mean.as_vec3()));
        }
        None => {
            let frame = WorldFrame::around(&means);
            trained_with.frame = take_to_frame(&mut scene, &means, frame);
            losses.extend(rounded_means(&scene, &means, &frame));
        }
    }
    Ok(File3d { losses, trained_with, ..File3d::of(Format3d::Ply, scene) })
}

/// Whether a property is a number of 64 bits.
fn is_double(element: &Element, property: usize) -> bool {
    element.properties[property].value == Value::Scalar(Number::F64)
}

/// Gives a scene, whose scales are in world units, these means, and takes both into a frame.
fn take_to_frame(scene: &mut Scene3d, means: &[DVec3], frame: WorldFrame) -> WorldFrame {
    scene.means.extend(means.iter().map(|&mean| frame.to_frame(mean).as_vec3()));
    if frame.unit != 1.0 {
        scene.log_scales.iter_mut().for_each(|s| *s = (s.as_dvec3() - frame.unit.ln()).as_vec3());
    }
    frame
}

/// What the means, which were rounded in this frame, have lost.
fn rounded_means(scene: &Scene3d, means: &[DVec3], frame: &WorldFrame) -> Option<ConversionLoss> {
    let moved = |i: usize| {
        let change = frame.to_frame(means[i]).distance(scene.means[i].as_dvec3());
        change / f64::from(scene.log_scales[i].min_element()).exp()
    };
    let changes = (0..means.len()).map(moved).filter(|change| *change > 0.0 && change.is_finite());
    let (largest, visible) =
        changes.fold((0.0, 0), |(largest, visible), c| (c.max(largest), visible + usize::from(c > 0.1)));
    (largest > 0.0).then_some(ConversionLoss::RoundedMeans { largest, visible })
}

/// The start of the comment with the frame of a scene that is stored in coordinates of its world.
const WORLD_FRAME: &str = "gs world-frame: ";

/// The frame in such a comment.
fn world_frame_of(comment: &str) -> Option<WorldFrame> {
    WorldFrame::of_words(&comment.strip_prefix(WORLD_FRAME)?.split(' ').collect::<Vec<_>>())
}

/// Calls `row` with the chosen columns of each row of an element; see [`rows::read`].
pub(crate) fn read_rows(
    source: &Source<'_>,
    header: &Header,
    element: usize,
    wanted: &[usize],
    row: impl FnMut(&[f64]),
) -> Result<(), Error> {
    let start = element_start(source, header, element)?;
    rows::read(source, header, &header.elements[element], start, wanted, row).map(drop)
}

/// Position of the first row of an element, after the rows of all earlier elements.
fn element_start(source: &Source<'_>, header: &Header, element: usize) -> Result<usize, Error> {
    let before = &header.elements[..element];
    before.iter().try_fold(header.data_start, |start, e| rows::read(source, header, e, start, &[], |_| {}))
}

/// Indices of the properties with these names.
fn columns(source: &Source<'_>, element: &Element, names: &[&str]) -> Result<Vec<usize>, Error> {
    let missing: Vec<&str> = names.iter().copied().filter(|name| element.find(name).is_none()).collect();
    if missing.is_empty() {
        return Ok(names.iter().filter_map(|name| element.find(name)).collect());
    }
    let problem = format!("its vertices have no {}", missing.join(", "));
    Err(Error::unusable(source.path, problem, "it is not a scene of Gaussians: export it as a 3DGS PLY"))
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

/// Encodes a scene as [`write()`] writes it.
pub(crate) fn encode(&ToWrite { format, path, scene, options }: &ToWrite<'_>) -> Result<Encoded3d, Error> {
    let mut bytes = Vec::new();
    let (comments, world) = comments(options);
    write(scene, &comments, world, &mut bytes).map_err(|source| Error::write(path, source))?;
    Ok(Encoded3d::of(format, bytes, ConversionLoss::of_infinite_logits(scene).into_iter().collect()))
}

/// The comments of a file, and the frame from which it leads to the world, if it must.
pub(crate) fn comments(options: &WriteOptions3d) -> (Vec<String>, Option<WorldFrame>) {
    let world = options.world();
    let frame = if world.is_some() { WorldFrame::WORLD } else { options.trained_with.frame };
    (options.trained_with.with(|s| s.frame = frame).comments(), world)
}

/// The header of a binary file of Gaussians alone, up to their number and from there on, the bytes of a row, and their
/// number; `None` where rows differ in size, or depend on each other as means of 64 bits do. `start` holds the header.
pub(crate) fn rows_of(path: &Path, start: &[u8]) -> Option<([Vec<u8>; 2], u64, u64)> {
    let header = Header::parse(&Source { path, what: "a PLY of Gaussians", bytes: start, beside: None }).ok()?;
    let [vertex] = &header.elements[..] else { return None };
    let row_bytes = vertex.properties.iter().map(|property| match property.value {
        Value::Scalar(number) if number != Number::F64 => Some(number.bytes() as u64),
        _ => None,
    });
    let row_bytes = row_bytes.sum::<Option<u64>>()?;
    let count = format!("\nelement vertex {}\n", vertex.count);
    let text = std::str::from_utf8(&start[..header.data_start]).ok()?;
    let (before, after) = text.split_once(&count)?;
    let (before, after) = ([before, "\nelement vertex "].concat(), ["\n", after].concat());
    let is_binary = header.encoding != header::Encoding::Ascii;
    is_binary.then(|| ([before.into_bytes(), after.into_bytes()], row_bytes, vertex.count))
}

/// Writes a scene in the layout of 3DGS: 62 properties at degree 3, fewer `f_rest` below.
///
/// With a frame, coordinates are those of its world: means of 64 bits if 32 do not suffice.
fn write(scene: &Scene3d, comments: &[String], world: Option<WorldFrame>, file: &mut dyn Write) -> io::Result<()> {
    write_header(scene.sh_degree, scene.len(), comments, world, file)?;
    write_rows(scene, world, file)
}

/// Whether coordinates of a world need 64 bits.
fn is_far(world: Option<WorldFrame>) -> bool {
    world.is_some_and(|frame| frame.origin != DVec3::ZERO)
}

/// Writes the header of a file of Gaussians of an SH degree.
pub(crate) fn write_header(
    sh_degree: u8,
    gaussians: usize,
    comments: &[String],
    world: Option<WorldFrame>,
    file: &mut dyn Write,
) -> io::Result<()> {
    let mut names: Vec<String> =
        ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(str::to_owned).to_vec();
    names.extend((0..rest_of_degree(sh_degree)).map(|k| format!("f_rest_{k}")));
    names.extend(["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"].map(str::to_owned));
    writeln!(file, "ply\nformat binary_little_endian 1.0")?;
    comments.iter().try_for_each(|comment| writeln!(file, "comment {comment}"))?;
    world.iter().try_for_each(|frame| writeln!(file, "comment {WORLD_FRAME}{}", frame.to_words()))?;
    writeln!(file, "element vertex {gaussians}")?;
    let kind = |name: &str| if is_far(world) && ["x", "y", "z"].contains(&name) { "double" } else { "float" };
    names.iter().try_for_each(|name| writeln!(file, "property {} {name}", kind(name)))?;
    writeln!(file, "end_header")
}

/// Writes the rows of Gaussians.
pub(crate) fn write_rows(scene: &Scene3d, world: Option<WorldFrame>, file: &mut dyn Write) -> io::Result<()> {
    let mut row = Vec::new();
    for i in 0..scene.len() {
        row.clear();
        // In other coordinates. Without, -0 must stay -0.
        let mean = scene.means[i].as_dvec3();
        let mean = world.map_or(mean, |frame| frame.to_world(mean));
        let log_scale = scene.log_scales[i];
        let log_scale = world.map_or(log_scale, |frame| (log_scale.as_dvec3() + frame.unit.ln()).as_vec3());
        match is_far(world) {
            true => mean.to_array().into_iter().for_each(|value| row.extend(value.to_le_bytes())),
            false => mean.as_vec3().to_array().into_iter().for_each(|value| row.extend(value.to_le_bytes())),
        }
        let mut put = |value: f32| row.extend(value.to_le_bytes());
        [0.0; 3].into_iter().for_each(&mut put);
        let (dc, higher) = scene.sh[i * scene.sh_len()..][..scene.sh_len()].split_at(1);
        dc[0].to_array().into_iter().for_each(&mut put);
        (0..3).for_each(|channel| higher.iter().for_each(|c| put(c[channel])));
        put(finite_logit(scene.opacity_logits[i]));
        log_scale.to_array().into_iter().chain(scene.rotations[i]).for_each(&mut put);
        file.write_all(&row)?;
    }
    Ok(())
}
