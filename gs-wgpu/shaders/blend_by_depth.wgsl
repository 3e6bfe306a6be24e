// Stages `blend` and `blend_bwd` under `Over` with a sort at each pixel, which is exact even where
// Gaussians interpenetrate. One work group per tile, one invocation per pixel.
//
// A pixel walks along its tile's queue, which is nearly in the pixel's own order. It holds the HELD
// nearest Gaussians that it has not blended yet. When another arrives, the pixel blends the nearest
// if no later entry of the queue can be nearer. Otherwise it postpones the farthest, and all that
// are farther, to the next walk, which begins at the first postponed entry. Each walk blends at
// least HELD Gaussians, so there are few walks.
//
// BACKWARD: pixels reach an entry in any order. The gradients of an entry are therefore summed as
// 64-bit fixed-point numbers, whose sum does not depend on the order. `units` computes their units.
// Lengths are scaled by powers of two, so that only the conversion to these units rounds.
//
// Legend: that of `blend_bwd`.

#import prelude: GRADIENTS, HELD, STRIDE, TILE_COLUMNS, TILE_ROWS
#import shared: FARTHEST, NO_DEPTH, flat, is_nan, Queued, step
#import counted: Counted
#import queued: UNITS, WORDS, power_of_two, twice_sigma, Unit, unit_of
#import at_pixel: blended, through_alpha, weights_at

@group(0) @binding(1) var<storage, read> tile_start: array<u32>;
@group(0) @binding(2) var<storage, read> queue: array<Queued>;
@group(0) @binding(3) var<storage, read_write> status: Counted;
#if BACKWARD
@group(0) @binding(4) var<storage, read> v_image: array<vec4f>;
@group(0) @binding(5) var<storage, read> image: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> slots: array<f32>;
// [entries, WORDS], by place in the queue.
@group(0) @binding(7) var<storage, read_write> totals: array<atomic<u32>>;
#if ERROR
@group(0) @binding(8) var<storage, read> target_image: array<vec4f>;
#endif
#else
// RGB and transmittance.
@group(0) @binding(4) var<storage, read_write> image: array<vec4f>;
#endif

// Largest number of iterations of a pixel. Software drivers end all loops of a vector of
// invocations after 65,535 iterations; a pixel that leaves its loop too early is unfinished.
const MOST_STEPS: u32 = 56000u;

// A Gaussian at one pixel.
struct Seen {
    depth: f32,
    // Index in the scene, which decides ties.
    index: u32,
    // Place in the queue.
    at: u32,
    // Opacity times weight.
    uncut: f32,
}

fn empty() -> Seen {
    return Seen(NO_DEPTH, 0xffffffffu, 0u, 0.0);
}

fn is_somebody(seen: Seen) -> bool {
    return seen.depth < NO_DEPTH;
}

fn is_nearer(a: Seen, b: Seen) -> bool {
    return a.depth < b.depth || (a.depth == b.depth && a.index < b.index);
}

fn seen_at(at: u32, q: Queued, d: vec2f) -> Seen {
    let u = d.y - q.slope * d.x;
    let w = weights_at(q.inverse_xx, q.c, d.x, vec4f(u)).x;
    let depth = fma(d.x, q.depth_slope.x, fma(d.y, q.depth_slope.y, q.depth));
    return Seen(select(clamp(depth, -FARTHEST, FARTHEST), FARTHEST, is_nan(depth)), q.index, at, w * q.opacity);
}

// The state of a pixel.
struct Pixel {
    center: vec2f,
    transmittance: f32,
#if BACKWARD
    v: vec3f,
    // v_C . (the colour behind).
    rest: f32,
#if ERROR
    error: f32,
#endif
#else
    color: vec3f,
#endif
}

#if BACKWARD
// The largest power of two that is at most the square root.
fn binary_root(x: f32) -> f32 {
    return bitcast<f32>((((bitcast<u32>(x) >> 23u) + 127u) >> 1u) << 23u);
}

// Powers of two by which dx and u, and the halves of Sigma'^-1 d, are multiplied.
struct Lengths {
    whiten: vec2f,
    pull: vec2f,
}

fn lengths_of(q: Queued) -> Lengths {
    let whiten = vec2f(binary_root(q.inverse_xx), binary_root(q.c));
    let across = 2.0 * (whiten.x + abs(q.slope) * whiten.y);
    return Lengths(whiten, vec2f(power_of_two(126 - i32(bitcast<u32>(across) >> 23u)), 0.5 / whiten.y));
}

