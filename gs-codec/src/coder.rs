//! The entropy coder: bits with given probabilities, written, read or only counted.
//!
//! The models ask a [`Coder`] for one bit at a time, so encoder, decoder and estimator run the same
//! code and cannot disagree.

use std::{borrow::Borrow, num::NonZero};

use constriction::stream::{
    Code as _, Decode, Encode,
    model::{DecoderModel, EncoderModel, EntropyModel},
    queue::{DefaultRangeDecoder, DefaultRangeEncoder},
};

/// Bits of a probability.
pub(crate) const PRECISION: usize = 16;

/// Words that a decoder has read before its first symbol.
const WORDS_AHEAD: i64 = 2;

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

impl DecoderModel<PRECISION> for Bit {
    fn quantile_function(&self, quantile: u16) -> (bool, u16, NonZero<u16>) {
        let bit = quantile >= self.zero();
        let (left, probability) = if bit { (self.zero(), self.one) } else { (0, self.zero()) };
        (bit, left, NonZero::new(probability).unwrap_or(NonZero::<u16>::MIN))
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

impl DecoderModel<PRECISION> for Uniform {
    fn quantile_function(&self, quantile: u16) -> (u32, u16, NonZero<u16>) {
        let value = (u32::from(quantile) / (65_536 / self.count)).min(self.count - 1);
        let (left, length) = self.interval(value);
        (value, left, NonZero::new(length as u16).unwrap_or(NonZero::<u16>::MIN))
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
pub(crate) struct Decoder {
    range: DefaultRangeDecoder,
    invalid: bool,
    /// Words of a truncated layer that are not read yet; negative where one is missing.
    words_left: Option<i64>,
}

impl Decoder {
    /// A decoder of the bytes of an [`Encoder`].
    pub(crate) fn new(bytes: &[u8]) -> Self {
        let word = |chunk: &[u8]| {
            let mut word = [0; 4];
            word[..chunk.len()].copy_from_slice(chunk);
            u32::from_be_bytes(word)
        };
        let words: Vec<u32> = bytes.chunks(4).map(word).collect();
        let Ok(range) = DefaultRangeDecoder::from_compressed(words);
        Self { range, invalid: false, words_left: None }
    }

    /// A decoder of the first bytes of an [`Encoder`].
    pub(crate) fn of_truncated(bytes: &[u8]) -> Self {
        let words = bytes.len() / 4;
        Self { words_left: Some(words as i64 - WORDS_AHEAD), ..Self::new(&bytes[..4 * words]) }
    }

    /// Counts the word that is read where a symbol's interval of this length, of 2¹⁶, leaves a range
    /// below 2³².
    fn count_word(&mut self, range: u64, length: u32) {
        if let Some(left) = &mut self.words_left
            && (range >> PRECISION) * u64::from(length) < 1 << 32
        {
            *left -= 1;
        }
    }

    /// Whether some bit could not come from an encoder; those after it were read as 0.
    pub(crate) fn is_invalid(&self) -> bool {
        self.invalid
    }
}

impl Coder for Decoder {
    fn code(&mut self, one: u16, _: bool) -> bool {
        if self.invalid {
            return false;
        }
        let range = self.range.state().range().get();
        let bit = self.range.decode_symbol(Bit { one }).unwrap_or_else(|_| {
            self.invalid = true;
            false
        });
        self.count_word(range, if bit { one.into() } else { 65_536 - u32::from(one) });
        bit
    }

    fn uniform(&mut self, count: u32, _: u32) -> u32 {
        if self.invalid || count < 2 {
            return 0;
        }
        let range = self.range.state().range().get();
        let value = self.range.decode_symbol(Uniform { count }).unwrap_or_else(|_| {
            self.invalid = true;
            0
        });
        self.count_word(range, Uniform { count }.interval(value).1);
        value
    }

    fn has_ended(&self) -> bool {
        self.invalid || self.words_left.is_some_and(|left| left < 0)
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
