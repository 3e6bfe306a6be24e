//! Lists the graphics adapters of this machine; fails if there is none.
//!
//! `cargo run -p gs-wgpu --example adapters`

#![allow(clippy::print_stdout)]

fn main() -> std::process::ExitCode {
    let adapters = pollster::block_on(gs_wgpu::adapters());
    adapters.iter().for_each(|adapter| println!("{adapter}"));
    if adapters.is_empty() { std::process::ExitCode::FAILURE } else { std::process::ExitCode::SUCCESS }
}
