// What `blend_vectors.wgsl` does with one entry at one pixel, and how lanes hand numbers to each other.

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
    let s = projected[entry.x];
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
