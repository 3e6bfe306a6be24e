//! The file of settings that `gs frontier` writes, which `gs render --settings` and
//! `gs fit --settings` take.

use std::path::Path;

use gs_lab::price::{FrontierMachine, FrontierSettings};

use super::backend::BackendArgs;
use crate::{failure::Failure, files::text_file::read_settings_text};

/// How to get a settings file of `gs frontier` where one is wrong.
const HINT: &str = "gs frontier with --max-error or --max-ms writes such a file";

/// Reads such a file.
pub(crate) fn read(file: &Path) -> Result<FrontierSettings, Failure> {
    parse(&read_settings_text(file)?, file)
}

/// Parses the text of a file if it is such a file.
pub(crate) fn parse_if_any(text: &str, file: &Path) -> Result<Option<FrontierSettings>, Failure> {
    FrontierSettings::is_in(text).then(|| parse(text, file)).transpose()
}

fn parse(text: &str, file: &Path) -> Result<FrontierSettings, Failure> {
    let settings = FrontierSettings::from_toml(text, file).map_err(|error| Failure::usage(error).hint(HINT))?;
    check_flags(&settings.machine.flags).map_err(|failure| failure.at(file.display()).hint(HINT))?;
    Ok(settings)
}

/// Checks the flags of a file.
fn check_flags(flags: &[String]) -> Result<(), Failure> {
    let refused = |why: &str| Failure::usage(format_args!("machine.flags {flags:?}: {why}"));
    let first_line = |error: clap::Error| {
        let text = error.render().to_string();
        let line = text.lines().next().unwrap_or_default();
        refused(line.strip_prefix("error: ").unwrap_or("are not those that choose a backend"))
    };
    let args = BackendArgs::from_flags(flags).map_err(first_line)?;
    args.request().map(drop).map_err(|failure| refused(failure.message()))
}

/// The backend of the file's machine, unless flags choose another. The tuning is for that machine
/// only.
pub(crate) fn backend(machine: &FrontierMachine, flags: &BackendArgs) -> BackendArgs {
    match BackendArgs::from_flags(&machine.flags) {
        Ok(recorded) if flags.is_open() => BackendArgs {
            threads: flags.threads.or(recorded.threads),
            tuning: machine.cpu.unwrap_or_default(),
            kernels: machine.kernels,
            ..recorded
        },
        _ => flags.clone(),
    }
}

#[cfg(test)]
mod tests {
    use std::process::ExitCode;

    use gs_cpu::CpuTuning;

    use super::*;
    use gs_backend::Wanted;

    #[test]
    fn impossible_values_are_refused_and_other_settings_files_ignored() {
        let parse = |text: &str| parse_if_any(text, Path::new("settings.toml"));
        for bad in
            ["[machine]\n[accuracy]\nalpha-cut = 7\n", "[machine]\ncpu = { tile-rows = 3 }\n", "[machine]\nx = 1\n"]
        {
            assert!(parse(bad).is_err(), "{bad}");
        }
        for (flags, why) in [
            ("'--backend', 'cuda'", "invalid value 'cuda'"),
            ("'--abacus'", "unexpected argument '--abacus'"),
            ("'--help'", "are not those that choose a backend"),
            ("'--backend', 'wgpu', '--simd', 'avx2'", "leave out one of the two"),
        ] {
            let refused = parse(&format!("machine.flags = [{flags}]\n")).unwrap_err();
            let line = refused.line().unwrap();
            assert!(line.starts_with("error: settings.toml: machine.flags [") && line.contains(why), "{line}");
            assert_eq!(refused.status(), ExitCode::from(2));
        }
        assert_eq!(parse("iterations = 7\n").unwrap(), None);
    }

    #[test]
    fn tuning_is_used_on_its_own_machine_only() {
        let flags = ["--backend", "cpu", "--simd", "baseline", "--threads", "2"].map(str::to_owned).to_vec();
        let cpu = CpuTuning::default().with(|s| s.tile_rows = Some(16));
        let mut machine = FrontierMachine::default();
        (machine.flags, machine.cpu) = (flags, Some(cpu));
        let open = backend(&machine, &BackendArgs::default());
        assert_eq!((open.simd.as_deref(), open.threads, open.tuning), (Some("baseline"), Some(2), cpu));
        let given = backend(&machine, &BackendArgs { backend: Wanted::Cpu, ..BackendArgs::default() });
        assert_eq!((given.simd.as_deref(), given.threads, given.tuning), (None, None, CpuTuning::default()));
    }
}
