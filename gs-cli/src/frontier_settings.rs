//! The file of settings that `gs frontier` writes: how exactly to render, with which effects, and
//! on what. `gs render --settings` and `gs fit --settings` take it.

use std::path::Path;

use gs_core::{
    Accuracy, Effects, RenderSettings,
    effects::{Antialias, Order},
};
use gs_cpu::CpuTuning;
use gs_wgpu::Kernels;
use serde::{Deserialize, Deserializer, Serialize, de::Error as _};

use crate::{
    backend::BackendArgs,
    failure::Failure,
    output,
    text_file::{parse_toml, read_toml, to_toml},
};

/// How to get such a file where one is wrong.
const HINT: &str = "gs frontier with --max-error or --max-ms writes such a file";

/// How exactly to render, and on what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct FrontierSettings {
    /// The approximations.
    #[serde(default)]
    pub(crate) accuracy: Accuracy,
    /// The effects of a 3D scene; a 2D scene has its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) effects: Option<FrontierEffects>,
    /// What computes.
    pub(crate) machine: FrontierMachine,
}

/// The effects that the frontier chooses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct FrontierEffects {
    pub(crate) order: Order,
    pub(crate) antialias: Antialias,
    /// Highest degree of SH. A scene with fewer is rendered with those that it has.
    pub(crate) sh_degree: u8,
}

/// What computes.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct FrontierMachine {
    /// The flags that choose it. Flags on the command line override them.
    pub(crate) flags: Vec<String>,
    /// Tuning of the cpu backend.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) cpu: Option<CpuTuning>,
    /// Kernels of the wgpu backend, unless they are the adapter's usual ones: portable or
    /// subgroups.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "kernels")]
    pub(crate) kernels: Option<KernelsName>,
}

/// Kernels of the wgpu backend.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum KernelsName {
    Portable,
    Subgroups,
}

impl From<KernelsName> for Kernels {
    fn from(name: KernelsName) -> Self {
        match name {
            KernelsName::Portable => Self::Portable,
            KernelsName::Subgroups => Self::Subgroups,
        }
    }
}

/// The kernels of a name; none for `vectors`, which earlier versions had for software drivers.
fn kernels<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<KernelsName>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Stored {
        Name(KernelsName),
        Other(String),
    }
    match Stored::deserialize(deserializer)? {
        Stored::Name(name) => Ok(Some(name)),
        Stored::Other(name) if name == "vectors" => {
            output::note("machine.kernels \"vectors\" no longer exists: wgpu uses the usual kernels of the adapter");
            Ok(None)
        }
        Stored::Other(name) => Err(D::Error::unknown_variant(&name, &["portable", "subgroups"])),
    }
}

impl FrontierSettings {
    /// Reads such a file.
    pub(crate) fn read(file: &Path) -> Result<Self, Failure> {
        read_toml::<Self>(file, HINT)?.checked(file)
    }

    /// Parses the text of a file if it is such a file: any other settings file has no table
    /// `machine`.
    pub(crate) fn parse_if_any(text: &str, file: &Path) -> Result<Option<Self>, Failure> {
        let is_any = text.parse::<toml::Table>().is_ok_and(|table| table.contains_key("machine"));
        is_any.then(|| parse_toml::<Self>(text, file, HINT)?.checked(file)).transpose()
    }

    fn checked(self, file: &Path) -> Result<Self, Failure> {
        let failed = |error| Failure::usage(error).at(file.display()).hint(HINT);
        self.applied_to(RenderSettings::default()).validate().map_err(failed)?;
        self.machine.cpu.unwrap_or_default().validate().map_err(failed)?;
        self.machine.check_flags().map_err(|failure| failure.at(file.display()).hint(HINT))?;
        Ok(self)
    }

    /// Render settings with this accuracy, and with these effects if there are any.
    pub(crate) fn applied_to(&self, mut render: RenderSettings) -> RenderSettings {
        render.accuracy = self.accuracy;
        if let Some(FrontierEffects { order, antialias, sh_degree }) = self.effects {
            render.effects = Effects { order, antialias, sh_degree, ..render.effects };
        }
        render
    }

    /// The text of the file, under these lines of comment.
    pub(crate) fn to_file(&self, comment: &str) -> Result<String, Failure> {
        let comment: String = comment.lines().map(|line| format!("# {line}\n")).collect();
        Ok(comment + "\n" + &to_toml(self)?)
    }
}

