//! 3D Tiles: a tree of `.glb`, whose boxes contain each other and whose errors fall, with a place on the globe.

use std::{collections::BTreeMap, fs, path::Path};

use glam::{DMat4, DVec3, DVec4, Vec3, Vec3Swizzles as _};
use gs_core::{Scene, Scene3d};
use gs_io::{
    ConversionLoss, Error, Format3d, TrainedWith, WorldFrame, WriteOptions3d, read_3d, write_3d,
    write_levels_of_parts_3d,
};
use serde_json::{Value, json};

use super::streamed::{city, json_of};

/// Places in UTM, 100.5 m above the ellipsoid, and in ECEF, by pyproj 3.7.2 with PROJ 9.5.1: in the north, in the south,
/// and beyond the border of a zone.
const UTM: [(u16, [f64; 2], [f64; 3]); 3] = [
    (32632, [691_608.25, 5_334_760.5], [4_177_699.096_77, 855_701.606_32, 4_727_147.210_61]),
    (32733, [255_100.0, 6_243_500.0], [5_175_645.510_12, 1_133_290.154_55, -3_539_186.917_76]),
    (25831, [820_000.0, 5_500_000.0], [4_109_868.936_17, 535_693.266_40, 4_831_830.081_75]),
];

/// The center and the half sizes of a tile's box.
fn volume(tile: &Value) -> (DVec3, DVec3) {
    let numbers: [f64; 12] = serde_json::from_value(tile["boundingVolume"]["box"].clone()).unwrap();
    let column = |k: usize| DVec3::new(numbers[3 * k], numbers[3 * k + 1], numbers[3 * k + 2]);
    (column(0), column(1) + column(2) + column(3))
}

/// The place in a tile of one in a scene, whose y is down.
fn tile_of(place: Vec3) -> DVec3 {
    -DVec3::from(place.xzy())
}

/// Checks a tile and those below it. Returns the scenes of its leaves, and adds the numbers of Gaussians of levels.
fn checked(folder: &Path, tile: &Value, counts: &mut BTreeMap<u32, usize>) -> Vec<Scene3d> {
    let (center, half) = volume(tile);
    let error = tile["geometricError"].as_f64().unwrap();
    let content = tile["content"]["uri"].as_str().map(|name| {
        let file = read_3d(folder.join(name)).unwrap();
        let outside = |mean: &&Vec3| ((tile_of(**mean) - center).abs() - half).max_element() > 1e-4;
        assert_eq!(file.scene.means.iter().find(outside), None, "{name} in {center} ± {half}");
        *counts.entry(name.split('_').next().unwrap().parse().unwrap()).or_default() += file.scene.len();
        file.scene
    });
    let Some(children) = tile["children"].as_array() else {
        assert_eq!(error, 0.0, "nothing is finer");
        return content.into_iter().collect();
    };
    assert!(error > 0.0);
    let each = |child: &Value| {
        let (inner, size) = volume(child);
        assert!(((inner - center).abs() + size - half).max_element() < 1e-5, "{inner} ± {size} in {center} ± {half}");
        assert!(child["geometricError"].as_f64().unwrap() <= error);
        checked(folder, child, counts)
    };
    children.iter().flat_map(each).collect()
}

