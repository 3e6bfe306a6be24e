//! Bytes per Gaussian in each 3D format at each SH degree, and time of reading and writing.
//!
//! `GS_DATA=../shared/data cargo bench -p gs-lab --bench formats -- [--quick]`

#![allow(clippy::print_stdout)]

mod measure;

use std::path::Path;

use clap::Parser;
use gs_conformance::data;
use gs_core::{Scene, Scene3d};
use gs_io::{GltfBuffer, SpzOptions, SpzVersion, WriteOptions3d, Written3d, read_3d, write_3d};
use measure::{
    Options, Outcome, Quantiles, count, ms, number, print_columns, print_head, print_row, print_section, try_time,
};

/// The scenes: one by 3DGS's own code with all SH coefficients, and a quantised one without SH
/// above degree 0.
const SCENES: [&str; 2] = ["kacytran_iter7000_point_cloud.ply", "biker.compressed.ply"];

fn main() -> Outcome {
    let options = Options::parse();
    let data = data::folder();
    print_head(
        "Formats of 3D scenes",
        &options,
        &[1],
        "public scene files; each is read, cut to every degree that it has, and written in every format",
    );
    let folder = tempfile::tempdir()?;
    for name in SCENES {
        let path = data.join("splats").join(name);
        if !path.exists() {
            println!("\nskipped: no test data ({name})");
            continue;
        }
        let file = read_3d(&path)?;
        let reading = ms(Quantiles::of(&try_time(repetitions(&options), || read_3d(&path))?));
        let as_it_came =
            Row {
                format: format!("{}, as it came", file.format), bytes: file.bytes, times: ["–".to_owned(), reading]
            };
        for degree in (0..=file.scene.sh_degree).rev() {
            let scene = of_degree(&file.scene, degree);
            print_section(&format!("{name}: {} Gaussians, SH degree {degree}", count(scene.len() as u64)));
            print_columns(&["format", "bytes", "bytes a Gaussian", "of PLY's", "writing, ms", "reading, ms"]);
            let rows = written(&scene, folder.path(), repetitions(&options))?;
            let ply = rows[0].bytes;
            if degree == file.scene.sh_degree {
                as_it_came.print(scene.len(), ply);
            }
            rows.iter().for_each(|row| row.print(scene.len(), ply));
        }
    }
    Ok(())
}

/// A scene without the SH coefficients above a degree.
fn of_degree(scene: &Scene3d, sh_degree: u8) -> Scene3d {
    let mut cut = Scene3d { sh_degree, ..Scene3d::default() };
    (0..scene.len()).for_each(|index| cut.push(scene.gaussian(index).with_degree(sh_degree)));
    cut
}

/// The results of a format.
struct Row {
    format: String,
    bytes: u64,
    /// Times of writing and reading, as table cells.
    times: [String; 2],
}

impl Row {
    fn print(&self, gaussians: usize, ply: u64) {
        let Self { format, bytes, times: [writing, reading] } = self;
        let (each, share) = (*bytes as f64 / gaussians as f64, *bytes as f64 / ply as f64);
        print_row(&[format, &count(*bytes), &number(each), &number(share), writing, reading]);
    }
}

/// Writes a scene in every format, 3DGS's PLY first, and reads it back.
fn written(scene: &Scene3d, folder: &Path, repetitions: usize) -> Result<Vec<Row>, gs_io::Error> {
    let plain = WriteOptions3d::default();
    let spz = |version| plain.with(|s| s.spz = SpzOptions::default().with(|s| s.version = version));
    let beside = plain.with(|s| s.gltf_buffer = GltfBuffer::Beside);
    let formats = [
        ("PLY", "a.ply", plain),
        ("`.splat`", "a.splat", plain),
        ("SPZ 4", "a.spz", spz(SpzVersion::V4)),
        ("SPZ 3", "a.spz", spz(SpzVersion::V3)),
        ("`.glb`", "a.glb", plain),
        ("`.gltf`, buffer inside", "a.gltf", plain),
        ("`.gltf`, buffer beside", "a.gltf", beside),
    ];
    let row = |(format, name, options): (&str, &str, WriteOptions3d)| {
        let to = folder.join(name);
        let writing = try_time(repetitions, || write_3d(&to, scene, &options))?;
        let Written3d { beside, .. } = write_3d(&to, scene, &options)?;
        let reading = try_time(repetitions, || read_3d(&to))?;
        let size = |file: &Path| std::fs::metadata(file).map_or(0, |file| file.len());
        let bytes = size(&to) + beside.iter().map(|file| size(file)).sum::<u64>();
        let times = [writing, reading].map(|seconds| ms(Quantiles::of(&seconds)));
        Ok(Row { format: format.to_owned(), bytes, times })
    };
    formats.into_iter().map(row).collect()
}

fn repetitions(options: &Options) -> usize {
    options.pick(9, 2)
}
