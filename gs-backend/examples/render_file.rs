//! A scene file as a PNG, drawn as its training drew it, on a GPU or the CPU.
//!
//! `cargo run --release -p gs-backend --example render_file -- scene.ply picture.png`
#![allow(clippy::print_stdout)]

use std::error::Error;

use gs_backend::{Request, block_on, open};
use gs_core::{Scene, view::Bulk};

/// Columns and rows of the picture, px.
const SIZE: (u32, u32) = (800, 600);

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(input), Some(output)) = (arguments.next(), arguments.next()) else {
        return Err("usage: render_file SCENE PICTURE.png".into());
    };

    let file = gs_io::read_3d(&input)?; // .ply, .spz, .sog, .splat, .ksplat, .gltf or .glb
    let bulk = Bulk::of(&file.scene).ok_or("the scene has no Gaussian with a finite mean")?;
    let up = [0.0, -1.0, 0.0].into(); // y points down in the files of 3DGS
    let camera = bulk.overview(SIZE.0, SIZE.1, Bulk::FIELD_OF_VIEW, up).ok_or("the direction `up` has no length")?;

    let chosen = block_on(open(&Request::default()))?;
    // The defaults of RenderSettings are for 2D scenes; the file knows its order, antialiasing and SH.
    let image = block_on(file.render(&chosen.rasterizer, &camera))?;
    gs_io::write_png(&output, &image)?;
    println!("{}: {} Gaussians, on {}", output, file.scene.len(), chosen.reason);
    Ok(())
}
