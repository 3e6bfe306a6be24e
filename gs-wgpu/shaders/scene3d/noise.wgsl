// Noise on the means of 3D scenes. One invocation per Gaussian.

#import prelude: MIN_QUATERNION_NORM2
#import shared: Ellipsoid, exp_exact, flat
#import noise: noise, noise_weight, normals
#import scene3d/shared: all_finite, quaternion

@group(0) @binding(2) var<storage, read_write> ellipsoids: array<Ellipsoid>;

@compute @workgroup_size(64)
fn add_noise_3d(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 64u + lane;
    if index >= noise.gaussians || index < noise.fixed {
        return;
    }
    let e = ellipsoids[index];
    let scaled = quaternion(e.rotation).scaled;
    let norm2 = dot(scaled, scaled);
    if !(norm2 >= MIN_QUATERNION_NORM2) {
        return;
    }
    let unit = scaled / sqrt(norm2);
    let w = unit.x;
    let x = unit.y;
    let y = unit.z;
    let z = unit.w;
    let scale = vec3f(exp_exact(e.log_scale.x), exp_exact(e.log_scale.y), exp_exact(e.log_scale.z));
    let m = mat3x3f(
        scale.x * vec3f(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        scale.y * vec3f(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        scale.z * vec3f(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    );
    let shift = m * (transpose(m) * normals(index)) * noise_weight(e.opacity_logit);
    if all_finite(shift) {
        ellipsoids[index].mean = e.mean + shift;
    }
}
