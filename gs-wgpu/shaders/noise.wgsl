// Noise on the means, as `MeanNoise` of gs-core defines it: eta is a function of the seed, the step
// and the Gaussian's index.

#import prelude: NOISE_OPACITY, NOISE_STEEPNESS
#import shared: direction, sigmoid
#import random: random_words

struct Noise {
    scale: f32,
    seed: u32,
    step: u32,
    gaussians: u32,
    fixed: u32,
}

@group(0) @binding(1) var<uniform> noise: Noise;

fn normals(index: u32) -> vec3f {
    let words = random_words(vec4u(noise.seed, noise.step, index, 0u));
    let u = vec4f((words >> vec4u(8u)) + 1u) / 16777216.0;
    let radius = sqrt(-2.0 * log(u.xz));
    return vec3f(radius.x * direction(6.283185307179586 * u.y), radius.y * direction(6.283185307179586 * u.w).x);
}

fn noise_weight(opacity_logit: f32) -> f32 {
    return noise.scale * sigmoid(-NOISE_STEEPNESS * (sigmoid(opacity_logit) - NOISE_OPACITY));
}
