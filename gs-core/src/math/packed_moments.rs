//! Two Adam moments as one number ([`MomentFormat::Bf16`](crate::adam::MomentFormat)): the first is
//! the upper half, as bf16, and the second the lower half.
//!
//! A backend adds 16 random bits to the lower half of a moment and then cuts that half off, so that
//! the mean is exact. Infinities and NaN stay. The first moment takes the upper half of
//! [`random_bits`], the second the lower half.

/// The upper half of a number.
pub const UPPER: u32 = 0xFFFF_0000;

/// Packs two moments, each rounded towards zero.
#[inline]
pub fn packed(first: f32, second: f32) -> u32 {
    (first.to_bits() & UPPER) | (second.to_bits() >> 16)
}

/// The two moments of a packed number.
#[inline]
pub fn unpacked(both: u32) -> [f32; 2] {
    [f32::from_bits(both & UPPER), f32::from_bits(both << 16)]
}

/// Random bits for moment `number` of the Gaussian `index`, at its step number `steps`.
///
/// Numbers of SH coefficients above degree 0 count R, G, B of each coefficient in turn.
#[inline]
pub fn random_bits(index: u32, steps: u32, number: u32) -> u32 {
    let block = (index.wrapping_mul(0x85EB_CA6B) ^ steps.wrapping_mul(0xC2B2_AE35)).wrapping_add(number / 16 * 16);
    // The finalizer of MurmurHash3 with better constants (`lowbias32`, Wellons 2018).
    let bits = (number % 16).wrapping_mul(0x9E37_79B9).wrapping_add(block.wrapping_mul(0x27D4_EB2F));
    let bits = (bits ^ (bits >> 16)).wrapping_mul(0x21F0_AAAD);
    let bits = (bits ^ (bits >> 15)).wrapping_mul(0x735A_2D97);
    bits ^ (bits >> 15)
}
