// Shared by all stages: the layouts that `src/layout.rs` mirrors, and arithmetic whose precision
// WGSL leaves open.

#import prelude: DSSIM_GROUP, MAX_EXPONENT_2, MAX_EXPONENT_E, SSIM_SEGMENT, TILE_COLUMNS

struct Step {
    // View: plane coordinates of the canvas' corner, pixels per plane unit, size in px, size in
    // tiles.
    origin: vec2f,
    pixels_per_unit: vec2f,
    size: vec2u,
    tiles: vec2u,
    background: vec3f,
    gaussians: u32,
    alpha_cut: f32,
    alpha_max: f32,
    transmittance_min: f32,
    entry_capacity: u32,
    // Weights of the pointwise loss and of D-SSIM, each times the gradient's 1/(number of values);
    // the value's 1/(number of values).
    pointwise_scale: f32,
    dssim_scale: f32,
    per_value: f32,
    epsilon: f32,
    min_scale: f32,
    max_scale: f32,
    // 1 if all Gaussians are opaque; 1 if statistics are collected.
    opaque: u32,
    collect: u32,
    // 1 if Adam moves only Gaussians that some tile lists.
    visible_only: u32,
    // SH: coefficients per Gaussian (2D scenes: 0), and the evaluated degree.
    coefficients: u32,
    sh_degree: u32,
    // Number of low bits of an entry's key that hold its depth.
    depth_bits: u32,
    // Longest list that this pass's kernels can loop over.
    longest_list: u32,
    // 2D scenes: the dilation of Sigma', px², and 1 if the opacity compensates for it.
    dilation: f32,
    compensates: u32,
    // What 3D Gaussians show: 0 for colours, 1 for inverse depths, 2 for alpha.
    output: u32,
    // 3D scenes: the share of Gaussians that is left out, times 2²⁴, and the seed that selects them.
    dropout_threshold: u32,
    dropout_seed: u32,
    // Number of Gaussians, the first, that Adam and edits leave as they are.
    fixed: u32,
    // Aligns the rates to 16 bytes.
    padding: u32,
    // Adam: mean, scale, rotation, opacity, colour, SH above degree 0. Learning rate, beta1, beta2,
    // 1 - beta1; ln beta1, ln beta2, 1 - beta2, and for scales and opacities the penalty's weight
    // per number.
    rates: array<vec4f, 6>,
    decays: array<vec4f, 6>,
}

struct Gaussian {
    mean: vec2f,
    opacity_logit: f32,
    // Adam steps taken.
    steps: u32,
    // ScaleRotation: ln-scales and rotation. CovarianceFactor: the columns of L.
    shape: vec4f,
    color: vec3f,
    unused: f32,
}

struct Moments {
    // First moments: mean 2, shape 2; shape 1, colour 3. Then second moments, then both of the
    // opacity.
    first: array<vec4f, 2>,
    second: array<vec4f, 2>,
    opacity: vec4f,
}

struct Statistics {
    signal_sum: f32,
    visible: u32,
}

// The statistics after a step that adds a value of this weight.
fn with_share(s: Statistics, value: f32, weight: u32) -> Statistics {
    return Statistics(s.signal_sum + value, s.visible + min(weight, 0xffffffffu - s.visible));
}

// One Gaussian on the canvas, in px: sigma = dx²/(2 Sxx) + c (dy - slope dx)²/2.
struct Splat {
    mean: vec2f,
    inverse_xx: f32,
    slope: f32,
    c: f32,
    opacity: f32,
    // 2 ln(opacity/cut): twice sigma on the ellipse outside which nothing is added.
    reach: f32,
    // Half that ellipse's extent along x; negative for a culled Gaussian.
    half_x: f32,
    color: vec3f,
    // dx of the ellipse's lowest point.
    lowest_dx: f32,
}

// One Gaussian's gradient in its whitened coordinates.
struct Gradient {
    color: vec3f,
    opacity_logit: f32,
    eta: vec3f,
    device_norm: f32,
    xi: vec2f,
    visible: u32,
    // Weight of `device_norm` in the statistic.
    weight: u32,
}

// A 3D Gaussian without its colour.
struct Ellipsoid {
    mean: vec3f,
    opacity_logit: f32,
    log_scale: vec3f,
    // Adam steps taken.
    steps: u32,
    // (w, x, y, z), of any length but 0.
    rotation: vec4f,
}

