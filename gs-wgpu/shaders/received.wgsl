// What a Gaussian received from the pixels: the sums over its entries' slots, which stand side by side. Where invocations are lanes of a CPU's
// vector, they add up eight Gaussians' slots together, because a Gaussian with many entries would keep the others' lanes waiting; but not
// where those have more entries than such a driver lets one invocation loop over. The sums are the same, bit for bit.

@group(0) @binding(2) var<storage, read> projected: array<Splat>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
@group(0) @binding(4) var<storage, read> slots: array<f32>;

// In the legend of `blend_bwd`: v_colour; Sx, Su; Sxx, Sxu, Suu; under `Over` S, else 0.
struct Received {
    color: vec3f,
    first: vec2f,
    second: vec3f,
    zeroth: f32,
    // What is collected besides.
    collected: vec2f,
}

// What is collected of an entry.
fn collected_of(e: u32) -> vec2f {
#if ABSOLUTE
    return vec2f(slots[e * STRIDE + GRADIENTS], slots[e * STRIDE + GRADIENTS + 1u]);
#else
#if ERROR
    return vec2f(slots[e * STRIDE + GRADIENTS], 0.0);
#else
    return vec2f(0.0);
#endif
#endif
}

#if VECTORS
const INVOCATIONS: u32 = LANES;

// Of eight numbers, whose k-th lanes belong together, the l-th in lane l; and so that every lane has all eight of its own.
fn transposed(rows: array<f32, 8>, lane: u32) -> array<f32, 8> {
    var r = rows;
#each s STAGES
    {
        let bit = 1u << @su;
        let upper = (lane & bit) != 0u;
        var t: array<f32, 8>;
#each k EIGHT
        {
            // Of the pair of rows k and k with that bit turned, the one that stays in this half of the lanes.
            let other = subgroupShuffleXor(r[@ku ^ bit], bit);
            t[@k] = select(r[@k], other, upper != ((@ku & bit) != 0u));
        }
#end
        r = t;
    }
#end
    return r;
}
#else
const INVOCATIONS: u32 = 64u;
#endif

// The sums of a splat's slots.
struct Sums {
    gradients: array<f32, GRADIENTS>,
    collected: vec2f,
}

// Of splat `place`, by one invocation.
fn sums_of(place: u32) -> Sums {
    var sums: Sums;
    let end = offsets[place + 1u];
    for (var e = offsets[place]; e < end; e++) {
#each k EIGHT
        sums.gradients[@k] += slots[e * STRIDE + @ku];
#end
#if OVER
        sums.gradients[8] += slots[e * STRIDE + 8u];
#endif
        sums.collected += collected_of(e);
    }
    return sums;
}

#if VECTORS
// The first entry of splat `place`, and the end of the last splat's for those that are beyond it.
fn first_entry(place: u32) -> u32 {
    return offsets[min(place, step.gaussians)];
}

// Of splat `first_of_group + lane`, by all lanes: each sums one number of every entry of the eight projected, and then takes all of one splat.
fn sums_together(first_of_group: u32, lane: u32) -> Sums {
    var by_splat: array<f32, 8>;
    var sums: Sums;
#each g EIGHT
    {
        let end = first_entry(first_of_group + @gu + 1u);
        var e = first_entry(first_of_group + @gu);
        var sum = 0.0;
#if OVER
        var sum_of_last = 0.0;
#endif
        var sum_of_collected = vec2f(0.0);
        if e < end {
            loop {
                sum += slots[e * STRIDE + lane];
#if OVER
                sum_of_last += slots[e * STRIDE + 8u];
#endif
                sum_of_collected += collected_of(e);
                continuing {
                    e++;
                    break if e >= end;
                }
            }
        }
        by_splat[@g] = sum;
#if OVER
        sums.gradients[8] = select(sums.gradients[8], sum_of_last, lane == @gu);
#endif
        sums.collected = select(sums.collected, sum_of_collected, lane == @gu);
    }
#end
    let mine = transposed(by_splat, lane);
#each k EIGHT
    sums.gradients[@k] = mine[@k];
#end
    return sums;
}
#endif

// Of splat `first_of_group + lane`; to be called by all lanes of a work group, those of no splat included.
fn received(first_of_group: u32, lane: u32) -> Received {
    let place = min(first_of_group + lane, step.gaussians - 1u);
    var sums: Sums;
#if VECTORS
    if first_entry(first_of_group + LANES) - first_entry(first_of_group) <= LONGEST_LOOP {
        sums = sums_together(first_of_group, lane);
    } else {
        sums = sums_of(place);
    }
#else
    sums = sums_of(place);
#endif
    let s = sums.gradients;
#if OVER
    let zeroth = s[8];
#else
    let zeroth = 0.0;
#endif
    return Received(vec3f(s[0], s[1], s[2]), vec2f(s[3], s[4]), vec3f(s[5], s[6], s[7]), zeroth, sums.collected);
}

// The statistic that a training step collects of a Gaussian, from v_mean, px^-1.
fn statistic_of(sums: Received, v_mean: vec2f) -> f32 {
#if ABSOLUTE
    return length(sums.collected * vec2f(step.size) * 0.5);
#else
#if ERROR
    return sums.collected.x;
#else
    return length(v_mean * vec2f(step.size) * 0.5);
#endif
#endif
}
