//! The gradients of all pairs of a Gaussian and a tile: tiles write them, in whatever order, and
//! Gaussians read theirs one after the other.
//!
//! Numbers are relaxed atomics, because tiles write between each other's: plain stores, without
//! `unsafe`.

use std::{
    ops::Range,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

use gs_core::{Error, memory};

/// Rows of the same number of `f32`.
#[derive(Debug, Default)]
pub(crate) struct Slots(Vec<AtomicU32>);

impl Slots {
    /// Makes `len` numbers, which are unspecified.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn fit(&mut self, len: usize) -> Result<(), Error> {
        memory::reserve(&mut self.0, len, "the gradients of all pairs of a Gaussian and a tile")?;
        self.0.resize_with(len, AtomicU32::default);
        Ok(())
    }

    /// Writes row `slot`.
    #[inline(always)]
    pub(crate) fn put(&self, slot: u32, numbers: &[f32]) {
        let places = &self.0[slot as usize * numbers.len()..][..numbers.len()];
        places.iter().zip(numbers).for_each(|(place, number)| place.store(number.to_bits(), Relaxed));
    }

    /// The sums over these rows, the first numbers of each.
    #[inline(always)]
    pub(crate) fn sums<const N: usize>(&self, slots: Range<usize>, stride: usize) -> [f32; N] {
        let mut sums = [0.0; N];
        for row in self.0[slots.start * stride..slots.end * stride].chunks_exact(stride) {
            for (sum, number) in sums.iter_mut().zip(row) {
                *sum += f32::from_bits(number.load(Relaxed));
            }
        }
        sums
    }
}
