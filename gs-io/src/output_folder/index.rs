//! The index of a folder: a file that lists the files that runs of gs wrote there.

use std::{
    collections::BTreeSet,
    fs,
    path::{Component, Path},
};

use serde::{Deserialize, Serialize};

use crate::{
    atomic::{write_atomically, write_durably},
    error::Error,
};

/// The name of the index file.
pub(super) const NAME: &str = ".gs-files.json";

const ABOUT: &str = "Files in this folder that runs of gs wrote. A later run replaces these, and no others.";

/// The paths, relative to the folder, of files that runs of gs wrote.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Index(pub(super) BTreeSet<String>);

#[derive(Serialize, Deserialize)]
struct Content {
    #[serde(default)]
    about: String,
    files: BTreeSet<String>,
}

impl Index {
    /// The index of a folder, without files that no longer exist. An unreadable index counts as
    /// empty, so that no file in the folder is replaced.
    pub(super) fn of(folder: &Path) -> Self {
        let text = fs::read(folder.join(NAME)).unwrap_or_default();
        let mut files = serde_json::from_slice(&text).map(|Content { files, .. }| files).unwrap_or_default();
        files.retain(|name| stays_inside(name) && fs::symlink_metadata(folder.join(name)).is_ok());
        Self(files)
    }

    /// Writes the index durably, before the files in it are written.
    pub(super) fn store(&self, folder: &Path) -> Result<(), Error> {
        let text = self.text();
        write_durably(folder.join(NAME), |file| file.write_all(text.as_bytes()))
    }

    /// Writes the index without waiting for the disk. If the index is lost, a later run does not
    /// replace the files that it would list.
    pub(super) fn update(&self, folder: &Path) {
        let text = self.text();
        let _ = write_atomically(folder.join(NAME), |file| file.write_all(text.as_bytes()));
    }

    /// Removes files from the index that do not exist. This need not be durable, because no file is
    /// added.
    pub(super) fn tidy(&self, folder: &Path) {
        let there =
            Self(self.0.iter().filter(|name| fs::symlink_metadata(folder.join(name)).is_ok()).cloned().collect());
        if there != *self {
            // The next run repeats this if it is lost.
            there.update(folder);
        }
    }

    fn text(&self) -> String {
        let content = Content { about: ABOUT.to_owned(), files: self.0.clone() };
        serde_json::to_string_pretty(&content).unwrap_or_default() + "\n"
    }
}

/// Whether a name in an index names a file in the folder.
fn stays_inside(name: &str) -> bool {
    !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_index_names_files_of_its_folder_that_are_there() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        fs::create_dir_all(folder.join("views")).unwrap();
        for file in ["mine.txt", "out/a.png", "out/views/b.png"] {
            fs::write(place.path().join(file), "").unwrap();
        }
        let outside = place.path().join("mine.txt").to_str().unwrap().to_owned();
        let names = ["a.png", "views/b.png", "gone.png", "../mine.txt", &outside, ""].map(str::to_owned);
        Index(names.into()).store(&folder).unwrap();
        assert_eq!(Index::of(&folder).0, ["a.png", "views/b.png"].map(str::to_owned).into());
        fs::write(folder.join(NAME), "{ \"files\": [\"a.png\"").unwrap();
        assert_eq!(Index::of(&folder), Index::default(), "damaged");
    }
}
