// Stage `adam`: one step of every Gaussian, and its statistics. One invocation per Gaussian.

#import prelude: MAX_ETA, MAX_XI
#import shared: determinant_of, exp_exact, factor_of, flat, Gaussian, Gradient, is_finite, Moments
#import shared: one_less_exp, solve_transposed, Statistics, step, with_share
#import moments: moved, rates_of

@group(0) @binding(1) var<storage, read> gradients: array<Gradient>;
@group(0) @binding(2) var<storage, read_write> gaussians: array<Gaussian>;
@group(0) @binding(3) var<storage, read_write> moments: array<Moments>;
@group(0) @binding(4) var<storage, read_write> statistics: array<Statistics>;

// The square root of a unit complex number.
fn half_way(z: vec2f) -> vec2f {
    if z.x >= 0.0 {
        let c = sqrt(0.5 * (1.0 + z.x));
        return vec2f(c, 0.5 * z.y / c);
    }
    let s = sqrt(0.5 * (1.0 - z.x));
    return vec2f(0.5 * abs(z.y) / s, select(-s, s, z.y >= 0.0));
}

// L with its scales clamped to their bounds, and its axes and right-hand rotation unchanged.
fn bounded(l: mat2x2f) -> mat2x2f {
    // Singular values: L is a sum of two scaled rotations; sum and difference of their lengths.
    let turning = 0.5 * vec2f(l[0].x + l[1].y, l[0].y - l[1].x);
    let mirroring = 0.5 * vec2f(l[0].x - l[1].y, l[0].y + l[1].x);
    let q = length(turning);
    let r = length(mirroring);
    let scale = vec2f(q + r, abs(determinant_of(l)) / max(q + r, 1e-30));
    let within = clamp(scale, vec2f(step.min_scale), vec2f(step.max_scale));
    if all(within == scale) || !is_finite(scale.x) {
        return l;
    }
    let a = select(turning / q, vec2f(1.0, 0.0), q == 0.0);
    let b = select(mirroring / r, vec2f(1.0, 0.0), r == 0.0);
    let axis = half_way(vec2f(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x));
    let axes = mat2x2f(axis, vec2f(-axis.y, axis.x));
    let factor = within / scale;
    if is_finite(factor.y) {
        return axes * mat2x2f(vec2f(factor.x, 0.0), vec2f(0.0, factor.y)) * transpose(axes) * l;
    }
    return axes * mat2x2f(vec2f(within.x, 0.0), vec2f(0.0, within.y));
}

// L (I + eta + eta²/2) with eta = -`by`, and scales within their bounds.
fn turn(l: mat2x2f, by: vec3f) -> mat2x2f {
    let eta = clamp(-by, vec3f(-MAX_ETA), vec3f(MAX_ETA));
    let b2 = eta.y * eta.y;
    let xx = 1.0 + eta.x + 0.5 * (eta.x * eta.x + b2);
    let yy = 1.0 + eta.z + 0.5 * (eta.z * eta.z + b2);
    let xy = eta.y + 0.5 * eta.y * (eta.x + eta.z);
    let turned = mat2x2f(l[0] * xx + l[1] * xy, l[0] * xy + l[1] * yy);
    let frobenius = sqrt(dot(turned[0], turned[0]) + dot(turned[1], turned[1]));
    let suspicious = abs(determinant_of(turned)) <= step.min_scale * frobenius || frobenius > step.max_scale;
    if suspicious {
        return bounded(turned);
    }
    return turned;
}

@compute @workgroup_size(64)
fn adam(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 64u + lane;
    if index >= step.gaussians || index < step.fixed {
        return;
    }
    let gradient = gradients[index];
    if step.visible_only == 1u && gradient.visible == 0u {
        return;
    }
    var g = gaussians[index];
    var m = moments[index];
    g.steps += select(1u, 0u, g.steps == 0xffffffffu);
    let steps = f32(g.steps);

    var by_mean = vec2f(0.0);
    var by_shape = vec3f(0.0);
    let l = factor_of(g.shape);
#if COVARIANCE_FACTOR
    by_mean = gradient.xi;
    by_shape = gradient.eta;
    let third = 1u;
#else
    if gradient.visible == 1u {
        let log_ratio = g.shape.x - g.shape.y;
        let twice_sinh = sign(log_ratio) * exp_exact(abs(log_ratio)) * one_less_exp(-2.0 * abs(log_ratio));
        by_mean = solve_transposed(l, gradient.xi);
        by_shape = vec3f(gradient.eta.x, gradient.eta.z, gradient.eta.y * twice_sinh);
    }
    let third = 2u;
#endif
    var first = m.first;
    var second = m.second;
    var m0 = first[0];
    var v0 = second[0];
    let place = moved(&m0, &v0, vec4f(by_mean, by_shape.xy), rates_of(vec4u(0u, 0u, 1u, 1u), steps));
    var m1 = first[1];
    var v1 = second[1];
    let rest = moved(&m1, &v1, vec4f(by_shape.z, gradient.color), rates_of(vec4u(third, 4u, 4u, 4u), steps));
    m.first = array<vec4f, 2>(m0, m1);
    m.second = array<vec4f, 2>(v0, v1);
    g.color -= rest.yzw;
#if COVARIANCE_FACTOR
    g.mean -= l * clamp(place.xy, vec2f(-MAX_XI), vec2f(MAX_XI));
    let turned = turn(l, vec3f(place.zw, rest.x));
    g.shape = vec4f(turned[0], turned[1]);
#else
    g.mean -= place.xy;
    let floor_ = log(step.min_scale);
    let ceiling = log(step.max_scale);
    var scales = g.shape.xy - place.zw;
    // NaN stays, so that the Gaussian is pruned.
    scales = select(scales, vec2f(floor_), scales < vec2f(floor_));
    scales = select(scales, vec2f(ceiling), scales > vec2f(ceiling));
    g.shape = vec4f(scales, g.shape.z - rest.x, 0.0);
#endif
    if step.opaque == 0u {
        var mo = vec4f(m.opacity.x);
        var vo = vec4f(m.opacity.y);
        let by = moved(&mo, &vo, vec4f(gradient.opacity_logit), rates_of(vec4u(3u), steps));
        m.opacity = vec4f(mo.x, vo.x, 0.0, 0.0);
        g.opacity_logit -= by.x;
    }
    gaussians[index] = g;
    moments[index] = m;
    if step.collect == 1u && gradient.visible == 1u {
        statistics[index] = with_share(statistics[index], gradient.device_norm, gradient.weight);
    }
}
