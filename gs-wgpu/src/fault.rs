//! Errors of the device.

use std::sync::{Arc, Mutex, PoisonError};

use gs_core::Error;

/// The name of this backend in errors.
pub(crate) const BACKEND: &str = "wgpu";

/// An error of this backend.
pub(crate) fn backend_error(message: impl Into<String>) -> Error {
    Error::Backend { backend: BACKEND, message: message.into() }
}

/// An error for an effect that this backend does not offer.
pub(crate) fn unsupported(effect: impl Into<String>) -> Error {
    Error::unsupported(BACKEND, effect)
}

/// The first error of a device.
#[derive(Debug, Clone, Default)]
pub(crate) struct Faults(Arc<Mutex<Option<String>>>);

impl Faults {
    pub(crate) fn note(&self, text: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(text);
    }

    /// Fails if there was an error.
    pub(crate) fn check(&self) -> Result<(), Error> {
        match &*self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            None => Ok(()),
            Some(fault) => Err(backend_error(fault.clone())),
        }
    }
}
