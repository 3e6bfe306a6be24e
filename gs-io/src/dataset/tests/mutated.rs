//! Reading mutated files ends in a data set or in an error of one line.

use std::fs;

use crate::dataset::{ColmapModel, DatasetSettings, read_dataset};
use gs_conformance::properties::fresh;
use proptest::prelude::*;

use super::{
    llff,
    made::{binary, colmap, folder, model, picture, text},
    metashape, opensfm, realityscan,
};

/// Changes of a file's bytes: a relative position, and a byte to overwrite, drop or insert.
fn any_changes() -> impl Strategy<Value = Vec<(f64, u8, u8)>> {
    prop::collection::vec(
        (0.0..1.0_f64, 0..4_u8, prop_oneof![any::<u8>(), Just(0xff), Just(0), Just(b' '), Just(b'9')]),
        1..6,
    )
}

fn changed(bytes: &[u8], changes: &[(f64, u8, u8)]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for &(place, kind, value) in changes {
        let at = (place * bytes.len() as f64) as usize;
        match kind {
            _ if at >= bytes.len() => {}
            0 => bytes[at] = value,
            1 => drop(bytes.remove(at)),
            2 => bytes.insert(at, value),
            _ => bytes.truncate(at),
        }
    }
    bytes
}

proptest! {
    #![proptest_config(fresh(400))]

    #[test]
    fn mutated_binary_models(which in 0..3_usize, changes in any_changes()) {
        let mut files = binary(&model(3));
        files[which] = changed(&files[which], &changes);
        let read = ColmapModel::from_binary("a".as_ref(), &files[0], &files[1], Some(&files[2]));
        prop_assert!(read.err().is_none_or(|error| !error.to_string().contains('\n')));
    }

    #[test]
    fn mutated_text_models(which in 0..3_usize, changes in any_changes()) {
        let mut files = text(&model(3));
        files[which] = changed(&files[which], &changes);
        let read = ColmapModel::from_text("a".as_ref(), &files[0], &files[1], Some(&files[2]));
        prop_assert!(read.err().is_none_or(|error| !error.to_string().contains('\n')));
    }
}

proptest! {
    #![proptest_config(fresh(60))]

    /// Reads a data set with its images.
    #[test]
    fn mutated_data_sets(which in 0..3_usize, changes in any_changes()) {
        let place = folder();
        let files = binary(&colmap(place.path(), 3));
        let name = ["cameras.bin", "images.bin", "points3D.bin"][which];
        fs::write(place.path().join("sparse/0").join(name), changed(&files[which], &changes)).unwrap();
        match read_dataset(place.path(), &DatasetSettings::default()) {
            Ok(dataset) => {
                prop_assert!(!dataset.views.is_empty() && dataset.views.len() <= 3);
                for view in dataset.views {
                    view.camera.validate().unwrap();
                    let posed = view.read_image().unwrap();
                    prop_assert_eq!(posed.image.size(), (view.camera.width, view.camera.height));
                }
                prop_assert!(dataset.points.iter().all(|point| point.position.is_finite()));
            }
            Err(error) => prop_assert!(!error.to_string().contains('\n')),
        }
    }

    #[test]
    fn mutated_transforms(changes in any_changes()) {
        let place = folder();
        picture(place.path().join("a.png"), 20, 10);
        let json = r#"{"fl_x": 30, "w": 20, "h": 10, "k1": 0.01, "p1": -0.002, "camera_model": "OPENCV", "frames": [{"file_path": "./a.png",
            "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}"#;
        fs::write(place.path().join("transforms.json"), changed(json.as_bytes(), &changes)).unwrap();
        match read_dataset(place.path(), &DatasetSettings::default()) {
            Ok(dataset) => {
                let view = &dataset.views[0];
                prop_assert_eq!(view.read_image().unwrap().image.size(), (view.camera.width, view.camera.height));
            }
            Err(error) => prop_assert!(!error.to_string().contains('\n')),
        }
    }

    #[test]
    fn mutated_poses_of_other_programs(program in 0..4_usize, which in 0..4_usize, changes in any_changes()) {
        let place = folder();
        picture(place.path().join("a.png"), 20, 10);
        let seeds = [llff::seeds(), opensfm::seeds(), metashape::seeds(), realityscan::seeds()];
        let name = ["poses_bounds.npy", "reconstruction.json", "cameras.xml", "cameras.csv"][program];
        fs::write(place.path().join(name), changed(&seeds[program][which], &changes)).unwrap();
        match read_dataset(place.path().join(name), &DatasetSettings::default()) {
            Ok(dataset) => {
                for view in dataset.views {
                    view.camera.validate().unwrap();
                    prop_assert_eq!(view.read_image().unwrap().image.size(), (view.camera.width, view.camera.height));
                }
                prop_assert!(dataset.points.iter().all(|point| point.position.is_finite()));
            }
            Err(error) => prop_assert!(!error.to_string().contains('\n')),
        }
    }
}
