//! glTF with `KHR_gaussian_splatting`: `.gltf` with an embedded or separate buffer, and `.glb`;
//! [`read`] and [`encode`].
//!
//! A primitive's attributes are POSITION and, after the extension's name and a colon, ROTATION (x,
//! y, z, w), SCALE (linear), OPACITY (0 to 1) and SH_DEGREE_l_COEF_n. All primitives of the default
//! scene are merged into one scene, transformed by their nodes.
//!
//! glTF has y up and z forward; scenes here have y down and z forward, as in COLMAP, so x and y are
//! negated.
//!
//! In place of values, a primitive may have an SPZ (`KHR_gaussian_splatting_compression_spz_2`). Its
//! coordinates are taken as those of the glTF, as CesiumJS takes them, although the draft of that extension
//! asks for the axes of SPZ files; the two differ by half a turn around y.
//!
//! *Source:* Khronos, KHR_gaussian_splatting, ratified. Drafts of it had logarithms as scales; a
//!   file with a scale below 0, which the ratified text forbids, is read as a draft. CesiumJS 1.145,
//!   `GaussianSplat3DTileContent`, `GltfSpzLoader`, and pull request 2531 of KhronosGroup/glTF, for the SPZ.

mod accessor;
mod buffers;
mod document;
mod linear_light;
#[cfg(feature = "write")]
mod tile;
mod write;

use glam::{DAffine3, DMat3, DVec3, Vec3};
use gs_core::Scene3d;

#[cfg(feature = "write")]
pub(crate) use self::tile::{TILE_EXTENSIONS, encode_spz};
pub(crate) use self::write::encode;
use self::{
    accessor::Accessors,
    buffers::Buffers,
    document::{Document, EXTENSION, Primitive, SPZ_EXTENSION, Splatting},
};
use super::{
    File3d, Format3d, TrainedWith,
    conversion_loss::ConversionLoss,
    foreign,
    source::Source,
    spz,
    values::{Flips, MAX_DEGREE, log_of_scale, logit_of_opacity, logit_of_step, scale_of_log, transform},
};
use crate::{WorldFrame, error::Error};

/// Signs between glTF's axes and ours.
const AXES: [f32; 3] = [-1.0, -1.0, 1.0];

/// The colour space of scenes here. The one in linear light is `lin_rec709_display`.
const SRGB: &str = "srgb_rec709_display";
const LINEAR: &str = "lin_rec709_display";

/// Required extensions that are supported: ours, SPZ in it, and integers as components.
const HARMLESS: [&str; 3] = [EXTENSION, SPZ_EXTENSION, "KHR_mesh_quantization"];

/// Whether a file starts like a `.glb` or a `.gltf`, which is JSON.
pub(crate) fn recognises(start: &[u8]) -> bool {
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    let is_text = text.iter().all(|byte| !byte.is_ascii_control() || byte.is_ascii_whitespace());
    let mut visible = text.iter().filter(|byte| is_text && !byte.is_ascii_whitespace());
    start.starts_with(&buffers::GLB_MAGIC)
        || (visible.next() == Some(&b'{') && matches!(visible.next(), Some(b'"' | b'}')))
}

/// Reads all Gaussians of the default scene, with the losses.
pub(crate) fn read(source: &Source<'_>, format: Format3d) -> Result<File3d, Error> {
    let (json_start, json, binary) = buffers::split(source)?;
    let document: Document = serde_json::from_slice(json).map_err(|error| {
        let line_start = json.split_inclusive(|&b| b == b'\n').take(error.line().saturating_sub(1)).map(<[u8]>::len);
        let byte = json_start + line_start.sum::<usize>() + error.column().saturating_sub(1);
        source.damaged(byte, "the JSON of a glTF", error.to_string())
    })?;
    if let Some(name) = document.extensions_required.iter().find(|name| !HARMLESS.contains(&name.as_str())) {
        return Err(unsupported(source, format!("the extension {name}, which it requires,")));
    }
    let places = places(source, &document)?;
    if places.is_empty() {
        let unknown = || Error::not_a_3d_scene(source.path, &format!("a glTF without {EXTENSION} in its scene"));
        return Err(foreign::refusal_of_json(json, source.path).unwrap_or_else(unknown));
    }
    let buffers = Buffers::read(source, &document, binary)?;
    let accessors = Accessors { source, document: &document, buffers: &buffers };
    check_claims(&accessors, &places)?;

    let mut parts = Vec::new();
    for place in &places {
        parts.push(read_part(&accessors, place)?);
    }
    // A negative scale identifies a draft, whose scales are all logarithms.
    let draft = parts.iter().any(|part| part.scales.iter().flatten().any(|&scale| scale < 0.0));
    let mut whole = Scene3d::default();
    let mut losses = Vec::new();
    let said = places.iter().map(|place| TrainedWith::of_extras(&place.primitive.extras));
    let mut trained_with = said.reduce(TrainedWith::in_common).unwrap_or_default();
    let (maps, frame) = maps_and_frame(&parts, &places, trained_with.frame);
    trained_with.frame = frame;
    for (part, map) in parts.into_iter().zip(&maps) {
        let Part { mut scene, scales, linear_light } = part;
        let log_scales = scales.iter().map(|s| if draft { Vec3::from(*s) } else { s.map(log_of_scale).into() });
        scene.log_scales = log_scales.collect();
        if linear_light {
            let len = scene.sh_len();
            scene.sh.chunks_exact_mut(len).for_each(linear_light::to_srgb);
            ConversionLoss::merge(&mut losses, [ConversionLoss::LinearLight]);
        }
        ConversionLoss::merge(&mut losses, transform(&mut scene, map));
        whole.append(scene);
    }
    losses.extend(draft.then_some(ConversionLoss::DraftScales));
    Ok(File3d { losses, trained_with, ..File3d::of(format, whole) }.beside(buffers.files))
}

