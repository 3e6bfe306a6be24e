//! The targets of a training's steps, made when they are first needed and kept as far as memory allows.

use std::collections::{BTreeMap, btree_map::Entry};

use gs_core::{Rasterizer, Scene3d, TargetImage};
use gs_io::dataset::PosedImage;

use super::{color_map::ColorMap, resolution::reduced, view::PosedView};
use crate::error::Error;

/// Cache of target images.
pub(crate) struct Images<T> {
    /// Targets by view, all of one resolution.
    kept: BTreeMap<usize, T>,
    factor: u32,
    bytes: u64,
    /// Largest number of bytes.
    limit: u64,
    /// The last target for which there was no room.
    passing: Option<T>,
}

impl<T> Images<T> {
    /// An empty cache for at most this many bytes of targets.
    pub(crate) fn new(limit: u64) -> Self {
        Self { kept: BTreeMap::new(), factor: 1, bytes: 0, limit, passing: None }
    }

    /// Whether the target of a view is kept.
    pub(crate) fn has(&self, index: usize) -> bool {
        self.kept.contains_key(&index)
    }

    /// Forgets all targets: what they were made with has changed.
    pub(crate) fn forget(&mut self) {
        (self.kept, self.bytes) = (BTreeMap::new(), 0);
    }

    /// The target of view `index` at 1/`factor` of its size, which `make` makes if it is not there,
    /// with its number of bytes.
    ///
    /// # Errors
    /// Those of `make`.
    pub(crate) fn get(
        &mut self,
        index: usize,
        factor: u32,
        make: impl FnOnce() -> Result<(T, u64), Error>,
    ) -> Result<&T, Error> {
        if factor != self.factor {
            self.forget();
            self.factor = factor;
        }
        let place = match self.kept.entry(index) {
            Entry::Occupied(target) => return Ok(target.into_mut()),
            Entry::Vacant(place) => place,
        };
        let (target, bytes) = make()?;
        if self.bytes + bytes > self.limit {
            return Ok(self.passing.insert(target));
        }
        self.bytes += bytes;
        Ok(place.insert(target))
    }
}

/// The image of a view at 1/`factor` of its size, with mapped colours.
///
/// # Errors
/// Those of reading the image.
pub(crate) fn training_image(view: &PosedView, factor: u32, map: Option<&ColorMap>) -> Result<PosedImage, Error> {
    let mut posed = view.image()?;
    if factor > 1 {
        posed = reduced(&posed, factor)?;
    }
    if let Some(map) = map {
        posed.image = map.image(&posed.image);
    }
    Ok(posed)
}

/// Uploads an image over `background` as target; also returns its number of bytes.
pub(crate) fn target<R: Rasterizer<Scene3d>>(
    on: &R,
    posed: PosedImage,
    background: [f32; 3],
    compact: bool,
) -> Result<(R::Target, u64), Error> {
    let mask = posed.mask.clone();
    let image = posed.over(background)?;
    let target = TargetImage { mask: mask.as_deref(), compact, ..TargetImage::from(&image) };
    let float = size_of::<f32>() as u64;
    let coverage = if mask.is_none() { 0 } else { float };
    let bytes = coverage + if compact && target.is_8_bit() { 4 } else { 3 * float };
    Ok((on.upload_target(target)?, bytes * image.pixels().len() as u64))
}
