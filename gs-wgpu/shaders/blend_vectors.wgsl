// Stages `blend`, `loss` (pointwise) and `blend_bwd` where an invocation is a lane of a CPU's vector. A work group is one subgroup, a
// tile its own; a lane has COLUMNS columns of it, and `@c` and `@r` count columns and rows. FORWARD stores the image, BACKWARD reads
// v_image, the image's gradient, and with both, one pass does all.
//
// Such an adapter executes both sides of every branch and the loops' bodies once more than a test at their head would let through; so
// there are few branches, and loops end at their tail. What a lane reads from a buffer costs as much as ten operations; so each lane
// fetches one of LANES entries, and hands it to all.
//
// Under `Sum` the weights of a column are e^-s for s quadratic in the row: from one row to the next they grow by a factor that itself
// grows by e^-c. That runs both ways from the middle row, and not for the entries of a tile's second list, which are too steep.
//
// Legend of BACKWARD: t = w v_w (under `Over` alpha v_alpha); a slot: v_colour 3, then the sums over the entry's pixels of t dx, t u,
// t dx², t dx u, t u²; under `Over` also of t; then what statistics need: with ABSOLUTE the sums of the magnitudes of t Sigma'^-1 d, with
// ERROR of what a pixel shows of the Gaussian times the pixel's error.

@group(0) @binding(1) var<storage, read> tile_start: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<vec2u>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
#if BACKWARD
@group(0) @binding(5) var<storage, read_write> slots: array<f32>;
#if FORWARD
@group(0) @binding(6) var<storage, read> target_image: array<vec4f>;
// One number a tile.
@group(0) @binding(7) var<storage, read_write> partial: array<f32>;
#else
@group(0) @binding(6) var<storage, read> v_image: array<vec4f>;
#if OVER_OR_ERROR
@group(0) @binding(7) var<storage, read> image: array<vec4f>;
#endif
#if ERROR
@group(0) @binding(8) var<storage, read> target_image: array<vec4f>;
#endif
#endif
#else
// RGB, and the transmittance under `Over`.
@group(0) @binding(5) var<storage, read_write> image: array<vec4f>;
#endif

#if FORWARD
#if BACKWARD
// 1: L2. 2: L1.
override KIND: u32 = 1u;
#endif
#endif

// An entry's Gaussian: the exponent of 2 is across dx² + curve u², with u = dy - slope dx; under `Over` with log2 of the opacity added.
struct Fetched {
    mean: vec2f,
    across: f32,
    slope: f32,
    curve: f32,
    // Under `Sum`, how the growth from row to row itself grows; under `Over`, log2 of the opacity.
    extra: f32,
    color: vec3f,
    slot: u32,
}

fn fetch(place: u32) -> Fetched {
    let slot = order[place];
    let entry = entries[slot];
    let s = splats[entry.x];
    // An entry without rows is far away.
    let mean = select(s.mean, vec2f(1e15), entry.y == 0u);
    let curve = -0.5 * LOG2_E * s.c;
#if OVER
    let extra = log2(s.opacity);
#else
    let extra = exp2_exact(2.0 * curve);
#endif
    return Fetched(mean, -0.5 * LOG2_E * s.inverse_xx, s.slope, curve, extra, s.color, slot);
}

fn of_lane(f: Fetched, lane: u32) -> Fetched {
    return Fetched(
        vec2f(subgroupShuffle(f.mean.x, lane), subgroupShuffle(f.mean.y, lane)),
        subgroupShuffle(f.across, lane),
        subgroupShuffle(f.slope, lane),
        subgroupShuffle(f.curve, lane),
        subgroupShuffle(f.extra, lane),
        vec3f(subgroupShuffle(f.color.x, lane), subgroupShuffle(f.color.y, lane), subgroupShuffle(f.color.z, lane)),
        subgroupShuffle(f.slot, lane),
    );
}

// A pixel while entries are blended: what it has got, and its transmittance under `Over`, with the sign turned once it is full.
struct Pixel {
    color: vec3f,
#if OVER
    transmittance: f32,
#endif
}

#if OVER
struct Share {
    // Of the colour.
    share: f32,
    alpha: f32,
    transmittance: f32,
    before: f32,
    counted: bool,
    clamped: bool,
}

