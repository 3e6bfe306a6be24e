//! `cargo xtask dist`: everything that a release has, in `target/dist`, and its test where it will run.

mod archive;
mod build;
mod debian;
mod test;
mod tools;

use std::path::{Path, PathBuf};

use crate::{
    system::{Options, VERSION, empty, target},
    web,
};
use tools::Tools;

/// A system that a release is for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct System {
    /// Its name in the names of files.
    name: &'static str,
    /// Rust's name for it.
    triple: &'static str,
    /// The oldest glibc that is enough, appended to the triple for the linker.
    glibc: &'static str,
    /// Python's name of it.
    wheel: &'static str,
    /// Debian's name of the architecture.
    debian: Option<&'static str>,
}

impl System {
    fn is_windows(&self) -> bool {
        self.triple.contains("windows")
    }
}

/// The systems.
const SYSTEMS: [System; 3] = [
    System {
        name: "x86_64-linux",
        triple: "x86_64-unknown-linux-gnu",
        glibc: ".2.28",
        wheel: "manylinux_2_28_x86_64",
        debian: Some("amd64"),
    },
    System {
        name: "aarch64-linux",
        triple: "aarch64-unknown-linux-gnu",
        glibc: ".2.28",
        wheel: "manylinux_2_28_aarch64",
        debian: Some("arm64"),
    },
    System { name: "x86_64-windows", triple: "x86_64-pc-windows-gnullvm", glibc: "", wheel: "win_amd64", debian: None },
];

/// Builds the release, and tests it on request.
pub(crate) fn run(options: Options) -> Result<(), String> {
    if options.install {
        web::install(true)?;
    }
    let tools = Tools::prepare(options.install)?;
    let out = target().join("dist");
    release(&tools, &out)?;
    if options.test { test::run(&tools, &out, options.install) } else { Ok(()) }
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

/// The licences of what a file of the release is made of.
const NOTICES: &str = "THIRD-PARTY-LICENSES.txt";

/// What a release for a system is made of.
#[derive(Debug)]
struct Papers {
    /// The licences of everything.
    notices: PathBuf,
    /// The SBOM of the program and the page.
    program: PathBuf,
    /// The SBOM of the Python module.
    module: PathBuf,
}

impl Papers {
    fn write(tools: &Tools, system: &System) -> Result<Self, String> {
        let folder = target().join("dist-tools/papers").join(system.name);
        empty(&folder)?;
        let [notices, program, module] =
            [NOTICES, "gs.cdx.json", "gaussian_splats.cdx.json"].map(|name| folder.join(name));
        tools.script("notices.py", [Path::new(system.triple), &notices, &program, &module])?;
        Ok(Self { notices, program, module })
    }
}

/// Where the trees of the archives are put together.
fn staging(system: &System) -> PathBuf {
    target().join("dist-tools").join("trees").join(format!("gs-{VERSION}-{}", system.name))
}
