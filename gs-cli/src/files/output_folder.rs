//! The folder that a command writes its results into, and the files that it must not touch.

use std::{
    env,
    ops::Deref,
    path::{Path, PathBuf},
    process,
};

use clap::Args;
use gs_io::{FolderClaim, Inputs, remove_leftovers, write_durably};
use serde::Serialize;

use crate::failure::Failure;

/// The flag of every command that writes into a folder.
#[derive(Debug, Clone, Copy, Default, Args)]
pub(crate) struct OverwriteArgs {
    /// Replace files that have the name of a result even if gs did not write them; without it, such
    /// a file is an error
    #[arg(long)]
    pub(crate) overwrite: bool,
}

impl OverwriteArgs {
    /// A claim to these files in a folder, for a run that reads `inputs`. It changes nothing:
    /// [`check`] says whether the run may begin, and [`OutputFolder::begin`] begins it.
    pub(crate) fn claim<'n>(
        self,
        folder: &Path,
        files: impl IntoIterator<Item = &'n str>,
        inputs: Inputs,
    ) -> FolderClaim {
        FolderClaim { inputs, overwrite: self.overwrite, ..FolderClaim::new(folder, files) }
    }
}

/// Checks that a run may write into its folder, before anything is computed. It changes nothing.
pub(crate) fn check(claim: &FolderClaim) -> Result<(), Failure> {
    claim.check().map_err(refused)
}

/// Checks that a single file may be written by a run that reads `inputs`; removes incomplete files
/// of a killed run beside it.
pub(crate) fn check_file<P: AsRef<Path>>(file: &Path, inputs: impl IntoIterator<Item = P>) -> Result<(), Failure> {
    inputs.into_iter().collect::<Inputs>().guard(file)?;
    remove_leftovers(folder_of(file));
    Ok(())
}

/// The folder that a file lies in.
pub(crate) fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn refused(error: gs_io::Error) -> Failure {
    match error {
        gs_io::Error::Write { path, source } => {
            Failure::failed(format_args!("{}: cannot be written to: {source}", path.display()))
                .hint("choose another folder with --output")
        }
        error => error.into(),
    }
}

/// A folder that this run alone writes into.
#[derive(Debug)]
pub(crate) struct OutputFolder(gs_io::OutputFolder);

impl Deref for OutputFolder {
    type Target = gs_io::OutputFolder;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl OutputFolder {
    /// Makes the folder if necessary and locks it for this run.
    pub(crate) fn begin(claim: FolderClaim) -> Result<Self, Failure> {
        claim.begin().map(Self).map_err(refused)
    }

    /// Makes a folder inside.
    pub(crate) fn make(&self, name: &str) -> Result<PathBuf, Failure> {
        let path = self.path().join(name);
        std::fs::create_dir_all(&path)
            .map_err(|error| refused(gs_io::Error::Write { path: path.clone(), source: error }))?;
        Ok(path)
    }

    /// Writes a file that can be made again easily.
    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) -> Result<(), Failure> {
        Ok(self.0.write(name, content)?)
    }

    /// Writes a text file so that it survives a power cut.
    pub(crate) fn write_text_durably(&self, name: &str, text: &str) -> Result<(), Failure> {
        Ok(write_durably(self.file(name), |file| file.write_all(text.as_bytes()))?)
    }

    /// Writes a file that only the whole work could make again. If the folder does not take it, as
    /// on a full disk, it goes into the system's folder for temporary files.
    pub(crate) fn write_precious(
        &self,
        name: &str,
        write: impl Fn(&Path) -> Result<(), gs_io::Error>,
    ) -> Result<(), Failure> {
        let Err(error) = write(&self.file(name)) else { return Ok(()) };
        let elsewhere = env::temp_dir().join(format!("gs-{}-{name}", process::id()));
        Err(match write(&elsewhere) {
            Ok(()) => Failure::from(error).hint(format_args!("it has been saved as {} instead", elsewhere.display())),
            Err(_) => error.into(),
        })
    }

    /// Writes a value as JSON so that it survives a power cut.
    pub(crate) fn write_json(&self, name: &str, value: &impl Serialize) -> Result<(), Failure> {
        let json = serde_json::to_string_pretty(value).map_err(|error| Failure::failed(error).at(name))?;
        self.write_text_durably(name, &(json + "\n"))
    }

    /// Removes files of an earlier run that this run does not write.
    pub(crate) fn leave_out<N: AsRef<str>>(&self, names: impl IntoIterator<Item = N>) -> Result<(), Failure> {
        Ok(names.into_iter().try_for_each(|name| self.remove(name.as_ref()))?)
    }

    /// Claims and writes files, given by name and content.
    pub(crate) fn write_all(&self, files: Vec<(String, Vec<u8>)>) -> Result<(), Failure> {
        self.claim(files.iter().map(|(name, _)| name.clone()))?;
        files.into_iter().try_for_each(|(name, bytes)| self.write(&name, bytes))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A folder in which a run has claimed these files.
    pub(crate) fn begun(path: &Path, files: &[&str]) -> OutputFolder {
        OutputFolder::begin(OverwriteArgs::default().claim(path, files.iter().copied(), Inputs::default())).unwrap()
    }

    #[test]
    fn a_refusal_names_the_flag_that_helps() {
        let place = tempfile::tempdir().unwrap();
        let photo = place.path().join("curve.svg");
        std::fs::write(&photo, "mine").unwrap();
        let line = |inputs: Inputs| {
            let claim = OverwriteArgs::default().claim(place.path(), ["curve.svg"], inputs);
            check(&claim).unwrap_err().line().unwrap()
        };
        let in_the_way = line(Inputs::default());
        assert!(in_the_way.contains("curve.svg: is in the way") && in_the_way.contains("--overwrite"), "{in_the_way}");
        let input = line(Inputs::from_iter([&photo]));
        assert!(input.contains("is an input of this run") && !input.contains("--overwrite"), "{input}");
        let below_a_file = OverwriteArgs::default().claim(&photo.join("out"), [], Inputs::default());
        let line = check(&below_a_file).unwrap_err().line().unwrap();
        assert!(line.ends_with("choose another folder with --output"), "{line}");

        let folder = begun(&place.path().join("out"), &["a"]);
        let line = check(&OverwriteArgs::default().claim(folder.path(), ["b"], Inputs::default())).unwrap_err();
        assert!(line.line().unwrap().contains("another run of gs is at work in this folder: wait for it"));
    }

    #[test]
    fn a_single_file_does_not_replace_its_input() {
        let place = tempfile::tempdir().unwrap();
        let [scene, copy, left] = ["scene.ply", "copy.ply", ".gs-abc123.tmp"].map(|name| place.path().join(name));
        std::fs::write(&scene, "ply").unwrap();
        std::fs::write(&left, "half").unwrap();
        assert!(check_file(&scene, [&scene]).unwrap_err().line().unwrap().contains("is an input of this run"));
        check_file(&copy, [&scene]).unwrap();
        assert!(!left.exists());
        assert_eq!(folder_of(Path::new("a.png")), Path::new("."));
    }
}
