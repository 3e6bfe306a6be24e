// Noise on the means of 2D scenes. One invocation per Gaussian.

#import shared: factor_of, flat, Gaussian, is_finite
#import noise: noise, noise_weight, normals

@group(0) @binding(2) var<storage, read_write> gaussians: array<Gaussian>;

@compute @workgroup_size(64)
fn add_noise(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 64u + lane;
    if index >= noise.gaussians || index < noise.fixed {
        return;
    }
    let g = gaussians[index];
    let l = factor_of(g.shape);
    let shift = l * (transpose(l) * normals(index).xy) * noise_weight(g.opacity_logit);
    if is_finite(shift.x) && is_finite(shift.y) {
        gaussians[index].mean = g.mean + shift;
    }
}
