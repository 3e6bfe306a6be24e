// Stage `blend_bwd`: computes the gradient of each entry from v_image, the image's gradient. One
// work group per tile, as in `blend`. It sums over an invocation's rows in registers, and over the
// tile in work-group memory, a few entries at a time, in a fixed order. Each entry has a slot of
// its own, so work groups do not share sums.
//
// Legend: t = w v_w (under `Over` alpha v_alpha); S = sum over the entry's pixels of t times 1, dx,
// u, dx², dx u, u². A slot: v_colour 3, Sx, Su, Sxx, Sxu, Suu; under `Over` also S; then the sums
// for statistics: with ABSOLUTE the magnitudes of t Sigma'^-1 d, with COUNT the number of pixels,
// with ERROR each pixel's share of the Gaussian times its error.

#import prelude: BATCH, GRADIENTS, ROWS, STRIDE, TILE_COLUMNS, TILE_ROWS
#import shared: flat, Splat, step
#import at_pixel: blended, share_of, through_alpha, weights_at

@group(0) @binding(1) var<storage, read> tile_start: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<vec2u>;
@group(0) @binding(4) var<storage, read> projected: array<Splat>;
@group(0) @binding(5) var<storage, read> v_image: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> slots: array<f32>;
#if OVER_OR_ERROR
@group(0) @binding(7) var<storage, read> image: array<vec4f>;
#endif
#if ERROR
@group(0) @binding(8) var<storage, read> target_image: array<vec4f>;
#endif

const INVOCATIONS: u32 = TILE_COLUMNS * (TILE_ROWS / ROWS);

// Four rows of a column.
struct Rows {
    v_red: vec4f,
    v_green: vec4f,
    v_blue: vec4f,
    // Under `Over`: the transmittance in front, and v_C . (the colour behind).
    transmittance: vec4f,
    rest: vec4f,
    // The errors of pixels; with COUNT 1 inside the image.
    error: vec4f,
}

// The state of one column.
struct Sums {
    color: vec3f,
    t: f32,
    tu: f32,
    tuu: f32,
    collected: vec2f,
}

#if SUBGROUPS
// A subgroup has at least four invocations.
const PARTS: u32 = INVOCATIONS / 4u;
#else
const PARTS: u32 = INVOCATIONS;
#endif

// The sums of each invocation or subgroup.
var<workgroup> partial: array<f32, BATCH * STRIDE * PARTS>;

fn load(column: u32, row: u32) -> Rows {
    var rows = Rows(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(1.0), vec4f(0.0), vec4f(0.0));
    for (var k = 0u; k < 4u; k++) {
        if column < step.size.x && row + k < step.size.y {
            let at = (row + k) * step.size.x + column;
            let v = v_image[at];
            rows.v_red[k] = v.x;
            rows.v_green[k] = v.y;
            rows.v_blue[k] = v.z;
#if OVER
            rows.rest[k] = dot(v.xyz, image[at].xyz);
#endif
#if COUNT
            rows.error[k] = 1.0;
#endif
#if ERROR
            rows.error[k] = dot(abs(image[at].xyz - target_image[at].xyz), vec3f(1.0 / 3.0));
#endif
        }
    }
    return rows;
}

fn total(v: vec4f) -> f32 {
    return (v.x + v.y) + (v.z + v.w);
}

fn gather_rows(rows: ptr<function, Rows>, sums: ptr<function, Sums>, s: Splat, dx: f32, u: vec4f) {
    let w = weights_at(s.inverse_xx, s.c, dx, u);
    let v_dot_c = fma((*rows).v_blue, vec4f(s.color.z), fma((*rows).v_green, vec4f(s.color.y), (*rows).v_red * s.color.x));
#if OVER
    let before = (*rows).transmittance;
    let b = blended(before, w * s.opacity);
    let share = b.share;
    (*rows).transmittance = b.transmittance;
    (*rows).rest -= share * v_dot_c;
    let t = through_alpha(b, before, v_dot_c, (*rows).rest);
#else
    let share = share_of(w);
    let t = share * v_dot_c;
#endif
    let tu = t * u;
    (*sums).color += vec3f(dot(share, (*rows).v_red), dot(share, (*rows).v_green), dot(share, (*rows).v_blue));
    (*sums).t += total(t);
    (*sums).tu += total(tu);
    (*sums).tuu += dot(tu, u);
#if ABSOLUTE
    let down = s.c * u;
    (*sums).collected += vec2f(dot(abs(t), abs(s.inverse_xx * dx - s.slope * down)), dot(abs(t), abs(down)));
#endif
#if COUNT
    (*sums).collected.x += dot(select(vec4f(0.0), vec4f(1.0), share > vec4f(0.0)), (*rows).error);
#endif
#if ERROR
    (*sums).collected.x += dot(share, (*rows).error);
#endif
}

