//! What this backend refuses, as errors.

use gs_core::{Cut, Error, RenderSettings};

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
    Ok(())
}
