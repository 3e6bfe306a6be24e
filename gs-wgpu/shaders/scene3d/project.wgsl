// Stage `project` of 3D scenes: computes every Gaussian's splat, its tile count and its depth, by
// index; `place` brings them into the order of blending. Colours are only evaluated for Gaussians
// that touch a tile. One invocation per Gaussian.

#import prelude: MIN_DETERMINANT_PX4, MIN_QUATERNION_NORM2
#import shared: Ellipsoid, evaluated, flat, is_finite, is_nan, sigmoid, Splat, step
#import counted: Counted, culled, splat_of, tiles_of
#import scene3d/shared: all_finite, basis, Camera, in_camera, intermediate, quaternion, towards
#import random: random_words

@group(0) @binding(1) var<uniform> camera: Camera;
@group(0) @binding(2) var<storage, read> ellipsoids: array<Ellipsoid>;
// [N, coefficients, 3]
@group(0) @binding(3) var<storage, read> sh: array<f32>;
@group(0) @binding(4) var<storage, read_write> projected: array<Splat>;
@group(0) @binding(5) var<storage, read_write> counts: array<u32>;
// The input of the sort by depth: the bits of the depths, which are positive, and indices.
@group(0) @binding(6) var<storage, read_write> depths: array<u32>;
@group(0) @binding(7) var<storage, read_write> order: array<u32>;
@group(0) @binding(8) var<storage, read_write> status: Counted;
#if PER_PIXEL
// By index: depth of the mean, its slope by px, and the bits of the index.
@group(0) @binding(9) var<storage, read_write> pixel_depths: array<vec4f>;
#endif

fn color_of(index: u32, mean: vec3f) -> vec3f {
    var y_k = basis(towards(camera, mean).xyz);
    var sum = vec3f(0.5);
    var at = index * step.coefficients * 3u;
    for (var k = 0u; k < evaluated(); k++) {
        sum += vec3f(sh[at], sh[at + 1u], sh[at + 2u]) * y_k[k];
        at += 3u;
    }
    // Numbers that are not finite stay, so that they are not drawn as black.
    return select(sum, vec3f(0.0), (sum < vec3f(0.0)) & (sum >= vec3f(-3.4028234663852886e38)));
}

// Whether dropout leaves out this Gaussian.
fn left_out(index: u32) -> bool {
    if step.dropout_threshold == 0u {
        return false;
    }
    return random_words(vec4u(step.dropout_seed, 0u, index, 1u)).x >> 8u < step.dropout_threshold;
}

// A splat without its colour. `depth_slope`: change of the depth per px, for drawn Gaussians.
fn project_one(e: Ellipsoid, p: vec3f, depth_slope: ptr<function, vec2f>) -> Splat {
    let q = quaternion(e.rotation);
    let norm2 = dot(q.scaled, q.scaled);
    let finite = all_finite(e.mean) && all_finite(e.log_scale) && is_finite(norm2) && !is_nan(e.opacity_logit);
    if !finite || is_nan(p.x) || is_nan(p.y) || is_nan(p.z) {
        atomicAdd(&status.not_finite, 1u);
        return culled();
    }
    if !(p.z >= camera.near) {
        atomicAdd(&status.near, 1u);
        return culled();
    }
    if !(norm2 >= MIN_QUATERNION_NORM2) {
        atomicAdd(&status.degenerate, 1u);
        return culled();
    }
    let i = intermediate(camera, e, p);
    let mean = camera.focal * i.slope + camera.center;
    let n = cross(i.r0, i.r1);
    let undilated = dot(n, n);
    let xx = dot(i.r0, i.r0);
    let yy = dot(i.r1, i.r1);
    let delta = camera.dilation;
    let det = undilated + delta * (xx + yy) + delta * delta;
    let covariance = vec3f(xx + delta, dot(i.r0, i.r1), yy + delta);
    let sized = is_finite(mean.x) && is_finite(mean.y) && is_finite(covariance.x * covariance.z) && is_finite(det);
    if !sized {
        atomicAdd(&status.not_finite, 1u);
        return culled();
    }
    if !(det >= MIN_DETERMINANT_PX4) {
        atomicAdd(&status.degenerate, 1u);
        return culled();
    }
    var opacity = 1.0;
    if step.opaque == 0u {
        opacity = sigmoid(e.opacity_logit);
        if camera.compensates == 1u {
            opacity *= sqrt(undilated / det);
        }
        if step.dropout_threshold != 0u {
            opacity /= 1.0 - f32(step.dropout_threshold) / 16777216.0;
        }
    }
    if !(opacity >= step.alpha_cut) {
        atomicAdd(&status.transparent, 1u);
        return culled();
    }
#if PER_PIXEL
    let undilated_slope = vec2f(dot(i.m[2], cross(i.r1, n)), dot(i.m[2], cross(n, i.r0)));
    *depth_slope = (undilated_slope + delta * vec2f(dot(i.m[2], i.r0), dot(i.m[2], i.r1))) / det;
#endif
    return splat_of(mean, covariance, det, opacity, vec3f(0.0));
}

@compute @workgroup_size(64)
fn project_3d(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 64u + lane;
    if index >= step.gaussians {
        return;
    }
    let e = ellipsoids[index];
    let p = in_camera(camera, e.mean);
    var depth_slope = vec2f(0.0);
    var splat = culled();
    if left_out(index) {
        atomicAdd(&status.transparent, 1u);
    } else {
        splat = project_one(e, p, &depth_slope);
    }
    var touched = tiles_of(splat);
    if splat.half_x >= 0.0 {
        if touched == 0u {
            atomicAdd(&status.outside, 1u);
            splat = culled();
        } else {
            switch step.output {
                case 1u: { splat.color = vec3f(1.0 / p.z); }
                case 2u: { splat.color = vec3f(1.0); }
                default: { splat.color = color_of(index, e.mean); }
            }
            if !all_finite(splat.color) {
                atomicAdd(&status.not_finite, 1u);
                splat = culled();
                touched = 0u;
            }
        }
    }
    projected[index] = splat;
    counts[index] = touched;
    depths[index] = bitcast<u32>(max(p.z, 0.0));
    order[index] = index;
#if PER_PIXEL
    pixel_depths[index] = vec4f(p.z, depth_slope, bitcast<f32>(index));
#endif
}
