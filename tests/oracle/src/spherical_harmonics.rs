//! SH up to degree 3 with the signs of 3DGS, as polynomials of the unit direction. They are sums of
//! monomials, so that the gradient follows from the table by the power rule.

use std::f64::consts::PI;

use super::rounded::Rounded;

/// coefficient · xⁱ yʲ zᵏ.
type Monomial = (f64, [i32; 3]);

/// Y_k as a factor whose square is a rational multiple of 1/π, and the polynomial it multiplies.
///
/// The order within a degree is m = −l..=l; the sign is (−1)ᵐ (Condon–Shortley), which 3DGS keeps.
const BASIS: [([f64; 2], &[Monomial]); 16] = [
    ([1.0, 4.0], &[(1.0, [0, 0, 0])]),
    ([3.0, 4.0], &[(-1.0, [0, 1, 0])]),
    ([3.0, 4.0], &[(1.0, [0, 0, 1])]),
    ([3.0, 4.0], &[(-1.0, [1, 0, 0])]),
    ([15.0, 4.0], &[(1.0, [1, 1, 0])]),
    ([15.0, 4.0], &[(-1.0, [0, 1, 1])]),
    ([5.0, 16.0], &[(2.0, [0, 0, 2]), (-1.0, [2, 0, 0]), (-1.0, [0, 2, 0])]),
    ([15.0, 4.0], &[(-1.0, [1, 0, 1])]),
    ([15.0, 16.0], &[(1.0, [2, 0, 0]), (-1.0, [0, 2, 0])]),
    ([35.0, 32.0], &[(-3.0, [2, 1, 0]), (1.0, [0, 3, 0])]),
    ([105.0, 4.0], &[(1.0, [1, 1, 1])]),
    ([21.0, 32.0], &[(-4.0, [0, 1, 2]), (1.0, [2, 1, 0]), (1.0, [0, 3, 0])]),
    ([7.0, 16.0], &[(2.0, [0, 0, 3]), (-3.0, [2, 0, 1]), (-3.0, [0, 2, 1])]),
    ([21.0, 32.0], &[(-4.0, [1, 0, 2]), (1.0, [3, 0, 0]), (1.0, [1, 2, 0])]),
    ([105.0, 16.0], &[(1.0, [2, 0, 1]), (-1.0, [0, 2, 1])]),
    ([35.0, 32.0], &[(-1.0, [3, 0, 0]), (3.0, [1, 2, 0])]),
];

/// Y_k(d), k = 0..16.
pub(crate) fn basis(k: usize, d: &[Rounded; 3]) -> Rounded {
    let (_, monomials) = BASIS[k];
    factor(k) * monomials.iter().map(|&(c, powers)| c * power(d, powers)).sum()
}

/// ∂Y_k/∂d of the polynomial; only its component tangent to the sphere is meaningful.
pub(crate) fn gradient(k: usize, d: &[Rounded; 3]) -> [Rounded; 3] {
    let (_, monomials) = BASIS[k];
    std::array::from_fn(|axis| {
        let lowered = monomials.iter().filter(|(_, powers)| powers[axis] > 0).map(|&(c, mut powers)| {
            powers[axis] -= 1;
            c * f64::from(powers[axis] + 1) * power(d, powers)
        });
        factor(k) * lowered.sum()
    })
}

fn factor(k: usize) -> Rounded {
    let [numerator, denominator] = BASIS[k].0;
    Rounded { value: (numerator / (denominator * PI)).sqrt(), error: 0.0 }
}

fn power(d: &[Rounded; 3], powers: [i32; 3]) -> Rounded {
    (0..3).fold(Rounded::ONE, |product, axis| (0..powers[axis]).fold(product, |product, _| product * d[axis]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gauss–Legendre nodes of order 4 in z (exact to degree 7) times 8 equal angles (exact to
    /// degree 7).
    fn quadrature() -> Vec<([f64; 3], f64)> {
        let nodes =
            [(0.339_981_043_584_856_26, 0.652_145_154_862_546_1), (0.861_136_311_594_052_6, 0.347_854_845_137_453_9)];
        let mut points = Vec::new();
        for (z, weight) in nodes.into_iter().flat_map(|(z, w)| [(z, w), (-z, w)]) {
            for step in 0..8 {
                let angle = 2.0 * PI * (f64::from(step) + 0.3) / 8.0;
                let r = (1.0f64 - z * z).sqrt();
                points.push(([r * angle.cos(), r * angle.sin(), z], weight * 2.0 * PI / 8.0));
            }
        }
        points
    }

    fn at(k: usize, d: [f64; 3]) -> f64 {
        basis(k, &d.map(Rounded::exact)).value
    }

    #[test]
    fn the_basis_is_orthonormal_on_the_sphere() {
        let points = quadrature();
        assert!((points.iter().map(|p| p.1).sum::<f64>() - 4.0 * PI).abs() < 1e-12);
        for a in 0..16 {
            for b in 0..16 {
                let inner: f64 = points.iter().map(|&(d, w)| w * at(a, d) * at(b, d)).sum();
                let expected = f64::from(u8::from(a == b));
                assert!((inner - expected).abs() < 1e-12, "<Y{a}, Y{b}> = {inner}");
            }
        }
    }

    /// The values that 3DGS prints, with their signs.
    #[test]
    fn constants_are_those_of_3dgs() {
        let s = 3f64.sqrt().recip();
        let d = [s, s, s];
        assert!((at(0, d) - 0.282_094_791_773_878_14).abs() < 1e-15);
        for (k, c, polynomial) in [
            (1, -0.488_602_511_902_919_9, s),
            (2, 0.488_602_511_902_919_9, s),
            (3, -0.488_602_511_902_919_9, s),
            (4, 1.092_548_430_592_079_2, s * s),
            (5, -1.092_548_430_592_079_2, s * s),
            (7, -1.092_548_430_592_079_2, s * s),
            (9, -0.590_043_589_926_643_5, 2.0 * s.powi(3)),
            (10, 2.890_611_442_640_554, s.powi(3)),
            (11, -0.457_045_799_464_465_8, 2.0 * s.powi(3)),
            (12, 0.373_176_332_590_115_4, -4.0 * s.powi(3)),
            (13, -0.457_045_799_464_465_8, 2.0 * s.powi(3)),
            (15, -0.590_043_589_926_643_5, -2.0 * s.powi(3)),
        ] {
            assert!((at(k, d) - c * polynomial).abs() < 1e-14, "Y{k}");
        }
        assert!((at(6, [0.0, 0.0, 1.0]) - 2.0 * 0.315_391_565_252_520_05).abs() < 1e-15);
        assert!((at(8, [1.0, 0.0, 0.0]) - 0.546_274_215_296_039_6).abs() < 1e-15);
        assert!((at(14, [0.6, 0.0, 0.8]) - 1.445_305_721_320_277 * 0.8 * 0.36).abs() < 1e-14);
    }

    #[test]
    fn gradients_are_those_of_the_polynomials() {
        let d = [0.48, -0.6, 0.64];
        for k in 0..16 {
            let analytic = gradient(k, &d.map(Rounded::exact));
            for axis in 0..3 {
                let nudged = |step: f64| at(k, std::array::from_fn(|i| d[i] + if i == axis { step } else { 0.0 }));
                let numeric = (nudged(1e-5) - nudged(-1e-5)) / 2e-5;
                assert!((analytic[axis].value - numeric).abs() < 1e-9, "Y{k} along {axis}");
            }
        }
    }
}