// Gradient of an ellipsoid, by index.
struct EllipsoidGradient {
    mean: vec3f,
    opacity_logit: f32,
    log_scale: vec3f,
    device_norm: f32,
    rotation: vec4f,
    // 1 if some tile lists it. Otherwise all is 0, and the gradients of its SH are unspecified.
    visible: u32,
    // Weight of `device_norm` in the statistic.
    weight: u32,
    unused: array<u32, 2>,
}

struct EllipsoidMoments {
    // Moments of mean and opacity, log-scale, rotation.
    first: array<vec4f, 3>,
    second: array<vec4f, 3>,
}

// A queued entry of a tile, for the sort at each pixel, with the data of its Gaussian.
struct Queued {
    mean: vec2f,
    inverse_xx: f32,
    slope: f32,
    c: f32,
    opacity: f32,
    // Upper bound of twice sigma where the Gaussian adds anything.
    reach: f32,
    // Lower bound of the depth of this entry and all later ones at the tile's pixels.
    lower: f32,
    // Slope of the depth per px.
    depth_slope: vec2f,
    // Depth at the mean.
    depth: f32,
    // Index in the scene.
    index: u32,
    color: vec3f,
    // Number of the entry.
    slot: u32,
}

// The largest depth, and a number beyond it.
const FARTHEST: f32 = 3.4e38;
const NO_DEPTH: f32 = 3.402e38;

// The status that the host reads later.
struct Status {
    entries: u32,
    // Number of entries if they exceed the capacity, else 0. If it is not 0, nothing is trained.
    overflow: u32,
    // Length of the longest list if it exceeds `longest_list`, else 0. Then `overflow` is not 0,
    // either.
    longest: u32,
    loss: f32,
    // The gradient by the camera, if it was asked for, as `CameraGradient::to_array` of gs-core.
    by_camera: array<f32, 10>,
    near: u32,
    not_finite: u32,
    degenerate: u32,
    transparent: u32,
    // Number of pixels that could not sort their Gaussians.
    unfinished: u32,
    outside: u32,
}

@group(0) @binding(0) var<uniform> step: Step;

// Number of SH coefficients of the evaluated degree.
fn evaluated() -> u32 {
    return (step.sh_degree + 1u) * (step.sh_degree + 1u);
}

const LOG2_E: f32 = 1.4426950408889634;

// The number of a work group in a dispatch of several rows.
fn flat(group: vec3u, groups: vec3u) -> u32 {
    return group.y * groups.x + group.x;
}

// Work groups of D-SSIM's kernels for lines of a length.
fn dssim_groups(lines: u32, length: u32) -> u32 {
    return (3u * lines * ((length + SSIM_SEGMENT - 1u) / SSIM_SEGMENT) + DSSIM_GROUP - 1u) / DSSIM_GROUP;
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn is_nan(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) > 0x7f800000u;
}

// 2^r - 1 for |r| <= 1/2 (coefficients: Cephes' exp2f).
fn exp2_less_one(r: f32) -> f32 {
    var p = fma(1.535336188319500e-4, r, 1.339887440266574e-3);
    p = fma(p, r, 9.618437357674640e-3);
    p = fma(p, r, 5.550332471162809e-2);
    p = fma(p, r, 2.402264791363012e-1);
    p = fma(p, r, 6.931472028550421e-1);
    return p * r;
}

// 2^x of four numbers <= 0; 0 below 2^-126. WGSL's own may be off by 3 + 2|x| ulp.
fn exp2_exact4(x: vec4f) -> vec4f {
    let n = round(x);
    let r = x - n;
    var p = fma(vec4f(1.535336188319500e-4), r, vec4f(1.339887440266574e-3));
    p = fma(p, r, vec4f(9.618437357674640e-3));
    p = fma(p, r, vec4f(5.550332471162809e-2));
    p = fma(p, r, vec4f(2.402264791363012e-1));
    p = fma(p, r, vec4f(6.931472028550421e-1));
    p = fma(p, r, vec4f(1.0));
    let power = bitcast<vec4f>(vec4u(vec4i(max(n, vec4f(-MAX_EXPONENT_2))) + 127) << vec4u(23u));
    return select(vec4f(0.0), p * power, x >= vec4f(-MAX_EXPONENT_2));
}

