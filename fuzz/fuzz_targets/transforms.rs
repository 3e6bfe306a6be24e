//! Data sets with a `transforms.json`, photographs included: the file is the input, beside it is one photograph, `a.png`.

#![no_main]

use std::{fs, sync::LazyLock};

use gs_core::Image;
use gs_io::dataset::{DatasetSettings, read_dataset};

static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let picture = Image::filled(20, 10, [0.5; 3]).expect("a small image");
    gs_io::write_png(folder.path().join("a.png"), &picture).expect("an image that can be written");
    folder
});

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let file = FOLDER.path().join("transforms.json");
    fs::write(&file, bytes).expect("a file that can be written");
    match read_dataset(&file, &DatasetSettings::default()) {
        Ok(dataset) => {
            for view in dataset.views {
                view.camera.validate().expect("a possible camera");
                let photograph = view.read_image().expect("a photograph that is there");
                assert_eq!(photograph.image.size(), (view.camera.width, view.camera.height));
            }
        }
        Err(error) => assert!(!error.to_string().contains('\n')),
    }
});
