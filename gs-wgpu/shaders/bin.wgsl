// Stage `bin`: writes one entry per Gaussian and tile that it touches; the entries of a Gaussian
// are neighbours. One invocation per Gaussian.

#import prelude: TILE_COLUMNS, TILE_ROWS
#import shared: flat, rows_in_column, Splat, step, tile_columns
#import least_depth: least_depth

@group(0) @binding(1) var<storage, read> projected: array<Splat>;
@group(0) @binding(2) var<storage, read> offsets: array<u32>;
// The tile of each entry.
@group(0) @binding(3) var<storage, read_write> keys: array<u32>;
// The number of each entry, which the sort moves with the key.
@group(0) @binding(4) var<storage, read_write> order: array<u32>;
// The Gaussian, and the rows of the tile that it touches: first | end << 16.
@group(0) @binding(5) var<storage, read_write> entries: array<vec2u>;
#if PER_PIXEL
// By place: depth, its slope, and the bits of the index.
@group(0) @binding(6) var<storage, read> depths: array<vec4f>;

// The depth bits of an entry's key: its least depth, between 2^-8 and 2^24. Any order is correct,
// but a good one lets pixels hold fewer Gaussians.
fn depth_key(s: Splat, depth: vec4f, tile: u32) -> u32 {
    let corner = vec2u(tile % step.tiles.x, tile / step.tiles.x) * vec2u(TILE_COLUMNS, TILE_ROWS);
    let least = clamp(least_depth(s, depth.x, depth.yz, corner), 0.00390625, 16777215.0);
    return (bitcast<u32>(least) - bitcast<u32>(0.00390625)) >> (28u - step.depth_bits);
}
#endif

@compute @workgroup_size(64)
fn bin(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 64u + lane;
    if index >= step.gaussians {
        return;
    }
    let splat = projected[index];
    var at = offsets[index];
    let end = offsets[index + 1u];
    let columns = tile_columns(splat);
    for (var column = columns.x; column < columns.y; column++) {
        let rows = rows_in_column(splat, column);
        if rows.x >= rows.y {
            continue;
        }
        for (var band = rows.x / TILE_ROWS; band <= (rows.y - 1u) / TILE_ROWS; band++) {
            if at >= end {
                return;
            }
            let first = max(rows.x, band * TILE_ROWS) - band * TILE_ROWS;
            let last = min(rows.y, (band + 1u) * TILE_ROWS) - band * TILE_ROWS;
            let tile = band * step.tiles.x + column;
            keys[at] = tile;
#if PER_PIXEL
            keys[at] = (tile << step.depth_bits) | depth_key(splat, depths[index], tile);
#endif
            order[at] = at;
            entries[at] = vec2u(index, first | (last << 16u));
            at++;
        }
    }
    // If the compiler rounds differently here than in `project`, the entries have no rows.
    for (; at < end; at++) {
        keys[at] = 0u;
        order[at] = at;
        entries[at] = vec2u(index, 0u);
    }
}