// 2^x, with x clamped to [-126, 126].
fn exp2_within(x: f32) -> f32 {
    let y = clamp(x, -MAX_EXPONENT_2, MAX_EXPONENT_2);
    let n = round(y);
    let r = y - n;
    var p = fma(1.535336188319500e-4, r, 1.339887440266574e-3);
    p = fma(p, r, 9.618437357674640e-3);
    p = fma(p, r, 5.550332471162809e-2);
    p = fma(p, r, 2.402264791363012e-1);
    p = fma(p, r, 6.931472028550421e-1);
    p = fma(p, r, 1.0);
    return p * bitcast<f32>((i32(n) + 127) << 23u);
}

// 2^x of x <= 0; 0 below 2^-126.
fn exp2_exact(x: f32) -> f32 {
    return select(0.0, exp2_within(x), x >= -MAX_EXPONENT_2);
}

fn weights(exponent: vec4f) -> vec4f {
#if ON_CPU
    return exp2_exact4(exponent);
#else
    return exp2(exponent);
#endif
}

// e^x, |x| clamped to 87.
fn exp_exact(x: f32) -> f32 {
    let y = clamp(x, -MAX_EXPONENT_E, MAX_EXPONENT_E);
    let n = round(y * LOG2_E);
    let r = fma(n, 2.12194440e-4, fma(n, -0.693359375, y));
    var p = fma(1.9875691500e-4, r, 1.3981999507e-3);
    p = fma(p, r, 8.3334519073e-3);
    p = fma(p, r, 4.1665795894e-2);
    p = fma(p, r, 1.6666665459e-1);
    p = fma(p, r, 5.0000001201e-1);
    let e = fma(p, r * r, r) + 1.0;
    return e * bitcast<f32>(u32(i32(n) + 127) << 23u);
}

// 1 - e^x for x <= 0, without cancellation.
fn one_less_exp(x: f32) -> f32 {
    if x < -0.34 {
        return 1.0 - exp_exact(x);
    }
    var p = fma(1.9875691500e-4, x, 1.3981999507e-3);
    p = fma(p, x, 8.3334519073e-3);
    p = fma(p, x, 4.1665795894e-2);
    p = fma(p, x, 1.6666665459e-1);
    p = fma(p, x, 5.0000001201e-1);
    return -fma(p, x * x, x);
}

// An angle minus a multiple of pi/2, and that multiple modulo 4.
struct Reduced {
    rest: f32,
    quarter: u32,
}

// The bits of 2/pi, after 32 zeros.
const TWO_OVER_PI = array<u32, 7>(
    0u, 0xA2F9836Eu, 0x4E441529u, 0xFC2757D1u, 0xF534DDC0u, 0xDB629599u, 0x3C439041u,
);

// For angles above 10^4, whose multiple of pi/2 has too many digits for f32 (Payne and Hanek 1983).
// It computes 64 bits of the product with 2/pi, beginning with the bit of 2.
fn reduced_exactly(angle: f32) -> Reduced {
    if !is_finite(angle) {
        return Reduced(angle, 0u);
    }
    let bits = bitcast<u32>(angle);
    let mantissa = (bits & 0x7fffffu) | 0x800000u;
    let first = ((bits >> 23u) & 0xffu) - 120u;
    let shift = first % 32u;
    var table = TWO_OVER_PI;
    let a = table[first / 32u];
    let b = table[first / 32u + 1u];
    let c = table[first / 32u + 2u];
    let high = (a << shift) | ((b >> 1u) >> (31u - shift));
    let low = (b << shift) | ((c >> 1u) >> (31u - shift));
    // The upper half of mantissa * low, by halves of 16 bits.
    let m0 = mantissa & 0xffffu;
    let m1 = mantissa >> 16u;
    let middle = m0 * (low >> 16u) + ((m0 * (low & 0xffffu)) >> 16u);
    let carry = ((middle & 0xffffu) + m1 * (low & 0xffffu)) >> 16u;
    let top = mantissa * high + m1 * (low >> 16u) + (middle >> 16u) + carry;
    let part = bitcast<i32>((top << 2u) | ((mantissa * low) >> 30u));
    let rest = f32(part) * (1.5707963267948966 / 4294967296.0);
    let quarter = (top >> 30u) + select(0u, 1u, part < 0);
    return Reduced(select(rest, -rest, angle < 0.0), select(quarter, 0u - quarter, angle < 0.0) & 3u);
}

