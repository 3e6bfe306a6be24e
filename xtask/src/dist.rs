//! `cargo xtask dist`: everything that a release has, in `target/dist`, and its test where it will run.

mod archive;
pub mod build;
mod debian;
mod papers;
pub mod systems;
pub mod tools;

use std::path::Path;

use crate::{
    system::{Options, empty, start_test, target},
    web,
};
use papers::{NOTICES, Papers};
use systems::SYSTEMS;
use tools::Tools;

/// Builds the release, and tests it on request.
pub fn run(options: Options) -> Result<(), String> {
    if options.install {
        web::install(true)?;
    }
    let tools = Tools::prepare(options.install)?;
    let out = target().join("dist");
    release(&tools, &out)?;
    if options.test { start_test("dist", options.install) } else { Ok(()) }
}

/// Builds the release into a folder, which it replaces.
fn release(tools: &Tools, out: &Path) -> Result<(), String> {
    let page = web::built_page()?;
    let built = build::all(tools)?;
    let [manual, debian_manual] = ["gs", debian::NAME].map(|name| build::manual(tools, &built, name));
    let (manual, debian_manual) = (manual?, debian_manual?);
    empty(out)?;
    for (system, built) in SYSTEMS.iter().zip(&built) {
        let papers = Papers::write(tools, system)?;
        let contents = archive::Contents {
            program: built.program.clone(),
            manual: manual.clone(),
            debian_manual: debian_manual.clone(),
            page: page.clone(),
        };
        archive::pack(tools, system, &contents, &papers, out)?;
        build::wheel(tools, system, built, &papers, out)?;
    }
    web::package(out, |tree| tools.script("notices.py", [Path::new(web::TARGET), &tree.join(NOTICES)]))?;
    tools.script("sums.py", [out])?;
    eprintln!("built {}", out.display());
    Ok(())
}
