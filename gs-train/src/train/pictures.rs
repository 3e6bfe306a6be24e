//! The photographs of a training, read when they are first needed and kept as far as memory allows.

use std::collections::{BTreeMap, btree_map::Entry};

use gs_core::{Rasterizer, Scene3d, TargetImage};
use gs_io::dataset::PosedImage;

use super::{resolution::reduced, views::PosedView};
use crate::error::Error;

/// What has been read.
pub(super) struct Pictures<T> {
    /// By view, all of one resolution, where the backend computes.
    kept: BTreeMap<usize, T>,
    factor: u32,
    bytes: u64,
    /// Most bytes.
    limit: u64,
    /// The last that there was no room for.
    passing: Option<T>,
}

impl<T> Pictures<T> {
    /// None yet, and room for so many bytes.
    pub(super) fn new(limit: u64) -> Self {
        Self { kept: BTreeMap::new(), factor: 1, bytes: 0, limit, passing: None }
    }

    /// The picture of view `index` at 1/`factor` of its size, before `background` if that never changes, or else with its alpha.
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
    ) -> Result<&T, Error> {
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
        let (target, floats) = target(on, photograph, background)?;
        let bytes = floats * size_of::<f32>() as u64;
        if self.bytes + bytes > self.limit {
            return Ok(self.passing.insert(target));
        }
        self.bytes += bytes;
        Ok(place.insert(target))
    }
}

/// A photograph where the backend computes, before `background` if there is one, or else with its alpha; and how many numbers it has.
pub(super) fn target<R: Rasterizer<Scene3d>>(
    on: &R,
    photograph: PosedImage,
    background: Option<[f32; 3]>,
) -> Result<(R::Target, u64), Error> {
    let mask = photograph.mask.clone();
    let (image, alpha) = match background {
        Some(background) => (photograph.over(background), None),
        None => (photograph.image, photograph.alpha),
    };
    let target = TargetImage { image: &image, alpha: alpha.as_deref(), mask: mask.as_deref() };
    let floats = if alpha.is_none() && mask.is_none() { 3 } else { 4 };
    Ok((on.upload_target(target)?, floats * image.pixels().len() as u64))
}
