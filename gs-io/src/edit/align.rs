//! Aligning a scene by cameras of images that two data sets have.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

use glam::{DMat3, DVec3};
use gs_core::{Camera, math::similarity::Similarity, metrics::median};

use super::EditError;
use crate::{
    dataset::{Dataset, DatasetSettings, read_dataset},
    world_frame::WorldFrame,
};

/// Cameras further from their places than this multiple of the median do not count.
const OUTLIER: f64 = 3.0;

/// The largest median distance of the cameras from their places, as a share of their spread.
const MOST_APART: f64 = 0.05;

/// How a scene fits onto another one by cameras of the same images.
#[derive(Debug)]
pub(super) struct Aligned {
    pub(super) map: Similarity,
    /// The frame of the other scene.
    pub(super) frame: WorldFrame,
    /// Number of images that both data sets have.
    pub(super) shared: usize,
    /// Median distance of the cameras from their places, as a share of their spread.
    pub(super) apart: f64,
}

/// Aligns the data set of a scene in this frame with another one.
pub(super) fn aligned([from, to]: &[PathBuf; 2], frame: WorldFrame) -> Result<Aligned, EditError> {
    let settings = DatasetSettings::default();
    let to = read_dataset(to, &settings)?;
    let from = read_dataset(from, &settings.with(|s| s.frame = Some(frame)))?;
    let places = cameras(&to);
    let shared: Vec<(Camera, Camera)> =
        cameras(&from).into_iter().filter_map(|(image, camera)| Some((camera, *places.get(&image)?))).collect();
    let shared_count = shared.len();
    let spread = spread(&shared);
    if shared_count < 2 || spread == 0.0 {
        return Err(EditError::FewCameras { shared: shared_count });
    }
    let fit = |pairs: &[(Camera, Camera)]| similarity(pairs, spread).ok_or(EditError::OtherCameras);
    let first = fit(&shared)?;
    let most = OUTLIER * median_apart(&first, &shared) + 1e-6 * spread;
    let good: Vec<_> = shared.iter().copied().filter(|pair| apart(&first, pair) <= most).collect();
    let map = fit(&good)?;
    let apart = median_apart(&map, &shared) / spread;
    match apart <= MOST_APART {
        true => Ok(Aligned { map, frame: to.frame, shared: shared_count, apart }),
        false => Err(EditError::OtherCameras),
    }
}

/// The cameras by the names of their images, without folders and endings. Names that come twice are left out.
fn cameras(dataset: &Dataset) -> HashMap<String, Camera> {
    let mut cameras: HashMap<String, Option<Camera>> = HashMap::new();
    for view in &dataset.views {
        let name = Path::new(&view.name).with_extension("");
        let name = name.file_name().unwrap_or_default().to_string_lossy().into_owned();
        cameras.entry(name).and_modify(|camera| *camera = None).or_insert(Some(view.camera));
    }
    cameras.into_iter().filter_map(|(name, camera)| Some((name, camera?))).collect()
}

fn position(camera: &Camera) -> DVec3 {
    -(camera.rotation.as_dmat3().transpose() * camera.translation.as_dvec3())
}

/// Root mean square distance of the places from their mean.
fn spread(pairs: &[(Camera, Camera)]) -> f64 {
    let count = pairs.len().max(1) as f64;
    let mean = pairs.iter().map(|(_, to)| position(to)).sum::<DVec3>() / count;
    (pairs.iter().map(|(_, to)| position(to).distance_squared(mean)).sum::<f64>() / count).sqrt()
}

/// The similarity that takes the cameras to their places. Their directions count as much as their positions.
fn similarity(pairs: &[(Camera, Camera)], spread: f64) -> Option<Similarity> {
    let turn = |(from, to): &(Camera, Camera)| to.rotation.as_dmat3().transpose() * from.rotation.as_dmat3();
    let turns = pairs.iter().map(turn).fold(DMat3::ZERO, |sum, turn| sum + turn) * (spread * spread / 3.0);
    let positions: Vec<_> = pairs.iter().map(|(from, to)| (position(from), position(to), 1.0)).collect();
    Similarity::between(&positions, turns).filter(|map| map.scale > 0.0)
}

fn apart(map: &Similarity, (from, to): &(Camera, Camera)) -> f64 {
    map.apply(position(from)).distance(position(to))
}

