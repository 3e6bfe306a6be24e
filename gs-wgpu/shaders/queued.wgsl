// What the stages share that walk along tiles' queues: whether an entry reaches a pixel, and in backward, in which units its sums are.
//
// An entry's sums are integers, so that they do not depend on the order of the pixels, and each is of units of 2^-53 of the most that one of
// the pixels can give which the entry reaches: no Gaussian that shares none of these has a say in it, however bright.

// Twice sigma at d from the mean.
fn twice_sigma(q: Queued, d: vec2f) -> f32 {
    let u = d.y - q.slope * d.x;
    return d.x * d.x * q.inverse_xx + u * u * q.c;
}

// Words of `totals` that an entry has: low and high halves of its sums, and `units`.
const WORDS: u32 = 2u * STRIDE + 1u;

// Where in them the units stand: the exponents, as f32 has them, of what a pixel gives at most to the colour's gradient, to those of the shape
// and the opacity, and to the error.
const UNITS: u32 = 2u * STRIDE;

fn power_of_two(exponent: i32) -> f32 {
    return bitcast<f32>(u32(clamp(exponent, -126, 127) + 127) << 23u);
}

fn packed_units(most: vec3f) -> u32 {
    let exponents = bitcast<vec3u>(most) >> vec3u(23u);
    return exponents.x | (exponents.y << 8u) | (exponents.z << 16u);
}

// A unit's inverse, and the unit.
struct Unit {
    scale: f32,
    size: f32,
}

// The k-th of packed units: numbers of such an exponent come to 2^53 at most.
fn unit_of(packed: u32, k: u32) -> Unit {
    let exponent = clamp(53 + 126 - i32((packed >> (8u * k)) & 0xffu), -126, 126);
    return Unit(power_of_two(exponent), power_of_two(-exponent));
}
