// Stage `loss`: `loss` computes each pixel's loss and gradient, and `loss_sum` the total, in a
// fixed order. KIND: 0, the difference (for solving colours); 1, its square (L2); 2, its absolute
// value (L1); 3, the image itself (for solving colours). Each is multiplied by the pixel's weight.

#import prelude: MAX_RESIDUAL
#import shared: dssim_groups, flat, Status, step

@group(0) @binding(1) var<storage, read> image: array<vec4f>;
@group(0) @binding(2) var<storage, read> target_image: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> v_image: array<vec4f>;
// One number per work group of `loss`, or the partial sums of SUM_OF.
@group(0) @binding(4) var<storage, read_write> partial: array<f32>;
@group(0) @binding(5) var<storage, read_write> status: Status;
#if WEIGHTED
@group(0) @binding(6) var<storage, read> pixel_weights: array<f32>;
#endif

override KIND: u32 = 1u;
// The partial sums of the loss: 0, those of `loss`; 1, those of D-SSIM, which are weighted.
override SUM_OF: u32 = 0u;

const PER_LANE: u32 = 4u;

var<workgroup> lanes: array<f32, 256>;

fn sum_group(lane: u32, value: f32) -> f32 {
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

// A pixel's unscaled loss. Writes its gradient into `v_image`.
fn compare(pixel: u32) -> f32 {
    let d = image[pixel].xyz - target_image[pixel].xyz;
    var v = d;
    var values = vec3f(0.0);
    if KIND == 1u {
        values = d * d;
        v = step.pointwise_scale * (2.0 * clamp(d, vec3f(-MAX_RESIDUAL), vec3f(MAX_RESIDUAL)));
    }
    if KIND == 2u {
        values = abs(d);
        v = step.pointwise_scale * sign(d);
    }
    if KIND == 3u {
        v = image[pixel].xyz;
    }
#if WEIGHTED
    v *= pixel_weights[pixel];
    values *= pixel_weights[pixel];
#endif
    v_image[pixel] = vec4f(v, 0.0);
    return values.x + values.y + values.z;
}

@compute @workgroup_size(256)
fn loss(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = flat(group, groups);
    let pixels = step.size.x * step.size.y;
    var sum = 0.0;
    for (var k = 0u; k < PER_LANE; k++) {
        let pixel = (block * PER_LANE + k) * 256u + lane;
        if pixel < pixels {
            sum += compare(pixel);
        }
    }
    let total = sum_group(lane, sum);
    if lane == 0u && block * PER_LANE * 256u < pixels {
        partial[block] = total;
    }
}

fn sum_partial(lane: u32, count: u32) -> f32 {
    var sum = 0.0;
    for (var i = lane; i < count; i += 256u) {
        sum += partial[i];
    }
    return sum_group(lane, sum);
}

@compute @workgroup_size(256)
fn loss_sum(@builtin(local_invocation_index) lane: u32) {
    var value: f32;
    if SUM_OF == 1u {
        value = sum_partial(lane, dssim_groups(step.size.x, step.size.y) + dssim_groups(step.size.y, step.size.x));
    } else {
        let pixels = step.size.x * step.size.y;
        value = sum_partial(lane, (pixels + 1023u) / 1024u) * step.pointwise_scale;
    }
    if lane == 0u {
        status.loss = value;
    }
}
