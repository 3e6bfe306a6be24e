// Stage `adam` of 3D scenes: one step of every Gaussian without its colour, and its statistics. One
// invocation per Gaussian.

#import shared: Ellipsoid, EllipsoidGradient, EllipsoidMoments, exp_exact, flat, sigmoid
#import shared: Statistics, step, with_share
#import moments: moved, rates_of

@group(0) @binding(1) var<storage, read> gradients: array<EllipsoidGradient>;
@group(0) @binding(2) var<storage, read_write> ellipsoids: array<Ellipsoid>;
@group(0) @binding(3) var<storage, read_write> moments: array<EllipsoidMoments>;
@group(0) @binding(4) var<storage, read_write> statistics: array<Statistics>;

@compute @workgroup_size(64)
fn adam_3d(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 64u + lane;
    if index >= step.gaussians || index < step.fixed {
        return;
    }
    let gradient = gradients[index];
    if step.visible_only == 1u && gradient.visible == 0u {
        return;
    }
    var e = ellipsoids[index];
    e.steps += select(1u, 0u, e.steps == 0xffffffffu);
    let steps = f32(e.steps);
    var m = moments[index];
    var m0 = m.first[0];
    var v0 = m.second[0];
    // The penalty's gradient is w o (1 - o) by the opacity's logit, and w s by each ln-scale.
    let o = sigmoid(e.opacity_logit);
    let by_opacity = gradient.opacity_logit + step.decays[3].w * o * (1.0 - o);
    var by_scale = gradient.log_scale;
    if step.decays[1].w > 0.0 {
        by_scale += step.decays[1].w * vec3f(exp_exact(e.log_scale.x), exp_exact(e.log_scale.y), exp_exact(e.log_scale.z));
    }
    let place = moved(&m0, &v0, vec4f(gradient.mean, by_opacity), rates_of(vec4u(0u, 0u, 0u, 3u), steps));
    var m1 = m.first[1];
    var v1 = m.second[1];
    let size = moved(&m1, &v1, vec4f(by_scale, 0.0), rates_of(vec4u(1u), steps));
    var m2 = m.first[2];
    var v2 = m.second[2];
    e.rotation -= moved(&m2, &v2, gradient.rotation, rates_of(vec4u(2u), steps));
    m.first = array<vec4f, 3>(m0, m1, m2);
    m.second = array<vec4f, 3>(v0, v1, v2);
    e.mean -= place.xyz;
    e.opacity_logit -= place.w;
    let floor_ = vec3f(log(step.min_scale));
    let ceiling = vec3f(log(step.max_scale));
    var scales = e.log_scale - size.xyz;
    // NaN stays, so that the Gaussian is pruned.
    scales = select(scales, floor_, scales < floor_);
    scales = select(scales, ceiling, scales > ceiling);
    e.log_scale = scales;
    ellipsoids[index] = e;
    moments[index] = m;
    if step.collect == 1u && gradient.visible == 1u {
        statistics[index] = with_share(statistics[index], gradient.device_norm, gradient.weight);
    }
}