/// How each primitive's coordinates become those of the scene, in a frame that `f32` resolves.
///
/// `named` is the frame that the file names. If a node leads from it to the world, as
/// [`Coordinates::World`](crate::Coordinates::World) writes it, the node is left out. In a file that
/// names none, nodes may lead far away.
fn maps_and_frame(parts: &[Part], places: &[Place<'_>], named: WorldFrame) -> (Vec<DAffine3>, WorldFrame) {
    let axes = DAffine3::from_mat3(DMat3::from_diagonal(signs()));
    let to_world = named.to(&WorldFrame::WORLD);
    let tolerance = 1e-9 * to_world.translation.length().max(named.unit);
    let leads_to_world = |place: &Place<'_>| (axes * place.map * axes).abs_diff_eq(to_world, tolerance);
    if !named.is_world() && places.iter().all(leads_to_world) {
        return (vec![axes; places.len()], named);
    }
    let mut maps: Vec<DAffine3> = places.iter().map(|place| axes * place.map).collect();
    let mut frame = named;
    if named.is_world() && places.iter().any(|place| place.map.translation != DVec3::ZERO) {
        let means = |(part, map): (&Part, &DAffine3)| {
            part.scene.means.iter().map(|mean| map.transform_point3(mean.as_dvec3())).collect::<Vec<_>>()
        };
        frame = WorldFrame::around(&parts.iter().zip(&maps).flat_map(means).collect::<Vec<_>>());
        maps.iter_mut().for_each(|map| map.translation -= frame.origin);
    }
    (maps, frame)
}

/// A primitive of Gaussians with the transformation to the scene's coordinates.
struct Place<'a> {
    primitive: &'a Primitive,
    splatting: Splatting,
    map: DAffine3,
}

