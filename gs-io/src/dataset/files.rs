//! The files of a data set.

use std::path::{Path, PathBuf};

use super::{Dataset, View, colmap::models_of, opensfm};

impl Dataset {
    /// All files of the data set, which a program that reads it must not replace: images, masks,
    /// depth maps, and everything else in its folder and in those of its poses and points, such as COLMAP's `sparse`.
    pub fn files(&self) -> Vec<PathBuf> {
        let depth = |view: &View| view.depth.as_ref().map(|depth| depth.path.clone());
        let files = |view: &View| [Some(view.image.clone()), view.mask.clone(), depth(view)];
        let of_views = self.views.iter().flat_map(files).flatten();
        let root = if self.root.as_os_str().is_empty() { Path::new(".") } else { &self.root };
        let (models, inner) = (models_of(root), root.join(opensfm::FOLDER));
        let above = models.iter().filter_map(|model| model.parent());
        let folders: Vec<&Path> =
            [root, &inner].into_iter().chain(above).chain(models.iter().map(|model| &**model)).collect();
        let entries = folders.into_iter().flat_map(|folder| std::fs::read_dir(folder).into_iter().flatten().flatten());
        of_views.chain(entries.map(|entry| entry.path()).filter(|path| path.is_file())).collect()
    }
}
