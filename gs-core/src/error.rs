//! Errors that a caller of gs-core, or of a backend, cannot foresee.

use std::ops::RangeBounds;

use thiserror::Error;

/// An error of the engine: scenes, views, settings and backends. File formats have their own, in
/// gs-io.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// Two arrays that describe the same Gaussians, or an image and its size, differ in length.
    #[error("{what}: expected {expected} values, found {found}")]
    Length {
        /// The array.
        what: &'static str,
        /// The length that the rest of the scene implies.
        expected: usize,
        /// The length that was found.
        found: usize,
    },
    /// A value that must be finite is NaN or infinite.
    #[error("{what} of Gaussian {index} is not finite ({value}); repair it, or remove that Gaussian")]
    NotFinite {
        /// The parameter.
        what: &'static str,
        /// The Gaussian.
        index: usize,
        /// The parameter's value.
        value: f32,
    },
    /// A setting is out of range.
    #[error("{what} is {value}, but must be {allowed}")]
    Setting {
        /// The setting.
        what: &'static str,
        /// The setting's value, printed.
        value: String,
        /// The range in words.
        allowed: &'static str,
    },
    /// An image or canvas of an impossible size.
    #[error("a size of {width}x{height} px is not possible: each side must be 1 to {limit} px")]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// The longest side.
        limit: u32,
    },
    /// Two images, or an image and a canvas, differ in size.
    #[error("sizes differ: {left_width}x{left_height} px against {right_width}x{right_height} px")]
    SizesDiffer {
        /// Columns of the first.
        left_width: u32,
        /// Rows of the first.
        left_height: u32,
        /// Columns of the second.
        right_width: u32,
        /// Rows of the second.
        right_height: u32,
    },
    /// The system refused memory for something large.
    #[error("{what}: {} of memory were refused; make it smaller, or free memory", crate::memory::amount(*bytes))]
    Memory {
        /// What the memory was for.
        what: &'static str,
        /// Bytes requested.
        bytes: u64,
    },
    /// A pixel that must be finite is NaN or infinite.
    #[error("{what} is not finite ({value}) in column {column} of row {row}; repair the image, or leave it out")]
    Pixel {
        /// The image.
        what: &'static str,
        /// The pixel's column, from 0.
        column: u32,
        /// The pixel's row, from 0.
        row: u32,
        /// The pixel's value.
        value: f32,
    },
    /// An edit plan does not fit its splats.
    #[error("edit plan: {0}")]
    Plan(String),
    /// The backend does not offer an effect.
    #[error("backend {backend} does not offer {effect}")]
    Unsupported {
        /// The backend.
        backend: &'static str,
        /// The effect and its value.
        effect: String,
    },
    /// A saved state that does not fit this kind of splats.
    #[error("state: {0}")]
    State(String),
    /// The backend failed: the device was lost, memory ran out.
    #[error("backend {backend}: {message}")]
    Backend {
        /// The backend.
        backend: &'static str,
        /// What happened, and what may help.
        message: String,
    },
}

impl Error {
    /// A setting outside its range; `allowed` completes "must be …".
    pub fn setting(what: &'static str, value: impl ToString, allowed: &'static str) -> Self {
        Self::Setting { what, value: value.to_string(), allowed }
    }

    /// An effect that a backend does not offer.
    pub fn unsupported(backend: &'static str, effect: impl Into<String>) -> Self {
        Self::Unsupported { backend, effect: effect.into() }
    }

    /// Checks that a setting lies in its range, which `allowed` says in words. NaN lies in none.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn within<T: PartialOrd + ToString>(
        what: &'static str,
        value: T,
        range: impl RangeBounds<T>,
        allowed: &'static str,
    ) -> Result<(), Self> {
        if range.contains(&value) { Ok(()) } else { Err(Self::setting(what, value, allowed)) }
    }
}