/// All primitives of Gaussians below the default scene's nodes, in tree order.
fn places<'a>(source: &Source<'_>, document: &'a Document) -> Result<Vec<Place<'a>>, Error> {
    let bad = |expected: &str, number: usize| source.damaged(0, expected, format!("number {number}"));
    let roots: Vec<usize> = match document.scenes.get(document.scene) {
        Some(scene) => scene.nodes.clone(),
        None if document.scenes.is_empty() => {
            let mut is_root = vec![true; document.nodes.len()];
            let children = document.nodes.iter().flat_map(|node| &node.children);
            children.for_each(|&child| _ = is_root.get_mut(child).map(|root| *root = false));
            (0..is_root.len()).filter(|&node| is_root[node]).collect()
        }
        None => return Err(bad("a scene that there is", document.scene)),
    };
    let mut visited = vec![false; document.nodes.len()];
    let mut found = Vec::new();
    let mut next: Vec<(usize, DAffine3)> = roots.into_iter().rev().map(|node| (node, DAffine3::IDENTITY)).collect();
    while let Some((number, parent)) = next.pop() {
        let node = document.nodes.get(number).ok_or_else(|| bad("a node that there is", number))?;
        if std::mem::replace(&mut visited[number], true) {
            return Err(bad("a tree, in which each node stands once", number));
        }
        let map = parent * node.map();
        if !map.is_finite() {
            return Err(bad("a node whose transform is finite", number));
        }
        if let Some(mesh) = node.mesh {
            let mesh = document.meshes.get(mesh).ok_or_else(|| bad("a mesh that there is", mesh))?;
            let splats = mesh.primitives.iter().filter_map(|primitive| Some((primitive, primitive.splatting()?)));
            found.extend(splats.map(|(primitive, splatting)| Place { primitive, splatting, map }));
            // Many nodes that refer to a mesh of many primitives could make a small file expand
            // without limit.
            source.check_claim(source.bytes.len() as u64, (found.len() * size_of::<Place<'_>>()) as u64)?;
        }
        next.extend(node.children.iter().rev().map(|&child| (child, map)));
    }
    Ok(found)
}

/// Fails if primitives that share accessors add up to more than the file's size justifies.
fn check_claims(accessors: &Accessors<'_>, places: &[Place<'_>]) -> Result<(), Error> {
    let source = accessors.source;
    let mut claimed = 0_u64;
    for place in places {
        let rows = place.primitive.attributes.get("POSITION").map_or(Ok(0), |&number| accessors.count(number))?;
        // Mean, scale, rotation, opacity, and a colour per coefficient.
        let numbers =
            11 + 3 * place.primitive.attributes.keys().filter(|name| name.contains(":SH_DEGREE_")).count() as u64;
        claimed = claimed.saturating_add(rows.saturating_mul(4 * numbers));
    }
    source.check_claim(source.bytes.len() as u64 + accessors.buffers.decoded_bytes(), claimed)
}

/// The Gaussians of a primitive, in its own coordinates, with scales as stored.
struct Part {
    scene: Scene3d,
    scales: Vec<[f32; 3]>,
    linear_light: bool,
}

fn read_part(accessors: &Accessors<'_>, place: &Place<'_>) -> Result<Part, Error> {
    let source = accessors.source;
    let attributes = &place.primitive.attributes;
    let linear_light = match place.splatting.color_space.as_deref() {
        None | Some(SRGB) => false,
        Some(LINEAR) => true,
        Some(other) => return Err(unsupported(source, format!("the colour space {other:?}"))),
    };
    if let Some(view) = place.splatting.spz() {
        let source = Source { what: "the SPZ in a glTF", bytes: accessors.view(view, SPZ_EXTENSION)?.1, ..*source };
        let scene = spz::read_with_axes(&source, Format3d::Spz, Flips::new([1.0; 3]))?.scene;
        let scales = scene.log_scales.iter().map(|log| log.to_array().map(scale_of_log)).collect();
        return Ok(Part { scene, scales, linear_light });
    }
    if let Some(name) = place.splatting.extensions.keys().find(|name| name.contains("compression")) {
        return Err(unsupported(source, format!("the compression {name}")));
    }
    let named = |name: &str| -> Result<usize, Error> {
        attributes.get(name).copied().ok_or_else(|| source.damaged(0, format!("an attribute {name}"), "none"))
    };
    let ours = |name: &str| format!("{EXTENSION}:{name}");
    let means = accessors.rows::<3>(named("POSITION")?, "POSITION")?;
    let count = means.len();
    let same_count = |name: &str, found: usize| match found == count {
        true => Ok(()),
        false => Err(source.damaged(0, format!("{count} rows in {name}"), found.to_string())),
    };
    let rotations = accessors.rows::<4>(named(&ours("ROTATION"))?, "ROTATION")?;
    same_count("ROTATION", rotations.len())?;
    let scales = accessors.rows::<3>(named(&ours("SCALE"))?, "SCALE")?;
    same_count("SCALE", scales.len())?;
    let opacity = named(&ours("OPACITY"))?;
    let opacities = accessors.rows::<1>(opacity, "OPACITY")?;
    let steps = accessors.steps(opacity)?;
    same_count("OPACITY", opacities.len())?;

    let degree_of = |name: &String| name.strip_prefix(&ours("SH_DEGREE_"))?.split('_').next()?.parse::<u8>().ok();
    let degree = attributes.keys().filter_map(degree_of).max().unwrap_or(0).min(MAX_DEGREE);
    let mut scene = Scene3d { sh_degree: degree, ..Scene3d::default() };
    let len = scene.sh_len();
    let names = (0..=degree).flat_map(|l| (0..=2 * l).map(move |n| format!("SH_DEGREE_{l}_COEF_{n}")));
    let mut numbers = Vec::new();
    for name in names {
        let number = named(&ours(&name))?;
        same_count(&name, accessors.count(number)? as usize)?;
        numbers.push((name, number));
    }
    scene.sh = vec![Vec3::ZERO; count * len];
    for (k, (name, number)) in numbers.iter().enumerate() {
        let rows = accessors.rows::<3>(*number, name)?;
        scene.sh.iter_mut().skip(k).step_by(len).zip(rows).for_each(|(c, row)| *c = row.into());
    }
    scene.means = means.into_iter().map(Vec3::from).collect();
    scene.rotations = rotations.into_iter().map(|[x, y, z, w]| [w, x, y, z]).collect();
    let logit = |[opacity]: [f32; 1]| match steps {
        Some(steps) if opacity >= 0.0 => logit_of_step((opacity * f32::from(steps)).round() as u16, steps),
        _ => logit_of_opacity(opacity),
    };
    scene.opacity_logits = opacities.into_iter().map(logit).collect();
    scene.log_scales = vec![Vec3::ZERO; count];
    Ok(Part { scene, scales, linear_light })
}

fn unsupported(source: &Source<'_>, what: String) -> Error {
    Error::unsupported(source.path, what, "export the file without it")
}

/// The flips between glTF's axes and ours.
pub(crate) const fn axes() -> Flips {
    Flips::new(AXES)
}

/// The signs of the axes: glTF = signs · ours, and the reverse.
fn signs() -> DVec3 {
    DVec3::from(AXES.map(f64::from))
}
