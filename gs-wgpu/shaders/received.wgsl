// The gradient of a splat: the sum over its entries' slots, which are neighbours.

#import prelude: GRADIENTS, STRIDE
#import shared: Splat, step

@group(0) @binding(2) var<storage, read> projected: array<Splat>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
@group(0) @binding(4) var<storage, read> slots: array<f32>;

// In the legend of `blend_bwd`: v_colour; Sx, Su; Sxx, Sxu, Suu; under `Over` S, else 0.
struct Received {
    color: vec3f,
    first: vec2f,
    second: vec3f,
    zeroth: f32,
    // Further sums for the statistic.
    collected: vec2f,
}

// The further sums of an entry.
fn collected_of(e: u32) -> vec2f {
#if ABSOLUTE
    return vec2f(slots[e * STRIDE + GRADIENTS], slots[e * STRIDE + GRADIENTS + 1u]);
#else
#if COLLECTS
    return vec2f(slots[e * STRIDE + GRADIENTS], 0.0);
#else
    return vec2f(0.0);
#endif
#endif
}

// The sums of a splat's slots.
struct Sums {
    gradients: array<f32, GRADIENTS>,
    collected: vec2f,
}

// The sums of splat `place`, by one invocation.
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

// The gradient of splat `place`.
fn received(place: u32) -> Received {
    let sums = sums_of(place);
    let s = sums.gradients;
#if OVER
    let zeroth = s[8];
#else
    let zeroth = 0.0;
#endif
    return Received(vec3f(s[0], s[1], s[2]), vec2f(s[3], s[4]), vec3f(s[5], s[6], s[7]), zeroth, sums.collected);
}

// The weight of a Gaussian's contribution to the densification statistic.
fn weight_of(sums: Received) -> u32 {
#if COUNT
    return u32(sums.collected.x);
#else
    return 1u;
#endif
}

// A Gaussian's contribution to the densification statistic, from v_mean, px^-1. It does not depend
// on the depth.
fn statistic_of(sums: Received, v_mean: vec2f) -> f32 {
#if ABSOLUTE
    return length(sums.collected * vec2f(step.size) * 0.5);
#else
#if ERROR
    return sums.collected.x;
#else
    let norm = length(v_mean * vec2f(step.size) * 0.5);
#if COUNT
    return sums.collected.x * norm;
#else
    return norm;
#endif
#endif
#endif
}
