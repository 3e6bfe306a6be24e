//! Writes a scene with levels of detail, as a streamed SOG or as 3D Tiles.

use std::{borrow::Cow, collections::BTreeSet, fs, io, path::Path};

use gs_core::{Bounds, Scene, Scene3d};
use gs_density::Level;
use rayon::prelude::*;

use super::{
    layout::Layout,
    meta::Node,
    plan::{CELL, Cell, Plan},
    tiles::Tileset,
};
use crate::{
    FolderClaim, OutputFolder,
    atomic::write_durably,
    error::Error,
    scene3d::{
        ConversionLoss, Encoded3d, Format3d, WriteOptions3d, Written3d, options::ToWrite, values::UnitRotations,
        whole::writable,
    },
};

/// Takes a file: its path, and its content.
type Sink<'a> = dyn FnMut(&Path, &[u8]) -> Result<(), Error> + 'a;

/// A scene in parts.
struct Parts<'a, E> {
    sh_degree: u8,
    /// The numbers of Gaussians of the parts.
    gaussians: &'a [usize],
    /// Gives a part.
    part: &'a mut dyn FnMut(usize) -> Result<Cow<'a, Scene3d>, E>,
}

/// Whether a format has levels of detail in the files of a folder.
pub(crate) fn writes_levels(format: Format3d) -> bool {
    matches!(format, Format3d::StreamedSog | Format3d::Tiles3d)
}

/// Writes a scene with levels of detail as [`write_3d`](crate::write_3d) does.
pub(crate) fn write(
    path: &Path,
    format: Format3d,
    scene: &Scene3d,
    options: &WriteOptions3d,
) -> Result<Written3d, Error> {
    if scene.is_empty() {
        return Err(Error::empty(path));
    }
    let (scene, options) = writable(path, format, Cow::Borrowed(scene), options)?;
    let mut part = |_| Ok(Cow::Borrowed(&*scene));
    write_all(path, format, Parts { sh_degree: scene.sh_degree, gaussians: &[scene.len()], part: &mut part }, &options)
}

/// Writes a scene that is never in memory as a whole as a streamed SOG or as 3D Tiles: a tree of levels of detail for each of its
/// parts, and one tree above them. `gaussians` are the numbers of Gaussians of the parts; `part` gives each of them once,
/// in their order, with this SH degree.
///
/// Needs memory for a part and some chunks.
///
/// # Errors
/// Those of [`write_3d`](crate::write_3d) and of `part`; [`Error::Write`] where a part has another number of Gaussians or
/// another SH degree.
pub fn write_levels_of_parts_3d<E: From<Error>>(
    path: impl AsRef<Path>,
    sh_degree: u8,
    gaussians: &[usize],
    options: &WriteOptions3d,
    mut part: impl FnMut(usize) -> Result<Scene3d, E>,
) -> Result<Written3d, E> {
    let path = path.as_ref();
    let Some(format) = Format3d::to_write(path).filter(|format| writes_levels(*format)) else {
        return Err(Format3d::unknown_ending(path).into());
    };
    if gaussians.iter().all(|gaussians| *gaussians == 0) {
        return Err(Error::empty(path).into());
    }
    let writable = |scene| writable(path, format, Cow::Owned(scene), options);
    // Refuses what no scene may have, before anything is written.
    let (_, of_all) = writable(Scene3d::default())?;
    let mut part = |number| Ok(writable(part(number)?)?.0);
    write_all(path, format, Parts { sh_degree, gaussians, part: &mut part }, &of_all)
}

/// Writes all chunks into a temporary folder, and when they are complete, into their places, the file that describes
/// them last.
fn write_all<E: From<Error>>(
    path: &Path,
    format: Format3d,
    parts: Parts<'_, E>,
    options: &WriteOptions3d,
) -> Result<Written3d, E> {
    let layout: &dyn Layout = match format {
        Format3d::Tiles3d => &Tileset::of(parts.gaussians, path, options)?,
        _ => &Plan::of(parts.gaussians),
    };
    let names = layout.plan().chunks.iter().flat_map(|chunk| layout.names(chunk, parts.sh_degree));
    let names: Vec<String> = names.chain([format.row().ending.unwrap_or_default().to_owned()]).collect();
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let is_new = !folder.exists();
    let folder = FolderClaim::new(folder, names.iter().cloned()).begin()?;
    let losses = write_into(&folder, layout, &names, parts, options).inspect_err(|_| {
        if is_new {
            folder.discard();
        }
    })?;
    let beside = names[..names.len() - 1].iter().map(|name| folder.path().join(name)).collect();
    Ok(Written3d { format, losses, beside, order: None })
}

