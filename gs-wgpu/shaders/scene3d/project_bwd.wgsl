// Stage `project_bwd` of 3D scenes: computes the gradient of a Gaussian's parameters from those of
// its entries. One invocation per place; gradients are by index.
//
// With Sigma'^-1 d = A (dx, u): v_mean' = sum t Sigma'^-1 d, v_Sigma' = ½ sum t (Sigma'^-1
// d)(Sigma'^-1 d)^T, linear in the slots' sums.
//
// With CAMERA, each work group also sums what its Gaussians add to the gradient by the camera, in a
// fixed order; `camera_gradient_3d` sums the groups.

#import prelude: SH_C1, SH_C2, SH_C3
#import shared: Ellipsoid, EllipsoidGradient, evaluated, flat, sigmoid, step
#import received: offsets, projected, received, statistic_of, weight_of
#import scene3d/camera_sum: CameraGradient, camera_row, sum_of_group
#import scene3d/shared: basis, Camera, in_camera, in_world, intermediate, towards, turned

@group(0) @binding(1) var<uniform> camera: Camera;
// [N]; with CAMERA, rows of sums follow, one per work group.
@group(0) @binding(5) var<storage, read_write> gradients: array<EllipsoidGradient>;
@group(0) @binding(6) var<storage, read> ellipsoids: array<Ellipsoid>;
// [N, coefficients, 3]
@group(0) @binding(7) var<storage, read> sh: array<f32>;
@group(0) @binding(8) var<storage, read_write> v_sh: array<f32>;
// Place -> index.
@group(0) @binding(9) var<storage, read> order: array<u32>;

#if CAMERA
// What this invocation's Gaussian adds to the gradient by the camera.
var<private> by_camera: CameraGradient;
#endif

// Sum of a_k grad Y_k(d) up to the evaluated degree.
fn weighted_gradients(d: vec3f, a: ptr<function, array<f32, 16>>) -> vec3f {
    if step.sh_degree == 0u {
        return vec3f(0.0);
    }
    let x = d.x;
    let y = d.y;
    let z = d.z;
    var sum = vec3f(-(*a)[3], -(*a)[1], (*a)[2]) * SH_C1;
    if step.sh_degree == 1u {
        return sum;
    }
    let xy = (*a)[4] * SH_C2[0];
    let yz = (*a)[5] * SH_C2[1];
    let zz = (*a)[6] * SH_C2[2];
    let xz = (*a)[7] * SH_C2[3];
    let xx = (*a)[8] * SH_C2[4];
    sum += vec3f(
        xy * y - 2.0 * zz * x + xz * z + 2.0 * xx * x,
        xy * x + yz * z - 2.0 * zz * y - 2.0 * xx * y,
        yz * y + 4.0 * zz * z + xz * x,
    );
    if step.sh_degree == 2u {
        return sum;
    }
    let b0 = (*a)[9] * SH_C3[0];
    let b1 = (*a)[10] * SH_C3[1];
    let b2 = (*a)[11] * SH_C3[2];
    let b3 = (*a)[12] * SH_C3[3];
    let b4 = (*a)[13] * SH_C3[4];
    let b5 = (*a)[14] * SH_C3[5];
    let b6 = (*a)[15] * SH_C3[6];
    let x2 = x * x;
    let y2 = y * y;
    let z2 = z * z;
    let ring = 4.0 * z2 - x2 - y2;
    return sum + vec3f(
        6.0 * b0 * x * y + b1 * y * z - 2.0 * b2 * x * y - 6.0 * b3 * x * z + b4 * (ring - 2.0 * x2) + 2.0 * b5 * x * z
            + 3.0 * b6 * (x2 - y2),
        3.0 * b0 * (x2 - y2) + b1 * x * z + b2 * (ring - 2.0 * y2) - 6.0 * b3 * y * z - 2.0 * b4 * x * y - 2.0 * b5 * y * z
            - 6.0 * b6 * x * y,
        b1 * x * y + 8.0 * b2 * y * z + 3.0 * b3 * (2.0 * z2 - x2 - y2) + 8.0 * b4 * x * z + b5 * (x2 - y2),
    );
}

