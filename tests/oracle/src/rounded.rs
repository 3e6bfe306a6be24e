//! Numbers in `f64` with the error of their computation in `f32`: running error analysis
//! (Wilkinson; Higham, Accuracy and Stability of Numerical Algorithms, §3.3).
//!
//! The 3D projection and its derivatives use them. A surfel seen edge-on thus has a larger
//! tolerance than a ball, without a separate analysis that could differ from the formula.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Half the distance between neighbouring `f32` numbers, relative: the rounding of one operation.
pub(crate) const F32_ROUNDING: f64 = 5.960_464_477_539_063e-8;

/// Relative error that the analysis counts for one operation.
///
/// A rounding is at most [`F32_ROUNDING`]. The analysis adds magnitudes, but roundings rarely all
/// have one sign. With an eighth for each, the same [`ROUNDINGS`](crate::ROUNDINGS) fit 2D and 3D
/// scenes.
const OPERATION: f64 = F32_ROUNDING / 8.0;

/// Roundings of a square root or an exponential.
const FUNCTION: f64 = 2.0 * OPERATION;

/// A number and its uncertainty in `f32`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rounded {
    /// The number.
    pub value: f64,
    /// The uncertainty; a tolerance is a multiple of it.
    pub error: f64,
}

impl Rounded {
    pub(crate) const ZERO: Self = Self::exact(0.0);
    pub(crate) const ONE: Self = Self::exact(1.0);

    /// A number that is exact in `f32`: a parameter, an intrinsic, a small integer.
    pub(crate) const fn exact(value: f64) -> Self {
        Self { value, error: 0.0 }
    }

    /// A result whose operands contribute `inherited`.
    ///
    /// If the operands are exact and `f32` can represent the result, it is exact, too.
    fn result(value: f64, inherited: f64) -> Self {
        let exact = inherited == 0.0 && f64::from(value as f32) == value;
        Self { value, error: if exact { 0.0 } else { inherited + OPERATION * value.abs() } }
    }

    pub(crate) fn squared(self) -> Self {
        self * self
    }

    /// The square root of a number that is not negative.
    pub(crate) fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        let inherited = if value > 0.0 { 0.5 * self.error / value } else { self.error.sqrt() };
        Self { value, error: inherited + FUNCTION * value }
    }

    pub(crate) fn exp(self) -> Self {
        let value = self.value.exp();
        Self { value, error: value * (self.error + FUNCTION) }
    }

    /// Whether the value is finite in `f32`.
    pub(crate) fn is_finite(self) -> bool {
        self.value.abs() <= f64::from(f32::MAX) // NaN fails
    }

    /// The relative error; 0 for 0.
    pub(crate) fn relative(self) -> f64 {
        if self.value == 0.0 { 0.0 } else { self.error / self.value.abs() }
    }
}

impl Neg for Rounded {
    type Output = Self;

    fn neg(self) -> Self {
        Self { value: -self.value, ..self }
    }
}

impl Add for Rounded {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::result(self.value + other.value, self.error + other.error)
    }
}

impl Sub for Rounded {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Rounded {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let inherited = self.value.abs() * other.error + other.value.abs() * self.error;
        Self::result(self.value * other.value, inherited)
    }
}

impl Mul<Rounded> for f64 {
    type Output = Rounded;

    fn mul(self, other: Rounded) -> Rounded {
        Rounded::exact(self) * other
    }
}

impl Div for Rounded {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Self::result(value, (self.error + value.abs() * other.error) / other.value.abs())
    }
}

impl std::iter::Sum for Rounded {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(Self::ZERO, Add::add)
    }
}

/// A matrix of `ROWS` rows.
pub(crate) type Matrix<const ROWS: usize, const COLUMNS: usize> = [[Rounded; COLUMNS]; ROWS];

/// A B.
pub(crate) fn product<const I: usize, const J: usize, const K: usize>(
    a: &Matrix<I, J>,
    b: &Matrix<J, K>,
) -> Matrix<I, K> {
    std::array::from_fn(|i| std::array::from_fn(|k| (0..J).map(|j| a[i][j] * b[j][k]).sum()))
}

/// Aᵀ.
pub(crate) fn transposed<const I: usize, const J: usize>(a: &Matrix<I, J>) -> Matrix<J, I> {
    std::array::from_fn(|j| std::array::from_fn(|i| a[i][j]))
}

/// A v.
pub(crate) fn applied<const I: usize, const J: usize>(a: &Matrix<I, J>, v: &[Rounded; J]) -> [Rounded; I] {
    std::array::from_fn(|i| dot(&a[i], v))
}

/// a · b.
pub(crate) fn dot<const N: usize>(a: &[Rounded; N], b: &[Rounded; N]) -> Rounded {
    (0..N).map(|i| a[i] * b[i]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_in_f32_are_within_the_analysis() {
        // A sum with cancellation, a quotient and a root, in f32 and with its analysis.
        let mut worst: f64 = 0.0;
        for i in 1..200 {
            let (a, b, c) = (1.0 + i as f32 / 7.0, 3.1 / i as f32, 0.3 * i as f32);
            let plain = ((a * b - c / a + b).abs() / (a + c)).sqrt();
            let [x, y, z] = [a, b, c].map(|v| Rounded::exact(f64::from(v)));
            let signed = x * y - z / x + y;
            let positive = if signed.value < 0.0 { -signed } else { signed };
            let rounded = (positive / (x + z)).sqrt();
            worst = worst.max((f64::from(plain) - rounded.value).abs() / rounded.error);
        }
        assert!((1.0..8.0).contains(&worst), "{worst}");
    }

    #[test]
    fn exact_arithmetic_has_no_error() {
        let [a, b] = [Rounded::exact(0.75), Rounded::exact(-3.0)];
        assert_eq!((a * b + Rounded::ONE - b / a).error, 0.0);
        let uneven = Rounded::exact(f64::from(0.7f32));
        assert!((a / uneven).error > 0.0 && (a / uneven * uneven).error > 0.0);
    }
}
