//! Settings that `gs frontier` has chosen, as a file: how exactly to render, and on what. `gs render` and `gs fit` take it with --settings.

use std::path::Path;

use gs_core::{
    Accuracy, RenderSettings,
    effects::{Antialias, Order},
};
use serde::{Deserialize, Serialize};

use crate::{
    backend::check_flags,
    chosen_machine::ChosenMachine,
    failure::Failure,
    settings_file::{parse_toml, read_toml, to_toml},
};

/// What helps where such a file is wrong.
const MEND: &str = "gs frontier with --max-error or --max-ms writes such a file";

/// How exactly to render, and on what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct ChosenSettings {
    /// The approximations.
    #[serde(default)]
    pub(crate) accuracy: Accuracy,
    /// Which effects a 3D scene is shown with; an image's scene has its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) effects: Option<ChosenEffects>,
    /// What computes.
    pub(crate) machine: ChosenMachine,
}

/// The effects that are a matter of choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct ChosenEffects {
    /// In which order Gaussians are blended.
    pub(crate) order: Order,
    /// What is done about those narrower than a pixel.
    pub(crate) antialias: Antialias,
    /// Highest degree of the spherical harmonics; of a scene that has fewer, those that it has.
    pub(crate) sh_degree: u8,
}

impl ChosenSettings {
    /// Reads such a file.
    ///
    /// # Errors
    /// Where it cannot be read, is not of this kind, or a number in it is not possible.
    pub(crate) fn read(file: &Path) -> Result<Self, Failure> {
        read_toml::<Self>(file, MEND)?.checked(file)
    }

    /// What the text of a file says if it is such a file: nothing of a file of other settings, which has no machine.
    ///
    /// # Errors
    /// Where it is not of this kind, or a number in it is not possible.
    pub(crate) fn parse_if_chosen(text: &str, file: &Path) -> Result<Option<Self>, Failure> {
        let is_chosen = text.parse::<toml::Table>().is_ok_and(|table| table.contains_key("machine"));
        is_chosen.then(|| parse_toml::<Self>(text, file, MEND)?.checked(file)).transpose()
    }

    fn checked(self, file: &Path) -> Result<Self, Failure> {
        let failed = |error| Failure::usage(error).at(file.display()).mend(MEND);
        self.applied_to(RenderSettings::default()).validate().map_err(failed)?;
        self.machine.cpu.unwrap_or_default().validate().map_err(failed)?;
        check_flags(&self.machine.flags).map_err(|failure| failure.at(file.display()).mend(MEND))?;
        Ok(self)
    }

    /// The same rendering, as exactly as was chosen, and with the effects if there are any.
    pub(crate) fn applied_to(&self, mut render: RenderSettings) -> RenderSettings {
        render.accuracy = self.accuracy;
        if let Some(ChosenEffects { order, antialias, sh_degree }) = self.effects {
            (render.effects.order, render.effects.antialias, render.effects.sh_degree) = (order, antialias, sh_degree);
        }
        render
    }

    /// As a file, under these lines of comment.
    ///
    /// # Errors
    /// Where it cannot be written as TOML.
    pub(crate) fn to_file(&self, comment: &str) -> Result<String, Failure> {
        let comment: String = comment.lines().map(|line| format!("# {line}\n")).collect();
        Ok(comment + "\n" + &to_toml(self)?)
    }
}

#[cfg(test)]
mod tests {
    use std::process::ExitCode;

    use gs_core::Extent;
    use gs_cpu::{Bounds, CpuTuning};

    use super::*;
    use crate::chosen_machine::KernelsName;

    #[test]
    fn a_file_comes_back_as_it_was_written() {
        let accuracy = Accuracy::default().with(|s| {
            s.alpha_cut = 1.0 / 1024.0;
            s.extent = Extent::Sigmas(3.5);
        });
        let effects = ChosenEffects { order: Order::PerPixel, antialias: Antialias::Mip, sh_degree: 2 };
        let cpu = CpuTuning { bounds: Bounds::Box, tile_rows: Some(16), ..CpuTuning::default() };
        let flags = ["--backend", "cpu"].map(str::to_owned).to_vec();
        for (effects, cpu, kernels) in
            [(Some(effects), Some(cpu), None), (None, None, Some(KernelsName::Portable)), (None, None, None)]
        {
            let machine = ChosenMachine { flags: flags.clone(), cpu, kernels };
            let chosen = ChosenSettings { accuracy, effects, machine };
            let folder = tempfile::tempdir().unwrap();
            let file = folder.path().join("settings.toml");
            let text = chosen.to_file("two\nlines").unwrap();
            std::fs::write(&file, &text).unwrap();
            assert_eq!(ChosenSettings::read(&file).unwrap(), chosen);
            assert_eq!(ChosenSettings::parse_if_chosen(&text, &file).unwrap(), Some(chosen));
        }
    }

    #[test]
    fn kernels_of_earlier_versions_are_the_adapters_own_choice() {
        let parse = |name: &str| {
            let text = format!("[machine]\nkernels = '{name}'\n");
            ChosenSettings::parse_if_chosen(&text, Path::new("settings.toml"))
                .map(|chosen| chosen.unwrap().machine.kernels)
        };
        assert_eq!(parse("vectors").unwrap(), None);
        assert_eq!(parse("subgroups").unwrap(), Some(KernelsName::Subgroups));
        let line = parse("abacus").unwrap_err().line().unwrap();
        assert!(line.contains("abacus") && line.contains("portable"), "{line}");
    }

    #[test]
    fn what_is_not_possible_is_refused_and_other_settings_are_left_to_others() {
        let parse = |text: &str| ChosenSettings::parse_if_chosen(text, Path::new("settings.toml"));
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
}
