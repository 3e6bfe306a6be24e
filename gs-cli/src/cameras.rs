//! The cameras that flags name, or that a scene is shown with where none is named.

use std::path::Path;

use glam::Vec3;
use gs_core::{Camera, Scene3d, view::Bulk};
use gs_io::{File3d, dataset::Dataset};
use gs_train::train::{Flat, Focus, extent_of};

use crate::{
    failure::Failure,
    values::{Size, ViewName},
};

/// What a 3D scene is seen with where nothing says from where.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Home {
    pub(crate) camera: Camera,
    /// What the camera looks at, world units.
    pub(crate) target: Vec3,
    /// What is up in the picture.
    pub(crate) up: Vec3,
}

impl Home {
    /// The front of a flat scene, filling the picture; any other scene from a little above. Where it is said what is up, a flat scene
    /// is seen as any other.
    ///
    /// # Errors
    /// Where nothing could be seen, or the scene is larger than numbers are.
    pub(crate) fn of(file: &File3d, size: Option<Size>, up: Option<Vec3>) -> Result<Self, Failure> {
        if let Some(flat) = Flat::of(&file.scene, file.picture).filter(|_| up.is_none()) {
            let size = size.map_or_else(|| flat.size(), |Size { width, height }| (width, height));
            return Ok(Self { camera: flat.camera(size), target: flat.center(), up: flat.up() });
        }
        let (bulk, up) = (bulk_of(&file.scene)?, up.unwrap_or(UP));
        Ok(Self { camera: overview(&bulk, size, up).map_err(or_name_one)?, target: bulk.center, up })
    }
}

/// Size of the picture where nothing says another.
const SIZE: Size = Size { width: 800, height: 600 };

/// Field of view across where no data set says another, rad.
const FIELD_OF_VIEW: f32 = 0.9;

/// What is up where neither a flag nor a data set says another: y points down in most scenes.
pub(crate) const UP: Vec3 = Vec3::NEG_Y;

/// Where the bulk of a scene is.
///
/// # Errors
/// Where nothing of it could be seen.
pub(crate) fn bulk_of(scene: &Scene3d) -> Result<Bulk, Failure> {
    Bulk::of(scene).ok_or_else(|| Failure::failed("the scene has no Gaussian that could be seen"))
}

/// A camera from a little above that has the whole bulk in view.
///
/// # Errors
/// Where the bulk is larger than numbers are.
pub(crate) fn overview(bulk: &Bulk, size: Option<Size>, up: Vec3) -> Result<Camera, Failure> {
    let Size { width, height } = size.unwrap_or(SIZE);
    bulk.overview(width, height, FIELD_OF_VIEW, up).ok_or_else(|| {
        Failure::failed("the scene's extent is beyond what can be looked at from outside; gs info tells of it")
    })
}

/// Commands that show a scene from where they are told have another way than the overview.
pub(crate) fn or_name_one(failure: Failure) -> Failure {
    failure.mend("name a camera with --camera DATASET:VIEW")
}

/// The camera of the view that is called so.
///
/// # Errors
/// Bad usage where there is none, or several.
pub(crate) fn of_view(dataset: &Dataset, name: &ViewName) -> Result<Camera, Failure> {
    let stem = |text: &str| Path::new(text).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let exact = dataset.views.iter().find(|view| view.name == name.view);
    // A view may be called by its file alone, if that says which.
    let mut alike = dataset.views.iter().filter(|view| stem(&view.name) == stem(&name.view));
    match exact.or_else(|| alike.next().filter(|_| alike.next().is_none())) {
        Some(view) => Ok(view.camera),
        None => {
            let names: Vec<&str> = dataset.views.iter().take(5).map(|view| view.name.as_str()).collect();
            let more = if dataset.views.len() > 5 { ", ..." } else { "" };
            let what = format_args!("{}: has no view `{}`, or several", name.dataset.display(), name.view);
            Err(Failure::usage(what).mend(format_args!("its views are {}{more}", names.join(", "))))
        }
    }
}

/// What the cameras of the data set look at; where they look nowhere in common, what is ahead of this one.
pub(crate) fn looked_at(dataset: &Dataset, camera: &Camera) -> Vec3 {
    let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
    Focus::of(&cameras)
        .map_or_else(|| camera.position() + camera.rotation.row(2) * extent_of(&cameras, None), |focus| focus.point)
}

/// What is up for most photographers; any length.
pub(crate) fn up_of(dataset: &Dataset) -> Vec3 {
    dataset.views.iter().map(|view| -view.camera.rotation.row(1)).sum()
}
