// Stage `project_bwd`: computes the gradient of a Gaussian in its whitened coordinates from those
// of its entries. One invocation per Gaussian.
//
// With z = L'^-1 d, a step mu += L xi, L <- L exp(eta) changes sigma by -z.xi - z.eta z, so v_xi =
// sum t z and v_eta = sum t z z^T. The sums over (dx, u) are whitened by the lower-triangular root
// of Sigma', and a rotation leads from there to the factor of L'. Where Sigma' is dilated, L' is
// not a root of it: there z = L'^T Sigma'^-1 d.

#import shared: determinant_of, factor_of, flat, Gaussian, Gradient, sigmoid, solve_transposed
#import shared: Splat, step
#import received: offsets, projected, Received, received, statistic_of, weight_of

// In whitened coordinates: v_xi, and v_eta as (xx, xy, yy).
struct Whitened {
    xi: vec2f,
    eta: vec3f,
    // In px^-1.
    v_mean: vec2f,
}

fn whitened(s: Splat, l: mat2x2f, sums: Received) -> Whitened {
    let root_x = sqrt(s.inverse_xx);
    let root_u = sqrt(s.c);
    let xx = sums.second.x * s.inverse_xx;
    let xu = sums.second.y * root_x * root_u;
    let uu = sums.second.z * s.c;
    // The first row of L is the root of Sxx times the first row of Q^T.
    let row = vec2f(l[0].x, l[1].x) * root_x;
    let q = mat2x2f(row, vec2f(-row.y, row.x) * select(-1.0, 1.0, determinant_of(l) >= 0.0));
    let moment = q * mat2x2f(vec2f(xx, xu), vec2f(xu, uu)) * transpose(q);
    let xi = q * (sums.first * vec2f(root_x, root_u));
    return Whitened(xi, vec3f(moment[0].x, moment[0].y, moment[1].y), solve_transposed(l, xi));
}

fn whitened_dilated(s: Splat, l: mat2x2f, sums: Received) -> Whitened {
    let conic = mat2x2f(vec2f(s.inverse_xx, 0.0), vec2f(-s.slope * s.c, s.c));
    let q = transpose(l) * conic;
    var moment = q * mat2x2f(sums.second.xy, sums.second.yz) * transpose(q);
    if step.compensates == 1u {
        // ln of the compensation is (ln D - ln D')/2, D = det² L', D' = D + delta tr L' L'^T +
        // delta².
        let root = determinant_of(l);
        let inverse = 1.0 / (root * root + step.dilation * (dot(l[0], l[0]) + dot(l[1], l[1]) + step.dilation));
        let gram = transpose(l) * l;
        let less = mat2x2f(vec2f(1.0 - root * root * inverse, 0.0), vec2f(0.0, 1.0 - root * root * inverse));
        moment += (less - gram * (step.dilation * inverse)) * sums.zeroth;
    }
    return Whitened(q * sums.first, vec3f(moment[0].x, moment[0].y, moment[1].y), conic * sums.first);
}

@group(0) @binding(1) var<storage, read> gaussians: array<Gaussian>;
@group(0) @binding(5) var<storage, read_write> gradients: array<Gradient>;

@compute @workgroup_size(64)
fn project_bwd(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 64u + lane;
    if index >= step.gaussians {
        return;
    }
    let sums = received(index);
    let s = projected[index];
    var gradient = Gradient(vec3f(0.0), 0.0, vec3f(0.0), 0.0, vec2f(0.0), 0u, 0u);
    if offsets[index] < offsets[index + 1u] && s.half_x >= 0.0 {
        let plane = factor_of(gaussians[index].shape);
        let l = mat2x2f(plane[0] * step.pixels_per_unit, plane[1] * step.pixels_per_unit);
        var by: Whitened;
        if step.dilation > 0.0 {
            by = whitened_dilated(s, l, sums);
        } else {
            by = whitened(s, l, sums);
        }
        gradient.color = sums.color;
        gradient.xi = by.xi;
        gradient.eta = by.eta;
        gradient.visible = 1u;
        // Not 1 - o, which cancels for an opacity near 1.
        gradient.opacity_logit = sums.zeroth * sigmoid(-gaussians[index].opacity_logit);
        if step.collect == 1u {
            gradient.device_norm = statistic_of(sums, by.v_mean);
            gradient.weight = weight_of(sums);
        }
    }
    gradients[index] = gradient;
}
