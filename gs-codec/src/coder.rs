//! The entropy coder: bits with given probabilities, written, read or only counted.
//!
//! The models ask a [`Coder`] for one bit at a time, so encoder, decoder and estimator run the same
//! code and cannot disagree.

use std::{borrow::Borrow, num::NonZero};

use constriction::stream::{
    Encode,
    model::{EncoderModel, EntropyModel},
    queue::DefaultRangeEncoder,
};

/// Bits of a probability.
pub(crate) const PRECISION: usize = 16;

/// Something that codes bits.
pub(crate) trait Coder {
    /// Codes a bit: an encoder takes `bit` and returns it, a decoder ignores it and returns the one
    /// it has read. `one` is the probability that the bit is set, in units of 2⁻¹⁶, 1 to 65,535.
    fn code(&mut self, one: u16, bit: bool) -> bool;

    /// Codes a number below `count`, 1 to 2¹⁵, all equally likely.
    fn uniform(&mut self, count: u32, value: u32) -> u32;

    /// Whether the bytes of a truncated layer have ended or are damaged, so that the last numbers mean
    /// nothing.
    fn has_ended(&self) -> bool {
        false
    }
}

/// The distribution of one bit: 0 has the lower part of the interval.
#[derive(Debug, Clone, Copy)]
struct Bit {
    one: u16,
}

impl Bit {
    fn zero(self) -> u16 {
        0u16.wrapping_sub(self.one)
    }
}

impl EntropyModel<PRECISION> for Bit {
    type Symbol = bool;
    type Probability = u16;
}

impl EncoderModel<PRECISION> for Bit {
    fn left_cumulative_and_probability(&self, bit: impl Borrow<bool>) -> Option<(u16, NonZero<u16>)> {
        let (left, probability) = if *bit.borrow() { (self.zero(), self.one) } else { (0, self.zero()) };
        NonZero::new(probability).map(|probability| (left, probability))
    }
}

/// Numbers below `count`, all equally likely, but for the last, which has what is left.
#[derive(Debug, Clone, Copy)]
struct Uniform {
    count: u32,
}

impl Uniform {
    /// Where the interval of `value` starts, and its length.
    fn interval(self, value: u32) -> (u16, u32) {
        let share = 65_536 / self.count;
        let length = if value + 1 == self.count { 65_536 - share * value } else { share };
        ((share * value) as u16, length)
    }

    /// The value whose interval holds this number.
    fn value_at(self, quantile: u16) -> u32 {
        (u32::from(quantile) / (65_536 / self.count)).min(self.count - 1)
    }
}

impl EntropyModel<PRECISION> for Uniform {
    type Symbol = u32;
    type Probability = u16;
}

impl EncoderModel<PRECISION> for Uniform {
    fn left_cumulative_and_probability(&self, value: impl Borrow<u32>) -> Option<(u16, NonZero<u16>)> {
        let (left, length) = self.interval((*value.borrow()).min(self.count - 1));
        Some((left, NonZero::new(length as u16)?))
    }
}

/// Writes bits.
#[derive(Debug, Default)]
pub(crate) struct Encoder {
    range: DefaultRangeEncoder,
}

impl Encoder {
    /// The bytes written, without the zeros at their end, which a [`Decoder`] adds.
    pub(crate) fn finish(self) -> Vec<u8> {
        let words: Vec<u32> = self.range.into();
        let mut bytes: Vec<u8> = words.into_iter().flat_map(u32::to_be_bytes).collect();
        bytes.truncate(bytes.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1));
        bytes
    }
}

impl Coder for Encoder {
    fn code(&mut self, one: u16, bit: bool) -> bool {
        self.range.encode_symbol(bit, Bit { one }).expect("both bits are possible, and a vector takes all words");
        bit
    }

    fn uniform(&mut self, count: u32, value: u32) -> u32 {
        if count > 1 {
            self.range
                .encode_symbol(value, Uniform { count })
                .expect("all values are possible, and a vector takes all words");
        }
        value
    }
}

/// Reads bits.
#[derive(Debug)]
pub(crate) struct Decoder<'a> {
    bytes: &'a [u8],
    /// Words read so far, with those of zeros after the end.
    words: usize,
    /// Length of the interval.
    range: u64,
    /// The code less the lower end of the interval.
    point: u64,
    truncated: bool,
    invalid: bool,
}

impl<'a> Decoder<'a> {
    /// A decoder of the bytes of an [`Encoder`].
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { bytes, words: 0, range: u64::MAX, point: 0, truncated: false, invalid: false };
        for _ in 0..2 {
            decoder.point = decoder.point << 32 | decoder.word();
        }
        decoder
    }

    /// A decoder of the first bytes of an [`Encoder`].
    pub(crate) fn of_truncated(bytes: &'a [u8]) -> Self {
        Self { truncated: true, ..Self::new(&bytes[..bytes.len() / 4 * 4]) }
    }

    /// The next word; zeros follow the bytes.
    fn word(&mut self) -> u64 {
        let rest = self.bytes.get(4 * self.words..).unwrap_or_default();
        self.words += 1;
        let mut word = [0; 4];
        let there = rest.len().min(4);
        word[..there].copy_from_slice(&rest[..there]);
        u32::from_be_bytes(word).into()
    }

    /// Continues with the part of the interval that begins at `left` and has this length.
    fn narrow(&mut self, left: u64, length: u64) {
        (self.point, self.range) = (self.point.wrapping_sub(left), length);
        if self.range < 1 << 32 {
            self.range <<= 32;
            self.point = self.point << 32 | self.word();
        }
    }

    /// Whether some bit could not come from an encoder; those after it mean nothing.
    pub(crate) fn is_invalid(&self) -> bool {
        self.invalid
    }
}

impl Coder for Decoder<'_> {
    fn code(&mut self, one: u16, _: bool) -> bool {
        let scale = self.range >> PRECISION;
        let zero = scale * (65_536 - u64::from(one));
        let bit = self.point >= zero;
        self.invalid |= self.point >= scale << PRECISION;
        let (left, length) = if bit { (zero, scale * u64::from(one)) } else { (0, zero) };
        self.narrow(left, length);
        bit
    }

    fn uniform(&mut self, count: u32, _: u32) -> u32 {
        if count < 2 {
            return 0;
        }
        let scale = self.range >> PRECISION;
        let quantile = self.point / scale;
        self.invalid |= quantile >> PRECISION != 0;
        let uniform = Uniform { count };
        let value = uniform.value_at(quantile.min(65_535) as u16);
        let (left, length) = uniform.interval(value);
        self.narrow(scale * u64::from(left), scale * u64::from(length));
        value
    }

    fn has_ended(&self) -> bool {
        self.invalid || self.truncated && 4 * self.words > self.bytes.len()
    }
}

/// Counts the bits that an [`Encoder`] would write.
#[derive(Debug, Default)]
pub(crate) struct Estimator {
    /// Length so far, bits.
    pub(crate) bits: f64,
}

impl Coder for Estimator {
    fn code(&mut self, one: u16, bit: bool) -> bool {
        let share = if bit { f64::from(one) } else { 65_536.0 - f64::from(one) };
        self.bits += PRECISION as f64 - share.log2();
        bit
    }

    fn uniform(&mut self, count: u32, value: u32) -> u32 {
        self.bits += f64::from(count).log2();
        value
    }
}