// `x`: in units. `total`: the position of the sum's low half.
fn add(total: u32, x: f32) {
    // At most twice the expected bound. A larger number overflows, and so does the sum.
    let most = 18014398509481984.0;
    let y = select(most, abs(x), abs(x) <= most);
    let above = floor(y * (1.0 / 4294967296.0));
    var high = u32(above);
    var low = u32(y - above * 4294967296.0);
    if (low | high) == 0u {
        return;
    }
    if x < 0.0 {
        low = ~low + 1u;
        high = ~high + select(0u, 1u, low == 0u);
    }
    let before = atomicAdd(&totals[total], low);
    let carried = high + select(0u, 1u, before + low < before);
    if carried != 0u {
        atomicAdd(&totals[total + 1u], carried);
    }
}

fn sum_of(total: u32, unit: Unit) -> f32 {
    var low = atomicLoad(&totals[total]);
    var high = atomicLoad(&totals[total + 1u]);
    let is_negative = high >> 31u == 1u;
    if is_negative {
        low = ~low + 1u;
        high = ~high + select(0u, 1u, low == 0u);
    }
    let size = (f32(high) * 4294967296.0 + f32(low)) * unit.size;
    return select(size, -size, is_negative);
}
#endif

// Blends a Gaussian behind the earlier ones. Returns whether the pixel was not full.
fn blend_one(pixel: ptr<function, Pixel>, seen: Seen) -> bool {
    let q = queue[seen.at];
    let before = (*pixel).transmittance;
    let b = blended(vec4f(before), vec4f(seen.uncut));
    if b.transmittance.x < 0.0 {
        return false;
    }
    let share = b.share.x;
    (*pixel).transmittance = b.transmittance.x;
#if BACKWARD
    let v = (*pixel).v;
    let v_w = dot(v, q.color);
    (*pixel).rest -= share * v_w;
    let t = through_alpha(b, vec4f(before), vec4f(v_w), vec4f((*pixel).rest)).x;
    let d = (*pixel).center - q.mean;
    let u = d.y - q.slope * d.x;
    let lengths = lengths_of(q);
    let z = vec2f(d.x, u) * lengths.whiten;
    let total = seen.at * WORDS;
    let units = atomicLoad(&totals[total + UNITS]);
    let of_color = unit_of(units, 0u).scale;
    let unit = unit_of(units, 1u).scale;
    add(total, share * v.x * of_color);
    add(total + 2u, share * v.y * of_color);
    add(total + 4u, share * v.z * of_color);
    add(total + 6u, t * z.x * unit);
    add(total + 8u, t * z.y * unit);
    add(total + 10u, t * z.x * z.x * unit);
    add(total + 12u, t * z.x * z.y * unit);
    add(total + 14u, t * z.y * z.y * unit);
    add(total + 16u, t * unit);
#if ABSOLUTE
    let down = q.c * u;
    add(total + 2u * GRADIENTS, abs(t * (q.inverse_xx * d.x - q.slope * down) * lengths.pull.x) * unit);
    add(total + 2u * GRADIENTS + 2u, abs(t * down * lengths.pull.y) * unit);
#endif
#if COUNT
    add(total + 2u * GRADIENTS, 1.0);
#endif
#if ERROR
    add(total + 2u * GRADIENTS, share * (*pixel).error * unit_of(units, 2u).scale);
#endif
#else
    (*pixel).color += share * q.color;
#endif
    return true;
}

