//! Powers of two with fractional exponents, with the same bits on every machine.

use std::sync::LazyLock;

/// Units of an octave.
pub(crate) const OCTAVE: i32 = 128;

/// 2^(k/128) for k in 0..128: products of repeated square roots of 2.
///
/// Only multiplications and square roots take part, which IEEE 754 defines to the last bit;
/// `f64::exp2` may round differently on each platform.
static FRACTIONS: LazyLock<[f64; OCTAVE as usize]> = LazyLock::new(|| {
    let mut root = 2f64;
    let roots: [f64; 7] = std::array::from_fn(|_| {
        root = root.sqrt();
        root
    });
    std::array::from_fn(|k| {
        let product =
            |value: f64, (place, root): (usize, &f64)| if k >> (6 - place) & 1 == 1 { value * root } else { value };
        roots.iter().enumerate().fold(1.0, product)
    })
});

/// 2^(units/128), for exponents from −1000 to 1000.
pub(crate) fn exp2(units: i32) -> f64 {
    let whole = units.div_euclid(OCTAVE).clamp(-1000, 1000);
    let power = f64::from_bits(((1023 + whole) as u64) << 52);
    power * FRACTIONS[units.rem_euclid(OCTAVE) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_those_of_the_library() {
        for units in -3000..3000 {
            let expected = (f64::from(units) / f64::from(OCTAVE)).exp2();
            assert!((exp2(units) / expected - 1.0).abs() < 1e-14, "{units}: {} {expected}", exp2(units));
        }
        assert_eq!((exp2(0), exp2(128), exp2(-256), exp2(64)), (1.0, 2.0, 0.25, 2f64.sqrt()));
    }
}