// Writes v_sh; returns v_mean through the direction.
fn color_bwd(index: u32, mean: vec3f, v_color: vec3f) -> vec3f {
    let seen = towards(camera, mean);
    let d = seen.xyz;
    var y_k = basis(d);
    let first = index * step.coefficients * 3u;
    var sum = vec3f(0.5);
    for (var k = 0u; k < evaluated(); k++) {
        let at = first + 3u * k;
        sum += vec3f(sh[at], sh[at + 1u], sh[at + 2u]) * y_k[k];
    }
    let v = select(vec3f(0.0), v_color, sum > vec3f(0.0));
    var a: array<f32, 16>;
    for (var k = 0u; k < step.coefficients; k++) {
        let at = first + 3u * k;
        var v_k = vec3f(0.0);
        if k < evaluated() {
            a[k] = dot(vec3f(sh[at], sh[at + 1u], sh[at + 2u]), v);
            v_k = v * y_k[k];
        }
        v_sh[at] = v_k.x;
        v_sh[at + 1u] = v_k.y;
        v_sh[at + 2u] = v_k.z;
    }
    let v_d = weighted_gradients(d, &a);
    return (v_d - d * dot(d, v_d)) * seen.w;
}

// Writes v_sh = 0.
fn sh_without_effect_bwd(index: u32) {
    let first = index * step.coefficients * 3u;
    for (var at = first; at < first + 3u * step.coefficients; at++) {
        v_sh[at] = 0.0;
    }
}

// v_mean through the inverse depth.
fn inverse_depth_bwd(mean: vec3f, v_color: vec3f) -> vec3f {
    let inverse_z = 1.0 / in_camera(camera, mean).z;
    return in_world(camera, vec3f(0.0, 0.0, -inverse_z * inverse_z * (v_color.x + v_color.y + v_color.z)));
}

// The gradient by the parameters from v_mean', v_Sigma' (xx; xy and yx each; yy) and v_(ln o),
// without the mean's part through the colour. With CAMERA, also sets `by_camera`.
fn geometry_bwd(e: Ellipsoid, v_mean: vec2f, v_covariance: vec3f, v_log_opacity: f32) -> EllipsoidGradient {
    let p = in_camera(camera, e.mean);
    let i = intermediate(camera, e, p);
    var v_r0 = 2.0 * (v_covariance.x * i.r0 + v_covariance.y * i.r1);
    var v_r1 = 2.0 * (v_covariance.y * i.r0 + v_covariance.z * i.r1);
    if camera.compensates == 1u && step.opaque == 0u {
        // ln of the compensation is ½ (ln D - ln D'), D = |n|², D' = D + delta (|r0|² + |r1|²) +
        // delta².
        let n = cross(i.r0, i.r1);
        let det = dot(n, n);
        let delta = camera.dilation;
        // The compensation is at least the cut of alpha, or this Gaussian would not be drawn. So D
        // is not 0.
        let grown = delta * (dot(i.r0, i.r0) + dot(i.r1, i.r1)) + delta * delta;
        let by_minors = grown / (det * (det + grown));
        let by_trace = delta / (det + grown);
        v_r0 += v_log_opacity * (by_minors * cross(i.r1, n) - by_trace * i.r0);
        v_r1 += v_log_opacity * (by_minors * cross(n, i.r0) - by_trace * i.r1);
    }
    // r0 = fx/z (m0 - tx m2), r1 = fy/z (m1 - ty m2).
    let scale = camera.focal * i.inverse_z;
    let v_m0 = scale.x * v_r0;
    let v_m1 = scale.y * v_r1;
    let v_m2 = -(i.clamped.x * v_m0 + i.clamped.y * v_m1);
    let v_clamped = -vec2f(dot(v_m0, i.m[2]), dot(v_m1, i.m[2]));
    let v_slope = camera.focal * v_mean + select(vec2f(0.0), v_clamped, i.slope == i.clamped);
    let v_depth = -i.inverse_z * (dot(v_slope, i.slope) + dot(v_r0, i.r0) + dot(v_r1, i.r1));
    // A rotation about the camera's axes, then about the world's.
    let v_turn = vec3f(
        dot(i.m[1], v_m2) - dot(i.m[2], v_m1),
        dot(i.m[2], v_m0) - dot(i.m[0], v_m2),
        dot(i.m[0], v_m1) - dot(i.m[1], v_m0),
    );
    let turn = in_world(camera, v_turn) * (2.0 * i.inverse_norm);
    let axis = i.unit.yzw;
    let imaginary = i.unit.x * turn + cross(turn, axis);
    let v_p = vec3f(i.inverse_z * v_slope, v_depth);
#if CAMERA
    // u = fx x/z + cx, and the bounds of tx are (-cx and W - cx, less and plus a share of W)/fx.
    let v_bound = select(v_clamped, vec2f(0.0), i.slope == i.clamped) / camera.focal;
    let v_focal = v_mean * i.slope + vec2f(dot(v_r0, i.r0), dot(v_r1, i.r1)) / camera.focal - v_bound * i.clamped;
    by_camera = CameraGradient(v_p, cross(p, v_p) + v_turn, v_focal, v_mean - v_bound);
#endif
    var g: EllipsoidGradient;
    g.mean = in_world(camera, v_p);
    g.log_scale = v_r0 * i.r0 + v_r1 * i.r1;
    g.rotation = vec4f(-dot(turn, axis), imaginary);
    if step.opaque == 0u {
        g.opacity_logit = v_log_opacity * sigmoid(-e.opacity_logit);
    }
    g.visible = 1u;
    return g;
}

