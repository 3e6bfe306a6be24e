//! A parallel stable radix sort by depth of all Gaussians in front of the camera, for stage `sort`.
//!
//! Least significant digit first. Each block of keys counts its digits; a sum over digits and
//! blocks gives the position of every block's keys of every digit; then the blocks scatter their
//! keys. A key's place does not depend on the number of threads. Keys are relaxed atomics, because
//! blocks write between each other's keys: plain stores, without `unsafe`.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

/// Fewest keys in a block.
const BLOCK: usize = 8192;

/// Largest number of blocks: each has a count per digit.
const MOST_BLOCKS: usize = 32;

const DIGIT_BITS: u32 = 11;
const DIGITS: usize = 1 << DIGIT_BITS;

/// Bit offsets of the digits of the depth in a key. The low half of a key is the Gaussian's index.
const SHIFTS: [u32; 3] = [32, 32 + DIGIT_BITS, 32 + 2 * DIGIT_BITS];

/// The sort, with its buffers.
#[derive(Debug, Default)]
pub(crate) struct DepthSort {
    keys: Vec<AtomicU64>,
    other: Vec<AtomicU64>,
    /// Per block: first the number of keys of each digit, then the position of the next one.
    digits: Vec<Vec<u32>>,
    len: usize,
}

impl DepthSort {
    /// Sorts the Gaussians whose depth is positive, nearest first, ties by index.
    pub(crate) fn sort(&mut self, depth: impl Fn(usize) -> f32 + Sync, count: usize) {
        self.collect(&depth, count);
        for shift in SHIFTS {
            self.pass(shift);
        }
    }

    /// Lists the Gaussians whose depth is positive, by index.
    pub(crate) fn collect(&mut self, depth: &(impl Fn(usize) -> f32 + Sync), count: usize) {
        self.keys.resize_with(count, AtomicU64::default);
        self.other.resize_with(count, AtomicU64::default);
        let block = BLOCK.max(count.div_ceil(MOST_BLOCKS));
        self.digits.resize_with(count.div_ceil(BLOCK).clamp(1, MOST_BLOCKS), || vec![0; DIGITS]);
        let of_block = |b: usize| b * block..((b + 1) * block).min(count);
        self.digits.par_iter_mut().enumerate().for_each(|(b, digits)| {
            digits[0] = of_block(b).filter(|&i| depth(i) > 0.0).count() as u32;
        });
        let mut next = 0;
        for digits in &mut self.digits {
            next += std::mem::replace(&mut digits[0], next);
        }
        self.len = next as usize;
        let keys = &self.keys;
        self.digits.par_iter().enumerate().for_each(|(b, digits)| {
            let mut at = digits[0] as usize;
            for i in of_block(b) {
                let depth = depth(i);
                if depth > 0.0 {
                    keys[at].store(u64::from(depth.to_bits()) << 32 | i as u64, Relaxed);
                    at += 1;
                }
            }
        });
    }

    fn pass(&mut self, shift: u32) {
        let digit = |key: u64| (key >> shift) as usize & (DIGITS - 1);
        let keys = &self.keys[..self.len];
        let block = BLOCK.max(self.len.div_ceil(MOST_BLOCKS));
        self.digits.par_iter_mut().enumerate().for_each(|(b, digits)| {
            digits.fill(0);
            for key in keys.iter().skip(b * block).take(block) {
                digits[digit(key.load(Relaxed))] += 1;
            }
        });
        let mut next = 0;
        for d in 0..DIGITS {
            let before = next;
            for digits in &mut self.digits {
                next += std::mem::replace(&mut digits[d], next);
            }
            if next - before == self.len as u32 {
                // All keys have the same digit.
                return;
            }
        }
        let other = &self.other;
        self.digits.par_iter_mut().enumerate().for_each(|(b, digits)| {
            for key in keys.iter().skip(b * block).take(block) {
                let key = key.load(Relaxed);
                let place = &mut digits[digit(key)];
                other[*place as usize].store(key, Relaxed);
                *place += 1;
            }
        });
        std::mem::swap(&mut self.keys, &mut self.other);
    }

    /// Number of Gaussians that were sorted.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// The Gaussian of this rank.
    #[inline(always)]
    pub(crate) fn at(&self, rank: usize) -> u32 {
        self.keys[rank].load(Relaxed) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_first_and_ties_by_index() {
        let mut sort = DepthSort::default();
        for count in [0, 1, 7, 1000, 100_000, 400_000] {
            // Many ties; a third of the Gaussians has no depth.
            let depth = |i: usize| {
                let hash = (i as u32).wrapping_mul(0x9E37_79B9) >> 12;
                if hash.is_multiple_of(3) { 0.0 } else { (hash % 5000) as f32 * 0.013 + 0.01 }
            };
            let mut expected: Vec<u32> = (0..count as u32).filter(|&i| depth(i as usize) > 0.0).collect();
            expected.sort_by(|&a, &b| depth(a as usize).total_cmp(&depth(b as usize)));
            sort.sort(depth, count);
            let found: Vec<u32> = (0..sort.len()).map(|rank| sort.at(rank)).collect();
            assert_eq!(found, expected, "{count}");
        }
    }
}
