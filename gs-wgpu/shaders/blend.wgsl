// Stage `blend`: draws the image from the sorted entries of each tile. One work group per tile; an
// invocation has four rows of a column, as one vector.

#import prelude: ROWS, TILE_COLUMNS, TILE_ROWS
#import shared: flat, Splat, step
#import at_pixel: blended, share_of, weights_at

@group(0) @binding(1) var<storage, read> tile_start: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<vec2u>;
@group(0) @binding(4) var<storage, read> projected: array<Splat>;
// RGB, and the transmittance under `Over`.
@group(0) @binding(5) var<storage, read_write> image: array<vec4f>;

struct Pixels {
    red: vec4f,
    green: vec4f,
    blue: vec4f,
    transmittance: vec4f,
}

fn blend_rows(pixels: ptr<function, Pixels>, s: Splat, dx: f32, u: vec4f) {
    let w = weights_at(s.inverse_xx, s.c, dx, u);
#if OVER
    let b = blended((*pixels).transmittance, w * s.opacity);
    (*pixels).transmittance = b.transmittance;
    let share = b.share;
#else
    let share = share_of(w);
#endif
    (*pixels).red = fma(share, vec4f(s.color.x), (*pixels).red);
    (*pixels).green = fma(share, vec4f(s.color.y), (*pixels).green);
    (*pixels).blue = fma(share, vec4f(s.color.z), (*pixels).blue);
}

fn store(pixels: Pixels, column: u32, row: u32) {
    if column >= step.size.x {
        return;
    }
    for (var k = 0u; k < 4u; k++) {
        if row + k < step.size.y {
            var color = vec3f(pixels.red[k], pixels.green[k], pixels.blue[k]);
#if OVER
            let left = abs(pixels.transmittance[k]);
            color += left * step.background;
#else
            let left = 0.0;
            color += step.background;
#endif
            image[(row + k) * step.size.x + column] = vec4f(color, left);
        }
    }
}

@compute @workgroup_size(TILE_COLUMNS, TILE_ROWS / ROWS)
fn blend(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_id) lane: vec3u) {
    let tile = flat(group, groups);
    if tile >= step.tiles.x * step.tiles.y {
        return;
    }
    let corner = vec2u(tile % step.tiles.x, tile / step.tiles.x) * vec2u(TILE_COLUMNS, TILE_ROWS);
    let within = lane.y * ROWS;
    let y = vec4f(f32(corner.y + within) + 0.5) + vec4f(0.0, 1.0, 2.0, 3.0);
    let column = corner.x + lane.x;
    let x = f32(column) + 0.5;
    var pixels = Pixels(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(1.0));
    let end = tile_start[tile + 1u];
    for (var i = tile_start[tile]; i < end; i++) {
        let entry = entries[order[i]];
        let first = entry.y & 0xffffu;
        let last = entry.y >> 16u;
        let s = projected[entry.x];
        let dx = x - s.mean.x;
        let u = (y - s.mean.y) - s.slope * dx;
        if first < within + ROWS && last > within {
            blend_rows(&pixels, s, dx, u);
        }
    }
    store(pixels, column, corner.y + within);
}
