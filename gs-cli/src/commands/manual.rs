//! `gs manual`: man pages, and completions of shells.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use clap::Args;
use clap_complete::Shell;

use crate::failure::Failure;

/// The flags of `gs manual`.
#[derive(Debug, Clone, Args)]
pub(crate) struct ManualArgs {
    /// The folder to write: man/ for man pages, completions/ for bash, zsh, fish and PowerShell
    folder: PathBuf,
    /// The name of the command, where that is not gs
    #[arg(default_value = "gs")]
    name: String,
}

/// Writes the folder for a command line.
pub(crate) fn run(args: &ManualArgs, command_line: fn() -> clap::Command) -> Result<(), Failure> {
    write(&args.folder, &args.name, command_line).map_err(|error| Failure::failed(error).at(args.folder.display()))
}

fn write(folder: &Path, name: &str, command_line: fn() -> clap::Command) -> io::Result<()> {
    // What it is called lives as long as the program.
    let name: &'static str = name.to_owned().leak();
    let command = || command_line().name(name).bin_name(name);
    let [man, completions] = ["man", "completions"].map(|name| folder.join(name));
    fs::create_dir_all(&man)?;
    clap_mangen::generate_to(command(), &man)?;
    fs::create_dir_all(&completions)?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish, Shell::PowerShell] {
        clap_complete::generate_to(shell, &mut command(), name, &completions)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command_line::ungrouped;

    #[test]
    fn each_command_has_a_page_and_completions() {
        let place = tempfile::tempdir().unwrap();
        write(place.path(), "gs", ungrouped).unwrap();
        let text = |name: &str| fs::read_to_string(place.path().join(name)).unwrap();
        assert!(text("man/gs-fit.1").contains("\\-\\-gaussians"), "{}", text("man/gs-fit.1"));
        for shell in ["gs.bash", "_gs", "gs.fish", "_gs.ps1"] {
            let text = text(&format!("completions/{shell}"));
            assert!(text.contains("train") && text.contains("gaussians"), "{text}");
        }
        assert!(!place.path().join("man/gs-manual.1").exists());
    }

    #[test]
    fn another_name_is_that_of_pages_and_completions() {
        let place = tempfile::tempdir().unwrap();
        write(place.path(), "splats", ungrouped).unwrap();
        let text = |name: &str| fs::read_to_string(place.path().join(name)).unwrap();
        for file in ["man/splats.1", "man/splats-fit.1"] {
            assert!(
                text(file).contains("splats") && !text(file).contains("gs\\-fit") && !text(file).contains("gs\\-train"),
                "{}",
                text(file)
            );
        }
        assert!(text("completions/splats.bash").contains("complete -F _splats"), "{}", text("completions/splats.bash"));
    }
}
