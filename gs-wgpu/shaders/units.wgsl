// The first part of `blend_bwd` with a sort at each pixel: the units of each entry's sums, from the
// largest contributions of the pixels that it reaches. One work group per tile; one invocation per
// pixel, then per entry, which reads all pixels.

#import prelude: TILE_COLUMNS, TILE_ROWS
#import shared: flat, Queued, step
#import queued: UNITS, WORDS, packed_units, twice_sigma

@group(0) @binding(1) var<storage, read> tile_start: array<u32>;
@group(0) @binding(2) var<storage, read> queue: array<Queued>;
@group(0) @binding(3) var<storage, read> v_image: array<vec4f>;
// RGB and transmittance.
@group(0) @binding(4) var<storage, read> image: array<vec4f>;
// [entries, WORDS], by place in the queue.
@group(0) @binding(5) var<storage, read_write> totals: array<u32>;
#if ERROR
@group(0) @binding(6) var<storage, read> target_image: array<vec4f>;
#endif

// The largest contribution of each pixel, in the order of `packed_units`.
var<workgroup> most: array<vec3f, TILE_COLUMNS * TILE_ROWS>;

fn largest(v: vec3f) -> f32 {
    return max(max(v.x, v.y), v.z);
}

// Bounds of the numbers of `blend_one`. Colours are not negative, so the colour behind a Gaussian
// times the transmittance there is at most the pixel's colour C. Hence |t| <= 3 |v| C (1 +
// alpha/(1 - alpha)), and 1 - alpha is at least the remaining share of the pixel's transmittance. t
// is multiplied by at most twice sigma.
fn most_of(place: u32) -> vec3f {
    let v = largest(abs(v_image[place].xyz));
    let shown = image[place];
    // A background may be negative.
    let color = largest(shown.xyz + shown.w * (abs(step.background) - step.background));
    let widest = max(1.0, -2.0 * log(step.alpha_cut));
    let t = v * color * (3.0 * widest / max(1.0 - step.alpha_max, step.transmittance_min));
#if ERROR
    let error = dot(abs(shown.xyz - target_image[place].xyz), vec3f(1.0 / 3.0));
#else
    let error = 0.0;
#endif
    let found = vec3f(v, t, error);
    // A contribution that overflows is too large for these units, too, and so are its sums.
    return select(vec3f(3.4e38), found, found <= vec3f(3.4e38));
}

@compute @workgroup_size(TILE_COLUMNS, TILE_ROWS)
fn units(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_id) lane: vec3u,
    @builtin(local_invocation_index) invocation: u32,
) {
    let tile = flat(group, groups);
    if tile >= step.tiles.x * step.tiles.y {
        return;
    }
    let corner = vec2u(tile % step.tiles.x, tile / step.tiles.x) * vec2u(TILE_COLUMNS, TILE_ROWS);
    let pixel = corner + lane.xy;
    most[invocation] = vec3f(0.0);
    if all(pixel < step.size) {
        most[invocation] = most_of(pixel.y * step.size.x + pixel.x);
    }
    workgroupBarrier();
    let end = tile_start[tile + 1u];
    for (var at = tile_start[tile] + invocation; at < end; at += TILE_COLUMNS * TILE_ROWS) {
        let q = queue[at];
        var found = vec3f(0.0);
        // Eight pixels per iteration, so that software drivers do not end the loops before those of
        // `blend_by_depth`.
        for (var first = 0u; first < TILE_COLUMNS * TILE_ROWS; first += 8u) {
            let before = vec2f(corner + vec2u(first % TILE_COLUMNS, first / TILE_COLUMNS)) + 0.5 - q.mean;
#each k EIGHT
            if twice_sigma(q, before + vec2f(@k.0, 0.0)) <= q.reach {
                found = max(found, most[first + @ku]);
            }
#end
        }
        totals[at * WORDS + UNITS] = packed_units(found);
    }
}
