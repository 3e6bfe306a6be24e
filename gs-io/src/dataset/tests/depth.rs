//! Depth maps of data sets: formats and shapes that are read, and those that are refused.

use std::{fs, path::Path};

use crate::{
    Error,
    dataset::{CameraModel, DatasetSettings, DepthMap, Remark, read_dataset},
};
use image::{ImageBuffer, Luma, Rgb};
use serde_json::json;

use super::made::{binary, colmap, folder, picture, read, write_model};

/// A NumPy array with this header and these numbers.
fn npy(header: &str, numbers: &[u8]) -> Vec<u8> {
    [b"\x93NUMPY\x01\0".as_slice(), &(header.len() as u16).to_le_bytes(), header.as_bytes(), numbers].concat()
}

fn header(descr: &str, shape: &str) -> String {
    format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}   \n")
}

/// A map of 20×15 px with the values 1, 2, 3, ….
fn counted(bytes: impl Fn(u16) -> Vec<u8>) -> Vec<u8> {
    (1..=300).flat_map(bytes).collect()
}

fn depth(root: &Path) -> Result<Option<DepthMap>, Error> {
    read(root).views[0].read_depth()
}

#[test]
fn maps_of_every_kind_are_read() {
    let place = folder();
    colmap(place.path(), 1);
    let file = |ending: &str| place.path().join("depths/view 000").with_extension(ending);
    fs::create_dir(place.path().join("depths")).unwrap();
    assert_eq!(depth(place.path()).unwrap(), None);
    let expected: Vec<f32> = (1..=300_u16).map(f32::from).collect();
    for (descr, numbers) in [
        ("<f4", counted(|v| f32::from(v).to_le_bytes().to_vec())),
        ("<f8", counted(|v| f64::from(v).to_le_bytes().to_vec())),
        ("<u2", counted(|v| v.to_le_bytes().to_vec())),
    ] {
        fs::write(file("npy"), npy(&header(descr, "(15, 20)"), &numbers)).unwrap();
        let map = depth(place.path()).unwrap().unwrap();
        assert_eq!((&map.values, map.unit), (&expected, None), "{descr}");
        let camera = read(place.path()).views[0].camera;
        assert_eq!((map.camera.width, map.camera.height, map.camera.focal), (20, 15, 0.5 * camera.focal));
    }
    fs::remove_file(file("npy")).unwrap();
    let grey = ImageBuffer::from_fn(40, 30, |x, y| Luma([(1000 * y + x) as u16]));
    grey.save(place.path().join("depths/view 000.png.png")).unwrap();
    let map = depth(place.path()).unwrap().unwrap();
    assert_eq!((map.values[0], map.values[1], map.values[45]), (0.0, 1.0, 1005.0));
    ImageBuffer::from_pixel(40, 30, Luma([7_u8])).save(file("png")).unwrap();
    assert_eq!(depth(place.path()).unwrap().unwrap().values, [7.0; 1200]);
    assert!(read(place.path()).files().contains(&file("png")), "which no run may replace");
}

/// A TIFF file of 20×15 px with one strip of numbers of this sample format and number of bits.
fn tiff(format: u16, bits: u16, numbers: &[u8]) -> Vec<u8> {
    let (width, height) = (20, 15);
    // Tag, type (3: 16 bits, 4: 32 bits) and value of each entry: sides, bits, no compression, grey
    // with black as 0, offset of the strip, samples, rows and bytes of the strip, sample format.
    let entries: [(u16, u16, u32); 10] = [
        (256, 3, width),
        (257, 3, height),
        (258, 3, bits.into()),
        (259, 3, 1),
        (262, 3, 1),
        (273, 4, 8),
        (277, 3, 1),
        (278, 3, height),
        (279, 4, numbers.len() as u32),
        (339, 3, format.into()),
    ];
    let mut file = [b"II*\0".as_slice(), &(8 + numbers.len() as u32).to_le_bytes(), numbers].concat();
    file.extend((entries.len() as u16).to_le_bytes());
    for (tag, kind, value) in entries {
        file.extend([tag, kind].map(u16::to_le_bytes).concat());
        file.extend([1, value].map(u32::to_le_bytes).concat());
    }
    file.extend([0; 4]);
    file
}

