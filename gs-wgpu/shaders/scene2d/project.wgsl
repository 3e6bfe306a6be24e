// Stage `project`: computes every Gaussian's splat, and the number of tiles that it touches. One
// invocation per Gaussian.
//
// Sigma' is stored so that the exponent is a sum of squares, without the cancellation that a
// quadratic form suffers in needles.

#import prelude: MIN_DETERMINANT_PX4
#import shared: determinant_of, factor_of, flat, Gaussian, is_finite, is_nan, sigmoid, Splat, step
#import counted: Counted, culled, splat_of, tiles_of

@group(0) @binding(1) var<storage, read> gaussians: array<Gaussian>;
@group(0) @binding(2) var<storage, read_write> projected: array<Splat>;
@group(0) @binding(3) var<storage, read_write> counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> status: Counted;

fn project_one(g: Gaussian) -> Splat {
    let plane = factor_of(g.shape);
    let l = mat2x2f(plane[0] * step.pixels_per_unit, plane[1] * step.pixels_per_unit);
    let mean = (g.mean - step.origin) * step.pixels_per_unit;
    var opacity = select(sigmoid(g.opacity_logit), 1.0, step.opaque == 1u);
    var xx = l[0].x * l[0].x + l[1].x * l[1].x;
    var yy = l[0].y * l[0].y + l[1].y * l[1].y;
    let xy = l[0].x * l[0].y + l[1].x * l[1].y;
    let root = determinant_of(l);
    let undilated = root * root;
    let det = undilated + step.dilation * (xx + yy) + step.dilation * step.dilation;
    xx += step.dilation;
    yy += step.dilation;
    let placed = is_finite(mean.x) && is_finite(mean.y) && (step.opaque == 1u || !is_nan(g.opacity_logit));
    let sized = is_finite(det) && is_finite(xx * yy);
    let colored = is_finite(g.color.x) && is_finite(g.color.y) && is_finite(g.color.z);
    if !placed || !sized || !colored {
        atomicAdd(&status.not_finite, 1u);
        return culled();
    }
    if !(det >= MIN_DETERMINANT_PX4) {
        atomicAdd(&status.degenerate, 1u);
        return culled();
    }
    if step.compensates == 1u {
        opacity *= sqrt(undilated / det);
    }
    if !(opacity >= step.alpha_cut) {
        atomicAdd(&status.transparent, 1u);
        return culled();
    }
    return splat_of(mean, vec3f(xx, xy, yy), det, opacity, g.color);
}

@compute @workgroup_size(64)
fn project(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 64u + lane;
    if index > step.gaussians {
        return;
    }
    var touched = 0u;
    if index < step.gaussians {
        let splat = project_one(gaussians[index]);
        projected[index] = splat;
        touched = tiles_of(splat);
        if touched == 0u && splat.half_x >= 0.0 {
            atomicAdd(&status.outside, 1u);
        }
    }
#if LISTS
    counts[index] = touched;
#endif
}
