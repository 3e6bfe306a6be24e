//! What a Gaussian takes on disk in each format, and how long reading and writing take.
//!
//! `GS_DATA=../shared/data cargo bench -p gs-train --bench formats -- [--quick]`

#![allow(clippy::print_stdout)]

mod measure;

use clap::Parser;
use gs_core::Scene;
use gs_io::{
    GltfBuffer, SpatialFile, SpatialOptions, SpatialWritten, SpzOptions, SpzVersion, read_spatial, write_spatial,
};
use measure::{
    Options, Outcome, Quantiles, count, ms, number, photographs::data_folder, print_columns, print_head, print_row,
    print_section, try_time,
};

/// The scenes: one with all harmonics from 3DGS's own code, one without any that was quantised before.
const SCENES: [&str; 2] = ["kacytran_iter7000_point_cloud.ply", "biker.compressed.ply"];

fn main() -> Outcome {
    let options = Options::parse();
    let data = data_folder();
    print_head(
        "Formats of spatial scenes",
        &options,
        &[1],
        "public scene files; each is read, and written in every format",
    );
    let folder = tempfile::tempdir()?;
    for name in SCENES {
        let path = data.join("splats").join(name);
        if !path.exists() {
            println!("\nskipped: no test data ({name})");
            continue;
        }
        let file = read_spatial(&path)?;
        let (gaussians, degree) = (count(file.scene.len() as u64), file.scene.sh_degree);
        print_section(&format!("{name}: {gaussians} Gaussians, SH degree {degree}"));
        print_columns(&["format", "bytes", "bytes a Gaussian", "writing, ms", "reading, ms"]);
        let reading = ms(Quantiles::of(&try_time(repetitions(&options), || read_spatial(&path))?));
        print_sizes(&format!("{}, as it came", file.format), file.bytes, &file, "–", &reading);
        let spz =
            |version| SpatialOptions { spz: SpzOptions { version, ..SpzOptions::default() }, ..Default::default() };
        let plain = SpatialOptions::default();
        for (format, name, settings) in [
            ("PLY", "a.ply", plain),
            ("`.splat`", "a.splat", plain),
            ("SPZ 4", "a.spz", spz(SpzVersion::V4)),
            ("SPZ 3", "a.spz", spz(SpzVersion::V3)),
            ("`.glb`", "a.glb", plain),
            ("`.gltf`, buffer inside", "a.gltf", plain),
            ("`.gltf`, buffer beside", "a.gltf", SpatialOptions { gltf_buffer: GltfBuffer::Beside, ..plain }),
        ] {
            let to = folder.path().join(name);
            let writing = try_time(repetitions(&options), || write_spatial(&to, &file.scene, &settings))?;
            let SpatialWritten { beside, .. } = write_spatial(&to, &file.scene, &settings)?;
            let reading = try_time(repetitions(&options), || read_spatial(&to))?;
            let mut bytes = std::fs::metadata(&to)?.len();
            if let Some(beside) = beside {
                bytes += std::fs::metadata(beside)?.len();
            }
            let [writing, reading] = [writing, reading].map(|seconds| ms(Quantiles::of(&seconds)));
            print_sizes(format, bytes, &file, &writing, &reading);
        }
    }
    Ok(())
}

fn repetitions(options: &Options) -> usize {
    options.pick(9, 2)
}

fn print_sizes(format: &str, bytes: u64, file: &SpatialFile, writing: &str, reading: &str) {
    let each = bytes as f64 / file.scene.len() as f64;
    print_row(&[format, &count(bytes), &number(each), writing, reading]);
}
