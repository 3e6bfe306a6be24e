//! Numbers in `f64` that know what computing them in `f32` may have changed: running error analysis (Wilkinson; Higham, Accuracy and
//! Stability of Numerical Algorithms, §3.3). What the 3D projection and its derivatives are written in, so that a surfel seen edge-on is
//! allowed more than a ball without a separate analysis that could differ from the formula.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Half the distance between neighbouring `f32` numbers, relative: the rounding of one operation.
pub(crate) const F32_ROUNDING: f64 = 5.960_464_477_539_063e-8;

/// What is counted for one operation, relative. Single roundings are at most [`F32_ROUNDING`] and seldom all fall to one side, as this
/// analysis adds them up; with an eighth of it for each, the same [`ROUNDINGS`](crate::ROUNDINGS) fit both kinds of scenes.
const OPERATION: f64 = F32_ROUNDING / 8.0;

/// Roundings of a square root or an exponential.
const FUNCTION: f64 = 2.0 * OPERATION;

/// A number and what `f32` may change it by.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rounded {
    /// The number.
    pub value: f64,
    /// What rounding may change it by; a tolerance is a multiple of it.
    pub error: f64,
}

impl Rounded {
    pub(crate) const ZERO: Self = Self::exact(0.0);
    pub(crate) const ONE: Self = Self::exact(1.0);

    /// A number that `f32` holds as it is: a parameter, an intrinsic, a small integer.
    pub(crate) const fn exact(value: f64) -> Self {
        Self { value, error: 0.0 }
    }

    /// A result whose operands contribute `inherited`. Of exact operands, a result that `f32` holds is exact too.
    fn result(value: f64, inherited: f64) -> Self {
        let exact = inherited == 0.0 && f64::from(value as f32) == value;
        Self { value, error: if exact { 0.0 } else { inherited + OPERATION * value.abs() } }
    }

    pub(crate) fn squared(self) -> Self {
        self * self
    }

    /// √, of what is not negative.
    pub(crate) fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        let inherited = if value > 0.0 { 0.5 * self.error / value } else { self.error.sqrt() };
        Self { value, error: inherited + FUNCTION * value }
    }

    pub(crate) fn exp(self) -> Self {
        let value = self.value.exp();
        Self { value, error: value * (self.error + FUNCTION) }
    }

    /// Whether it is finite in `f32`.
    pub(crate) fn is_finite(self) -> bool {
        self.value.abs() <= f64::from(f32::MAX) // NaN fails
    }

    /// Its error as a share of it; 0 for 0.
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
    fn what_f32_does_is_within_a_few_of_what_is_counted() {
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
