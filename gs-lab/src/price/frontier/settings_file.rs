//! The settings that a search of the frontier ends with: how exactly to render, with which effects,
//! and on what.

use std::path::Path;

use gs_core::{
    Accuracy, Effects, RenderSettings,
    effects::{Antialias, Order},
};
use gs_cpu::CpuTuning;
use gs_train::{parse_settings, settings_to_toml};
use gs_wgpu::Kernels;
use serde::{Deserialize, Serialize};

use crate::error::Error;

/// How exactly to render, and on what. `gs frontier` writes it as a TOML file, which
/// `gs render --settings` and `gs fit --settings` take.
///
/// ```
/// use gs_lab::price::FrontierSettings;
///
/// let text = "[accuracy]\nalpha-cut = 0.001\n[machine]\nflags = ['--backend', 'cpu']\n";
/// let settings = FrontierSettings::from_toml(text, "settings.toml".as_ref())?;
/// assert_eq!(settings.machine.flags, ["--backend", "cpu"]);
/// # Ok::<(), String>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct FrontierSettings {
    /// The approximations.
    #[serde(default)]
    pub accuracy: Accuracy,
    /// The effects of a 3D scene; a 2D scene has its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) effects: Option<FrontierEffects>,
    /// The backend and machine that compute.
    pub machine: FrontierMachine,
}

/// The effects that the frontier chooses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub(crate) struct FrontierEffects {
    /// Order of blending.
    pub(crate) order: Order,
    /// Treatment of Gaussians narrower than a pixel.
    pub(crate) antialias: Antialias,
    /// Highest degree of SH, 0 to 3. A scene with fewer is rendered with those that it has.
    pub(crate) sh_degree: u8,
}

/// What computes.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct FrontierMachine {
    /// The flags of `gs` that choose the machine; empty where another program chooses it.
    pub flags: Vec<String>,
    /// Tuning of the cpu backend; `None` for the default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cpu: Option<CpuTuning>,
    /// Kernels of the wgpu backend, unless they are the adapter's usual ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kernels: Option<Kernels>,
}

impl FrontierSettings {
    /// Whether the text of a settings file holds settings of the frontier: that of a fit or a
    /// training has no table `machine`.
    pub fn is_in(text: &str) -> bool {
        text.parse::<toml::Table>().is_ok_and(|table| table.contains_key("machine"))
    }

    /// Parses the text of a settings file; `file` is its name for the error. The flags are not checked.
    ///
    /// # Errors
    /// What is wrong and where: a text that is no such file, or the first number outside its range.
    pub fn from_toml(text: &str, file: &Path) -> Result<Self, String> {
        let settings: Self = parse_settings(text, file).map_err(|error| error.to_string())?;
        let render = settings.applied_to(RenderSettings::default()).validate();
        let checked = render.and_then(|()| settings.machine.cpu.unwrap_or_default().validate());
        checked.map_err(|error| format!("{}: {error}", file.display()))?;
        Ok(settings)
    }

    /// The settings as the text of a TOML file.
    ///
    /// # Errors
    /// Those of [`settings_to_toml`].
    pub(crate) fn to_toml(&self) -> Result<String, Error> {
        Ok(settings_to_toml(self)?)
    }

    /// Render settings with this accuracy, and with these effects if there are any.
    #[must_use]
    pub fn applied_to(&self, mut render: RenderSettings) -> RenderSettings {
        render.accuracy = self.accuracy;
        if let Some(FrontierEffects { order, antialias, sh_degree }) = self.effects {
            render.effects = Effects { order, antialias, sh_degree, ..render.effects };
        }
        render
    }
}

impl FrontierEffects {
    /// Returns the effects among these that the frontier chooses.
    pub(crate) const fn of(effects: &Effects) -> Self {
        // Each effect is named, so that a new one cannot be forgotten: a 3D scene has a kind of
        // blending of its own, and backgrounds and statistics do not change what is compared.
        let &Effects { order, antialias, sh_degree, blend: _, background: _, statistics: _ } = effects;
        Self { order, antialias, sh_degree }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_are_known_by_name() {
        let parse = |name: &str| {
            let text = format!("[machine]\nkernels = '{name}'\n");
            FrontierSettings::from_toml(&text, "settings.toml".as_ref()).map(|settings| settings.machine.kernels)
        };
        assert_eq!(parse("subgroups").unwrap(), Some(Kernels::Subgroups));
        let message = parse("abacus").unwrap_err().to_string();
        assert!(
            message.ends_with("unknown name `abacus` in [machine], which is none of portable, subgroups"),
            "{message}"
        );
        let misspelt = parse("subgroup").unwrap_err().to_string();
        assert!(misspelt.ends_with("did you mean `subgroups`?"), "{misspelt}");
    }

    #[test]
    fn impossible_values_are_refused_and_other_settings_files_recognised() {
        for bad in ["[machine]\n[accuracy]\nalpha-cut = 7\n", "[machine]\ncpu = { tile-rows = 3 }\n"] {
            assert!(FrontierSettings::is_in(bad));
            let message = FrontierSettings::from_toml(bad, "settings.toml".as_ref()).unwrap_err();
            assert!(message.starts_with("settings.toml: ") && message.contains("must be"), "{message}");
        }
        assert!(!FrontierSettings::is_in("iterations = 7\n"));
    }
}
