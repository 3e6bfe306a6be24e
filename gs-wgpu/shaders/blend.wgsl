// Stage `blend`: the image, from the sorted entries of each tile. A work group a tile; an invocation has ROWS rows of a column, four to
// a vector.
//
// Under `Over`, a pixel that is full keeps its transmittance with the sign turned, so that every later Gaussian fails the test against
// the minimum.

@group(0) @binding(1) var<storage, read> tile_start: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<vec2u>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
// RGB, and the transmittance under `Over`.
@group(0) @binding(5) var<storage, read_write> image: array<vec4f>;

struct Pixels {
    red: vec4f,
    green: vec4f,
    blue: vec4f,
    transmittance: vec4f,
}

fn blend_rows(pixels: ptr<function, Pixels>, s: Splat, u: vec4f, across: f32, curve: f32) {
    let w = weights(fma(u * u, vec4f(curve), vec4f(across)));
#if OVER
    let uncut = w * s.opacity;
    let alpha = min(uncut, vec4f(step.alpha_max));
    let before = (*pixels).transmittance;
    let behind = before - before * alpha;
    let touches = uncut >= vec4f(step.alpha_cut);
    let counts = behind >= vec4f(step.transmittance_min);
    (*pixels).transmittance = select(before, select(-abs(before), behind, counts), touches);
    let share = select(vec4f(0.0), before * alpha, touches & counts);
#else
    let share = select(vec4f(0.0), w, w >= vec4f(step.alpha_cut));
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
            color += left * step.backdrop;
#else
            let left = 0.0;
            color += step.backdrop;
#endif
            image[(row + k) * step.size.x + column] = vec4f(color, left);
        }
    }
}

@compute @workgroup_size(TILE, TILE / ROWS)
fn blend(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_id) lane: vec3u) {
    let tile = flat(group, groups);
    if tile >= step.tiles.x * step.tiles.y {
        return;
    }
    let corner = vec2u(tile % step.tiles.x, tile / step.tiles.x) * TILE;
    let column = corner.x + lane.x;
    let within = lane.y * ROWS;
    let x = f32(column) + 0.5;
    let y = vec4f(f32(corner.y + within) + 0.5) + vec4f(0.0, 1.0, 2.0, 3.0);
    let clear = Pixels(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(1.0));
    var p0 = clear;
#if SIXTEEN_ROWS
    var p1 = clear;
    var p2 = clear;
    var p3 = clear;
#endif
    let end = tile_start[tile + 1u];
    for (var i = tile_start[tile]; i < end; i++) {
        let entry = entries[order[i]];
        let first = entry.y & 0xffffu;
        let last = entry.y >> 16u;
        let s = splats[entry.x];
        let dx = x - s.mean.x;
        let across = dx * dx * (-0.5 * LOG2_E * s.inverse_xx);
        let curve = -0.5 * LOG2_E * s.c;
        let u = (y - s.mean.y) - s.slope * dx;
        if first < within + 4u && last > within {
            blend_rows(&p0, s, u, across, curve);
        }
#if SIXTEEN_ROWS
        if first < 8u && last > 4u {
            blend_rows(&p1, s, u + 4.0, across, curve);
        }
        if first < 12u && last > 8u {
            blend_rows(&p2, s, u + 8.0, across, curve);
        }
        if last > 12u {
            blend_rows(&p3, s, u + 12.0, across, curve);
        }
#endif
    }
    let row = corner.y + within;
    store(p0, column, row);
#if SIXTEEN_ROWS
    store(p1, column, row + 4u);
    store(p2, column, row + 8u);
    store(p3, column, row + 12u);
#endif
}
