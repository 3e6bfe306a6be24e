//! Writes the small files of gs-io's tests as each target's first corpus: `cargo run --example
//! seed_scenes`, in this folder.

use std::{fs, io, path::Path};

#[allow(dead_code)]
#[path = "../../gs-io/tests/scene3d/samples.rs"]
mod samples;

fn main() -> io::Result<()> {
    for (name, bytes) in samples::corpus() {
        let target = match name.split_once('.') {
            Some((_, "compressed.ply")) => "compressed_ply",
            Some((_, "glb")) => "gltf",
            Some((_, ending)) => ending,
            None => continue,
        };
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join(name), bytes)?;
    }
    Ok(())
}
