// Stage `blend_bwd`: what each entry's Gaussian receives from v_image, the image's gradient. A work group a tile, as in `blend`; sums over
// an invocation's rows in registers, over the tile's in work-group memory, in a fixed order, a few entries at a time. Nothing is added
// across work groups: each entry has a slot of its own.
//
// Legend: t = w v_w (under `Over` alpha v_alpha); S = sum over the entry's pixels of t times 1, dx, u, dx², dx u, u².
// A slot: v_colour 3, Sx, Su, Sxx, Sxu, Suu; under `Over` also S.

@group(0) @binding(1) var<storage, read> tile_start: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<vec2u>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read> v_image: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> slots: array<f32>;
#if OVER
@group(0) @binding(7) var<storage, read> image: array<vec4f>;
#endif

const INVOCATIONS: u32 = TILE * (TILE / ROWS);

// Four rows of the column.
struct Rows {
    v_red: vec4f,
    v_green: vec4f,
    v_blue: vec4f,
    // Under `Over`: the transmittance in front, and v_C . (what is behind).
    transmittance: vec4f,
    rest: vec4f,
}

struct Sums {
    color: vec3f,
    t: f32,
    tu: f32,
    tuu: f32,
}

var<workgroup> partial: array<f32, BATCH * STRIDE * INVOCATIONS>;

fn load(column: u32, row: u32) -> Rows {
    var rows = Rows(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(1.0), vec4f(0.0));
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
        }
    }
    return rows;
}

fn total(v: vec4f) -> f32 {
    return (v.x + v.y) + (v.z + v.w);
}

fn gather_rows(rows: ptr<function, Rows>, sums: ptr<function, Sums>, s: Splat, u: vec4f, across: f32, curve: f32) {
    let w = weights(fma(u * u, vec4f(curve), vec4f(across)));
    let v_dot_c = fma((*rows).v_blue, vec4f(s.color.z), fma((*rows).v_green, vec4f(s.color.y), (*rows).v_red * s.color.x));
#if OVER
    let uncut = w * s.opacity;
    let alpha = min(uncut, vec4f(step.alpha_max));
    let before = (*rows).transmittance;
    let share_all = before * alpha;
    let behind = before - share_all;
    let touches = uncut >= vec4f(step.alpha_cut);
    let counts = behind >= vec4f(step.transmittance_min);
    (*rows).transmittance = select(before, select(-abs(before), behind, counts), touches);
    let counted = touches & counts;
    let share = select(vec4f(0.0), share_all, counted);
    (*rows).rest -= share * v_dot_c;
    let v_alpha = before * v_dot_c - (*rows).rest / (1.0 - alpha);
    // The gradient of a clamped alpha is zero.
    let t = select(vec4f(0.0), v_alpha * alpha, counted & (uncut <= vec4f(step.alpha_max)));
#else
    let share = select(vec4f(0.0), w, w >= vec4f(step.alpha_cut));
    let t = share * v_dot_c;
#endif
    let tu = t * u;
    (*sums).color += vec3f(dot(share, (*rows).v_red), dot(share, (*rows).v_green), dot(share, (*rows).v_blue));
    (*sums).t += total(t);
    (*sums).tu += total(tu);
    (*sums).tuu += dot(tu, u);
}

@compute @workgroup_size(TILE, TILE / ROWS)
fn blend_bwd(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_id) lane: vec3u,
    @builtin(local_invocation_index) invocation: u32,
) {
    let tile = flat(group, groups);
    if tile >= step.tiles.x * step.tiles.y {
        return;
    }
    let corner = vec2u(tile % step.tiles.x, tile / step.tiles.x) * TILE;
    let column = corner.x + lane.x;
    let within = lane.y * ROWS;
    let row = corner.y + within;
    let x = f32(column) + 0.5;
    let y = vec4f(f32(row) + 0.5) + vec4f(0.0, 1.0, 2.0, 3.0);
    var r0 = load(column, row);
#if SIXTEEN_ROWS
    var r1 = load(column, row + 4u);
    var r2 = load(column, row + 8u);
    var r3 = load(column, row + 12u);
#endif
    let end = tile_start[tile + 1u];
    for (var first_of_batch = tile_start[tile]; first_of_batch < end; first_of_batch += BATCH) {
        for (var b = 0u; b < BATCH; b++) {
            if first_of_batch + b >= end {
                break;
            }
            let entry = entries[order[first_of_batch + b]];
            let first = entry.y & 0xffffu;
            let last = entry.y >> 16u;
            let s = splats[entry.x];
            let dx = x - s.mean.x;
            let across = dx * dx * (-0.5 * LOG2_E * s.inverse_xx);
            let curve = -0.5 * LOG2_E * s.c;
            let u = (y - s.mean.y) - s.slope * dx;
            var sums = Sums(vec3f(0.0), 0.0, 0.0, 0.0);
            if first < within + 4u && last > within {
                gather_rows(&r0, &sums, s, u, across, curve);
            }
#if SIXTEEN_ROWS
            if first < 8u && last > 4u {
                gather_rows(&r1, &sums, s, u + 4.0, across, curve);
            }
            if first < 12u && last > 8u {
                gather_rows(&r2, &sums, s, u + 8.0, across, curve);
            }
            if last > 12u {
                gather_rows(&r3, &sums, s, u + 12.0, across, curve);
            }
#endif
            let at = b * STRIDE * INVOCATIONS + invocation;
            let tx = sums.t * dx;
            partial[at] = sums.color.x;
            partial[at + INVOCATIONS] = sums.color.y;
            partial[at + 2u * INVOCATIONS] = sums.color.z;
            partial[at + 3u * INVOCATIONS] = tx;
            partial[at + 4u * INVOCATIONS] = sums.tu;
            partial[at + 5u * INVOCATIONS] = tx * dx;
            partial[at + 6u * INVOCATIONS] = sums.tu * dx;
            partial[at + 7u * INVOCATIONS] = sums.tuu;
#if OVER
            partial[at + 8u * INVOCATIONS] = sums.t;
#endif
        }
        workgroupBarrier();
        let filled = min(BATCH, end - first_of_batch) * STRIDE;
        for (var slot = invocation; slot < filled; slot += INVOCATIONS) {
            var sum = 0.0;
            for (var k = 0u; k < INVOCATIONS; k++) {
                sum += partial[slot * INVOCATIONS + k];
            }
            slots[order[first_of_batch + slot / STRIDE] * STRIDE + slot % STRIDE] = sum;
        }
        workgroupBarrier();
    }
}
