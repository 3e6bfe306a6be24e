//! The best colours for a target under `Sum` by dense normal equations: the reference for a
//! backend's `solve_colors`.

use gs_core::{Error, Image, effects::Blend};

use super::{COLOR, Oracle, OracleScene};

/// The scene with the colours that minimise Σ (C − Y)². Gaussians that touch no pixel keep theirs.
///
/// Normal equations (Aᵀ A) c = Aᵀ (Y − background), A the weights, solved by Gaussian elimination.
///
/// # Errors
/// [`Error::Unsupported`] for any blending but `Sum`; [`Error::SizesDiffer`] if the target does not
/// have the canvas's size.
pub fn best_colors(oracle: &Oracle, scene: &OracleScene, target: &Image) -> Result<OracleScene, Error> {
    oracle.check_target(target)?;
    let settings = oracle.settings();
    if settings.effects.blend != Blend::Sum {
        return Err(Error::Unsupported { backend: "oracle", effect: "colours under this blending".to_owned() });
    }
    let background = settings.background_color().map(f64::from);
    let count = scene.gaussians.len();
    // Rows of (Aᵀ A | Aᵀ y), three right-hand sides.
    let mut rows = vec![vec![0.0; count + 3]; count];
    for (weights, y) in oracle.weights(scene).iter().zip(target.pixels()) {
        for &(i, wi) in weights {
            weights.iter().for_each(|&(j, wj)| rows[i][j] += wi * wj);
            (0..3).for_each(|k| rows[i][count + k] += wi * (f64::from(y[k]) - background[k]));
        }
    }
    let mut best = scene.clone();
    for (i, row) in rows.iter_mut().enumerate() {
        if row[i] == 0.0 {
            row[i] = 1.0;
            (0..3).for_each(|k| row[count + k] = scene.gaussians[i][COLOR + k]);
        }
    }
    eliminate(&mut rows);
    for (g, row) in best.gaussians.iter_mut().zip(&rows) {
        (0..3).for_each(|k| g[COLOR + k] = row[count + k]);
    }
    Ok(best)
}

/// Gauss–Jordan elimination with partial pivoting: leaves the solutions in the columns after the
/// square.
fn eliminate(rows: &mut [Vec<f64>]) {
    for column in 0..rows.len() {
        let pivot = (column..rows.len()).max_by(|&a, &b| rows[a][column].abs().total_cmp(&rows[b][column].abs()));
        rows.swap(column, pivot.unwrap_or(column));
        let scale = rows[column][column];
        rows[column].iter_mut().for_each(|v| *v /= scale);
        let pivot_row = rows[column].clone();
        for (_, row) in rows.iter_mut().enumerate().filter(|(i, _)| *i != column) {
            let factor = row[column];
            row.iter_mut().zip(&pivot_row).for_each(|(v, p)| *v -= factor * p);
        }
    }
}