@compute @workgroup_size(TILE_COLUMNS, TILE_ROWS)
fn blend_by_depth(
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
    let column = corner.x + lane.x;
    let row = corner.y + lane.y;
    let is_inside = column < step.size.x && row < step.size.y;
    let place = row * step.size.x + column;
    let start = tile_start[tile];
    let end = tile_start[tile + 1u];
    var pixel: Pixel;
    pixel.center = vec2f(vec2u(column, row)) + 0.5;
    pixel.transmittance = 1.0;
#if BACKWARD
    if is_inside {
        let color = image[place].xyz;
        pixel.v = v_image[place].xyz;
        pixel.rest = dot(pixel.v, color);
#if ERROR
        pixel.error = dot(abs(color - target_image[place].xyz), vec3f(1.0 / 3.0));
#endif
    }
#endif
    // The held Gaussians, nearest first.
    var held: array<Seen, HELD>;
#each k HELD
    held[@k] = empty();
#end
    // The nearest postponed Gaussian, the first place of a postponed one, and the first place of
    // this walk.
    var put_off = empty();
    var resume = end;
    var nearest = Seen(-NO_DEPTH, 0u, 0u, 0.0);
    var cursor = start;
    var is_done = !is_inside || start == end;
    var steps = 0u;
    // All walks, eight entries at a time. Loops test at their ends, because software drivers
    // otherwise run their bodies once more.
    if !is_done {
        loop {
            let first = cursor;
            var reaching = 0u;
#each e EIGHT
            {
                let q = queue[min(first + @eu, end - 1u)];
                let reaches = first + @eu < end && twice_sigma(q, pixel.center - q.mean) <= q.reach;
                reaching |= select(0u, 1u << @eu, reaches);
            }
#end
            cursor += 8u;
            // No later entry can be nearer than the postponed ones.
            let ends = cursor >= end || queue[min(cursor, end - 1u)].lower > put_off.depth;
            // Each of the eight entries that reaches the pixel; at the end of a walk, also all held
            // Gaussians.
            loop {
                var next = empty();
                var lower = NO_DEPTH;
                if reaching != 0u {
                    let at = first + firstTrailingBit(reaching);
                    reaching &= reaching - 1u;
                    let q = queue[at];
                    let seen = seen_at(at, q, pixel.center - q.mean);
                    if seen.uncut >= step.alpha_cut && !is_nearer(seen, nearest) {
                        next = seen;
                        lower = q.lower;
                    }
                }
                let is_next = is_somebody(next);
                let makes_room = is_next && is_somebody(held[HELD - 1u]) && held[0].depth < lower;
                let leaves = ends && reaching == 0u && !is_next && is_somebody(held[0]);
                if makes_room || leaves {
                    is_done = !blend_one(&pixel, held[0]);
#each k HELD_LESS_ONE
                    held[@k] = held[@k + 1];
#end
                    held[HELD - 1u] = empty();
                }
                if is_next {
                    let comes_before = is_nearer(next, put_off);
                    resume = select(min(resume, next.at), resume, comes_before);
                    if comes_before {
#each k HELD
                        if is_nearer(next, held[@k]) {
                            let farther = held[@k];
                            held[@k] = next;
                            next = farther;
                        }
#end
                        if is_somebody(next) {
                            put_off = next;
                            resume = min(resume, next.at);
                        }
                    }
                }
                steps++;
                continuing {
                    break if is_done || (reaching == 0u && !(ends && is_somebody(held[0])));
                }
            }
            if ends && !is_done && reaching == 0u && !is_somebody(held[0]) {
                is_done = !is_somebody(put_off);
                nearest = put_off;
                cursor = resume;
                put_off = empty();
                resume = end;
            }
            steps++;
            continuing {
                break if is_done || steps >= MOST_STEPS;
            }
        }
    }
#if BACKWARD
    storageBarrier();
    var at = start + invocation;
    for (; at < end; at += TILE_COLUMNS * TILE_ROWS) {
        let q = queue[at];
        let lengths = lengths_of(q);
        let px = 1.0 / lengths.whiten;
        let total = at * WORDS;
        let units = atomicLoad(&totals[total + UNITS]);
        let of_color = unit_of(units, 0u);
        let unit = unit_of(units, 1u);
        let slot = q.slot * STRIDE;
        slots[slot] = sum_of(total, of_color);
        slots[slot + 1u] = sum_of(total + 2u, of_color);
        slots[slot + 2u] = sum_of(total + 4u, of_color);
        slots[slot + 3u] = sum_of(total + 6u, unit) * px.x;
        slots[slot + 4u] = sum_of(total + 8u, unit) * px.y;
        slots[slot + 5u] = sum_of(total + 10u, unit) * px.x * px.x;
        slots[slot + 6u] = sum_of(total + 12u, unit) * px.x * px.y;
        slots[slot + 7u] = sum_of(total + 14u, unit) * px.y * px.y;
        slots[slot + 8u] = sum_of(total + 16u, unit);
#if ABSOLUTE
        slots[slot + GRADIENTS] = sum_of(total + 2u * GRADIENTS, unit) / lengths.pull.x;
        slots[slot + GRADIENTS + 1u] = sum_of(total + 2u * GRADIENTS + 2u, unit) / lengths.pull.y;
#endif
#if COUNT
        slots[slot + GRADIENTS] = sum_of(total + 2u * GRADIENTS, Unit(1.0, 1.0));
#endif
#if ERROR
        slots[slot + GRADIENTS] = sum_of(total + 2u * GRADIENTS, unit_of(units, 2u));
#endif
    }
    is_done &= at >= end;
#else
    if is_inside {
        image[place] = vec4f(pixel.color + pixel.transmittance * step.background, pixel.transmittance);
    }
#endif
    if !is_done {
        atomicAdd(&status.unfinished, 1u);
    }
}