#[test]
fn tiles_have_levels_of_detail_and_all_gaussians() {
    let (place, scene) = (tempfile::tempdir().unwrap(), city(17_000));
    let path = place.path().join("city/tileset.json");
    let written = write_3d(&path, &scene, &WriteOptions3d::default()).unwrap();
    assert_eq!((written.format, written.beside.len()), (Format3d::Tiles3d, 4 + 1));
    let tileset = json_of(&path);
    let both = json!(["KHR_gaussian_splatting", "KHR_gaussian_splatting_compression_spz_2"]);
    assert_eq!(tileset["extensions"]["3DTILES_content_gltf"]["extensionsRequired"], both);
    let root = &tileset["root"];
    assert_eq!((&tileset["asset"]["version"], &root["refine"]), (&json!("1.1"), &json!("REPLACE")));
    assert_eq!(root["transform"], Value::Null, "its place is unknown");
    assert!(tileset["geometricError"].as_f64() >= root["geometricError"].as_f64());
    let mut counts = BTreeMap::new();
    let leaves = checked(path.parent().unwrap(), root, &mut counts);
    assert_eq!(counts, BTreeMap::from([(0, 17_000), (2, 4_248)]));
    // All Gaussians of the scene, to rounding, in another order.
    let sorted = |mut means: Vec<Vec3>| {
        means.sort_by(|a, b| a.to_array().partial_cmp(&b.to_array()).unwrap());
        means
    };
    let found = sorted(leaves.iter().flat_map(|leaf| leaf.means.clone()).collect());
    let largest = found.iter().zip(sorted(scene.means)).map(|(a, b)| a.distance(b)).fold(0.0, f32::max);
    assert!(leaves.iter().all(|leaf| leaf.sh_degree == 1) && largest < 1e-4, "{largest}");

    // A smaller scene leaves no tile of the larger one.
    let written = write_3d(&path, &city(5), &WriteOptions3d::default()).unwrap();
    assert_eq!(written.beside, [path.with_file_name("0_0.glb")]);
    let names = fs::read_dir(path.parent().unwrap()).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(names.filter(|name| name.to_string_lossy().ends_with(".glb")).count(), 1);
    let text = read_3d(&path).unwrap_err().to_string();
    assert!(text.contains("a tileset of 3D Tiles") && text.contains("3D Tiles are only written"), "{text}");
}

#[test]
fn parts_of_a_scene_are_below_a_tile_without_content() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("parts/tileset.json");
    let (counts, options) = ([300, 0, 9_000], WriteOptions3d::default());
    write_levels_of_parts_3d::<Error>(&path, 1, &counts, &options, |part| Ok(city(counts[part]))).unwrap();
    let tileset = json_of(&path);
    assert_eq!((&tileset["root"]["content"], tileset["root"]["children"].as_array().unwrap().len()), (&Value::Null, 2));
    let mut counts = BTreeMap::new();
    checked(path.parent().unwrap(), &tileset["root"], &mut counts);
    assert_eq!(counts, BTreeMap::from([(0, 9_300), (1, 4_500)]));
}

/// The place in ECEF of a mean of a scene with this frame, by the transform of its tileset.
fn on_the_globe(epsg: Option<u16>, frame: WorldFrame, mean: Vec3) -> Result<DVec3, Vec<ConversionLoss>> {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("tileset.json");
    let options = WriteOptions3d::default().with(|s| {
        s.trained_with = TrainedWith::default().with(|t| t.frame = frame);
        s.epsg = epsg;
    });
    let written = write_3d(&path, &city(50), &options).unwrap();
    let transform = json_of(&path)["root"]["transform"].clone();
    let columns: [f64; 16] = serde_json::from_value(transform).map_err(|_| written.losses)?;
    Ok((DMat4::from_cols_array(&columns) * DVec4::from((tile_of(mean), 1.0))).truncate())
}

#[test]
fn scenes_with_a_known_system_have_a_place_on_the_globe() {
    // ECEF is that of the frame.
    let frame = WorldFrame { origin: DVec3::new(3_850_000.0, 650_000.0, 5_020_000.0), unit: 2.0 };
    let mean = Vec3::new(20.0, -1.0, 25.0);
    let found = on_the_globe(Some(4978), frame, mean).unwrap();
    assert!(found.distance(frame.origin + 2.0 * mean.as_dvec3()) < 1e-6, "{found}");
    for (epsg, [x, y], expected) in UTM {
        let frame = WorldFrame { origin: DVec3::new(x - 20.0, y - 20.0, 100.0), unit: 1.0 };
        let found = on_the_globe(Some(epsg), frame, Vec3::new(20.0, 20.0, 0.5)).unwrap();
        assert!(found.distance(DVec3::from(expected)) < 1e-4, "{epsg}: {found}");
    }
    let losses = on_the_globe(None, frame, mean).unwrap_err();
    assert!(losses.contains(&ConversionLoss::Frame(frame)), "{losses:?}");
    let place = tempfile::tempdir().unwrap();
    let wrong = "which is no place in the system";
    for (code, expected) in [(2056, "EPSG:2056"), (4978, wrong), (32632, wrong)] {
        let options = WriteOptions3d::default().with(|s| s.epsg = Some(code));
        let error = write_3d(place.path().join("new/tileset.json"), &city(5), &options).unwrap_err().to_string();
        assert!(error.contains(expected) && !place.path().join("new").exists(), "{error}");
    }
}