#[test]
fn tiffs_of_32_and_64_bits_are_read_and_damaged_ones_are_errors() {
    let place = folder();
    colmap(place.path(), 1);
    fs::create_dir(place.path().join("depths")).unwrap();
    let file = place.path().join("depths/view 000.tiff");
    let expected: Vec<f32> = (1..=300_u16).map(f32::from).collect();
    let floats = counted(|v| f32::from(v).to_le_bytes().to_vec());
    for bytes in [
        tiff(3, 32, &floats),
        tiff(3, 64, &counted(|v| f64::from(v).to_le_bytes().to_vec())),
        tiff(1, 32, &counted(|v| u32::from(v).to_le_bytes().to_vec())),
    ] {
        fs::write(&file, bytes).unwrap();
        assert_eq!(depth(place.path()).unwrap().unwrap().values, expected);
    }
    let unknown: Vec<u8> = [f32::NAN, f32::INFINITY, 2.0].repeat(100).iter().flat_map(|v| v.to_le_bytes()).collect();
    fs::write(&file, tiff(3, 32, &unknown)).unwrap();
    assert_eq!(depth(place.path()).unwrap().unwrap().values[..4], [0.0, 0.0, 2.0, 0.0]);
    fs::write(&file, tiff(2, 32, &floats)).unwrap();
    let error = depth(place.path()).unwrap_err().to_string();
    assert!(error.contains("view 000.tiff: signed integers are not supported"), "{error}");
    let mut short = tiff(3, 32, &floats);
    let beyond = short.len() as u32 - 3;
    short[4..8].copy_from_slice(&beyond.to_le_bytes());
    fs::write(&file, short).unwrap();
    let error = depth(place.path()).unwrap_err().to_string();
    assert!(error.contains("view 000.tiff"), "{error}");
}

#[test]
fn unknown_values_are_0_and_distorted_maps_are_undistorted() {
    let place = folder();
    let mut model = colmap(place.path(), 1);
    fs::create_dir(place.path().join("depths")).unwrap();
    let file = place.path().join("depths/view 000.npy");
    let mut values = [f32::NAN, -1.0, 0.0, f32::INFINITY, 5.0].repeat(60);
    fs::write(&file, npy(&header("<f4", "(15, 20)"), &values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()))
        .unwrap();
    assert_eq!(depth(place.path()).unwrap().unwrap().values[..6], [0.0, 0.0, 0.0, 0.0, 5.0, 0.0]);

    // The column of each pixel in the distorted image.
    let camera = model.cameras.get_mut(&1).unwrap();
    camera.model = CameraModel::SimpleRadial;
    camera.parameters = vec![30.0, 20.0, 15.0, -0.2];
    write_model(&place.path().join("sparse/0"), &binary(&model), "bin");
    values = (0..1200).map(|i| (i % 40) as f32 + 0.5).collect();
    fs::write(&file, npy(&header("<f4", "(30, 40)"), &values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()))
        .unwrap();
    let view = read(place.path()).views.remove(0);
    let map = view.read_depth().unwrap().unwrap();
    let mut moved = 0;
    for y in 0..map.camera.height {
        for x in 0..map.camera.width {
            let at = glam::dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5) - map.camera.center.as_dvec2();
            let expected = view.source.to_pixel(at / map.camera.focal.as_dvec2()).unwrap().x as f32;
            let value = map.values[(y * map.camera.width + x) as usize];
            assert!((value - expected).abs() < 0.51, "{value} {expected}");
            moved += u32::from((value - x as f32 - 0.5).abs() > 0.9);
        }
    }
    assert!(moved > 10, "{moved}");
}

