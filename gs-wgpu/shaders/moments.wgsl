// Adam's moments, for the parameters of 2D and 3D Gaussians.

#import prelude: MAX_DERIVATIVE, VANISHING_MOMENT
#import shared: one_less_exp, step

// Adam's settings for four parameters.
struct Rates {
    rate: vec4f,
    beta1: vec4f,
    beta2: vec4f,
    rest1: vec4f,
    rest2: vec4f,
    bias1: vec4f,
    bias2: vec4f,
}

fn rates_of(groups: vec4u, steps: f32) -> Rates {
    var r: Rates;
    for (var k = 0u; k < 4u; k++) {
        let a = step.rates[groups[k]];
        let b = step.decays[groups[k]];
        r.rate[k] = a.x;
        r.beta1[k] = a.y;
        r.beta2[k] = a.z;
        r.rest1[k] = a.w;
        r.rest2[k] = b.z;
        r.bias1[k] = 1.0 / one_less_exp(steps * b.x);
        r.bias2[k] = 1.0 / one_less_exp(steps * b.y);
    }
    return r;
}

fn moved(first: ptr<function, vec4f>, second: ptr<function, vec4f>, gradient: vec4f, r: Rates) -> vec4f {
    // The square of a larger one is infinite. NaN stays, so that the Gaussian is pruned.
    let g = select(gradient, sign(gradient) * MAX_DERIVATIVE, abs(gradient) > vec4f(MAX_DERIVATIVE));
    let m = r.beta1 * *first + r.rest1 * g;
    let v = r.beta2 * *second + r.rest2 * g * g;
    // Denormals cost time and move nothing.
    *first = select(m, vec4f(0.0), abs(m) < vec4f(VANISHING_MOMENT));
    *second = v;
    return r.rate * (*first * r.bias1) / (sqrt(*second * r.bias2) + step.epsilon);
}
