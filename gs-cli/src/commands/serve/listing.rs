//! The scenes and runs below a folder.

use std::{
    fs,
    path::{Path, PathBuf},
    time::{Duration, UNIX_EPOCH},
};

use gs_io::{Format3d, GSI_EXTENSION, scene_in};
use serde::Serialize;

/// How deep folders are looked through.
const DEPTH: usize = 5;

/// Longest list shown; people cannot choose from a longer one.
const MOST: usize = 2000;

/// The table of a run that goes on, or else of one that has ended.
const TABLES: [&str; 2] = ["metrics.part.csv", "metrics.csv"];

/// A scene or a run.
#[derive(Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub(super) enum Entry {
    /// A file with a scene.
    Scene {
        /// Its path below the folder, with slashes.
        path: String,
        /// When it was written, ms since 1970.
        modified: u64,
    },
    /// A fit or a training, finished or going on.
    Run {
        /// The path of its folder, with slashes.
        path: String,
        /// The path of its table of metrics.
        table: String,
        /// When that was written last, ms since 1970.
        modified: u64,
        /// The path of its newest scene or checkpoint.
        scene: Option<String>,
        /// When that was written, ms since 1970.
        scene_modified: u64,
    },
}

/// The scenes and runs below a folder, runs first, by path.
pub(super) fn of(folder: &Path) -> Vec<Entry> {
    let mut found = Vec::new();
    visit(folder, folder, DEPTH, &mut found);
    found.sort_by_key(|entry| match entry {
        Entry::Run { path, .. } => (0, path.clone()),
        Entry::Scene { path, .. } => (1, path.clone()),
    });
    found
}

fn visit(root: &Path, folder: &Path, depth: usize, found: &mut Vec<Entry>) {
    let below = |path: &Path| path.strip_prefix(root).ok().map(slashed).unwrap_or_default();
    if let Some(table) = TABLES.map(|name| folder.join(name)).into_iter().find(|table| table.is_file()) {
        let scene = newest_scene(folder);
        found.push(Entry::Run {
            path: below(folder),
            table: below(&table),
            modified: modified(&table),
            scene_modified: scene.as_deref().map_or(0, modified),
            scene: scene.as_deref().map(below),
        });
    }
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        let hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        if hidden || found.len() >= MOST {
            continue;
        }
        // Links are not followed, so there are no circles.
        if path.is_symlink() {
            continue;
        } else if path.is_dir() {
            if depth > 0 {
                visit(root, &path, depth - 1, found);
            }
        } else if is_scene(&path) {
            found.push(Entry::Scene { path: below(&path), modified: modified(&path) });
        }
    }
}

/// The scene of a run, or a checkpoint that is newer.
fn newest_scene(folder: &Path) -> Option<PathBuf> {
    let is_checkpoint = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("checkpoint") && name.ends_with(".safetensors") && path.is_file()
    };
    let files = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    files.filter(is_checkpoint).chain(scene_in(folder)).max_by_key(|path| modified(path))
}

/// Whether a file is a scene by its name; files are not opened for the list.
fn is_scene(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    // The page does not fetch the images of a SOG in a folder.
    let is_written = !matches!(Format3d::to_write(path), None | Some(Format3d::SogFolder | Format3d::Tiles3d));
    is_written || ["ksplat", GSI_EXTENSION, "safetensors", "ply"].contains(&ending.as_str())
}

fn slashed(path: &Path) -> String {
    let parts: Vec<_> = path.components().map(|part| part.as_os_str().to_string_lossy()).collect();
    parts.join("/")
}

fn modified(path: &Path) -> u64 {
    let time = fs::metadata(path).and_then(|file| file.modified()).ok();
    let since = time.and_then(|time| time.duration_since(UNIX_EPOCH).ok()).unwrap_or(Duration::ZERO);
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use std::{fs::File, time::SystemTime};

    use super::*;

    #[test]
    fn scenes_and_runs_are_found_by_their_names() {
        let place = tempfile::tempdir().unwrap();
        let write = |name: &str| {
            let path = place.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        };
        [
            "b.ply",
            "a/c.sog",
            "city/lod-meta.json",
            "city/0_0/meta.json",
            "a/notes.txt",
            "run/metrics.csv",
            "run/scene.ply",
            ".git/x.ply",
        ]
        .into_iter()
        .for_each(write);
        let list = of(place.path());
        let names: Vec<&str> = list
            .iter()
            .map(|entry| match entry {
                Entry::Scene { path, .. } | Entry::Run { path, .. } => path.as_str(),
            })
            .collect();
        assert_eq!(names, ["run", "a/c.sog", "b.ply", "city/lod-meta.json", "run/scene.ply"]);
        let Entry::Run { table, scene, .. } = &list[0] else { panic!("a run is first") };
        assert_eq!((table.as_str(), scene.as_deref()), ("run/metrics.csv", Some("run/scene.ply")));
    }

    #[test]
    fn a_run_that_goes_on_shows_its_rows_and_its_newest_scene() {
        let place = tempfile::tempdir().unwrap();
        let path = |name: &str| place.path().join(name);
        let run = || match of(place.path()).remove(0) {
            Entry::Run { table, scene, .. } => (table, scene),
            scene @ Entry::Scene { .. } => panic!("{scene:?}"),
        };
        fs::write(path("metrics.part.csv"), "").unwrap();
        assert_eq!(run(), ("metrics.part.csv".to_owned(), None));
        fs::write(path("metrics.csv"), "").unwrap();
        fs::write(path("scene.ply"), "").unwrap();
        let earlier = SystemTime::now() - Duration::from_secs(60);
        File::options().append(true).open(path("scene.ply")).unwrap().set_modified(earlier).unwrap();
        fs::write(path("checkpoint.safetensors"), "").unwrap();
        assert_eq!(run(), ("metrics.part.csv".to_owned(), Some("checkpoint.safetensors".to_owned())));
        fs::remove_file(path("metrics.part.csv")).unwrap();
        fs::write(path("scene.ply"), "").unwrap();
        assert_eq!(run(), ("metrics.csv".to_owned(), Some("scene.ply".to_owned())));
    }
}
