// Stage `adam` of 3D scenes for colours: one step of every evaluated SH coefficient. The others
// keep their values and moments. One invocation per coefficient, with its three channels.

@group(0) @binding(1) var<storage, read> gradients: array<EllipsoidGradient>;
@group(0) @binding(2) var<storage, read> ellipsoids: array<Ellipsoid>;
// [N, coefficients, 3]
@group(0) @binding(3) var<storage, read> v_sh: array<f32>;
@group(0) @binding(4) var<storage, read_write> sh: array<f32>;
// First and second moments.
@group(0) @binding(5) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(6) var<storage, read_write> second_moments: array<f32>;

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
    if step.visible_only == 1u && !visible {
        return;
    }
    // SH above degree 0 take turns, in groups of neighbours. The number of their moves corrects the
    // bias of their moments.
    var steps = ellipsoids[index].steps;
    if k > 0u {
        let every = step.color_rest_every;
        let at = steps % every + index / COLOR_REST_TURN % every;
        if at % every != 0u {
            return;
        }
        steps = steps / every + at / every;
    }
    let rates = rates_of(vec4u(select(5u, 4u, k == 0u)), f32(steps));
    let first = 3u * at;
    var gradient = vec4f(0.0);
    if visible {
        gradient = vec4f(v_sh[first], v_sh[first + 1u], v_sh[first + 2u], 0.0);
    }
    var m = vec4f(first_moments[first], first_moments[first + 1u], first_moments[first + 2u], 0.0);
    var v = vec4f(second_moments[first], second_moments[first + 1u], second_moments[first + 2u], 0.0);
    let by = moved(&m, &v, gradient, rates);
    for (var channel = 0u; channel < 3u; channel++) {
        sh[first + channel] -= by[channel];
        first_moments[first + channel] = m[channel];
        second_moments[first + channel] = v[channel];
    }
}
