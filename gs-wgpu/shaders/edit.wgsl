// Stage `edit`: every slot of the edited arrays takes what its source says, in all arrays alike. One invocation a slot.

// Where a slot's parameters, moments and statistics come from: a Gaussian before, or (parameters) one of `fresh`; NONE leaves 0.
struct Source {
    parameters: u32,
    moments: u32,
    statistics: u32,
    is_fresh: u32,
}

@group(0) @binding(1) var<storage, read> sources: array<Source>;
@group(0) @binding(2) var<storage, read> fresh: array<Gaussian>;
@group(0) @binding(3) var<storage, read> gaussians: array<Gaussian>;
@group(0) @binding(4) var<storage, read> moments: array<Moments>;
@group(0) @binding(5) var<storage, read> statistics: array<Statistics>;
@group(0) @binding(6) var<storage, read_write> edited_gaussians: array<Gaussian>;
@group(0) @binding(7) var<storage, read_write> edited_moments: array<Moments>;
@group(0) @binding(8) var<storage, read_write> edited_statistics: array<Statistics>;

const NONE: u32 = 0xffffffffu;

@compute @workgroup_size(64)
fn edit(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let slot = flat(group, groups) * 64u + lane;
    if slot >= step.gaussians {
        return;
    }
    let source = sources[slot];
    var g: Gaussian;
    if source.is_fresh == 1u {
        g = fresh[source.parameters];
    } else {
        g = gaussians[source.parameters];
    }
    var m: Moments;
    g.steps = 0u;
    if source.moments != NONE {
        m = moments[source.moments];
        g.steps = gaussians[source.moments].steps;
    }
    var s: Statistics;
    if source.statistics != NONE {
        s = statistics[source.statistics];
    }
    // An opacity reset: the pointwise ceiling is an infinite logit where there is none.
    if step.collect == 1u {
        if !(g.opacity_logit <= step.alpha_max) {
            g.opacity_logit = step.alpha_max;
        }
        m.opacity = vec4f(0.0);
    }
    edited_gaussians[slot] = g;
    edited_moments[slot] = m;
    edited_statistics[slot] = s;
}