fn write_into<E: From<Error>>(
    folder: &OutputFolder,
    layout: &dyn Layout,
    names: &[String],
    parts: Parts<'_, E>,
    options: &WriteOptions3d,
) -> Result<Vec<ConversionLoss>, E> {
    let place = folder.path();
    let failed = |error: io::Error| Error::write(place, error);
    let unfinished = folder.temporary_folder()?;
    let make_folders = |place: &Path| {
        let folders = names.iter().filter_map(|name| Some(name.split_once('/')?.0)).collect::<BTreeSet<_>>();
        folders.into_iter().try_for_each(|name| fs::create_dir_all(place.join(name))).map_err(failed)
    };
    make_folders(unfinished.path())?;
    let mut write = |path: &Path, bytes: &[u8]| {
        let name = path.strip_prefix(place).expect("a file in the folder");
        write_durably(unfinished.path().join(name), |file| file.write_all(bytes))
    };
    let description = names.last().expect("the file that describes the others");
    let path = place.join(description);
    let (content, losses) = encode_chunks(&path, layout, parts, options, &mut write)?;
    write(&path, &content)?;
    // Without its description, an older scene whose chunks are replaced is not read.
    folder.remove(description)?;
    make_folders(place)?;
    for name in names {
        fs::rename(unfinished.path().join(name), folder.file(name)).map_err(failed)?;
    }
    let old = folder.claimed("").into_iter().filter(|name| !names.contains(name));
    for name in old.filter(|name| name.split(['/', '.']).next().is_some_and(super::is_chunk)) {
        folder.remove(&name)?;
    }
    Ok(losses)
}

/// Encodes all chunks, and returns the content of the file that describes them and what is lost in the finest level.
fn encode_chunks<E: From<Error>>(
    path: &Path,
    layout: &dyn Layout,
    parts: Parts<'_, E>,
    options: &WriteOptions3d,
    sink: &mut Sink<'_>,
) -> Result<(Vec<u8>, Vec<ConversionLoss>), E> {
    let plan = layout.plan();
    let mut losses: Vec<ConversionLoss> = Vec::new();
    let mut leaves = Vec::with_capacity(plan.cells.len());
    let mut chunks: Vec<Scene3d> = vec![Scene3d::default(); plan.chunks.len()];
    let mut end_chunk = |file: usize, chunk: Scene3d| {
        let name = &plan.chunks[file];
        let path = path.with_file_name(&layout.names(name, chunk.sh_degree)[0]);
        let to = ToWrite { format: Format3d::Glb, path: &path, scene: &chunk, options };
        let Encoded3d { bytes, beside, written } = layout.encode(file, &to)?;
        if name.starts_with("0_") {
            ConversionLoss::merge(&mut losses, written.losses);
        }
        beside.into_iter().try_for_each(|(path, bytes)| sink(&path, &bytes))?;
        sink(&path, &bytes)
    };
    // Enough cells for all threads; they need memory until the last of them is done.
    let at_once = 2 * rayon::current_num_threads();
    for cells in plan.parts() {
        let Some(number) = cells.first().map(|cell| cell.part) else { continue };
        let scene = (parts.part)(number)?;
        if scene.len() != parts.gaussians[number] || scene.sh_degree != parts.sh_degree {
            let message = format!("part {} has other Gaussians than was said", number + 1);
            return Err(Error::write(path, io::Error::other(message)).into());
        }
        UnitRotations::new(&scene, path)?;
        let order = gs_density::spatial_order(&scene.means, CELL);
        for batch in cells.chunks(at_once) {
            let of = |cell: &Cell| levels(&scene, &order[cell.members.clone()], cell);
            let levels: Vec<Vec<Level>> = batch.par_iter().map(of).collect();
            for (cell, levels) in batch.iter().zip(levels) {
                leaves.push(leaf(cell, &levels));
                let next = plan.cells.get(leaves.len());
                for (run, level) in cell.runs.iter().zip(levels) {
                    chunks[run.file].append(level.scene);
                    let goes_on = next.is_some_and(|next| next.runs.iter().any(|other| other.file == run.file));
                    if !goes_on {
                        end_chunk(run.file, std::mem::take(&mut chunks[run.file]))?;
                    }
                }
            }
        }
    }
    Ok((layout.describe(path, leaves)?, losses))
}

/// All levels of a cell, the finest first.
fn levels(scene: &Scene3d, members: &[u32], cell: &Cell) -> Vec<Level> {
    let counts: Vec<usize> = cell.runs.iter().map(|run| run.count).collect();
    gs_density::levels(scene, members, &counts)
}

/// The node of a cell: the bounds of its Gaussians in all levels, out to a standard deviation, its runs
/// and errors.
fn leaf(cell: &Cell, levels: &[Level]) -> Node {
    let gaussians = levels.iter().flat_map(|level| (0..level.scene.len()).map(|i| level.scene.gaussian(i)));
    let bounds = gaussians.map(|gaussian| Bounds::of(&gaussian)).fold(Bounds::EMPTY, Bounds::union);
    let lods = cell.runs.iter().enumerate().map(|(level, run)| (level.to_string(), *run));
    let mut largest = 0.0;
    let errors = levels.iter().map(|level| {
        largest = level.error.max(largest);
        largest
    });
    Node { bound: bounds.into(), children: None, lods: Some(lods.collect()), errors: Some(errors.collect()) }
}
