//! Lenses of any coefficients, looked through both ways. The input is the number of COLMAP's camera model and its parameters.

#![no_main]

use glam::dvec2;
use gs_io::dataset::{CameraModel, ColmapCamera};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some((id, rest)) = bytes.split_first() else { return };
    let Some(model) = CameraModel::from_id((*id).into()) else { return };
    let parameters = rest.as_chunks::<8>().0.iter().map(|chunk| f64::from_le_bytes(*chunk)).collect();
    let Ok(source) = (ColmapCamera { model, width: 64, height: 48, parameters }).source() else { return };
    for (x, y) in [(0.0, 0.0), (32.0, 24.0), (64.0, 1.0), (1e3, -1e9)] {
        if let Some(ray) = source.to_ray(dvec2(x, y)) {
            assert!(source.to_pixel(ray).is_none_or(|pixel| pixel.is_finite()) || !source.focal.is_finite());
        }
    }
    let picture = source.pinhole();
    assert!(picture.width <= 128 && picture.height <= 96);
});
