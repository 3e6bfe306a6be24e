//! `gs info` on data sets of posed photographs, and on folders that are none.

use std::fs;

use crate::process::{folder, gs, picture};

#[test]
fn a_data_set_tells_what_is_in_it() {
    let place = folder();
    picture(place.path(), 40, 30);
    let json = r#"{"camera_angle_x": 1.0, "k1": -0.1, "frames": [
        {"file_path": "picture-40x30.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]},
        {"file_path": "gone.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}"#;
    let file = place.path().join("transforms.json");
    fs::write(&file, json).unwrap();
    for path in [place.path().to_str().unwrap(), file.to_str().unwrap()] {
        let info = gs(["info", path, "--json"]).json();
        assert_eq!((&info["kind"], &info["made_by"]), (&"dataset".into(), &"nerfstudio".into()));
        assert_eq!((&info["views"], &info["train"], &info["points"]), (&1.into(), &1.into(), &0.into()));
        let camera = &info["cameras"][0];
        assert_eq!((&camera["photograph"][0], &camera["lens"]), (&40.into(), &"Brown-Conrady".into()));
        assert!(camera["undistorted"][0].as_u64().unwrap() > 40, "{info}");
        let degrees = camera["field_of_view"][0].as_f64().unwrap();
        assert!((57.0..65.0).contains(&degrees), "{info}");
        let text = gs(["info", path]).done().stdout;
        assert!(text.contains("Nerfstudio data set") && text.contains("40x30 px"), "{text}");
        assert!(text.contains("1 skipped: no image file (first: gone.png)") && text.contains("no points"), "{text}");
    }
}

#[test]
fn a_folder_that_is_no_data_set_is_refused() {
    let place = folder();
    let run = gs(["info", place.path().to_str().unwrap()]);
    assert_eq!(run.status, Some(1), "{run:?}");
    assert!(run.refusal().contains("transforms.json") && run.refusal().contains("sparse/0"), "{run:?}");
    fs::write(place.path().join("transforms.json"), "{").unwrap();
    assert!(gs(["info", place.path().to_str().unwrap()]).refusal().contains("transforms.json: EOF"));
}
