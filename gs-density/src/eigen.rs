//! Eigenvalues of symmetric matrices.

use glam::{DMat3, DVec3};

/// Sweeps of rotations; each squares what is left off the diagonal, so that a few are enough.
const SWEEPS: usize = 12;

/// The smallest eigenvalue of a symmetric matrix, and its eigenvector of length 1.
pub(crate) fn smallest(matrix: DMat3) -> (f64, DVec3) {
    let (values, vectors) = decomposed(matrix);
    let least = (0..3).min_by(|&i, &j| values[i].total_cmp(&values[j])).unwrap_or_default();
    (values[least], vectors.col(least))
}

/// The eigenvalues of a symmetric matrix, and its eigenvectors as the columns of a rotation, by
/// Jacobi rotations.
pub(crate) fn decomposed(matrix: DMat3) -> (DVec3, DMat3) {
    let (mut a, mut vectors) = (matrix, DMat3::IDENTITY);
    for _ in 0..SWEEPS {
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let off = a.col(j)[i];
            if off == 0.0 {
                continue;
            }
            // The tangent of the angle that makes the entry 0, of the two the smaller one.
            let theta = (a.col(j)[j] - a.col(i)[i]) / (2.0 * off);
            let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
            let c = 1.0 / t.hypot(1.0);
            let s = t * c;
            let mut turn = DMat3::IDENTITY;
            (turn.col_mut(i)[i], turn.col_mut(j)[j]) = (c, c);
            (turn.col_mut(j)[i], turn.col_mut(i)[j]) = (s, -s);
            a = turn.transpose() * a * turn;
            vectors *= turn;
        }
    }
    let columns = [0, 1, 2].map(|k| vectors.col(k).normalize());
    (DVec3::new(a.col(0)[0], a.col(1)[1], a.col(2)[2]), DMat3::from_cols_array_2d(&columns.map(|c| c.to_array())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvalues_of_known_matrices_are_found() {
        let axes = DMat3::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 0.7);
        for values in [[-3.0, 1.0, 2.0], [5.0, -1e-6, 4.0], [1e9, 2.0, -1e-3], [2.0, 2.0, 2.0]] {
            let matrix = axes * DMat3::from_diagonal(values.into()) * axes.transpose();
            let (least, vector) = smallest(matrix);
            let expected = values.into_iter().fold(f64::INFINITY, f64::min);
            let scale = values.into_iter().fold(0.0f64, |m, v| m.max(v.abs()));
            assert!((least - expected).abs() < 1e-12 * scale, "{least} instead of {expected}");
            assert!((matrix * vector - expected * vector).length() < 1e-9 * scale);
        }
        assert_eq!(smallest(DMat3::ZERO).0, 0.0);
    }
}
