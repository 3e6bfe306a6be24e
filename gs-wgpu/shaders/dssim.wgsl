// Stage `loss`, D-SSIM: 1 - SSIM and its gradient (Wang et al. 2004; borders padded with zeros, as 3DGS has it).
//
// With b(.) the blur by the 11x11 Gaussian window, which is its own adjoint, x the image and y the target, S depends on x through
// b(x), b(x²) and b(xy); so v_x = b(dS/db(x)) + 2x b(dS/db(x²)) + y b(dS/db(xy)). Each blur is one along rows, one along columns.
// Planes of one vec4f a pixel (three channels), one after another.

@group(0) @binding(1) var<storage, read> image: array<vec4f>;
@group(0) @binding(2) var<storage, read> target_image: array<vec4f>;
// Blurred along rows: x, y, x², y², xy.
@group(0) @binding(3) var<storage, read_write> across: array<vec4f>;
// Derivatives by b(x), b(x²), b(xy).
@group(0) @binding(4) var<storage, read_write> by: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> v_image: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> partial: array<f32>;

const RADIUS: i32 = 5;

var<workgroup> lanes: array<f32, 256>;

fn pixel_of(group: vec3u, groups: vec3u, lane: u32) -> u32 {
    return flat(group, groups) * 256u + lane;
}

@compute @workgroup_size(256)
fn dssim_rows(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let pixels = step.size.x * step.size.y;
    let pixel = pixel_of(group, groups, lane);
    if pixel >= pixels {
        return;
    }
    let column = i32(pixel % step.size.x);
    var sums: array<vec4f, 5>;
    for (var j = -RADIUS; j <= RADIUS; j++) {
        if column + j >= 0 && column + j < i32(step.size.x) {
            let at = u32(i32(pixel) + j);
            let weight = WINDOW[j + RADIUS];
            let x = image[at];
            let y = target_image[at];
            sums[0] += weight * x;
            sums[1] += weight * y;
            sums[2] += weight * x * x;
            sums[3] += weight * y * y;
            sums[4] += weight * x * y;
        }
    }
    for (var q = 0u; q < 5u; q++) {
        across[q * pixels + pixel] = sums[q];
    }
}

@compute @workgroup_size(256)
fn dssim_columns(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let pixels = step.size.x * step.size.y;
    let pixel = pixel_of(group, groups, lane);
    var dissimilarity = 0.0;
    if pixel < pixels {
        let row = i32(pixel / step.size.x);
        var sums: array<vec3f, 5>;
        for (var j = -RADIUS; j <= RADIUS; j++) {
            if row + j >= 0 && row + j < i32(step.size.y) {
                let at = u32(i32(pixel) + j * i32(step.size.x));
                for (var q = 0u; q < 5u; q++) {
                    sums[q] += WINDOW[j + RADIUS] * across[q * pixels + at].xyz;
                }
            }
        }
        let mx = sums[0];
        let my = sums[1];
        let a = 2.0 * mx * my + SSIM_C1;
        let b = 2.0 * (sums[4] - mx * my) + SSIM_C2;
        let c = mx * mx + my * my + SSIM_C1;
        let d = (sums[2] - mx * mx) + (sums[3] - my * my) + SSIM_C2;
        let s = (a * b) / (c * d);
        let loss = 1.0 - s;
        dissimilarity = loss.x + loss.y + loss.z;
        // dS/db(x²) = -S/d; dS/db(xy) = 2a/(c d); dS/db(x) collects the means.
        let by_square = -s / d;
        let by_product = 2.0 * a / (c * d);
        let by_mean = 2.0 * my * (b - a) / (c * d) - 2.0 * mx * s / c + 2.0 * mx * s / d;
        by[pixel] = vec4f(by_mean, 0.0);
        by[pixels + pixel] = vec4f(by_square, 0.0);
        by[2u * pixels + pixel] = vec4f(by_product, 0.0);
    }
    lanes[lane] = dissimilarity;
    workgroupBarrier();
    for (var half = 128u; half > 0u; half /= 2u) {
        if lane < half {
            lanes[lane] += lanes[lane + half];
        }
        workgroupBarrier();
    }
    let block = flat(group, groups);
    if lane == 0u && block * 256u < pixels {
        partial[(pixels + 1023u) / 1024u + block] = lanes[0];
    }
}

@compute @workgroup_size(256)
fn dssim_bwd_rows(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let pixels = step.size.x * step.size.y;
    let pixel = pixel_of(group, groups, lane);
    if pixel >= pixels {
        return;
    }
    let column = i32(pixel % step.size.x);
    var sums: array<vec4f, 3>;
    for (var j = -RADIUS; j <= RADIUS; j++) {
        if column + j >= 0 && column + j < i32(step.size.x) {
            let at = u32(i32(pixel) + j);
            for (var q = 0u; q < 3u; q++) {
                sums[q] += WINDOW[j + RADIUS] * by[q * pixels + at];
            }
        }
    }
    for (var q = 0u; q < 3u; q++) {
        across[q * pixels + pixel] = sums[q];
    }
}

@compute @workgroup_size(256)
fn dssim_bwd_columns(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let pixels = step.size.x * step.size.y;
    let pixel = pixel_of(group, groups, lane);
    if pixel >= pixels {
        return;
    }
    let row = i32(pixel / step.size.x);
    var sums: array<vec4f, 3>;
    for (var j = -RADIUS; j <= RADIUS; j++) {
        if row + j >= 0 && row + j < i32(step.size.y) {
            let at = u32(i32(pixel) + j * i32(step.size.x));
            for (var q = 0u; q < 3u; q++) {
                sums[q] += WINDOW[j + RADIUS] * across[q * pixels + at];
            }
        }
    }
    let v = sums[0] + 2.0 * image[pixel] * sums[1] + target_image[pixel] * sums[2];
    v_image[pixel] -= vec4f(step.dssim_scale * v.xyz, 0.0);
}
