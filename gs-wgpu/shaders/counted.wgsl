// `Status` with atomic counts, and projected splats: the causes of culling, and the touched tiles.

#import prelude: TILE_ROWS
#import shared: rows_in_column, Splat, step, tile_columns

// `Status` with atomics.
struct Counted {
    entries: u32,
    overflow: atomic<u32>,
    longest: atomic<u32>,
    loss: f32,
    // The gradient by the camera, if it was asked for, as `CameraGradient::to_array` of gs-core.
    by_camera: array<f32, 10>,
    near: atomic<u32>,
    not_finite: atomic<u32>,
    degenerate: atomic<u32>,
    transparent: atomic<u32>,
    unfinished: atomic<u32>,
    outside: atomic<u32>,
}

fn culled() -> Splat {
    return Splat(vec2f(0.0), 1.0, 0.0, 1.0, 0.0, 0.0, -1.0, vec3f(0.0), 0.0);
}

// A splat from Sigma' (xx, xy, yy) and its determinant, for an opacity that is at least the cut.
fn splat_of(mean: vec2f, covariance: vec3f, det: f32, opacity: f32, color: vec3f) -> Splat {
    let xx = covariance.x;
    let xy = covariance.y;
    let yy = covariance.z;
    let reach = 2.0 * log(opacity / step.alpha_cut);
    return Splat(mean, 1.0 / xx, xy / xx, xx / det, opacity, reach, sqrt(reach * xx), color, xy / yy * sqrt(reach * yy));
}

// Number of tiles that a splat touches.
fn tiles_of(splat: Splat) -> u32 {
    var touched = 0u;
    let columns = tile_columns(splat);
    for (var column = columns.x; column < columns.y; column++) {
        let rows = rows_in_column(splat, column);
        if rows.x < rows.y {
            touched += (rows.y - 1u) / TILE_ROWS - rows.x / TILE_ROWS + 1u;
        }
    }
    return touched;
}
