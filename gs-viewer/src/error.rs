//! Errors of the viewer.

use thiserror::Error;

/// An error of the viewer.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// No display is available.
    #[error("there is no display to open a window on, or it cannot be reached")]
    NoDisplay,
    /// The window failed.
    #[error("{what}: {message}")]
    Window {
        /// The failure, such as "the window cannot be opened".
        what: &'static str,
        /// The system's message.
        message: String,
    },
    /// The backend failed, or does not offer what the scene needs.
    #[error(transparent)]
    Backend(#[from] gs_core::Error),
    /// A level of detail could not be read.
    #[error("{message}")]
    Levels {
        /// Why.
        message: String,
    },
    /// A 3D scene without a Gaussian that can be seen.
    #[error("the scene has no Gaussian that could be seen")]
    NothingVisible,
}
