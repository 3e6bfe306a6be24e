// Stage `loss` for L1 + D-SSIM: the loss and its gradient (Wang et al. 2004; borders padded with
// zeros as in 3DGS). D-SSIM is 1 - SSIM.
//
// With b(.) the blur by the 11x11 Gaussian window, which is its own adjoint, x the image and y the
// target, S depends on x through b(x), b(x² + y²) and b(xy); so v_x = b(dS/db(x)) + 2x b(dS/db(x² +
// y²)) + y b(dS/db(xy)). Each blur has one part down the columns and one along the rows.
// `dssim_moments` blurs the moments down; `dssim_derivatives` blurs them along, takes the
// derivatives and blurs these along; `dssim_gradient` blurs these down, and adds L1.
//
// An invocation goes through SSIM_SEGMENT pixels of one channel, SSIM_BLOCK pixels per iteration.
// It keeps the numbers under the window in registers, so a number is read once per segment, and
// again where two segments meet. A place is a channel of a column.

#import prelude: DSSIM_GROUP, SSIM_BLOCK, SSIM_C1, SSIM_C2, SSIM_MAX, SSIM_RADIUS, SSIM_SEGMENT
#import prelude: WINDOW
#import shared: dssim_groups, flat, step

// Four floats per pixel, of which three are the channels.
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> target_image: array<f32>;
// x, y, x² + y², xy, blurred down the columns: row by row, place by place.
@group(0) @binding(3) var<storage, read_write> moments: array<vec4f>;
// Derivatives by b(x), b(x² + y²), b(xy), blurred along the rows. They are in strips of 8 places,
// row by row, so that a walk down reads consecutive memory, which CPUs need.
@group(0) @binding(4) var<storage, read_write> derivatives: array<vec3f>;
@group(0) @binding(5) var<storage, read_write> v_image: array<f32>;
// The loss of each work group of `dssim_derivatives`, then of `dssim_gradient`.
@group(0) @binding(6) var<storage, read_write> partial: array<f32>;

const SPAN: u32 = 2u * SSIM_RADIUS;

// The numbers under the window before a block, and the block.
alias Held = array<vec4f, SPAN + SSIM_BLOCK>;

var<workgroup> lanes: array<f32, DSSIM_GROUP>;

// Moves the numbers to make room for the next block.
fn advance(held: ptr<function, Held>) {
#each t SSIM_SPAN
    (*held)[@tu] = (*held)[@tu + SSIM_BLOCK];
#end
}

// The window's sum around `held[at + SSIM_RADIUS]`; the window is symmetric.
fn blur(held: ptr<function, Held>, at: u32) -> vec4f {
    var sum = WINDOW[SSIM_RADIUS] * (*held)[at + SSIM_RADIUS];
#each j SSIM_RADIUS
    sum += WINDOW[@j] * ((*held)[at + @ju] + (*held)[at + SPAN - @ju]);
#end
    return sum;
}

// An invocation's segment of column or row `line`.
struct Segment {
    line: u32,
    channel: u32,
    first: u32,
    end: u32,
}

// Neighbouring invocations have neighbouring lines. After the last line, `first` is at least
// `length`.
fn segment_of(id: u32, lines: u32, length: u32) -> Segment {
    let first = id / (3u * lines) * SSIM_SEGMENT;
    return Segment(id % (3u * lines) / 3u, id % 3u, first, min(first + SSIM_SEGMENT, length));
}

fn is_within(s: Segment, pixel: u32) -> bool {
    return pixel >= s.first && pixel < s.end;
}

fn in_strips(place: u32, row: u32) -> u32 {
    return (place / 8u * step.size.y + row) * 8u + place % 8u;
}

fn sum_group(lane: u32, value: f32) -> f32 {
    lanes[lane] = value;
    workgroupBarrier();
    for (var half = DSSIM_GROUP / 2u; half > 0u; half /= 2u) {
        if lane < half {
            lanes[lane] += lanes[lane + half];
        }
        workgroupBarrier();
    }
    return lanes[0];
}

// SSIM is a quotient of fourth powers, which must be finite.
fn within_ssim(value: f32) -> f32 {
    return clamp(value, -SSIM_MAX, SSIM_MAX);
}

fn products(at: u32) -> vec4f {
    let x = within_ssim(image[at]);
    let y = within_ssim(target_image[at]);
    return vec4f(x, y, x * x + y * y, x * y);
}

