// What a Gaussian received from the pixels: the sums over its entries' slots, which stand side by side. Where invocations are lanes of a CPU's
// vector, they add up eight Gaussians' slots together, because a Gaussian with many entries would keep the others' lanes waiting.

@group(0) @binding(2) var<storage, read> splats: array<Splat>;
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

// Of splat `first_of_group + lane`; to be called by all lanes of a work group, those of no splat included.
fn received(first_of_group: u32, lane: u32) -> Received {
#if VECTORS
    // Each lane one number of every entry of the eight Gaussians; then each lane all of one Gaussian.
    var by_gaussian: array<f32, 8>;
    var last = 0.0;
    var collected = vec2f(0.0);
#each g EIGHT
    {
        let gaussian = min(first_of_group + @gu, step.gaussians - 1u);
        let end = offsets[gaussian + 1u];
        var e = offsets[gaussian];
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
        by_gaussian[@g] = sum;
#if OVER
        last = select(last, sum_of_last, lane == @gu);
#endif
        collected = select(collected, sum_of_collected, lane == @gu);
    }
#end
    let sums = transposed(by_gaussian, lane);
#else
    var sums: array<f32, GRADIENTS>;
    var collected = vec2f(0.0);
    let gaussian = min(first_of_group + lane, step.gaussians - 1u);
    let end = offsets[gaussian + 1u];
    for (var e = offsets[gaussian]; e < end; e++) {
        for (var k = 0u; k < GRADIENTS; k++) {
            sums[k] += slots[e * STRIDE + k];
        }
        collected += collected_of(e);
    }
#if OVER
    let last = sums[8];
#else
    let last = 0.0;
#endif
#endif
    return Received(
        vec3f(sums[0], sums[1], sums[2]),
        vec2f(sums[3], sums[4]),
        vec3f(sums[5], sums[6], sums[7]),
        last,
        collected,
    );
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