fn differentiate(place: u32) {
    let sums = received(place);
    let index = order[place];
    let s = projected[place];
    var gradient: EllipsoidGradient;
    if offsets[place] < offsets[place + 1u] && s.half_x >= 0.0 {
        let conic = mat2x2f(vec2f(s.inverse_xx, 0.0), vec2f(-s.slope * s.c, s.c));
        let v_mean = conic * sums.first;
        let half = 0.5 * sums.second;
        let v_covariance = conic * mat2x2f(half.xy, half.yz) * transpose(conic);
        let e = ellipsoids[index];
        gradient = geometry_bwd(e, v_mean, vec3f(v_covariance[0].xy, v_covariance[1].y), sums.zeroth);
        if step.output == 0u {
            let by_color = color_bwd(index, e.mean, sums.color);
            gradient.mean += by_color;
#if CAMERA
            // A turn of the camera about its own place changes no direction.
            by_camera.translation += turned(camera, by_color);
#endif
        } else {
            sh_without_effect_bwd(index);
            if step.output == 1u {
                let by_color = inverse_depth_bwd(e.mean, sums.color);
                gradient.mean += by_color;
#if CAMERA
                let v_p = turned(camera, by_color);
                by_camera.translation += v_p;
                by_camera.rotation += cross(in_camera(camera, e.mean), v_p);
#endif
            }
        }
        if step.collect == 1u {
            gradient.device_norm = statistic_of(sums, v_mean);
            gradient.weight = weight_of(sums);
#if COUNT
            let depth = in_camera(camera, e.mean).z;
            if depth < camera.full_depth {
                gradient.device_norm *= (depth / camera.full_depth) * (depth / camera.full_depth);
            }
#endif
        }
    }
    gradients[index] = gradient;
}

@compute @workgroup_size(64)
fn project_bwd_3d(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = flat(group, groups);
    let place = block * 64u + lane;
    if place < step.gaussians {
        differentiate(place);
    }
#if CAMERA
    let sum = sum_of_group(lane, by_camera);
    if lane == 0u && block * 64u < step.gaussians {
        gradients[step.gaussians + block] = camera_row(sum);
    }
#endif
}
