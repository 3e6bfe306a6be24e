//! Sets the version under which results are stored: the package's and, in a checkout, a digest of
//! the engine's sources. Without the digest, results of an older kernel could be reused after the
//! kernel has changed.

#[path = "src/sources.rs"]
mod sources;

use std::{env, path::Path};

fn main() {
    let package = env::var("CARGO_PKG_VERSION").unwrap_or_default();
    let workspace =
        env::var("CARGO_MANIFEST_DIR").ok().and_then(|folder| Some(Path::new(&folder).parent()?.to_owned()));
    let digest = workspace.as_deref().and_then(sources::digest);
    let version = digest.map_or_else(|| package.clone(), |digest| format!("{package}+{digest}"));
    println!("cargo:rustc-env=GS_LAB_VERSION={version}");
    for source in workspace.iter().flat_map(|workspace| sources::SOURCES.map(|source| workspace.join(source))) {
        if source.exists() {
            println!("cargo:rerun-if-changed={}", source.display());
        }
    }
    println!("cargo:rerun-if-changed=build.rs");
}
