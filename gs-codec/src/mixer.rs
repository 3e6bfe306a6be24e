//! Adaptive probabilities of bits, and their mixture.
//!
//! Each bit is predicted in several contexts at once. The predictions are mixed in the logistic
//! domain with weights that learn which context is right (as in the PAQ family of compressors,
//! Mahoney 2005). All arithmetic is in integers.

use crate::coder::Coder;

/// Contexts of a bit.
pub(crate) const INPUTS: usize = 3;

/// Largest logistic value, in units of 1/256.
const LARGEST: i32 = 2047;

/// Weight of a prediction that counts as it is.
const UNIT: i32 = 65_536;

/// First weight: three predictions that agree are a little surer than each.
const FIRST_WEIGHT: i32 = UNIT * 2 / 5;

/// Speed at which weights learn.
const LEARNING_RATE: i32 = 14;

/// 1 / (1 + exp(−x)) for x = −8, −7.5, …, 8, in units of 2⁻¹⁶.
const LOGISTIC: [i32; 33] = [
    22, 36, 60, 98, 162, 267, 439, 720, 1_179, 1_921, 3_108, 4_971, 7_812, 11_955, 17_625, 24_743, 32_768, 40_793,
    47_911, 53_581, 57_724, 60_565, 62_428, 63_615, 64_357, 64_816, 65_097, 65_269, 65_374, 65_438, 65_476, 65_500,
    65_514,
];

/// Probability, in units of 2⁻¹⁶, of a logistic value; linear between the values of [`LOGISTIC`].
const fn squash(value: i32) -> i32 {
    let limited = if value < -LARGEST { -LARGEST } else { value };
    let place = if limited > LARGEST { LARGEST } else { limited } + 2048;
    let (index, rest) = ((place >> 7) as usize, place & 127);
    LOGISTIC[index] + (((LOGISTIC[index + 1] - LOGISTIC[index]) * rest) >> 7)
}

/// The logistic value of each probability, in units of 2⁻¹²: the inverse of [`squash`].
static STRETCH: [i16; 4096] = {
    let mut inverse = [0; 4096];
    let (mut value, mut probability) = (-LARGEST, 0);
    while probability < inverse.len() {
        while value < LARGEST && squash(value) < probability as i32 * 16 + 8 {
            value += 1;
        }
        inverse[probability] = value as i16;
        probability += 1;
    }
    inverse
};

/// The probability of a set bit, learned from the bits so far.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Counter {
    /// Units of 2⁻¹⁶.
    one: u16,
    /// Bits so far, up to [`MEMORY`].
    seen: u8,
}

/// Number of bits after which a counter learns at a constant rate.
const MEMORY: u8 = 180;

/// Step of a counter by the bits that it has seen, units of 2⁻¹⁶: 1/(seen + 1.6), so that the first
/// bit does not decide alone.
static RATES: [i64; 256] = {
    let mut rates = [0; 256];
    let mut seen = 0;
    while seen < rates.len() {
        rates[seen] = 655_360 / (10 * seen as i64 + 16);
        seen += 1;
    }
    rates
};

impl Default for Counter {
    fn default() -> Self {
        Self { one: 1 << 15, seen: 0 }
    }
}

impl Counter {
    fn learn(&mut self, bit: bool) {
        let goal = if bit { 65_535 } else { 0 };
        let step = (goal - i64::from(self.one)) * RATES[usize::from(self.seen)];
        self.one = (i64::from(self.one) + (step >> 16)) as u16;
        self.seen = (self.seen + 1).min(MEMORY);
    }
}

/// Weights of the predictions of a bit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weights([i32; INPUTS]);

impl Default for Weights {
    fn default() -> Self {
        Self([FIRST_WEIGHT; INPUTS])
    }
}

/// Codes a bit with the mixture of the predictions of `counters`, which then learn.
pub(crate) fn code_bit(
    coder: &mut impl Coder,
    counters: [&mut Counter; INPUTS],
    weights: &mut Weights,
    bit: bool,
) -> bool {
    let inputs = counters.each_ref().map(|counter| i32::from(STRETCH[usize::from(counter.one >> 4)]));
    let sum: i32 = inputs.iter().zip(&weights.0).map(|(input, weight)| input * weight).sum();
    let one = squash(sum >> 16).clamp(32, 65_504);
    let bit = coder.code(one as u16, bit);
    let error = (i32::from(bit) * 65_535 - one) >> 4;
    for (weight, input) in weights.0.iter_mut().zip(inputs) {
        *weight = (*weight + ((input * error * LEARNING_RATE + 0x8000) >> 16)).clamp(-4 * UNIT, 4 * UNIT);
    }
    counters.into_iter().for_each(|counter| counter.learn(bit));
    bit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coder::Estimator;

    #[test]
    fn the_tables_are_logistic() {
        for (k, &value) in LOGISTIC.iter().enumerate() {
            let x = (k as f64 - 16.0) / 2.0;
            assert!((f64::from(value) - 65_536.0 / (1.0 + (-x).exp())).abs() < 1.0, "{k}");
        }
        for (k, pair) in STRETCH.windows(2).enumerate() {
            assert!(pair[0] <= pair[1] && (i32::from(pair[0]) + i32::from(STRETCH[4095 - k])).abs() < 24, "{k}");
        }
    }

    #[test]
    fn the_context_that_knows_the_bits_is_learned() {
        let bits: Vec<bool> = (0..4000u32).map(|k| k.wrapping_mul(2_654_435_761) >> 20 & 1 == 1).collect();
        let mut weights = Weights::default();
        let mut counters = [Counter::default(); 6];
        let mut cost = Estimator::default();
        for (k, &bit) in bits.iter().enumerate() {
            // The first context is the bit itself, the second the bit before, the third nothing.
            let [a, b, c] = [usize::from(bit), 2 + usize::from(k > 0 && bits[k - 1]), 4];
            let [one, two, three] = counters.get_disjoint_mut([a, b, c]).expect("different counters");
            code_bit(&mut cost, [one, two, three], &mut weights, bit);
        }
        assert!(cost.bits < 200.0, "{} bits", cost.bits);
    }
}