fn reduced(angle: f32) -> Reduced {
    if !(abs(angle) <= 1e4) {
        return reduced_exactly(angle);
    }
    let n = round(angle * 0.6366197723675814);
    let rest = fma(n, -7.54978995489188e-8, fma(n, -4.837512969970703125e-4, fma(n, -1.5703125, angle)));
    return Reduced(rest, u32(i32(n)) & 3u);
}

// (cos, sin): reduced by multiples of pi/2 in three parts, then Cephes' sinf and cosf.
fn direction(angle: f32) -> vec2f {
    let of_angle = reduced(angle);
    let r = of_angle.rest;
    let z = r * r;
    let s = fma(fma(fma(-1.9515295891e-4, z, 8.3321608736e-3), z, -1.6666654611e-1) * z, r, r);
    let c = fma(fma(fma(2.443315711809948e-5, z, -1.388731625493765e-3), z, 4.166664568298827e-2) * z, z, fma(z, -0.5, 1.0));
    let quarter = of_angle.quarter;
    let swapped = select(vec2f(c, s), vec2f(s, c), (quarter & 1u) == 1u);
    let cosine = select(swapped.x, -swapped.x, quarter == 1u || quarter == 2u);
    let sine = select(swapped.y, -swapped.y, quarter >= 2u);
    return vec2f(cosine, sine);
}

fn sigmoid(x: f32) -> f32 {
    return 1.0 / (1.0 + exp_exact(-x));
}

// L with Sigma = L L^T.
fn factor_of(shape: vec4f) -> mat2x2f {
#if COVARIANCE_FACTOR
    return mat2x2f(shape.xy, shape.zw);
#else
    let d = direction(shape.z);
    return mat2x2f(d * exp_exact(shape.x), vec2f(-d.y, d.x) * exp_exact(shape.y));
#endif
}

fn determinant_of(l: mat2x2f) -> f32 {
    return l[0].x * l[1].y - l[1].x * l[0].y;
}

// L^-T v.
fn solve_transposed(l: mat2x2f, v: vec2f) -> vec2f {
    return vec2f(l[1].y * v.x - l[0].y * v.y, l[0].x * v.y - l[1].x * v.x) / determinant_of(l);
}

// The pixels whose centres lie within [mean - before, mean + after]: first and end. The margin of a
// thousandth of a pixel keeps rounding from losing one; the blend kernels decide exactly.
fn pixels_between(mean: f32, before: f32, after: f32, side: u32) -> vec2u {
    let first = clamp(ceil(mean - before - 0.5 - 1e-3), 0.0, f32(side));
    let end = clamp(floor(mean + after - 0.5 + 1e-3) + 1.0, 0.0, f32(side));
    return vec2u(u32(first), u32(end));
}

// First and end of the tile columns that a splat touches.
fn tile_columns(s: Splat) -> vec2u {
    if !(s.half_x >= 0.0) {
        return vec2u(0u);
    }
    let columns = pixels_between(s.mean.x, s.half_x, s.half_x, step.size.x);
    if columns.x >= columns.y {
        return vec2u(0u);
    }
    return vec2u(columns.x / TILE_COLUMNS, (columns.y - 1u) / TILE_COLUMNS + 1u);
}

// First and end of the image rows in which the cut's ellipse meets a column of tiles.
fn rows_in_column(s: Splat, column: u32) -> vec2u {
    let left = max(f32(column * TILE_COLUMNS) + 0.5 - s.mean.x, -s.half_x);
    let right = min(f32((column + 1u) * TILE_COLUMNS) - 0.5 - s.mean.x, s.half_x);
    let bottom_dx = clamp(s.lowest_dx, left, right);
    let top_dx = clamp(-s.lowest_dx, left, right);
    let up = sqrt(max(s.reach - top_dx * top_dx * s.inverse_xx, 0.0) / s.c) - s.slope * top_dx;
    let down = sqrt(max(s.reach - bottom_dx * bottom_dx * s.inverse_xx, 0.0) / s.c) + s.slope * bottom_dx;
    return pixels_between(s.mean.y, up, down, step.size.y);
}
