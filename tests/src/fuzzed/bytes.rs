//! Numbers from bytes. Each takes a fixed number of bytes, so that changing one byte changes one
//! number.

use std::ops::Range;

/// Numbers at which arithmetic breaks, or nearly does.
const HOSTILE: [f32; 32] = [
    0.0,
    -0.0,
    1e-45,
    -1e-45,
    f32::MIN_POSITIVE,
    f32::EPSILON,
    1e-20,
    1e-7,
    1.0 / 255.0,
    0.003_921_569,
    0.5,
    1.0,
    -1.0,
    17.0,
    -17.0,
    88.0,
    -88.0,
    104.0,
    -104.0,
    1e4,
    -1e4,
    16_777_216.0,
    1e10,
    -1e10,
    1e19,
    -1e19,
    1e30,
    f32::MAX,
    f32::MIN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::NAN,
];

/// Bytes that are consumed from the front, followed by zeros.
pub(super) struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn byte(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    /// A number below `count`, which is 1 to 256.
    pub(super) fn below(&mut self, count: usize) -> usize {
        usize::from(self.byte()) % count
    }

    /// One of these choices.
    pub(super) fn pick<T: Copy, const N: usize>(&mut self, choices: [T; N]) -> T {
        choices[self.below(N)]
    }

    /// A number in this range, one of 65,536.
    pub(super) fn within(&mut self, range: Range<f32>) -> f32 {
        let share = f32::from(u16::from_le_bytes([self.byte(), self.byte()])) / 65_536.0;
        range.start + (range.end - range.start) * share
    }

    /// A number in the range `tame`, or a hostile one in one of `rarity` cases.
    pub(super) fn wild(&mut self, tame: Range<f32>, rarity: u8) -> f32 {
        let (chance, which) = (self.byte(), self.byte());
        let tame = tame.start + (tame.end - tame.start) * f32::from(which) / 256.0;
        if chance.is_multiple_of(rarity) { HOSTILE[usize::from(which) % HOSTILE.len()] } else { tame }
    }
}