fn share_of(uncut: f32, before: f32) -> Share {
    let alpha = min(uncut, step.alpha_max);
    let behind = before - before * alpha;
    let touches = uncut >= step.alpha_cut;
    let counts = behind >= step.transmittance_min;
    let counted = touches & counts;
    let transmittance = select(before, select(-abs(before), behind, counts), touches);
    return Share(select(0.0, before * alpha, counted), alpha, transmittance, before, counted, uncut > step.alpha_max);
}
#endif

fn with_share(pixel: Pixel, w: f32, color: vec3f) -> Pixel {
#if OVER
    let share = share_of(w, pixel.transmittance);
    return Pixel(pixel.color + share.share * color, share.transmittance);
#else
    return Pixel(pixel.color + select(0.0, w, w >= step.alpha_cut) * color);
#endif
}

#if BACKWARD
// A pixel while gradients are gathered: v_C; under `Over` also the transmittance in front, and v_C . (what is behind).
struct Gathering {
    v: vec3f,
#if OVER
    transmittance: f32,
    rest: f32,
#endif
#if ERROR
    error: f32,
#endif
}

// Of one column.
struct Sums {
    color: vec3f,
    t: f32,
    tu: f32,
    tuu: f32,
#if COLLECTS
    collected: vec2f,
#endif
}

fn no_sums() -> Sums {
    var sums: Sums;
    return sums;
}

// Adds to what statistics need: of a pixel that shows so much of the Gaussian, and t.
fn collect_besides(sums: ptr<function, Sums>, pixel: Gathering, share: f32, t: f32, u: f32, s: Fetched, dx: f32) {
#if ABSOLUTE
    // Both halves of the conic stand in `s` times -½ log2 e.
    let down = s.curve * u;
    (*sums).collected += abs(t * vec2f(s.across * dx - s.slope * down, down));
#endif
#if ERROR
    (*sums).collected.x += share * pixel.error;
#endif
}

#if OVER
// Adds to the sums; the pixel as the next Gaussian finds it.
fn gather(pixel: Gathering, sums: ptr<function, Sums>, w: f32, u: f32, s: Fetched, dx: f32) -> Gathering {
    let share = share_of(w, pixel.transmittance);
    let v_w = dot(pixel.v, s.color);
    let rest = pixel.rest - share.share * v_w;
    let v_alpha = share.before * v_w - rest / (1.0 - share.alpha);
    // The gradient of a clamped alpha is zero.
    let t = select(0.0, v_alpha * share.alpha, share.counted & !share.clamped);
    (*sums).t += t;
    collect(sums, pixel.v, share.share, t * u, u);
    collect_besides(sums, pixel, share.share, t, u, s, dx);
    var behind = pixel;
    behind.transmittance = share.transmittance;
    behind.rest = rest;
    return behind;
}
#else
fn gather(pixel: Gathering, sums: ptr<function, Sums>, w: f32, u: f32, s: Fetched, dx: f32) {
    let share = select(0.0, w, w >= step.alpha_cut);
    let t = share * dot(pixel.v, s.color);
    collect(sums, pixel.v, share, t * u, u);
    collect_besides(sums, pixel, share, t, u, s, dx);
}
#endif

fn collect(sums: ptr<function, Sums>, v: vec3f, share: f32, tu: f32, u: f32) {
    (*sums).color += share * v;
    (*sums).tu += tu;
    (*sums).tuu += tu * u;
}

fn fold(a: f32, b: f32, lane: u32, bit: u32) -> f32 {
    let upper = (lane & bit) != 0u;
    return select(a, b, upper) + subgroupShuffleXor(select(b, a, upper), bit);
}

// The sums over all lanes: the k-th in lane k.
fn sums_by_lane(a: vec4f, b: vec4f, lane: u32) -> f32 {
    let low = fold(fold(a.x, a.y, lane, 1u), fold(a.z, a.w, lane, 1u), lane, 2u);
    let high = fold(fold(b.x, b.y, lane, 1u), fold(b.z, b.w, lane, 1u), lane, 2u);
    return fold(low, high, lane, 4u);
}

fn sum_of_lanes(x: f32) -> f32 {
    let pairs = x + subgroupShuffleXor(x, 1u);
    let fours = pairs + subgroupShuffleXor(pairs, 2u);
    return fours + subgroupShuffleXor(fours, 4u);
}

