// Stage `adam` of 3D scenes for colours: one step of every evaluated SH coefficient. The others
// keep their values and moments. One invocation per coefficient, with its three channels.

#import shared: Ellipsoid, EllipsoidGradient, evaluated, flat, is_finite, step
#import moments: moved, rates_of

@group(0) @binding(1) var<storage, read> gradients: array<EllipsoidGradient>;
@group(0) @binding(2) var<storage, read> ellipsoids: array<Ellipsoid>;
// [N, coefficients, 3]
@group(0) @binding(3) var<storage, read> v_sh: array<f32>;
@group(0) @binding(4) var<storage, read_write> sh: array<f32>;
#if PACKED
// First and second moments of degree 0, [N, 2, 3].
@group(0) @binding(5) var<storage, read_write> base_moments: array<f32>;
// Both moments of the others, [N, coefficients - 1, 3], as in gs-core's `packed_moments`.
@group(0) @binding(6) var<storage, read_write> packed_moments: array<u32>;

fn packed_place(index: u32, k: u32) -> u32 {
    return 3u * (index * (step.coefficients - 1u) + k - 1u);
}

fn moments_of(index: u32, k: u32, channel: u32) -> vec2f {
    if k == 0u {
        let at = 6u * index + channel;
        return vec2f(base_moments[at], base_moments[at + 3u]);
    }
    let both = packed_moments[packed_place(index, k) + channel];
    return bitcast<vec2f>(vec2u(both & 0xffff0000u, both << 16u));
}

fn random_bits(index: u32, steps: u32, number: u32) -> u32 {
    let block = ((index * 0x85ebca6bu) ^ (steps * 0xc2b2ae35u)) + number / 16u * 16u;
    var bits = number % 16u * 0x9e3779b9u + block * 0x27d4eb2fu;
    bits = (bits ^ (bits >> 16u)) * 0x21f0aaadu;
    bits = (bits ^ (bits >> 15u)) * 0x735a2d97u;
    return bits ^ (bits >> 15u);
}

// A moment whose upper half is then kept. The upper half of a NaN might overflow.
fn rounded(moment: f32, random: u32) -> u32 {
    let bits = bitcast<u32>(moment);
    return select(bits, bits + random, is_finite(moment));
}

fn store_moments(index: u32, k: u32, channel: u32, steps: u32, moments: vec2f) {
    if k == 0u {
        let at = 6u * index + channel;
        base_moments[at] = moments.x;
        base_moments[at + 3u] = moments.y;
        return;
    }
    let random = random_bits(index, steps, 3u * (k - 1u) + channel);
    let first = rounded(moments.x, random >> 16u);
    let second = rounded(moments.y, random & 0xffffu);
    packed_moments[packed_place(index, k) + channel] = (first & 0xffff0000u) | (second >> 16u);
}
#else
// First and second moments, [N, coefficients, 3] each.
@group(0) @binding(5) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(6) var<storage, read_write> second_moments: array<f32>;

fn moments_of(index: u32, k: u32, channel: u32) -> vec2f {
    let at = 3u * (index * step.coefficients + k) + channel;
    return vec2f(first_moments[at], second_moments[at]);
}

fn store_moments(index: u32, k: u32, channel: u32, steps: u32, moments: vec2f) {
    let at = 3u * (index * step.coefficients + k) + channel;
    first_moments[at] = moments.x;
    second_moments[at] = moments.y;
}
#endif

@compute @workgroup_size(64)
fn adam_color_3d(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let at = flat(group, groups) * 64u + lane;
    if at >= step.gaussians * step.coefficients {
        return;
    }
    let k = at % step.coefficients;
    if k >= evaluated() {
        return;
    }
    let index = at / step.coefficients;
    let visible = gradients[index].visible == 1u;
    if index < step.fixed || (step.visible_only == 1u && !visible) {
        return;
    }
    let steps = ellipsoids[index].steps;
    let rates = rates_of(vec4u(select(5u, 4u, k == 0u)), f32(steps));
    let first = 3u * at;
    var gradient = vec4f(0.0);
    if visible {
        gradient = vec4f(v_sh[first], v_sh[first + 1u], v_sh[first + 2u], 0.0);
    }
    let red = moments_of(index, k, 0u);
    let green = moments_of(index, k, 1u);
    let blue = moments_of(index, k, 2u);
    var m = vec4f(red.x, green.x, blue.x, 0.0);
    var v = vec4f(red.y, green.y, blue.y, 0.0);
    let by = moved(&m, &v, gradient, rates);
    for (var channel = 0u; channel < 3u; channel++) {
        sh[first + channel] -= by[channel];
        store_moments(index, k, channel, steps, vec2f(m[channel], v[channel]));
    }
}
