//! COLMAP's text models. The input is `cameras.txt`, `images.txt` and `points3D.txt` with a 0 byte between them.

#![no_main]

use gs_io::dataset::ColmapModel;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let mut files = bytes.splitn(3, |byte| *byte == 0);
    let (Some(cameras), Some(images)) = (files.next(), files.next()) else { return };
    match ColmapModel::from_text("fuzzed".as_ref(), cameras, images, files.next()) {
        Ok(model) => model.cameras.values().for_each(|camera| drop(camera.source())),
        Err(error) => assert!(!error.to_string().contains('\n')),
    }
});
