//! What this backend refuses, as errors.

use gs_core::{Cut, Error, Extent, RenderSettings};

use crate::fault::BACKEND;

/// An error for an effect that this backend does not offer.
pub(crate) fn unsupported(effect: impl Into<String>) -> Error {
    Error::Unsupported { backend: BACKEND, effect: effect.into() }
}

/// Fails where a setting is impossible for both kinds of scenes.
pub(crate) fn check_settings(settings: &RenderSettings) -> Result<(), Error> {
    settings.validate()?;
    if settings.accuracy.cut != Cut::Hard {
        return Err(unsupported("a smooth cut, which would touch every pixel"));
    }
    if let Extent::Sigmas(k) = settings.accuracy.extent {
        return Err(unsupported(format!(
            "an extent of {k} standard deviations: its kernels have one cut for all Gaussians"
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use gs_core::Accuracy;

    use super::*;

    #[test]
    fn an_extent_in_standard_deviations_is_refused() {
        let mut settings = RenderSettings::default();
        check_settings(&settings).unwrap();
        settings.accuracy = Accuracy::default().with(|s| s.extent = Extent::Sigmas(3.0));
        let message = check_settings(&settings).unwrap_err().to_string();
        assert!(message.contains("wgpu") && message.contains("3 standard deviations"), "{message}");
    }
}
