//! Recognises scene files of other formats, and says how to convert them to PLY.

use std::path::Path;

use crate::error::Error;

/// The tool that reads most of them.
const SPLAT_TRANSFORM: &str =
    "convert it with PlayCanvas's splat-transform: npx @playcanvas/splat-transform FILE scene.ply";
const TRAIN: &str = "it holds no Gaussians; train a scene from images with gs train, or name a PLY of Gaussians";

/// A kind of file, recognised by its first bytes or its extension, or both.
struct Kind {
    start: &'static [u8],
    endings: &'static [&'static str],
    what: &'static str,
    hint: &'static str,
}

/// The file that describes 3D Tiles.
pub(crate) const TILESET: &str = "tileset.json";

/// Files that describe a scene in their folder and its subfolders.
pub(crate) const FOLDER_NAMES: [&str; 1] = [TILESET];

const ORIGINAL: &str = "3D Tiles are only written: name the scene that they were made of";

const ANY: &[&str] = &[];

/// The first match counts.
const KINDS: [Kind; 11] = [
    Kind { start: b"", endings: &["sogs"], what: "a SOG scene of version 1", hint: SPLAT_TRANSFORM },
    Kind {
        start: b"",
        endings: &["b3dm", "i3dm", "pnts", "cmpt", "subtree"],
        what: "a tile of 3D Tiles",
        hint: ORIGINAL,
    },
    Kind { start: b"", endings: &["lcc"], what: "an XGrids .lcc scene", hint: SPLAT_TRANSFORM },
    Kind {
        start: b"PK\x03\x04",
        endings: &["pt", "pth", "ckpt"],
        what: "a PyTorch checkpoint",
        hint: "export a PLY with the program that wrote it, such as Nerfstudio's ns-export gaussian-splat",
    },
    Kind { start: b"PK\x03\x04", endings: ANY, what: "a ZIP archive", hint: "unpack it and name the scene in it" },
    Kind {
        start: b"",
        endings: &["csv", "tsv"],
        what: "a table of numbers",
        hint: "export a PLY with the program that wrote it",
    },
    Kind { start: b"", endings: &["obj", "stl", "fbx", "dae", "off"], what: "a mesh", hint: TRAIN },
    Kind { start: b"LASF", endings: ANY, what: "a LAS point cloud", hint: TRAIN },
    Kind { start: b"", endings: &["las", "laz", "e57", "pcd", "xyz"], what: "a point cloud", hint: TRAIN },
    Kind { start: b"Kaydara FBX Binary", endings: ANY, what: "a mesh", hint: TRAIN },
    Kind {
        start: b"[",
        endings: &["json"],
        what: "a list in JSON, such as the cameras.json of 3DGS",
        hint: "name the scene that belongs to it, such as point_cloud.ply",
    },
];

/// The error for a file that is not a readable scene: it names the file's kind if that is known.
pub(crate) fn refusal(start: &[u8], path: &Path) -> Option<Error> {
    let has_ending = |ending: &&str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    let fits = |kind: &&Kind| {
        start.starts_with(kind.start) && (kind.endings.is_empty() || kind.endings.iter().any(has_ending))
    };
    let Kind { what, hint, .. } = KINDS.iter().find(fits)?;
    Some(Error::foreign_scene(path, what, hint))
}

/// The error for a JSON object that is not a glTF of Gaussians: it names the file's kind if that is
/// known.
pub(crate) fn refusal_of_json(json: &[u8], path: &Path) -> Option<Error> {
    let object: serde_json::Map<String, serde_json::Value> = serde_json::from_slice(json).ok()?;
    let has = |keys: &[&str]| keys.iter().all(|key| object.contains_key(*key));
    let (what, hint) = if has(&["means", "scales", "quats"]) {
        ("the meta.json of a SOG scene", "name it meta.json, beside its images")
    } else if has(&["lodLevels"]) || has(&["filenames", "tree"]) {
        ("the lod-meta.json of a streamed SOG", "name it lod-meta.json, beside the folders of its chunks")
    } else if has(&["root", "geometricError"]) {
        ("a tileset of 3D Tiles", ORIGINAL)
    } else if has(&["frames"]) {
        ("a transforms.json, which belongs to a data set", "train a scene with gs train, or name a scene")
    } else {
        return refusal(json, path);
    };
    Some(Error::foreign_scene(path, what, hint))
}

/// Whether a path ends in a file of this name, in whatever case.
pub(super) fn has_name(path: &Path, name: &str) -> bool {
    path.file_name().is_some_and(|found| found.eq_ignore_ascii_case(name))
}