@compute @workgroup_size(DSSIM_GROUP)
fn dssim_moments(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let s = segment_of(flat(group, groups) * DSSIM_GROUP + lane, step.size.x, step.size.y);
    if s.first >= step.size.y {
        return;
    }
    let place = s.line * 3u + s.channel;
    var held: Held;
    // Position of the block's first pixel. Before the image it has wrapped around, and is beyond
    // the image.
    var row = s.first - SSIM_RADIUS;
    loop {
        advance(&held);
#each k SSIM_BLOCK
        held[SPAN + @ku] = select(vec4f(0.0), products(((row + @ku) * step.size.x + s.line) * 4u + s.channel), row + @ku < step.size.y);
#end
#each k SSIM_BLOCK
        if is_within(s, row + @ku - SSIM_RADIUS) {
            moments[(row + @ku - SSIM_RADIUS) * 3u * step.size.x + place] = blur(&held, @ku);
        }
#end
        continuing {
            row += SSIM_BLOCK;
            break if i32(row) >= i32(s.end + SSIM_RADIUS);
        }
    }
}

// SSIM and its derivatives by the blurred moments.
fn ssim(m: vec4f) -> vec4f {
    let product = m.x * m.y;
    let squares = m.x * m.x + m.y * m.y;
    let a = 2.0 * product + SSIM_C1;
    // In a window that is nearly constant, these are rounding errors of large numbers. The exact
    // values satisfy these bounds, and with them SSIM stays within ±1.
    let variances = max(m.z - squares, 0.0);
    let covariance = 2.0 * (m.w - product);
    let b = clamp(covariance, -variances, variances) + SSIM_C2;
    let c = squares + SSIM_C1;
    let d = variances + SSIM_C2;
    let inverse = 1.0 / (c * d);
    let s = a * b * inverse;
    // dS/db(x² + y²) = -S/d; dS/db(xy) = 2a/(c d); dS/db(x) collects the means.
    let by_squares = -s * c * inverse;
    let by_mean = 2.0 * m.y * (b - a) * inverse - 2.0 * m.x * (s * d * inverse + by_squares);
    return vec4f(by_mean, by_squares, 2.0 * a * inverse, s);
}

@compute @workgroup_size(DSSIM_GROUP)
fn dssim_derivatives(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = flat(group, groups);
    let s = segment_of(block * DSSIM_GROUP + lane, step.size.y, step.size.x);
    var dissimilarity = 0.0;
    if s.first < step.size.x {
        var held: Held;
        var by: Held;
        // As in `dssim_moments`. Derivatives lag by half a window, and their blur by a whole one.
        var column = s.first - SPAN;
        loop {
            advance(&held);
            advance(&by);
#each k SSIM_BLOCK
            held[SPAN + @ku] = select(vec4f(0.0), moments[(s.line * step.size.x + column + @ku) * 3u + s.channel], column + @ku < step.size.x);
#end
#each k SSIM_BLOCK
            {
                let here = column + @ku - SSIM_RADIUS;
                let of_here = ssim(blur(&held, @ku));
                by[SPAN + @ku] = select(vec4f(0.0), of_here, here < step.size.x);
                dissimilarity += select(0.0, 1.0 - of_here.w, is_within(s, here));
            }
#end
#each k SSIM_BLOCK
            if is_within(s, column + @ku - SPAN) {
                derivatives[in_strips((column + @ku - SPAN) * 3u + s.channel, s.line)] = blur(&by, @ku).xyz;
            }
#end
            continuing {
                column += SSIM_BLOCK;
                break if i32(column) >= i32(s.end + SPAN);
            }
        }
    }
    let sum = sum_group(lane, dissimilarity);
    if lane == 0u && block < dssim_groups(step.size.y, step.size.x) {
        partial[block] = step.dssim_scale * sum;
    }
}

@compute @workgroup_size(DSSIM_GROUP)
fn dssim_gradient(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = flat(group, groups);
    let s = segment_of(block * DSSIM_GROUP + lane, step.size.x, step.size.y);
    var difference = 0.0;
    if s.first < step.size.y {
        let place = s.line * 3u + s.channel;
        var by: Held;
        var row = s.first - SSIM_RADIUS;
        loop {
            advance(&by);
#each k SSIM_BLOCK
            by[SPAN + @ku] = select(vec4f(0.0), vec4f(derivatives[in_strips(place, row + @ku)], 0.0), row + @ku < step.size.y);
#end
#each k SSIM_BLOCK
            if is_within(s, row + @ku - SSIM_RADIUS) {
                let at = ((row + @ku - SSIM_RADIUS) * step.size.x + s.line) * 4u + s.channel;
                let x = image[at];
                let y = target_image[at];
                let v = blur(&by, @ku);
                difference += abs(x - y);
                let by_ssim = v.x + 2.0 * within_ssim(x) * v.y + within_ssim(y) * v.z;
                v_image[at] = step.pointwise_scale * sign(x - y) - step.dssim_scale * by_ssim;
            }
#end
            continuing {
                row += SSIM_BLOCK;
                break if i32(row) >= i32(s.end + SSIM_RADIUS);
            }
        }
    }
    let sum = sum_group(lane, difference);
    if lane == 0u && block < dssim_groups(step.size.x, step.size.y) {
        partial[dssim_groups(step.size.y, step.size.x) + block] = step.pointwise_scale * sum;
    }
}
