// Stage `edit`: fills every slot of the edited arrays from its source. One invocation per slot.

#import shared: Ellipsoid, EllipsoidMoments, factor_of, flat, Gaussian, is_finite, Moments
#import shared: Statistics, step
#import sources: NONE, Source

#if SCENE_3D
alias Parameters = Ellipsoid;
alias Moved = EllipsoidMoments;
#else
alias Parameters = Gaussian;
alias Moved = Moments;
#endif

@group(0) @binding(1) var<storage, read> sources: array<Source>;
@group(0) @binding(2) var<storage, read> fresh: array<Parameters>;
@group(0) @binding(3) var<storage, read> gaussians: array<Parameters>;
@group(0) @binding(4) var<storage, read> moments: array<Moved>;
@group(0) @binding(5) var<storage, read> statistics: array<Statistics>;
@group(0) @binding(6) var<storage, read_write> edited_gaussians: array<Parameters>;
@group(0) @binding(7) var<storage, read_write> edited_moments: array<Moved>;
@group(0) @binding(8) var<storage, read_write> edited_statistics: array<Statistics>;

#if SCENE_3D
#else
#if COVARIANCE_FACTOR
// The factor of Sigma nearest to `parent`, in whose coordinates the moments are: as
// `whitened::aligned` in gs-core.
fn aligned(factor: mat2x2f, parent: mat2x2f) -> mat2x2f {
    let a = transpose(factor) * parent;
    let side = select(1.0, -1.0, determinant(a) < 0.0);
    let first = vec2f(a[0].x + side * a[1].y, a[0].y - side * a[1].x);
    let size = length(first);
    if !(size > 0.0 && is_finite(size)) {
        return factor;
    }
    let unit = first / size;
    return factor * mat2x2f(unit, side * vec2f(-unit.y, unit.x));
}
#endif
#endif

@compute @workgroup_size(64)
fn edit(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let slot = flat(group, groups) * 64u + lane;
    if slot >= step.gaussians {
        return;
    }
    let source = sources[slot];
    var g: Parameters;
    if source.is_fresh == 1u {
        g = fresh[source.parameters];
#if SCENE_3D
#else
#if COVARIANCE_FACTOR
        if source.moments != NONE {
            let factor = aligned(factor_of(g.shape), factor_of(gaussians[source.moments].shape));
            g.shape = vec4f(factor[0], factor[1]);
        }
#endif
#endif
    } else {
        g = gaussians[source.parameters];
    }
    var m: Moved;
    if source.moments != NONE {
        m = moments[source.moments];
    }
    g.steps = 0u;
    if source.steps != NONE {
        g.steps = gaussians[source.steps].steps;
    }
    var s: Statistics;
    if source.statistics != NONE {
        s = statistics[source.statistics];
    }
    // An opacity reset. Without one, the ceiling is an infinite logit.
    if step.collect == 1u && slot >= step.fixed {
        if !(g.opacity_logit <= step.alpha_max) {
            g.opacity_logit = step.alpha_max;
        }
#if SCENE_3D
        m.first[0].w = 0.0;
        m.second[0].w = 0.0;
#else
        m.opacity = vec4f(0.0);
#endif
    }
    edited_gaussians[slot] = g;
    edited_moments[slot] = m;
    edited_statistics[slot] = s;
}
