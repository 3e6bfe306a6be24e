//! The types of numbers in binary files.

/// A number type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Number {
    /// Size of a number, bytes.
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Decodes the number at the start of `bytes`. Numbers of all types fit an `f64`.
    pub(crate) fn decode<const LITTLE: bool>(self, bytes: &[u8]) -> f64 {
        fn array<const N: usize, const LITTLE: bool>(bytes: &[u8]) -> [u8; N] {
            let mut array = [0; N];
            array.copy_from_slice(&bytes[..N]);
            if !LITTLE {
                array.reverse();
            }
            array
        }
        match self {
            Self::I8 => f64::from(bytes[0].cast_signed()),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(i16::from_le_bytes(array::<2, LITTLE>(bytes))),
            Self::U16 => f64::from(u16::from_le_bytes(array::<2, LITTLE>(bytes))),
            Self::I32 => f64::from(i32::from_le_bytes(array::<4, LITTLE>(bytes))),
            Self::U32 => f64::from(u32::from_le_bytes(array::<4, LITTLE>(bytes))),
            Self::F32 => f64::from(f32::from_le_bytes(array::<4, LITTLE>(bytes))),
            Self::F64 => f64::from_le_bytes(array::<8, LITTLE>(bytes)),
        }
    }
}

/// The number of an IEEE half.
pub(crate) fn of_half(bits: u16) -> f32 {
    let sign = u32::from(bits >> 15) << 31;
    let (exponent, fraction) = (u32::from(bits >> 10 & 0x1f), u32::from(bits & 0x3ff));
    let magnitude = match exponent {
        0 => return f32::from_bits(sign | (fraction as f32 * 2.0_f32.powi(-24)).to_bits()),
        31 => 0xff << 23 | fraction << 13,
        _ => (exponent + 112) << 23 | fraction << 13,
    };
    f32::from_bits(sign | magnitude)
}

#[cfg(test)]
mod tests {
    use super::of_half;

    #[test]
    fn halves_are_exact() {
        let cases =
            [(0x3c00, 1.0), (0xc000, -2.0), (0x7bff, 65_504.0), (0x0001, 5.960_464_5e-8), (0x3555, 0.333_251_95)];
        cases.iter().for_each(|&(bits, value)| assert_eq!(of_half(bits), value));
        assert!(of_half(0x7c00).is_infinite() && of_half(0x7e00).is_nan() && of_half(0x8000).is_sign_negative());
    }
}
