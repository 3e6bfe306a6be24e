//! Lists the adapters of this machine; fails without one.

#![allow(clippy::print_stdout)]

fn main() -> std::process::ExitCode {
    let adapters = pollster::block_on(gs_wgpu::adapters());
    adapters.iter().for_each(|adapter| println!("{adapter}"));
    if adapters.is_empty() { std::process::ExitCode::FAILURE } else { std::process::ExitCode::SUCCESS }
}