impl FrontierMachine {
    /// Checks the flags of a file.
    fn check_flags(&self) -> Result<(), Failure> {
        let flags = &self.flags;
        let refused = |why: &str| Failure::usage(format_args!("machine.flags {flags:?}: {why}"));
        let first_line = |error: clap::Error| {
            let text = error.render().to_string();
            let line = text.lines().next().unwrap_or_default();
            refused(line.strip_prefix("error: ").unwrap_or("are not those that choose a backend"))
        };
        let args = BackendArgs::from_flags(flags).map_err(first_line)?;
        args.request().map(drop).map_err(|failure| refused(failure.message()))
    }

    /// The backend of this machine, unless flags choose another. The tuning is for this machine
    /// only.
    pub(crate) fn unless_given(&self, flags: &BackendArgs) -> BackendArgs {
        match BackendArgs::from_flags(&self.flags) {
            Ok(recorded) if flags.is_open() => BackendArgs {
                threads: flags.threads.or(recorded.threads),
                tuning: self.cpu.unwrap_or_default(),
                kernels: self.kernels.map(Into::into),
                ..recorded
            },
            _ => flags.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::process::ExitCode;

    use gs_core::Extent;
    use gs_cpu::Bounds;

    use super::*;
    use crate::backend::Choice;

    #[test]
    fn a_file_is_read_as_it_was_written() {
        let accuracy = Accuracy::default().with(|a| {
            a.alpha_cut = 1.0 / 1024.0;
            a.extent = Extent::Sigmas(3.5);
        });
        let effects = FrontierEffects { order: Order::PerPixel, antialias: Antialias::Mip, sh_degree: 2 };
        let cpu = CpuTuning { bounds: Bounds::Box, tile_rows: Some(16), ..CpuTuning::default() };
        let flags = ["--backend", "cpu"].map(str::to_owned).to_vec();
        for (effects, cpu, kernels) in
            [(Some(effects), Some(cpu), None), (None, None, Some(KernelsName::Portable)), (None, None, None)]
        {
            let machine = FrontierMachine { flags: flags.clone(), cpu, kernels };
            let settings = FrontierSettings { accuracy, effects, machine };
            let folder = tempfile::tempdir().unwrap();
            let file = folder.path().join("settings.toml");
            let text = settings.to_file("two\nlines").unwrap();
            std::fs::write(&file, &text).unwrap();
            assert_eq!(FrontierSettings::read(&file).unwrap(), settings);
            assert_eq!(FrontierSettings::parse_if_any(&text, &file).unwrap(), Some(settings));
        }
    }

    #[test]
    fn kernels_of_earlier_versions_become_the_usual_ones() {
        let parse = |name: &str| {
            let text = format!("[machine]\nkernels = '{name}'\n");
            FrontierSettings::parse_if_any(&text, Path::new("settings.toml"))
                .map(|settings| settings.unwrap().machine.kernels)
        };
        assert_eq!(parse("vectors").unwrap(), None);
        assert_eq!(parse("subgroups").unwrap(), Some(KernelsName::Subgroups));
        let line = parse("abacus").unwrap_err().line().unwrap();
        assert!(line.contains("abacus") && line.contains("portable"), "{line}");
    }

    #[test]
    fn impossible_values_are_refused_and_other_settings_files_ignored() {
        let parse = |text: &str| FrontierSettings::parse_if_any(text, Path::new("settings.toml"));
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
        let flags = ["--backend", "cpu", "--simd", "scalar", "--threads", "2"].map(str::to_owned).to_vec();
        let cpu = CpuTuning { tile_rows: Some(16), ..CpuTuning::default() };
        let machine = FrontierMachine { flags, cpu: Some(cpu), kernels: None };
        let open = machine.unless_given(&BackendArgs::default());
        assert_eq!((open.simd.as_deref(), open.threads, open.tuning), (Some("scalar"), Some(2), cpu));
        let given = machine.unless_given(&BackendArgs { backend: Choice::Cpu, ..BackendArgs::default() });
        assert_eq!((given.simd.as_deref(), given.threads, given.tuning), (None, None, CpuTuning::default()));
    }
}
