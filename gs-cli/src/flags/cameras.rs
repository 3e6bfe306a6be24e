//! The camera that a flag names, and the default one.

use std::path::Path;

use glam::Vec3;
use gs_core::{Camera, Scene3d, view::Bulk};
use gs_io::{
    File3d,
    dataset::{Dataset, View},
};
use gs_train::train::{Focus, extent_of};

use super::{
    dataset::ReadingArgs,
    values::{Size, ViewName},
};
use crate::failure::Failure;

/// The default camera for a 3D scene.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Home {
    pub(crate) camera: Camera,
    /// What the camera looks at, world units.
    pub(crate) target: Vec3,
    /// The up direction of the picture.
    pub(crate) up: Vec3,
}

impl Home {
    /// Sees most of a scene from slightly above.
    pub(crate) fn of(scene: &Scene3d, size: Option<Size>, up: Option<Vec3>) -> Result<Self, Failure> {
        let unseen = || Failure::failed("the scene has no Gaussian that could be seen");
        let (bulk, up) = (Bulk::of(scene).ok_or_else(unseen)?, up.unwrap_or(UP));
        let Size { width, height } = size.unwrap_or(SIZE);
        let camera = bulk.overview(width, height, Bulk::FIELD_OF_VIEW, up).ok_or_else(|| {
            Failure::failed("the scene is too large to be seen from outside; gs info shows its extent")
        })?;
        Ok(Self { camera, target: bulk.center, up })
    }

    /// The camera of the view that `--camera` names, with its data set, or else [`Self::of`] the scene.
    pub(crate) fn named(
        name: Option<&ViewName>,
        reading: &ReadingArgs,
        file: &File3d,
        size: Option<Size>,
        up: Option<Vec3>,
    ) -> Result<(Self, Option<Dataset>), Failure> {
        let Some(name) = name else {
            let home = Self::of(&file.scene, size, up);
            return Ok((home.map_err(|failure| failure.hint("name a camera with --camera DATASET:VIEW"))?, None));
        };
        let dataset = reading.read_for(file, &name.dataset)?;
        let camera = of_view(&dataset, name)?;
        let camera = size.map_or(camera, |Size { width, height }| camera.resized(width, height));
        let up = up.unwrap_or_else(|| up_of(&dataset));
        Ok((Self { camera, target: looked_at(&dataset, &camera), up }, Some(dataset)))
    }
}

/// Default size of the picture.
const SIZE: Size = Size { width: 800, height: 600 };

/// The default up direction: y points down in most scenes.
const UP: Vec3 = Vec3::NEG_Y;

/// The camera of the view with this name.
fn of_view(dataset: &Dataset, name: &ViewName) -> Result<Camera, Failure> {
    let stem = |text: &str| Path::new(text).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let exact = dataset.views.iter().find(|view| view.name == name.view);
    // The name of the file alone is enough if only one view has it.
    let alike: Vec<&View> = dataset.views.iter().filter(|view| stem(&view.name) == stem(&name.view)).collect();
    let refused = |what: &str, hint: &str, views: &[&View]| {
        let names: Vec<&str> = views.iter().take(5).map(|view| view.name.as_str()).collect();
        let more = if views.len() > 5 { ", ..." } else { "" };
        let failure = Failure::usage(format_args!("{}: has {what} `{}`", name.dataset.display(), name.view));
        Err(failure.hint(format_args!("{hint} {}{more}", names.join(", "))))
    };
    match (exact, alike.as_slice()) {
        (Some(view), _) | (None, &[view]) => Ok(view.camera),
        (None, []) => refused("no view", "its views are", &dataset.views.iter().collect::<Vec<_>>()),
        (None, several) => refused("several views", "give the whole name, one of", several),
    }
}

/// The point that the cameras of a data set look at. If they have none in common, a point ahead of
/// this camera.
fn looked_at(dataset: &Dataset, camera: &Camera) -> Vec3 {
    let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
    Focus::of(&cameras)
        .map_or_else(|| camera.position() + camera.rotation.row(2) * extent_of(&cameras, &[]), |focus| focus.point)
}

/// The mean up direction of a data set's cameras, of any length.
fn up_of(dataset: &Dataset) -> Vec3 {
    dataset.views.iter().map(|view| -view.camera.rotation.row(1)).sum()
}

/// Selects at most `most` of the cameras, evenly spread.
pub(crate) fn sampled(cameras: &[Camera], most: usize) -> Vec<Camera> {
    let count = cameras.len().min(most);
    (0..count).map(|number| cameras[number * cameras.len() / count]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_spread_evenly() {
        let camera = |width| Camera::looking_forward(width, 8, 1.0);
        let widths = |most| sampled(&(1..=10).map(camera).collect::<Vec<_>>(), most).iter().map(|c| c.width).collect();
        let [few, all, none]: [Vec<u32>; 3] = [widths(4), widths(99), widths(0)];
        assert_eq!((few, all.len(), none), (vec![1, 3, 6, 8], 10, vec![]));
    }
}
