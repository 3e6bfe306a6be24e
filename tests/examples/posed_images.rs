//! Writes a small data set of posed images with a known scene into the folder that is named:
//! `cargo run -p gs-conformance --example posed_images -- FOLDER`.

use std::{error::Error, path::Path};

use gs_conformance::posed::{small_scene, write_dataset};
use gs_cpu::{CpuRasterizer, CpuSettings};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).ok_or("name the folder to write")?;
    let cpu = CpuRasterizer::new(CpuSettings::default())?;
    write_dataset(Path::new(&folder), &small_scene(0), cpu.for_3d(), true)
}