fn median_apart(map: &Similarity, pairs: &[(Camera, Camera)]) -> f64 {
    median(pairs.iter().map(|pair| apart(map, pair)).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use glam::{DQuat, Mat3, Vec3};
    use gs_core::{Gaussian3d, Image, Scene3d};
    use serde_json::json;

    use super::*;
    use crate::{edit::Edit, write_png};

    /// The world of the second data set, in that of the first.
    fn world() -> Similarity {
        let rotation = DQuat::from_axis_angle(DVec3::new(2.0, -1.0, 2.0) / 3.0, 1.1);
        Similarity { rotation, scale: 2.5, from: DVec3::new(0.5, 0.0, -0.3), to: DVec3::new(7.0, -4.0, 1.0) }
    }

    /// A data set of these images, by number, in the world after a map; `bend` moves each camera.
    fn written(folder: &Path, images: &[usize], map: Option<Similarity>, bend: f32, ending: &str) -> PathBuf {
        fs::create_dir_all(folder).unwrap();
        let lens = Camera::looking_forward(8, 6, 1.0);
        let frame = |&i: &usize| {
            let t = i as f32;
            let position = 3.0 * Vec3::new(t.cos(), t.sin(), 0.4 * (2.0 * t).sin()) + bend * (t * t).sin() * Vec3::X;
            let camera = lens.looking_at(position, Vec3::ZERO, Vec3::Z).unwrap();
            let (mut turn, mut place) = (camera.rotation.transpose().as_dmat3(), position.as_dvec3());
            if let Some(map) = map {
                (turn, place) = (DMat3::from_quat(map.rotation) * turn, map.apply(place));
            }
            let turn = turn * Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0)).as_dmat3();
            let name = format!("image-{i}.{ending}");
            write_png(folder.join(&name), &Image::filled(8, 6, [0.5; 3]).unwrap()).unwrap();
            let row = |k: usize| [turn.row(k).x, turn.row(k).y, turn.row(k).z, place[k]];
            json!({ "file_path": name, "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]] })
        };
        let frames: Vec<_> = images.iter().map(frame).collect();
        let text = json!({ "fl_x": 8.0, "fl_y": 8.0, "cx": 4.0, "cy": 3.0, "w": 8, "h": 6, "frames": frames });
        fs::write(folder.join("transforms.json"), text.to_string()).unwrap();
        folder.to_owned()
    }

    #[test]
    fn a_scene_comes_to_where_another_data_set_has_the_same_cameras() {
        let place = tempfile::tempdir().unwrap();
        let here = written(&place.path().join("here"), &[0, 1, 2, 3, 4, 5], None, 0.0, "png");
        let there = written(&place.path().join("there"), &[3, 4, 5, 6, 7], Some(world()), 0.0, "PNG");
        let gaussian = Gaussian3d {
            mean: Vec3::new(0.2, -0.4, 0.7),
            log_scale: Vec3::splat(-2.0),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 1.0,
            sh: vec![Vec3::ONE],
        };
        let mut scene: Scene3d = [gaussian.clone()].into_iter().collect();
        let mut frame = WorldFrame::WORLD;
        let edit: Edit = format!("align={},{}", here.display(), there.display()).parse().unwrap();
        let done = edit.apply(&mut scene, &mut frame).unwrap().to_string();
        assert!(done.starts_with("aligned by 3 cameras"), "{done}");
        let expected = world().apply(gaussian.mean.as_dvec3()).as_vec3();
        assert!(scene.means[0].distance(expected) < 1e-4, "{} {expected}", scene.means[0]);
        assert!((scene.log_scales[0].x - (-2.0 + 2.5_f32.ln())).abs() < 1e-4);
        assert_eq!(frame, read_dataset(&there, &DatasetSettings::default()).unwrap().frame);
    }

    #[test]
    fn cameras_that_are_too_few_or_arranged_otherwise_are_refused() {
        let place = tempfile::tempdir().unwrap();
        let folder = |name: &str| place.path().join(name);
        let here = written(&folder("here"), &[0, 1, 2, 3, 4, 5], None, 0.0, "png");
        let one = written(&folder("one"), &[5, 6, 7], Some(world()), 0.0, "png");
        let bent = written(&folder("bent"), &[0, 1, 2, 3, 4, 5], Some(world()), 2.0, "png");
        let align = |to: PathBuf| aligned(&[here.clone(), to], WorldFrame::WORLD).unwrap_err();
        assert!(matches!(align(one), EditError::FewCameras { shared: 1 }));
        assert!(matches!(align(bent), EditError::OtherCameras));
        assert!(matches!(align(folder("none")), EditError::Read(_)));
    }
}
