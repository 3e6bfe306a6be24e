//! Models of numbers: a number is a few bits, each with its own counters in each context.

use crate::{
    coder::Coder,
    mixer::{Counter, INPUTS, Weights, code_bit},
};

/// Bits of a number that have counters: [`PREFIX`] for the length, then three for each length.
const NODES: usize = 80;
/// Longest length of a number in bits.
const PREFIX: usize = 20;
/// Nodes of the zero flag and the sign of signed numbers.
const ZERO: usize = NODES - 1;
const SIGN: usize = NODES - 2;

/// The model of one kind of number.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    counters: [Vec<[Counter; NODES]>; INPUTS],
    weights: [Weights; NODES],
}

/// A model in the contexts of one number.
struct InContext<'a> {
    counters: [&'a mut [Counter; NODES]; INPUTS],
    weights: &'a mut [Weights; NODES],
}

impl Model {
    /// A model whose contexts are numbers below these.
    pub(crate) fn new(contexts: [usize; INPUTS]) -> Self {
        Self {
            counters: contexts.map(|count| vec![[Counter::default(); NODES]; count]),
            weights: [Weights::default(); NODES],
        }
    }

    fn within(&mut self, contexts: [usize; INPUTS]) -> InContext<'_> {
        let [a, b, c] = &mut self.counters;
        let [i, j, k] = contexts;
        InContext { counters: [&mut a[i], &mut b[j], &mut c[k]], weights: &mut self.weights }
    }

    /// Codes a number below 2²⁰.
    pub(crate) fn unsigned(&mut self, coder: &mut impl Coder, contexts: [usize; INPUTS], value: u32) -> u32 {
        self.within(contexts).unsigned(coder, value)
    }

    /// Codes a number between ±2²⁰: whether it is 0, its sign, its size.
    pub(crate) fn signed(&mut self, coder: &mut impl Coder, contexts: [usize; INPUTS], value: i32) -> i32 {
        let mut model = self.within(contexts);
        if !model.bit(coder, ZERO, value != 0) {
            return 0;
        }
        let negative = model.bit(coder, SIGN, value < 0);
        let size = model.unsigned(coder, value.unsigned_abs().saturating_sub(1)) as i32 + 1;
        if negative { -size } else { size }
    }

    /// Codes a number below 2^`bits`, at most 6, its highest bit first.
    pub(crate) fn tree(&mut self, coder: &mut impl Coder, contexts: [usize; INPUTS], bits: u32, value: u32) -> u32 {
        let mut model = self.within(contexts);
        let mut node = 1usize;
        for place in (0..bits).rev() {
            let bit = model.bit(coder, node, value >> place & 1 == 1);
            node = node << 1 | usize::from(bit);
        }
        node as u32 - (1 << bits)
    }

    /// Codes a flag.
    pub(crate) fn flag(&mut self, coder: &mut impl Coder, contexts: [usize; INPUTS], value: bool) -> bool {
        self.within(contexts).bit(coder, ZERO, value)
    }
}

impl InContext<'_> {
    fn bit(&mut self, coder: &mut impl Coder, node: usize, bit: bool) -> bool {
        let counters = self.counters.each_mut().map(|counters| &mut counters[node]);
        code_bit(coder, counters, &mut self.weights[node], bit)
    }

    /// Codes a number below 2²⁰: the length of `value` + 1 in unary, then its bits after the first;
    /// the first two of these have counters.
    fn unsigned(&mut self, coder: &mut impl Coder, value: u32) -> u32 {
        let value = value.min((1 << PREFIX) - 2);
        let length = (value + 1).ilog2() as usize;
        let mut found = 0;
        while found < PREFIX - 1 && self.bit(coder, found, length > found) {
            found += 1;
        }
        let mut number = 1u32;
        for place in (0..found).rev() {
            let bit = (value + 1) >> place & 1 == 1;
            let depth = found - 1 - place;
            let bit = if depth < 2 {
                let node =
                    PREFIX + 3 * (found - 1).min(PREFIX - 2) + depth + usize::from(depth == 1) * (number & 1) as usize;
                self.bit(coder, node.min(SIGN - 1), bit)
            } else {
                coder.code(1 << 15, bit)
            };
            number = number << 1 | u32::from(bit);
        }
        number - 1
    }
}
