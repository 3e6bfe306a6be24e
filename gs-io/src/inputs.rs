//! The files that a run reads and must not replace.

use std::{collections::BTreeSet, fs, path::Path};

use crate::error::Error;

/// The input files of a run, which it never replaces or removes. Hard and symbolic links to them
/// count as the same files.
///
/// ```
/// # let folder = tempfile::tempdir().unwrap();
/// # let [photo, other] = ["photo.png", "other.png"].map(|name| folder.path().join(name));
/// # std::fs::write(&photo, "").unwrap();
/// let inputs = gs_io::Inputs::from_iter([&photo]);
/// assert!(inputs.guard(&photo).is_err() && inputs.guard(&other).is_ok());
/// ```
#[derive(Debug, Clone, Default)]
pub struct Inputs(BTreeSet<Identity>);

/// Identifies a file: device and file number.
#[cfg(unix)]
type Identity = (u64, u64);
/// Identifies a file by its canonical path; hard links are not recognised.
#[cfg(not(unix))]
type Identity = std::path::PathBuf;

impl Inputs {
    /// Whether the path leads to one of the inputs.
    pub fn contain(&self, path: &Path) -> bool {
        identity(path).is_some_and(|found| self.0.contains(&found))
    }

    /// Fails if the path leads to one of the inputs.
    ///
    /// # Errors
    /// [`Error::IsInput`].
    pub fn guard(&self, path: &Path) -> Result<(), Error> {
        if self.contain(path) { Err(Error::IsInput { path: path.to_owned() }) } else { Ok(()) }
    }
}

/// Only paths of files count: pipes and folders cannot be replaced by a file.
impl<P: AsRef<Path>> FromIterator<P> for Inputs {
    fn from_iter<I: IntoIterator<Item = P>>(paths: I) -> Self {
        Self(paths.into_iter().filter_map(|path| identity(path.as_ref())).collect())
    }
}

#[cfg(unix)]
fn identity(path: &Path) -> Option<Identity> {
    use std::os::unix::fs::MetadataExt;
    let file = fs::metadata(path).ok().filter(fs::Metadata::is_file)?;
    Some((file.dev(), file.ino()))
}

#[cfg(not(unix))]
fn identity(path: &Path) -> Option<Identity> {
    fs::canonicalize(path).ok().filter(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_is_known_under_every_name() {
        let folder = tempfile::tempdir().unwrap();
        let [photo, hard, missing] = ["photo.png", "hard.png", "missing.png"].map(|name| folder.path().join(name));
        fs::write(&photo, "pixels").unwrap();
        fs::hard_link(&photo, &hard).unwrap();
        let inputs = Inputs::from_iter([photo.as_path(), &missing, folder.path()]);
        assert!(inputs.contain(&folder.path().join("./photo.png")));
        assert!(!inputs.contain(&missing) && !inputs.contain(folder.path()));
        #[cfg(unix)]
        {
            let link = folder.path().join("link.png");
            std::os::unix::fs::symlink(&photo, &link).unwrap();
            assert!(inputs.contain(&hard) && inputs.contain(&link));
        }
        let message = inputs.guard(&photo).unwrap_err().to_string();
        assert!(message.ends_with("photo.png: is an input of this run, which is never replaced"), "{message}");
    }
}
