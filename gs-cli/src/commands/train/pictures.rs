//! The pictures of views in `DIR/views`. Their names are chosen so that they replace no other file,
//! in particular no image of a data set.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
};

use gs_core::{Image, constants::MAX_SIDE_PX};
use gs_io::{
    dataset::{Dataset, View},
    write_png,
};

use crate::{failure::Failure, files::output_folder::OutputFolder};

/// The folder among the results.
const FOLDER: &str = "views";

/// Columns between an image and its rendering, px.
const GAP_PX: u32 = 4;

/// Endings of names of images, which are removed from those of views.
const ENDINGS: [&str; 11] =
    [".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", ".webp", ".tiff", ".tif", ".bmp", ".gif"];

/// Refuses an output folder whose results could replace files of the data set: the data set's own
/// folder, and those with its images.
pub(super) fn keep_off(dataset: &Dataset, output: &Path) -> Result<(), Failure> {
    // A folder that does not exist holds nothing.
    let Ok(folder) = fs::canonicalize(output) else { return Ok(()) };
    let refused = |what: &Path| {
        let why = format_args!("results could replace files of the data set ({})", what.display());
        let other = output.join("results");
        Err(Failure::usage(why)
            .at(output.display())
            .hint(format_args!("choose another folder with --output, such as {}", other.display())))
    };
    let root = if dataset.root.as_os_str().is_empty() { Path::new(".") } else { &dataset.root };
    if fs::canonicalize(root).is_ok_and(|root| root == folder) {
        return refused(root);
    }
    let views = fs::canonicalize(folder.join(FOLDER)).unwrap_or_else(|_| folder.join(FOLDER));
    if views.is_file() {
        let failure = Failure::failed("is a file where a folder for pictures of the views must be").at(views.display());
        return Err(failure.hint("choose another folder with --output"));
    }
    let is_there = |file: &&PathBuf| {
        fs::canonicalize(file).is_ok_and(|file| file.starts_with(&views) || file.parent() == Some(&folder))
    };
    let depth = |view: &View| view.depth.as_ref().map(|depth| depth.path.clone());
    let files = |view: &'_ View| [Some(view.image.clone()), view.mask.clone(), depth(view)].into_iter().flatten();
    let files: BTreeSet<PathBuf> = dataset.views.iter().flat_map(files).collect();
    files.iter().find(is_there).map_or(Ok(()), |file| refused(file))
}

/// The folder of pictures, without those of an earlier training.
#[derive(Debug)]
pub(super) struct ViewPictures<'o> {
    output: &'o OutputFolder,
}

impl<'o> ViewPictures<'o> {
    /// Removes the pictures of an earlier training, and the folder if it is empty then.
    pub(super) fn clear(output: &OutputFolder) -> Result<(), Failure> {
        output.leave_out(output.claimed(&format!("{FOLDER}/")))?;
        // Fails if there are other files, which is intended.
        let _ = fs::remove_dir(output.path().join(FOLDER));
        Ok(())
    }

    /// Prepares for pictures of these views. Their names are new in the folder.
    pub(super) fn prepare<'v>(
        output: &'o OutputFolder,
        views: impl IntoIterator<Item = &'v str>,
    ) -> Result<(Self, Vec<String>), Failure> {
        Self::clear(output)?;
        let folder = output.make(FOLDER)?;
        let failed = |error: io::Error| Failure::failed(error).at(folder.display());
        let there = fs::read_dir(&folder).map_err(failed)?.flatten();
        let mut taken = there.map(|entry| entry.file_name().to_string_lossy().to_lowercase()).collect();
        let names: Vec<String> =
            views.into_iter().map(|view| format!("{FOLDER}/{}", free_name(view, &mut taken))).collect();
        output.claim(&names)?;
        Ok((Self { output }, names))
    }

    /// Writes an image with its rendering to the right, both clamped.
    pub(super) fn write(&self, name: &str, image: Image, rendered: &Image) -> Result<(), gs_train::Error> {
        Ok(write_png(self.output.file(name), &beside(image, rendered)?)?)
    }
}

/// A name for a view's picture that no file has in any letter case.
fn free_name(view: &str, taken: &mut BTreeSet<String>) -> String {
    let bare = bare_name(view);
    let numbered = (2u64..).map(|number| format!("{bare}-{number}.png"));
    let name = std::iter::once(format!("{bare}.png")).chain(numbered).find(|name| taken.insert(name.to_lowercase()));
    name.expect("there are more numbers than files")
}

/// The name of a view as the name of a file, without the image's ending. Names of views may contain
/// folders.
fn bare_name(view: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let bare = ENDINGS.iter().find_map(|ending| view.strip_suffix(ending)).unwrap_or(view);
    let name: String = bare.chars().map(plain).collect();
    name.trim_matches('.').to_owned()
}

fn beside(image: Image, rendered: &Image) -> Result<Image, gs_core::Error> {
    let (width, height) = image.size();
    let total = 2 * width + GAP_PX;
    if total > MAX_SIDE_PX {
        return Ok(rendered.clamped());
    }
    let mut pixels = Vec::with_capacity(total as usize * height as usize);
    for y in 0..height {
        pixels.extend_from_slice(image.row(y));
        pixels.extend([[1.0; 3]; GAP_PX as usize]);
        pixels.extend_from_slice(rendered.row(y));
    }
    Ok(Image::from_pixels(total, height, pixels)?.clamped())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::output_folder::tests::begun;

    #[test]
    fn names_of_views_stay_in_their_folder() {
        assert_eq!(bare_name("test/r_0"), "test_r_0");
        assert_eq!(bare_name("../../etc/passwd"), "_.._etc_passwd");
        assert_eq!(bare_name("IMG 1.jpg"), "IMG_1");
    }

    #[test]
    fn pictures_have_names_of_their_own() {
        let place = tempfile::tempdir().unwrap();
        let output = begun(place.path(), &[]);
        let views = place.path().join(FOLDER);
        fs::create_dir(&views).unwrap();
        fs::write(views.join("B.png"), b"mine").unwrap();
        let (pictures, names) = ViewPictures::prepare(&output, ["a.png", "a.jpg", "x/y", "x_y", "b.jpg"]).unwrap();
        assert_eq!(names, ["a.png", "a-2.png", "x_y.png", "x_y-2.png", "b-2.png"].map(|name| format!("views/{name}")));
        let image = Image::filled(2, 2, [0.5; 3]).unwrap();
        names.iter().for_each(|name| pictures.write(name, image.clone(), &image).unwrap());
        ViewPictures::clear(&output).unwrap();
        assert_eq!(fs::read_dir(&views).unwrap().count(), 1);
        assert_eq!(fs::read(views.join("B.png")).unwrap(), b"mine");
    }

    #[test]
    fn image_and_rendering_are_side_by_side() {
        let image = Image::filled(3, 2, [0.5; 3]).unwrap();
        let rendered = Image::filled(3, 2, [2.0, 0.0, -1.0]).unwrap();
        let both = beside(image, &rendered).unwrap();
        assert_eq!(both.size(), (10, 2));
        assert_eq!([both.pixel(2, 1), both.pixel(4, 0), both.pixel(9, 1)], [[0.5; 3], [1.0; 3], [1.0, 0.0, 0.0]]);
    }
}
