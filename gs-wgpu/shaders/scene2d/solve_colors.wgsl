// Solves for colours under `Sum`: conjugate gradients on the normal equations, all on the device.
// Every iteration blends the direction, differentiates that image and runs these kernels. The three
// channels are three systems with the same matrix.

#import prelude: STRIDE
#import shared: flat, Gaussian, is_finite, Splat, step

// The CG vectors of a Gaussian.
struct Conjugate {
    solution: vec4f,
    residual: vec4f,
    direction: vec4f,
    product: vec4f,
}

struct Scalars {
    // r.z, d.Ad, the step and the kept share of the old direction, per channel.
    rz: vec4f,
    curvature: vec4f,
    step: vec4f,
    keep: vec4f,
}

@group(0) @binding(1) var<storage, read_write> projected: array<Splat>;
@group(0) @binding(2) var<storage, read> offsets: array<u32>;
@group(0) @binding(3) var<storage, read> slots: array<f32>;
@group(0) @binding(4) var<storage, read_write> vectors: array<Conjugate>;
@group(0) @binding(5) var<storage, read_write> partial: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> scalars: Scalars;
@group(0) @binding(7) var<storage, read_write> gaussians: array<Gaussian>;

var<workgroup> lanes: array<vec4f, 256>;

fn sum_group(lane: u32, value: vec4f) -> vec4f {
    lanes[lane] = value;
    workgroupBarrier();
    for (var half = 128u; half > 0u; half /= 2u) {
        if lane < half {
            lanes[lane] += lanes[lane + half];
        }
        workgroupBarrier();
    }
    return lanes[0];
}

// A^T of the differentiated image.
fn product_of(index: u32) -> vec4f {
    var sum = vec4f(0.0);
    for (var e = offsets[index]; e < offsets[index + 1u]; e++) {
        sum += vec4f(slots[e * STRIDE], slots[e * STRIDE + 1u], slots[e * STRIDE + 2u], 0.0);
    }
    return sum;
}

// The inverse of A^T A's diagonal, sum w² ~ pi sqrt(det Sigma').
fn preconditioned(s: Splat, r: vec4f) -> vec4f {
    return r * (sqrt(s.inverse_xx * s.c) / 3.14159265358979);
}

// r = A^T(y - A c) from the slots of the first pass, z, d = z; partial sums of r.z.
@compute @workgroup_size(256)
fn solve_start(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = flat(group, groups);
    let index = block * 256u + lane;
    var dot_product = vec4f(0.0);
    if index < step.gaussians {
        let s = projected[index];
        let residual = -product_of(index);
        let z = preconditioned(s, residual);
        vectors[index] = Conjugate(vec4f(s.color, 0.0), residual, z, vec4f(0.0));
        projected[index].color = z.xyz;
        dot_product = residual * z;
    }
    let sum = sum_group(lane, dot_product);
    if lane == 0u && block * 256u < step.gaussians {
        partial[block] = sum;
    }
}

// A^T A d; partial sums of d.(A^T A d).
@compute @workgroup_size(256)
fn solve_product(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = flat(group, groups);
    let index = block * 256u + lane;
    var dot_product = vec4f(0.0);
    if index < step.gaussians {
        let product = product_of(index);
        vectors[index].product = product;
        dot_product = vectors[index].direction * product;
    }
    let sum = sum_group(lane, dot_product);
    if lane == 0u && block * 256u < step.gaussians {
        partial[block] = sum;
    }
}

// One step along the direction; partial sums of r.z.
@compute @workgroup_size(256)
fn solve_step(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = flat(group, groups);
    let index = block * 256u + lane;
    var dot_product = vec4f(0.0);
    if index < step.gaussians {
        var v = vectors[index];
        v.solution += scalars.step * v.direction;
        v.residual -= scalars.step * v.product;
        vectors[index] = v;
        dot_product = v.residual * preconditioned(projected[index], v.residual);
    }
    let sum = sum_group(lane, dot_product);
    if lane == 0u && block * 256u < step.gaussians {
        partial[block] = sum;
    }
}

@compute @workgroup_size(256)
fn solve_direction(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 256u + lane;
    if index < step.gaussians {
        var v = vectors[index];
        v.direction = preconditioned(projected[index], v.residual) + scalars.keep * v.direction;
        vectors[index] = v;
        projected[index].color = v.direction.xyz;
    }
}

@compute @workgroup_size(256)
fn solve_end(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 256u + lane;
    if index < step.gaussians {
        let solution = vectors[index].solution;
        if projected[index].half_x >= 0.0 && is_finite(solution.x) && is_finite(solution.y) && is_finite(solution.z) {
            gaussians[index].color = solution.xyz;
        }
    }
}

// The scalars that the partial sums yield, by WHICH: 0, r.z of the start; 1, the curvature and the
// step; 2, the next r.z and the kept share.
override WHICH: u32 = 0u;

@compute @workgroup_size(256)
fn solve_scalars(@builtin(local_invocation_index) lane: u32) {
    var value = vec4f(0.0);
    for (var i = lane; i < (step.gaussians + 255u) / 256u; i += 256u) {
        value += partial[i];
    }
    let sum = sum_group(lane, value);
    if lane == 0u {
        if WHICH == 0u {
            scalars.rz = sum;
        }
        if WHICH == 1u {
            scalars.step = select(vec4f(0.0), scalars.rz / sum, sum > vec4f(0.0));
        }
        if WHICH == 2u {
            scalars.keep = select(vec4f(0.0), sum / scalars.rz, scalars.rz > vec4f(0.0));
            scalars.rz = sum;
        }
    }
}
