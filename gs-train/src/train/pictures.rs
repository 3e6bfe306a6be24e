//! The photographs of a training, read when they are first needed and kept as far as memory allows.

use std::collections::{BTreeMap, btree_map::Entry};

use gs_core::{Rasterizer, Scene3d};
use gs_io::dataset::PosedImage;

use super::{resolution::reduced, views::PosedView};
use crate::error::Error;

/// A photograph as a step uses it.
pub(super) enum Picture<T> {
    /// The same in every step: where the backend computes.
    Target(T),
    /// To be put on another background in each step, or masked.
    PosedImage(PosedImage),
}

/// What has been read.
pub(super) struct Pictures<T> {
    /// By view, all of one resolution.
    kept: BTreeMap<usize, Picture<T>>,
    factor: u32,
    bytes: u64,
    /// Most bytes.
    limit: u64,
    /// The last that there was no room for.
    passing: Option<Picture<T>>,
}

impl<T> Pictures<T> {
    /// None yet, and room for so many bytes.
    pub(super) fn new(limit: u64) -> Self {
        Self { kept: BTreeMap::new(), factor: 1, bytes: 0, limit, passing: None }
    }

    /// The picture of view `index` at 1/`factor` of its size, on `background` if that never changes.
    ///
    /// # Errors
    /// Those of reading it, and of the backend.
    pub(super) fn get<R: Rasterizer<Scene3d, Target = T>>(
        &mut self,
        on: &R,
        view: &PosedView,
        index: usize,
        factor: u32,
        background: Option<[f32; 3]>,
    ) -> Result<&Picture<T>, Error> {
        if factor != self.factor {
            (self.kept, self.bytes, self.factor) = (BTreeMap::new(), 0, factor);
        }
        let place = match self.kept.entry(index) {
            Entry::Occupied(picture) => return Ok(picture.into_mut()),
            Entry::Vacant(place) => place,
        };
        let mut photograph = view.photograph()?;
        if factor > 1 {
            photograph = reduced(&photograph, factor)?;
        }
        let pixels = photograph.image.pixels().len() as u64;
        let fixed = photograph.alpha.is_none() || background.is_some();
        let picture = match photograph.mask.is_none() && fixed {
            true => Picture::Target(on.upload_target(&photograph.over(background.unwrap_or_default()))?),
            false => Picture::PosedImage(photograph),
        };
        // Three floats a pixel; a fourth for alpha and a byte for the mask where they are kept.
        let bytes = pixels * if matches!(picture, Picture::Target(_)) { 12 } else { 17 };
        if self.bytes + bytes > self.limit {
            return Ok(self.passing.insert(picture));
        }
        self.bytes += bytes;
        Ok(place.insert(picture))
    }
}
