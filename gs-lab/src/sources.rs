//! A digest of all sources that a result depends on. The build script makes it a part of the
//! version under which results are stored.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use hmac_sha256::Hash;

/// Files and folders of the workspace that the result of a run depends on. The paper's experiments,
/// tables and reports may change without invalidating results, so they are left out.
pub(crate) const SOURCES: [&str; 20] = [
    "Cargo.lock",
    "gs-core/src",
    "gs-libm/src",
    "gs-cpu/src",
    "gs-wgpu/src",
    "gs-density/src",
    "gs-io/src",
    "gs-train/src",
    "gs-lab/src/study/arm/pose_error.rs",
    "gs-lab/src/run/conduct.rs",
    "gs-lab/src/study/column.rs",
    "gs-lab/src/study/digest.rs",
    "gs-lab/src/run/record.rs",
    "gs-lab/src/run/resumption.rs",
    "gs-lab/src/study/settings",
    "gs-lab/src/synthetic",
    "gs-lab/src/study/target",
    "gs-lab/src/run/task",
    "gs-lab/src/run/train.rs",
    "gs-lab/src/run/trajectory.rs",
];

/// Hexadecimal digits of the digest.
const DIGITS: usize = 12;

/// The digest of [`SOURCES`] in a workspace; `None` where one of them is missing, as in a published
/// package.
pub(crate) fn digest(workspace: &Path) -> Option<String> {
    let mut files = Vec::new();
    for source in SOURCES {
        collect(&workspace.join(source), &mut files).ok()?;
    }
    // Relative paths with `/` give the same order on every system.
    let name = |file: &PathBuf| Some(file.strip_prefix(workspace).ok()?.to_str()?.replace('\\', "/"));
    let mut named = files.iter().map(|file| Some((name(file)?, file))).collect::<Option<Vec<_>>>()?;
    named.sort();
    let mut hash = Hash::new();
    for (name, file) in named {
        let content = fs::read(file).ok()?;
        for part in [name.as_bytes(), &content] {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
    }
    let mut digits: String = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    digits.truncate(DIGITS);
    Some(digits)
}

/// Collects a file, or all files of a folder and its subfolders.
fn collect(source: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    if fs::metadata(source)?.is_file() {
        files.push(source.to_owned());
        return Ok(());
    }
    for entry in fs::read_dir(source)? {
        collect(&entry?.path(), files)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A workspace with a file for each source.
    fn workspace() -> tempfile::TempDir {
        let place = tempfile::tempdir().unwrap();
        for source in SOURCES {
            let path = place.path().join(source);
            let file = if path.extension().is_some() { path } else { path.join("shaders/blend.wgsl") };
            write(place.path(), file.to_str().unwrap(), source);
        }
        place
    }

    fn write(workspace: &Path, name: &str, content: &str) {
        let file = workspace.join(name);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, content).unwrap();
    }

    #[test]
    fn sources_of_every_backend_count() {
        let manifest = include_str!("../../gs-backend/Cargo.toml").parse::<toml::Table>().unwrap();
        let dependencies = manifest["dependencies"].as_table().unwrap();
        let is_optional = |value: &toml::Value| value.get("optional").is_some();
        let backends: Vec<_> = dependencies.iter().filter(|(_, value)| is_optional(value)).collect();
        assert!(backends.len() >= 2, "{backends:?}");
        for (backend, _) in backends {
            assert!(SOURCES.contains(&&*format!("{backend}/src")), "{backend}");
        }
    }

    /// A source that is missing would make the version that of the package alone, so that results of
    /// older sources would be reused.
    #[test]
    fn every_source_exists_in_the_workspace() {
        let workspace = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
        for source in SOURCES {
            assert!(workspace.join(source).exists(), "{source}");
        }
        assert!(digest(workspace).is_some());
    }

    #[test]
    fn every_source_of_a_result_counts_and_nothing_else() {
        let place = workspace();
        let before = digest(place.path()).unwrap();
        assert_eq!((before.len(), digest(place.path())), (DIGITS, Some(before.clone())));
        write(place.path(), "gs-cli/src/main.rs", "fn main() {}");
        write(place.path(), "gs-lab/src/report/page.rs", "another page");
        write(place.path(), "gs-lab/src/experiments/page.rs", "another experiment");
        assert_eq!(digest(place.path()), Some(before.clone()));
        for (name, content) in [
            ("gs-cpu/src/shaders/blend.wgsl", "a kernel by another formula"),
            ("gs-density/src/policies/new.rs", "a file more"),
            ("Cargo.lock", "another version of a dependency"),
        ] {
            write(place.path(), name, content);
            assert_ne!(digest(place.path()), Some(before.clone()), "{name}");
        }
    }

    #[test]
    fn a_package_without_its_workspace_has_none() {
        let place = workspace();
        fs::remove_dir_all(place.path().join("gs-cpu")).unwrap();
        assert_eq!(digest(place.path()), None);
    }

    #[test]
    fn the_version_of_this_build_names_the_sources() {
        let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let package = env!("CARGO_PKG_VERSION");
        let expected = digest(workspace).map_or_else(|| package.to_owned(), |digest| format!("{package}+{digest}"));
        assert_eq!(crate::study::VERSION, expected);
    }
}