#[test]
fn an_unusable_depth_map_is_one_clear_error_when_used() {
    let place = folder();
    colmap(place.path(), 1);
    fs::create_dir(place.path().join("depths")).unwrap();
    let file = place.path().join("depths/view 000.npy");
    let right = counted(|v| f32::from(v).to_le_bytes().to_vec());
    for (bytes, expected) in [
        (npy(&header("<f4", "(20, 15)"), &right), "the image is 15x20 px, but 40x30 px or its shape is needed"),
        (npy(&header("<f4", "(15, 20)"), &right[1..]), "1199 bytes of numbers where 1200 are needed"),
        (npy(&header("<f4", "(15, 20, 1)"), &right), "two dimensions (rows, columns), not (15, 20, 1)"),
        (npy(&header("<f4", "(0, 20)"), &[]), "0 rows and 20 columns"),
        (npy(&header("<f4", "(4000000000, 4000000000)"), &right), "rows and"),
        (npy(&header(">f4", "(15, 20)"), &right), "float32, float64 or uint16"),
        (npy(&header("<f4", "(15, 20)").replace("False", "True"), &right), "C order"),
        (npy(&header("<f4", "(15, 20)").replace("descr", "kind"), &right), "not a NumPy array"),
        (npy(&header("<f4", "(15, 20)"), &right)[..40].to_vec(), "header is cut off"),
        (b"\x93NUMPY\x09\0".to_vec(), "not a NumPy array"),
        (Vec::new(), "not a NumPy array"),
    ] {
        fs::write(&file, bytes).unwrap();
        let error = depth(place.path()).unwrap_err().to_string();
        assert!(error.contains("view 000.npy") && error.contains(expected), "{error}");
        let remarked = Remark::DepthsUnusable { count: 1, first: error };
        assert!(read(place.path()).remarks.contains(&remarked), "{remarked}");
    }
    fs::write(&file, npy(&header("<f4", "(15, 20)"), &[0; 1200])).unwrap();
    let error = depth(place.path()).unwrap_err().to_string();
    assert!(error.contains("view 000.npy: no value is above 0; write this depth map again"), "{error}");
    fs::remove_file(&file).unwrap();

    let file = place.path().join("depths/view 000.png");
    ImageBuffer::from_pixel(30, 40, Luma([7_u16])).save(&file).unwrap();
    let error = depth(place.path()).unwrap_err().to_string();
    assert!(error.contains("view 000.png: the image is 30x40 px"), "{error}");
    ImageBuffer::from_pixel(40, 30, Rgb([7_u8, 8, 9])).save(&file).unwrap();
    let error = depth(place.path()).unwrap_err().to_string();
    assert!(error.contains("view 000.png: it is an image with colours, but must be grey"), "{error}");
    fs::write(&file, "no image").unwrap();
    let error = depth(place.path()).unwrap_err().to_string();
    assert!(error.contains("view 000.png"), "{error}");
    assert!(read(place.path()).views[0].read_image().is_ok(), "the image can be used without its depth map");
}

#[test]
fn nerfstudio_names_its_maps_and_gives_their_unit() {
    let place = folder();
    let rows = json!([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]);
    let frame = |name: &str, depth: &str| {
        picture(place.path().join(name), 40, 30);
        json!({"file_path": name, "transform_matrix": rows, "depth_file_path": depth})
    };
    let write = |frames: Vec<serde_json::Value>, model: &str| {
        let file = json!({"fl_x": 30.0, "camera_model": model, "frames": frames});
        fs::write(place.path().join("transforms.json"), file.to_string()).unwrap();
    };
    ImageBuffer::from_pixel(20, 15, Luma([2500_u16])).save(place.path().join("d.png")).unwrap();
    write(vec![frame("a.png", "d.png"), frame("b.png", "gone.png")], "OPENCV");
    let dataset = read(place.path());
    let map = dataset.views[0].read_depth().unwrap().unwrap();
    assert_eq!((map.values[0], map.unit), (2500.0, Some(1e-3)));
    assert_eq!(dataset.views[1].read_depth().unwrap(), None);
    let missing = Remark::DepthsMissing { count: 1, first: "gone.png".to_owned() };
    assert_eq!(missing.to_string(), "1 depth map not found (first: gone.png)");
    assert!(dataset.remarks.contains(&missing), "{:?}", dataset.remarks);

    write(vec![frame("a.png", "../d.png")], "OPENCV");
    let error = read_dataset(place.path(), &DatasetSettings::default()).unwrap_err();
    assert!(matches!(error, Error::LeavesDataset { key: "depth_file_path", .. }), "{error}");

    write(vec![frame("a.png", "d.png")], "EQUIRECTANGULAR");
    picture(place.path().join("a.png"), 40, 20);
    let dataset = read(place.path());
    assert!(dataset.views.iter().all(|view| view.depth.is_none()));
    assert!(dataset.remarks.contains(&Remark::DepthsUnused { count: 1 }), "{:?}", dataset.remarks);
}
