//! Rotates SH coefficients, so that the rotated function has the old colours in the rotated
//! directions.
//!
//! *Source:* Ivanic and Ruedenberg 1996 (and its correction of 1998): the matrix of each degree
//!   follows from that of the degree below by products with that of degree 1, which is the rotation
//!   itself. 3DGS's SH have the sign (−1)^m.

use glam::{DMat3, Vec3};

/// The matrices of degrees 1 to 3 for one rotation.
#[derive(Debug)]
pub(crate) struct ShRotation {
    degrees: [Matrix; 3],
}

impl ShRotation {
    pub(crate) fn new(rotation: DMat3) -> Self {
        let first = Matrix::of_degree_1(rotation);
        let second = Matrix::of_next_degree(&first, &first);
        let third = Matrix::of_next_degree(&first, &second);
        Self { degrees: [first, second, third] }
    }

    /// Rotates the coefficients of a Gaussian, of any degree.
    pub(crate) fn apply(&self, coefficients: &mut [Vec3]) {
        for (matrix, l) in self.degrees.iter().zip(1_i32..) {
            let (start, len) = ((l * l) as usize, (2 * l + 1) as usize);
            let Some(part) = coefficients.get_mut(start..start + len) else { return };
            let mut old = [Vec3::ZERO; 7];
            old[..len].copy_from_slice(part);
            for (c, m) in part.iter_mut().zip(-l..) {
                let sum = (-l..=l).zip(&old).map(|(n, old)| {
                    let sign = if (m + n) % 2 == 0 { 1.0 } else { -1.0 };
                    old.as_dvec3() * (sign * matrix.get(m, n))
                });
                *c = sum.sum::<glam::DVec3>().as_vec3();
            }
        }
    }
}

/// The rotation matrix of the real SH of degree l without the sign (−1)^m: rows and columns run
/// from −l to l.
#[derive(Debug)]
struct Matrix {
    l: i32,
    values: [[f64; 7]; 7],
}

impl Matrix {
    fn get(&self, m: i32, n: i32) -> f64 {
        self.values[(m + self.l) as usize][(n + self.l) as usize]
    }

    /// The SH of degree 1 are y, z and x.
    fn of_degree_1(rotation: DMat3) -> Self {
        let mut values = [[0.0; 7]; 7];
        for (m, row) in [1, 2, 0].into_iter().enumerate() {
            for (n, column) in [1, 2, 0].into_iter().enumerate() {
                values[m][n] = rotation.col(column)[row];
            }
        }
        Self { l: 1, values }
    }

    fn of_next_degree(first: &Self, below: &Self) -> Self {
        let l = below.l + 1;
        let mut next = Self { l, values: [[0.0; 7]; 7] };
        for m in -l..=l {
            for n in -l..=l {
                next.values[(m + l) as usize][(n + l) as usize] = element(first, below, l, m, n);
            }
        }
        next
    }
}

/// Table 1 of the source: u U + v V + w W. A factor of 0 stands for indices that do not exist.
fn element(first: &Matrix, below: &Matrix, l: i32, m: i32, n: i32) -> f64 {
    let p = |i: i32, a: i32| match n {
        n if n == -l => first.get(i, 1) * below.get(a, 1 - l) + first.get(i, -1) * below.get(a, l - 1),
        n if n == l => first.get(i, 1) * below.get(a, l - 1) - first.get(i, -1) * below.get(a, 1 - l),
        n => first.get(i, 0) * below.get(a, n),
    };
    let denominator = f64::from(if n.abs() == l { 2 * l * (2 * l - 1) } else { (l + n) * (l - n) });
    let root = |numerator: i32| (f64::from(numerator) / denominator).sqrt();
    let mut sum = 0.0;
    let u = root((l + m) * (l - m));
    if u != 0.0 {
        sum += u * p(0, m);
    }
    let size = m.abs();
    let both = root((l + size - 1) * (l + size));
    sum += match m {
        0 => -0.5 * std::f64::consts::SQRT_2 * both * (p(1, 1) + p(-1, -1)),
        1 => 0.5 * both * std::f64::consts::SQRT_2 * p(1, 0),
        -1 => 0.5 * both * std::f64::consts::SQRT_2 * p(-1, 0),
        m if m > 0 => 0.5 * both * (p(1, m - 1) - p(-1, 1 - m)),
        m => 0.5 * both * (p(1, m + 1) + p(-1, -m - 1)),
    };
    let w = root((l - size - 1) * (l - size));
    if m != 0 && w != 0.0 {
        sum -= 0.5 * w * if m > 0 { p(1, m + 1) + p(-1, -m - 1) } else { p(1, m - 1) - p(-1, 1 - m) };
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// 3DGS's sixteen SH.
    fn basis(d: DVec3) -> [f64; 16] {
        let DVec3 { x, y, z } = d;
        let (xx, yy, zz) = (x * x, y * y, z * z);
        [
            0.282_094_791_773_878_14,
            -0.488_602_511_902_919_9 * y,
            0.488_602_511_902_919_9 * z,
            -0.488_602_511_902_919_9 * x,
            1.092_548_430_592_079_2 * x * y,
            -1.092_548_430_592_079_2 * y * z,
            0.315_391_565_252_520_05 * (2.0 * zz - xx - yy),
            -1.092_548_430_592_079_2 * x * z,
            0.546_274_215_296_039_6 * (xx - yy),
            -0.590_043_589_926_643_5 * y * (3.0 * xx - yy),
            2.890_611_442_640_554 * x * y * z,
            -0.457_045_799_464_465_8 * y * (4.0 * zz - xx - yy),
            0.373_176_332_590_115_4 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
            -0.457_045_799_464_465_8 * x * (4.0 * zz - xx - yy),
            1.445_305_721_320_277 * z * (xx - yy),
            -0.590_043_589_926_643_5 * x * (xx - 3.0 * yy),
        ]
    }

    #[test]
    fn colours_turn_with_the_directions() {
        let coefficients: [Vec3; 16] = std::array::from_fn(|k| Vec3::new((k as f32).sin(), 0.1 * k as f32, -0.7));
        let color = |c: &[Vec3], d: DVec3| c.iter().zip(basis(d)).map(|(c, y)| c.as_dvec3() * y).sum::<DVec3>();
        for rotation in [
            DMat3::from_rotation_z(0.4),
            DMat3::from_rotation_x(2.1) * DMat3::from_rotation_y(-0.8),
            DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)),
        ] {
            let turned = ShRotation::new(rotation);
            for degree in 0..=3_usize {
                let len = (degree + 1) * (degree + 1);
                let mut after = coefficients[..len].to_vec();
                turned.apply(&mut after);
                for direction in
                    [DVec3::X, DVec3::new(0.3, -0.8, 0.2).normalize(), DVec3::new(-1.0, 2.0, 3.0).normalize()]
                {
                    let (before, now) = (color(&coefficients[..len], direction), color(&after, rotation * direction));
                    assert!(before.abs_diff_eq(now, 2e-6), "degree {degree}: {before} {now}");
                }
            }
        }
    }
}
