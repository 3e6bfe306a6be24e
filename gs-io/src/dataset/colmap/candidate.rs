//! Reads the models of a data set, and chooses one of several.

use std::{
    collections::BTreeSet,
    path::{MAIN_SEPARATOR, Path, PathBuf},
};

use glam::dvec2;

use super::{
    ColmapImage, ColmapModel, data_set_of,
    folders::{INPUT, is_named},
};
use crate::{
    dataset::{
        DatasetSettings, Remark, Skip,
        camera::Pose,
        read::{Draft, Finder, IMAGE_FOLDERS, NamePart, Place, Refusal, Stated, check_inside, search_folders},
    },
    error::Error,
};

/// Where the images of a model may be, in the order of preference.
fn places(root: &Path, model: &Path, settings: &DatasetSettings) -> Result<Vec<Place>, Error> {
    // Where the model was named, the folder of images may be relative to it.
    let is_of_root = settings.image_folder.as_ref().is_none_or(|name| root.join(name).is_dir());
    if let Some(place) = Place::chosen(if is_of_root { root } else { model }, settings, NamePart::Path)? {
        return Ok(vec![place]);
    }
    let distorted = model.ancestors().take(3).any(|folder| is_named(folder, |name| name == "distorted"));
    let mut names: Vec<&str> = IMAGE_FOLDERS.to_vec();
    names.insert(if distorted { 0 } else { names.len() }, INPUT);
    let of_folder = |folder: PathBuf| {
        // COLMAP can work inside the folder of the images itself.
        let own = Place { folder: folder.clone(), part: NamePart::Path, shrunk: 1.0 };
        names.iter().map(|name| Place::new(&folder, name, NamePart::Path)).chain([own]).collect::<Vec<_>>()
    };
    Ok([data_set_of(model), root.to_owned()].into_iter().flat_map(of_folder).collect())
}

/// A model that has been read.
pub(super) struct Candidate {
    pub(super) folder: PathBuf,
    pub(super) model: ColmapModel,
    pub(super) drafts: Vec<Draft>,
    pub(super) places: Vec<Place>,
    /// What was wrong with the model's other files.
    pub(super) damaged: Option<Remark>,
}

impl Candidate {
    fn read(root: &Path, folder: &Path, settings: &DatasetSettings) -> Result<Self, Error> {
        let (model, extension, damaged) = ColmapModel::read_either(folder)?;
        let cameras = format!("cameras.{extension}");
        let mut drafts: Vec<Draft> = model.images.iter().map(|image| draft(&model, root, &cameras, image)).collect();
        Draft::localize(&mut drafts, root, settings);
        let names = drafts.iter().map(|draft| ("the image name", draft.name.as_str()));
        check_inside(root, &folder.join("images").with_extension(extension), names, settings)?;
        Ok(Self { folder: folder.to_owned(), model, drafts, places: places(root, folder, settings)?, damaged })
    }

    /// Number of its images whose files are there.
    fn photographs(&self, root: &Path, settings: &DatasetSettings) -> usize {
        let mut finder = Finder::new(root, &self.places, &self.drafts, &search_folders(root, settings));
        self.drafts.iter().filter(|draft| draft.file.as_ref().is_some_and(|file| finder.find(file).is_some())).count()
    }

    fn is_undistorted(&self) -> bool {
        self.model.cameras.values().all(|camera| camera.model.name().ends_with("PINHOLE"))
    }

    fn names(&self) -> BTreeSet<&str> {
        self.drafts.iter().map(|draft| &*draft.name).collect()
    }
}

/// The draft of a view. `file` is that of the cameras.
fn draft(model: &ColmapModel, root: &Path, file: &str, image: &ColmapImage) -> Draft {
    let intrinsics = model.cameras.get(&image.camera_id).ok_or(Skip::NoCamera).and_then(|camera| {
        let size = dvec2(camera.width as f64, camera.height as f64);
        camera.model.intrinsics(&camera.parameters, size)
    });
    let intrinsics = intrinsics.map_err(Refusal::from);
    let stated = model.cameras.get(&image.camera_id).map(|camera| {
        let numbers = camera.model.parameter_names().iter().copied().zip(camera.parameters.iter().copied());
        Stated { place: format!("camera {} of {file}", image.camera_id), numbers: numbers.collect() }
    });
    let pose = Pose::world_to_camera(image.rotation, image.translation);
    Draft::of_image(root, &image.name, intrinsics, stated.unwrap_or_default(), pose)
}

/// Reads the model with most photographs, then images; of equal ones an undistorted one, or the first.
pub(super) fn read_largest(
    root: &Path,
    folders: &[PathBuf],
    settings: &DatasetSettings,
) -> Result<(Candidate, Option<Remark>), Error> {
    if let [only] = folders {
        return Ok((Candidate::read(root, only, settings)?, None));
    }
    let mut read: Vec<_> = folders.iter().map(|folder| Candidate::read(root, folder, settings)).collect();
    let photographs: Vec<usize> =
        read.iter().map(|read| read.as_ref().map_or(0, |model| model.photographs(root, settings))).collect();
    let rank = |index: &usize| {
        read[*index].as_ref().ok().map(|model| (photographs[*index], model.drafts.len(), model.is_undistorted()))
    };
    // Of equal ones, `max_by_key` takes the last.
    let best = (0..read.len()).rev().max_by_key(rank).unwrap_or(0);
    let named = |index: usize| {
        let (folder, there) = (&folders[index], photographs[index]);
        let images = |count| gs_core::counted(count, "image");
        let size = match &read[index] {
            Ok(model) if there == model.drafts.len() => images(there),
            Ok(model) => format!("{}, {there} of them with a file", images(model.drafts.len())),
            Err(error) => error.to_string().replace(&format!("{}{MAIN_SEPARATOR}", folder.display()), ""),
        };
        format!("{} ({size})", folder.strip_prefix(root).unwrap_or(folder).display())
    };
    // A later model of the same images is a copy or the one that this was made of.
    let is_same = |index: usize| match (&read[index], &read[best]) {
        (Ok(other), Ok(model)) => index > best && other.names() == model.names(),
        _ => false,
    };
    let others: Vec<String> = (0..read.len()).filter(|&index| index != best && !is_same(index)).map(named).collect();
    let remark = (!others.is_empty()).then(|| Remark::OtherModels { read: named(best), others });
    Ok((read.swap_remove(best)?, remark))
}
