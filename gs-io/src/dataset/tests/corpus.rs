//! The small models of these tests as the first corpus of the fuzz targets.

use std::{fs, io, path::Path};

use super::{llff, made, metashape, opensfm, realityscan};

#[test]
#[ignore = "writes into fuzz/corpus; fuzz/README.md has the command"]
fn small_models_as_the_first_corpus_of_the_fuzz_targets() -> io::Result<()> {
    let model = made::model(3);
    let [cameras, images, points] = made::binary(&model);
    let lengths = [cameras.len(), images.len()].map(|length| (length as u16).to_le_bytes());
    write("colmap_binary", &[&lengths.concat(), &cameras, &images, &points].map(|part| &part[..]).concat())?;
    write("colmap_text", &made::text(&model).join(&0))?;
    for camera in model.cameras.values() {
        let parameters = camera.parameters.iter().flat_map(|v| v.to_le_bytes());
        write("lens", &std::iter::once(camera.model as u8).chain(parameters).collect::<Vec<u8>>())?;
    }
    let frame = r#"{"file_path": "./a.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}"#;
    for camera in [
        r#""fl_x": 30, "w": 20, "h": 10, "k1": 0.01, "p1": -0.002, "camera_model": "OPENCV""#,
        r#""camera_angle_x": 0.7, "is_fisheye": true, "k2": -0.02, "applied_scale": 2.0, "test_filenames": ["a.png"]"#,
    ] {
        write("transforms", format!("{{{camera}, \"frames\": [{frame}]}}").as_bytes())?;
        let json = format!("{{{camera}, \"ply_file_path\": \"a.ply\", \"frames\": [{frame}]}}\0");
        for kind in ["ascii", "binary_little_endian"] {
            let points = format!(
                "ply\nformat {kind} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                 property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 4 5 6\n7 8 9 0 1 2\n3 4 5 6 7 8\n9 0 1 2 3"
            );
            write("transforms", (json.clone() + &points).as_bytes())?;
        }
    }
    for (program, files) in
        [llff::seeds(), opensfm::seeds(), metashape::seeds(), realityscan::seeds()].into_iter().enumerate()
    {
        for file in files {
            write("poses", &[&[program as u8], &file[..]].concat())?;
        }
    }
    Ok(())
}

/// A file of its own for each content.
fn write(target: &str, bytes: &[u8]) -> io::Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(target);
    fs::create_dir_all(&folder)?;
    fs::write(folder.join(format!("made-{:08x}", crc32fast::hash(bytes))), bytes)
}
