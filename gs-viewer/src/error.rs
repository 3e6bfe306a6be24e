//! What can go wrong with a window.

use thiserror::Error;

/// An error of the viewer.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// There is no display.
    #[error("there is no display to open a window on, or it cannot be reached")]
    NoDisplay,
    /// The window failed.
    #[error("{what}: {message}")]
    Window {
        /// "the window cannot be opened" or the like.
        what: &'static str,
        /// What the system says.
        message: String,
    },
    /// The backend failed, or does not offer what the scene needs.
    #[error(transparent)]
    Backend(#[from] gs_core::Error),
    /// A 3D scene without a Gaussian that can be seen.
    #[error("the scene has no Gaussian that could be seen")]
    NothingVisible,
}
