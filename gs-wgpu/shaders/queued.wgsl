// Queued entries: whether one reaches a pixel, and the units of its sums in the backward pass.
//
// An entry's sums are integers, so that they do not depend on the order of the pixels. A unit is
// 2^-53 of the largest contribution of a pixel that the entry reaches. It does not depend on
// Gaussians that share no pixel with the entry, however bright.

#import prelude: STRIDE
#import shared: Queued

// Twice sigma at distance d from the mean.
fn twice_sigma(q: Queued, d: vec2f) -> f32 {
    let u = d.y - q.slope * d.x;
    return d.x * d.x * q.inverse_xx + u * u * q.c;
}

// Words of `totals` per entry: low and high halves of its sums, and `units`.
const WORDS: u32 = 2u * STRIDE + 1u;

// Position of the units in these words. They are the f32 exponents of a pixel's largest
// contribution to the gradient of the colour, to those of shape and opacity, and to the error.
const UNITS: u32 = 2u * STRIDE;

fn power_of_two(exponent: i32) -> f32 {
    return bitcast<f32>(u32(clamp(exponent, -126, 127) + 127) << 23u);
}

fn packed_units(most: vec3f) -> u32 {
    let exponents = bitcast<vec3u>(most) >> vec3u(23u);
    return exponents.x | (exponents.y << 8u) | (exponents.z << 16u);
}

// The inverse of a unit, and the unit.
struct Unit {
    scale: f32,
    size: f32,
}

// The k-th of the packed units. Numbers with that exponent are at most 2^53 units.
fn unit_of(packed: u32, k: u32) -> Unit {
    let exponent = clamp(53 + 126 - i32((packed >> (8u * k)) & 0xffu), -126, 126);
    return Unit(power_of_two(exponent), power_of_two(-exponent));
}