#if COLLECTS
// What is collected of an entry, by all lanes.
fn store_collected(slot: u32, collected: vec2f, lane: u32) {
    let at = slot * STRIDE + GRADIENTS;
    let first = sum_of_lanes(collected.x);
#if ABSOLUTE
    let second = sum_of_lanes(collected.y);
    if lane == 0u {
        // What the conic stood times.
        slots[at] = first * (2.0 / LOG2_E);
        slots[at + 1u] = second * (2.0 / LOG2_E);
    }
#else
    if lane == 0u {
        slots[at] = first;
    }
#endif
}
#endif
#endif

@compute @workgroup_size(LANES)
fn blend_vectors(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let tile = flat(group, groups);
    if tile >= step.tiles.x * step.tiles.y {
        return;
    }
    let corner = vec2u(tile % step.tiles.x, tile / step.tiles.x) * vec2u(TILE_COLUMNS, TILE_ROWS);
    let first_y = f32(corner.y) + 0.5;
    let middle_y = first_y + 0.5 * f32(BLOCK);
    let start = tile_start[2u * tile];
    let steep = tile_start[2u * tile + 1u];
    let end = tile_start[2u * tile + 2u];
#each c COLUMNS
    let column_@c = corner.x + lane + @cu * LANES;
    let x_@c = f32(column_@c) + 0.5;
#end
#if FORWARD
#each c COLUMNS
#each b BLOCKS
#each r BLOCK
    var p_@c_@b@r: Pixel;
#if OVER
    p_@c_@b@r.transmittance = 1.0;
#endif
#end
#end
#end
#if OVER
#else
    if start < steep {
        var first = start;
        loop {
            let many = min(LANES, steep - first);
            let fetched = fetch(first + min(lane, many - 1u));
            var j = 0u;
            loop {
                let s = of_lane(fetched, j);
#each c COLUMNS
                let dx_@c = x_@c - s.mean.x;
                let across_@c = dx_@c * dx_@c * s.across;
                let u_@c_0 = (middle_y - s.mean.y) - s.slope * dx_@c;
                let u_@c_1 = u_@c_0 + f32(BLOCK);
                let middle_@c_0 = exp2_exact(across_@c + u_@c_0 * u_@c_0 * s.curve);
                let middle_@c_1 = exp2_exact(across_@c + u_@c_1 * u_@c_1 * s.curve);
                let growth_@c_0 = exp2_within((2.0 * u_@c_0 + 1.0) * s.curve);
                let growth_@c_1 = exp2_within((2.0 * u_@c_1 + 1.0) * s.curve);
#each b BLOCKS
                var w_@c_@b = middle_@c_@b;
                var g_@c_@b = growth_@c_@b;
#end
#end
#each r UP
#each c COLUMNS
#each b BLOCKS
                p_@c_@b@r = with_share(p_@c_@b@r, w_@c_@b, s.color);
                w_@c_@b *= g_@c_@b;
                g_@c_@b *= s.extra;
#end
#end
#end
#each c COLUMNS
#each b BLOCKS
                w_@c_@b = middle_@c_@b;
                g_@c_@b = s.extra / growth_@c_@b;
#end
#end
#each r DOWN
#each c COLUMNS
#each b BLOCKS
                w_@c_@b *= g_@c_@b;
                g_@c_@b *= s.extra;
                p_@c_@b@r = with_share(p_@c_@b@r, w_@c_@b, s.color);
#end
#end
#end
                continuing {
                    j++;
                    break if j >= many;
                }
            }
            continuing {
                first += LANES;
                break if first >= steep;
            }
        }
    }
#endif
    if steep < end {
        var first = steep;
        loop {
            let many = min(LANES, end - first);
            let fetched = fetch(first + min(lane, many - 1u));
            var j = 0u;
            loop {
                let s = of_lane(fetched, j);
#each c COLUMNS
                let dx_@c = x_@c - s.mean.x;
                let u_@c = (first_y - s.mean.y) - s.slope * dx_@c;
                let across_@c = exponent_across(s, dx_@c);
#each b BLOCKS
#each r BLOCK
                p_@c_@b@r = with_share(p_@c_@b@r, exp2_exact(across_@c + square(u_@c + (@b.0 * f32(BLOCK) + @r.0)) * s.curve), s.color);
#end
#end
#end
                continuing {
                    j++;
                    break if j >= many;
                }
            }
            continuing {
                first += LANES;
                break if first >= end;
            }
        }
    }
#if BACKWARD
    var loss = 0.0;
#else
#each c COLUMNS
#each b BLOCKS
#each r BLOCK
    if column_@c < step.size.x && corner.y + @bu * BLOCK + @ru < step.size.y {
#if OVER
        let left = abs(p_@c_@b@r.transmittance);
        image[(corner.y + @bu * BLOCK + @ru) * step.size.x + column_@c] = vec4f(p_@c_@b@r.color + left * step.backdrop, left);
#else
        image[(corner.y + @bu * BLOCK + @ru) * step.size.x + column_@c] = vec4f(p_@c_@b@r.color + step.backdrop, 0.0);
#endif
    }
#end
#end
#end
#endif
#endif

#if BACKWARD
    // Read in a loop that the compiler cannot unroll: the instructions of what follows fill the cache as it is.
#each c COLUMNS
    var read_@c: array<vec3f, ROWS>;
#if OVER_OR_ERROR
#if FORWARD
#else
    var color_@c: array<vec3f, ROWS>;
#endif
#endif
#if ERROR
#if FORWARD
#else
    var error_@c: array<f32, ROWS>;
#endif
#endif
#end
    let rows = min(ROWS, step.size.y - corner.y);
    var row = 0u;
    loop {
        let pixel = (corner.y + row) * step.size.x;
#each c COLUMNS
        if column_@c < step.size.x {
#if FORWARD
            read_@c[row] = target_image[pixel + column_@c].xyz;
#else
            read_@c[row] = v_image[pixel + column_@c].xyz;
#if OVER_OR_ERROR
            color_@c[row] = image[pixel + column_@c].xyz;
#endif
#if ERROR
            error_@c[row] = dot(abs(color_@c[row] - target_image[pixel + column_@c].xyz), vec3f(1.0 / 3.0));
#endif
#endif
        }
#end
        continuing {
            row++;
            break if row >= rows;
        }
    }
#each c COLUMNS
#each b BLOCKS
#each r BLOCK
    var v_@c_@b@r: Gathering;
    {
#if FORWARD
#if OVER
        let color = p_@c_@b@r.color + abs(p_@c_@b@r.transmittance) * step.backdrop;
#else
        let color = p_@c_@b@r.color + step.backdrop;
#endif
        let inside = column_@c < step.size.x && corner.y + @bu * BLOCK + @ru < step.size.y;
        let d = select(vec3f(0.0), color - read_@c[@bu * BLOCK + @ru], inside);
        let is_square = KIND == 1u;
        let values = select(abs(d), d * d, is_square);
        loss += values.x + values.y + values.z;
#if ERROR
        v_@c_@b@r.error = dot(abs(d), vec3f(1.0 / 3.0));
#endif
        let bounded = clamp(d, vec3f(-MAX_RESIDUAL), vec3f(MAX_RESIDUAL));
        v_@c_@b@r.v = step.pointwise_scale * select(sign(d), 2.0 * bounded, is_square);
#else
        v_@c_@b@r.v = read_@c[@bu * BLOCK + @ru];
#if ERROR
        v_@c_@b@r.error = error_@c[@bu * BLOCK + @ru];
#endif
#if OVER
        let color = color_@c[@bu * BLOCK + @ru];
#endif
#endif
#if OVER
        v_@c_@b@r.transmittance = 1.0;
        v_@c_@b@r.rest = dot(v_@c_@b@r.v, color);
#endif
    }
#end
#end
#end
#if FORWARD
    let loss_of_tile = sum_of_lanes(loss);
    if lane == 0u {
        partial[tile] = loss_of_tile;
    }
#endif
#if OVER
#else
    if start < steep {
        var first = start;
        loop {
            let many = min(LANES, steep - first);
            let fetched = fetch(first + min(lane, many - 1u));
            var j = 0u;
            loop {
                let s = of_lane(fetched, j);
                var a = vec4f(0.0);
                var b = vec4f(0.0);
#if COLLECTS
                var collected = vec2f(0.0);
#endif
#each c COLUMNS
                var sums_@c = no_sums();
                let dx_@c = x_@c - s.mean.x;
                let across_@c = dx_@c * dx_@c * s.across;
                let u_@c_0 = (middle_y - s.mean.y) - s.slope * dx_@c;
                let u_@c_1 = u_@c_0 + f32(BLOCK);
                let middle_@c_0 = exp2_exact(across_@c + u_@c_0 * u_@c_0 * s.curve);
                let middle_@c_1 = exp2_exact(across_@c + u_@c_1 * u_@c_1 * s.curve);
                let growth_@c_0 = exp2_within((2.0 * u_@c_0 + 1.0) * s.curve);
                let growth_@c_1 = exp2_within((2.0 * u_@c_1 + 1.0) * s.curve);
#each b BLOCKS
                var w_@c_@b = middle_@c_@b;
                var g_@c_@b = growth_@c_@b;
#end
#end
#each r UP
#each c COLUMNS
#each b BLOCKS
                gather(v_@c_@b@r, &sums_@c, w_@c_@b, u_@c_@b + (@r.0 - 0.5 * f32(BLOCK)), s, dx_@c);
                w_@c_@b *= g_@c_@b;
                g_@c_@b *= s.extra;
#end
#end
#end
#each c COLUMNS
#each b BLOCKS
                w_@c_@b = middle_@c_@b;
                g_@c_@b = s.extra / growth_@c_@b;
#end
#end
#each r DOWN
#each c COLUMNS
#each b BLOCKS
                w_@c_@b *= g_@c_@b;
                g_@c_@b *= s.extra;
                gather(v_@c_@b@r, &sums_@c, w_@c_@b, u_@c_@b + (@r.0 - 0.5 * f32(BLOCK)), s, dx_@c);
#end
#end
#end
#each c COLUMNS
                sums_@c.t = dot(sums_@c.color, s.color);
                a += vec4f(sums_@c.color, sums_@c.t * dx_@c);
                b += vec4f(sums_@c.tu, sums_@c.t * dx_@c * dx_@c, sums_@c.tu * dx_@c, sums_@c.tuu);
#if COLLECTS
                collected += sums_@c.collected;
#endif
#end
                slots[s.slot * STRIDE + lane] = sums_by_lane(a, b, lane);
#if COLLECTS
                store_collected(s.slot, collected, lane);
#endif
                continuing {
                    j++;
                    break if j >= many;
                }
            }
            continuing {
                first += LANES;
                break if first >= steep;
            }
        }
    }
#endif
    if steep < end {
        var first = steep;
        loop {
            let many = min(LANES, end - first);
            let fetched = fetch(first + min(lane, many - 1u));
            var j = 0u;
            loop {
                let s = of_lane(fetched, j);
                var a = vec4f(0.0);
                var b = vec4f(0.0);
#if COLLECTS
                var collected = vec2f(0.0);
#endif
                var t = 0.0;
#each c COLUMNS
                var sums_@c = no_sums();
                let dx_@c = x_@c - s.mean.x;
                let u_@c = (first_y - s.mean.y) - s.slope * dx_@c;
                let across_@c = exponent_across(s, dx_@c);
#each b BLOCKS
#each r BLOCK
#if OVER
                v_@c_@b@r = gather(v_@c_@b@r, &sums_@c, exp2_exact(across_@c + square(u_@c + (@b.0 * f32(BLOCK) + @r.0)) * s.curve), u_@c + (@b.0 * f32(BLOCK) + @r.0), s, dx_@c);
#else
                gather(v_@c_@b@r, &sums_@c, exp2_exact(across_@c + square(u_@c + (@b.0 * f32(BLOCK) + @r.0)) * s.curve), u_@c + (@b.0 * f32(BLOCK) + @r.0), s, dx_@c);
#endif
#end
#end
#if OVER
                t += sums_@c.t;
#else
                sums_@c.t = dot(sums_@c.color, s.color);
#endif
                a += vec4f(sums_@c.color, sums_@c.t * dx_@c);
                b += vec4f(sums_@c.tu, sums_@c.t * dx_@c * dx_@c, sums_@c.tu * dx_@c, sums_@c.tuu);
#if COLLECTS
                collected += sums_@c.collected;
#endif
#end
                slots[s.slot * STRIDE + lane] = sums_by_lane(a, b, lane);
#if COLLECTS
                store_collected(s.slot, collected, lane);
#endif
#if OVER
                let all = sum_of_lanes(t);
                if lane == 0u {
                    slots[s.slot * STRIDE + 8u] = all;
                }
#endif
                continuing {
                    j++;
                    break if j >= many;
                }
            }
            continuing {
                first += LANES;
                break if first >= end;
            }
        }
    }
#endif
}

fn square(x: f32) -> f32 {
    return x * x;
}

fn exponent_across(s: Fetched, dx: f32) -> f32 {
#if OVER
    return dx * dx * s.across + s.extra;
#else
    return dx * dx * s.across;
#endif
}
