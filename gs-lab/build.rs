//! Tells the library by which version a result was computed: that of the package and, where the sources of the engine are beside it, as in
//! a checkout, their digest. Without it a kernel could change under a version that stays the same, and old results would pass for new.

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
