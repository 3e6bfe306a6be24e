//! Time of one call that renders a 2D scene on the CPU, upload and image included.
//!
//! `cargo bench -p gs-lab --bench render_call -- SCENE COLUMNS ROWS` prints the median in µs.
//! `gs-python/benches/overhead.py` compares it with the same call from Python.

#![allow(clippy::print_stdout)]

use std::{env, error::Error, time::Instant};

use gs_backend::{Request, Wanted, block_on, open};
use gs_core::{Canvas, Rasterizer as _};
use gs_io::read_2d;

/// Calls before and during the measurement, as in `overhead.py`.
const CALLS: [usize; 2] = [500, 5000];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let [scene, columns, rows] = arguments.as_slice() else {
        println!("usage: cargo bench -p gs-lab --bench render_call -- SCENE COLUMNS ROWS");
        return Ok(());
    };
    let file = read_2d(scene)?;
    let canvas = Canvas::new(file.width, file.height).resized(columns.parse()?, rows.parse()?);
    let request = Request::default().with(|request| request.wanted = Wanted::Cpu);
    let backend = block_on(open(&request))?;
    let mut times = Vec::with_capacity(CALLS[1]);
    for call in 0..CALLS[0] + CALLS[1] {
        let started = Instant::now();
        block_on(backend.rasterizer.render(&file.scene, &canvas, &file.settings))?;
        if call >= CALLS[0] {
            times.push(started.elapsed().as_secs_f64() * 1e6);
        }
    }
    times.sort_by(f64::total_cmp);
    println!("{:.1}", times[times.len() / 2]);
    Ok(())
}