// The contribution of a part of the tile to an entry of the batch.
fn keep(entry: u32, part: u32, color: vec3f, first: vec3f, second: vec2f, t: f32, collected: vec2f) {
    let at = entry * STRIDE * PARTS + part;
    partial[at] = color.x;
    partial[at + PARTS] = color.y;
    partial[at + 2u * PARTS] = color.z;
    partial[at + 3u * PARTS] = first.x;
    partial[at + 4u * PARTS] = first.y;
    partial[at + 5u * PARTS] = first.z;
    partial[at + 6u * PARTS] = second.x;
    partial[at + 7u * PARTS] = second.y;
#if OVER
    partial[at + 8u * PARTS] = t;
#endif
#if ABSOLUTE
    partial[at + GRADIENTS * PARTS] = collected.x;
    partial[at + (GRADIENTS + 1u) * PARTS] = collected.y;
#endif
#if COUNT
    partial[at + GRADIENTS * PARTS] = collected.x;
#endif
#if ERROR
    partial[at + GRADIENTS * PARTS] = collected.x;
#endif
}

@compute @workgroup_size(INVOCATIONS)
fn blend_bwd(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) invocation: u32,
#if SUBGROUPS
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_invocation_id) place: u32,
    @builtin(num_subgroups) parts: u32,
#endif
) {
#if SUBGROUPS
#else
    let parts = INVOCATIONS;
#endif
    let lane = vec2u(invocation % TILE_COLUMNS, invocation / TILE_COLUMNS);
    let tile = flat(group, groups);
    if tile >= step.tiles.x * step.tiles.y {
        return;
    }
    let corner = vec2u(tile % step.tiles.x, tile / step.tiles.x) * vec2u(TILE_COLUMNS, TILE_ROWS);
    let within = lane.y * ROWS;
    let y = vec4f(f32(corner.y + within) + 0.5) + vec4f(0.0, 1.0, 2.0, 3.0);
    let column = corner.x + lane.x;
    let x = f32(column) + 0.5;
    var rows = load(column, corner.y + within);
    let end = tile_start[tile + 1u];
    for (var first_of_batch = tile_start[tile]; first_of_batch < end; first_of_batch += BATCH) {
        for (var b = 0u; b < BATCH; b++) {
            if first_of_batch + b >= end {
                break;
            }
            let entry = entries[order[first_of_batch + b]];
            let first = entry.y & 0xffffu;
            let last = entry.y >> 16u;
            let s = projected[entry.x];
            let dx = x - s.mean.x;
            let u = (y - s.mean.y) - s.slope * dx;
            var sums = Sums(vec3f(0.0), 0.0, 0.0, 0.0, vec2f(0.0));
            if first < within + ROWS && last > within {
                gather_rows(&rows, &sums, s, dx, u);
            }
            var color = sums.color;
            var t = sums.t;
            let tx = t * dx;
            let txx = t * dx * dx;
            let tu = sums.tu;
            let txu = tu * dx;
            let tuu = sums.tuu;
            var collected = sums.collected;
#if SUBGROUPS
            color = subgroupAdd(color);
            let sums_x = subgroupAdd(vec2f(tx, txx));
            let sums_u = subgroupAdd(vec3f(tu, txu, tuu));
#if OVER
            t = subgroupAdd(t);
#endif
#if COLLECTS
            collected = subgroupAdd(collected);
#endif
            if place == 0u {
                keep(b, subgroup, color, vec3f(sums_x.x, sums_u.x, sums_x.y), sums_u.yz, t, collected);
            }
#else
            keep(b, invocation, color, vec3f(tx, tu, txx), vec2f(txu, tuu), t, collected);
#endif
        }
        workgroupBarrier();
        let filled = min(BATCH, end - first_of_batch) * STRIDE;
        for (var slot = invocation; slot < filled; slot += INVOCATIONS) {
            var sum = 0.0;
            for (var k = 0u; k < parts; k++) {
                sum += partial[slot * PARTS + k];
            }
            slots[order[first_of_batch + slot / STRIDE] * STRIDE + slot % STRIDE] = sum;
        }
        workgroupBarrier();
    }
}
