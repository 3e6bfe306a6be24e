//! COLMAP's binary models. The input is the length of `cameras.bin` and that of `images.bin`, two bytes each, then both files, then
//! `points3D.bin`.

#![no_main]

use gs_io::dataset::ColmapModel;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some((lengths, files)) = bytes.split_first_chunk::<4>() else { return };
    let [a, b, c, d] = *lengths;
    let (cameras, rest) = files.split_at(files.len().min(u16::from_le_bytes([a, b]).into()));
    let (images, points) = rest.split_at(rest.len().min(u16::from_le_bytes([c, d]).into()));
    match ColmapModel::from_binary("fuzzed".as_ref(), cameras, images, Some(points)) {
        // Every camera is possible or is not; to find out must end.
        Ok(model) => model.cameras.values().for_each(|camera| drop(camera.source())),
        Err(error) => assert!(!error.to_string().contains('\n')),
    }
});
