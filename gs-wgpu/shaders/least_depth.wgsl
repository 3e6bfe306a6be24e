// The least depth of a Gaussian in a tile.

#import prelude: TILE_COLUMNS, TILE_ROWS
#import shared: FARTHEST, is_nan, Splat, step

// A lower bound of the depth at the tile's pixels inside the cut's ellipse: at the nearest point of
// the ellipse, or of its bounding rectangle within the tile, whichever is farther.
fn least_depth(s: Splat, depth: f32, depth_slope: vec2f, corner: vec2u) -> f32 {
    let first = vec2f(corner) + 0.5 - s.mean;
    let last = vec2f(min(corner + vec2u(TILE_COLUMNS, TILE_ROWS), step.size)) - 0.5 - s.mean;
    // A margin of a hundredth of a pixel, so that rounding loses no pixel.
    let half = vec2f(s.half_x, sqrt(s.reach * (1.0 / s.c + s.slope * s.slope / s.inverse_xx))) + 0.01;
    let before = max(first, -half);
    let after = min(last, half);
    let in_rectangle = min(depth_slope * before, depth_slope * after);
    let along = depth_slope.x + depth_slope.y * s.slope;
    let in_ellipse = -sqrt(s.reach * (along * along / s.inverse_xx + depth_slope.y * depth_slope.y / s.c));
    let terms = abs(depth) + dot(abs(depth_slope), max(abs(before), abs(after)));
    // Minus the rounding errors here and in the pixels' own depths.
    let slack = 1e-5 * terms + 1e-6 * dot(abs(depth_slope), half);
    let found = depth + max(in_rectangle.x + in_rectangle.y, in_ellipse) - slack;
    return select(clamp(found, -FARTHEST, FARTHEST), -FARTHEST, is_nan(found));
}

