// Adds the gradients of a further loss to those of a step, for the Gaussians that some tile lists
// in both. One invocation per Gaussian.

#import shared: EllipsoidGradient, flat, step

@group(0) @binding(1) var<storage, read_write> gradients: array<EllipsoidGradient>;
// [N, coefficients, 3]
@group(0) @binding(2) var<storage, read_write> v_sh: array<f32>;
@group(0) @binding(3) var<storage, read> added: array<EllipsoidGradient>;
@group(0) @binding(4) var<storage, read> added_sh: array<f32>;

@compute @workgroup_size(64)
fn add_gradients_3d(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 64u + lane;
    if index >= step.gaussians {
        return;
    }
    if gradients[index].visible == 0u || added[index].visible == 0u {
        return;
    }
    let weight = step.added_weight;
    gradients[index].mean += weight * added[index].mean;
    gradients[index].opacity_logit += weight * added[index].opacity_logit;
    gradients[index].log_scale += weight * added[index].log_scale;
    gradients[index].rotation += weight * added[index].rotation;
    let first = index * step.coefficients * 3u;
    for (var at = first; at < first + 3u * step.coefficients; at++) {
        v_sh[at] += weight * added_sh[at];
    }
}
