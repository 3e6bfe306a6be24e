//! What this backend refuses, as errors.

use gs_core::Error;

/// The backend's name in errors.
pub(crate) const BACKEND: &str = "cpu";

/// An error for an effect that this backend does not offer.
pub(crate) fn unsupported(effect: impl Into<String>) -> Error {
    Error::unsupported(BACKEND, effect)
}
