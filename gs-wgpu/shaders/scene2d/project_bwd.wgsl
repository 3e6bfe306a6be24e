// Stage `project_bwd`: what the entries of a Gaussian received becomes the gradient in its whitened coordinates. One invocation a Gaussian.
//
// With z = L'^-1 d, a step mu += L xi, L <- L exp(eta) changes sigma by -z.xi - z.eta z, so v_xi = sum t z and v_eta = sum t z z^T. The sums
// over (dx, u) are whitened by the lower-triangular root of Sigma', and a rotation leads from there to the factor of L'.

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
        let root_x = sqrt(s.inverse_xx);
        let root_u = sqrt(s.c);
        let whitened = sums.first * vec2f(root_x, root_u);
        let xx = sums.second.x * s.inverse_xx;
        let xu = sums.second.y * root_x * root_u;
        let uu = sums.second.z * s.c;
        let plane = factor_of(gaussians[index].shape);
        let l = mat2x2f(plane[0] * step.pixels_per_unit, plane[1] * step.pixels_per_unit);
        // The first row of L is the root of Sxx times the first row of Q^T.
        let row = vec2f(l[0].x, l[1].x) * root_x;
        let q = mat2x2f(row, vec2f(-row.y, row.x) * select(-1.0, 1.0, determinant_of(l) >= 0.0));
        let moment = q * mat2x2f(vec2f(xx, xu), vec2f(xu, uu)) * transpose(q);
        gradient.color = sums.color;
        gradient.xi = q * whitened;
        gradient.eta = vec3f(moment[0].x, moment[0].y, moment[1].y);
        gradient.visible = 1u;
        // Not 1 - o: of an opacity near 1 nothing is left of that.
        gradient.opacity_logit = sums.zeroth * sigmoid(-gaussians[index].opacity_logit);
        if step.collect == 1u {
            gradient.device_norm = statistic_of(sums, solve_transposed(l, gradient.xi));
        }
    }
    gradients[index] = gradient;
}
