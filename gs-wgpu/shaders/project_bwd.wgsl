// Stage `project_bwd`: what the entries of a Gaussian received becomes the gradient in its whitened frame. One invocation a Gaussian;
// its slots stand side by side. Where invocations are lanes of a CPU's vector, they add up eight Gaussians' slots together, because a
// Gaussian with many entries would keep the others' lanes waiting.
//
// With z = L'^-1 d, a step mu += L xi, L <- L exp(eta) changes sigma by -z.xi - z.eta z, so v_xi = sum t z and v_eta = sum t z z^T. The sums
// over (dx, u) are whitened by the lower-triangular root of Sigma', and a rotation leads from there to the frame of L'.

@group(0) @binding(1) var<storage, read> gaussians: array<Gaussian>;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
@group(0) @binding(4) var<storage, read> slots: array<f32>;
@group(0) @binding(5) var<storage, read_write> gradients: array<Gradient>;

#if VECTORS
const INVOCATIONS: u32 = LANES;

// Of eight numbers, whose k-th lanes belong together, the l-th in lane l; and so that every lane has all eight of its own.
fn transposed(rows: array<f32, 8>, lane: u32) -> array<f32, 8> {
    var r = rows;
#each s STAGES
    {
        let bit = 1u << @su;
        let upper = (lane & bit) != 0u;
        var t: array<f32, 8>;
#each k EIGHT
        {
            // Of the pair of rows k and k with that bit turned, the one that stays in this half of the lanes.
            let other = subgroupShuffleXor(r[@ku ^ bit], bit);
            t[@k] = select(r[@k], other, upper != ((@ku & bit) != 0u));
        }
#end
        r = t;
    }
#end
    return r;
}
#else
const INVOCATIONS: u32 = 64u;
#endif

@compute @workgroup_size(INVOCATIONS)
fn project_bwd(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let first_index = flat(group, groups) * INVOCATIONS;
    let index = first_index + lane;
#if VECTORS
    // Each lane one number of every entry of the eight Gaussians; then each lane all of one Gaussian.
    var by_gaussian: array<f32, 8>;
#if OVER
    var last = 0.0;
#endif
#each g EIGHT
    {
        let gaussian = min(first_index + @gu, step.gaussians - 1u);
        let end = offsets[gaussian + 1u];
        var e = offsets[gaussian];
        var sum = 0.0;
#if OVER
        var sum_of_last = 0.0;
#endif
        if e < end {
            loop {
                sum += slots[e * STRIDE + lane];
#if OVER
                sum_of_last += slots[e * STRIDE + 8u];
#endif
                continuing {
                    e++;
                    break if e >= end;
                }
            }
        }
        by_gaussian[@g] = sum;
#if OVER
        last = select(last, sum_of_last, lane == @gu);
#endif
    }
#end
    let sums = transposed(by_gaussian, lane);
#endif
    if index >= step.gaussians {
        return;
    }
    let s = splats[index];
    let first = offsets[index];
    let end = offsets[index + 1u];
    var gradient = Gradient(vec3f(0.0), 0.0, vec3f(0.0), 0.0, vec2f(0.0), 0u, 0u);
    if first < end && s.half_x >= 0.0 {
#if VECTORS
#else
        var sums: array<f32, STRIDE>;
        for (var e = first; e < end; e++) {
            for (var k = 0u; k < STRIDE; k++) {
                sums[k] += slots[e * STRIDE + k];
            }
        }
#endif
        let root_x = sqrt(s.inverse_xx);
        let root_u = sqrt(s.c);
        let whitened = vec2f(sums[3] * root_x, sums[4] * root_u);
        let xx = sums[5] * s.inverse_xx;
        let xu = sums[6] * root_x * root_u;
        let uu = sums[7] * s.c;
        let plane = frame_of(gaussians[index].shape);
        let l = mat2x2f(plane[0] * step.pixels_per_unit, plane[1] * step.pixels_per_unit);
        // The first row of L is the root of Sxx times the first row of Q^T.
        let row = vec2f(l[0].x, l[1].x) * root_x;
        let q = mat2x2f(row, vec2f(-row.y, row.x) * select(-1.0, 1.0, determinant_of(l) >= 0.0));
        let moment = q * mat2x2f(vec2f(xx, xu), vec2f(xu, uu)) * transpose(q);
        gradient.color = vec3f(sums[0], sums[1], sums[2]);
        gradient.xi = q * whitened;
        gradient.eta = vec3f(moment[0].x, moment[0].y, moment[1].y);
        gradient.visible = 1u;
#if OVER
#if VECTORS
        gradient.opacity_logit = last * (1.0 - s.opacity);
#else
        gradient.opacity_logit = sums[8] * (1.0 - s.opacity);
#endif
#endif
        if step.collect == 1u {
            gradient.device_norm = length(solve_transposed(l, gradient.xi) * vec2f(step.size) * 0.5);
        }
    }
    gradients[index] = gradient;
}
