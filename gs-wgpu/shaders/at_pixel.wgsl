// What one Gaussian does at four pixels of a column, one per component: its weight, its share of
// their colours, and the gradient by its alpha. Kernels with one pixel use the first component.

#import shared: LOG2_E, step, weights

// The weights at dx px from the mean and u px from the ridge (see Splat).
fn weights_at(inverse_xx: f32, c: f32, dx: f32, u: vec4f) -> vec4f {
    let across = dx * dx * (-0.5 * LOG2_E * inverse_xx);
    return weights(fma(u * u, vec4f(-0.5 * LOG2_E * c), vec4f(across)));
}

#if OVER
struct Blended {
    // What the Gaussian's colour is multiplied by; 0 at pixels that it does not change.
    share: vec4f,
    alpha: vec4f,
    // Behind the Gaussian. Full pixels have the transmittance before it with a negative sign, so
    // that every later Gaussian fails the test against the minimum.
    transmittance: vec4f,
    // Whether the image changes with alpha. The gradient of a clamped alpha is zero.
    has_gradient: vec4<bool>,
}

// Blends a Gaussian behind the earlier ones. `uncut`: opacity times weight.
fn blended(before: vec4f, uncut: vec4f) -> Blended {
    let alpha = min(uncut, vec4f(step.alpha_max));
    let share = before * alpha;
    let behind = before - share;
    let touches = uncut >= vec4f(step.alpha_cut);
    let is_full = !(behind >= vec4f(step.transmittance_min));
    let counts = touches & !is_full;
    return Blended(
        select(vec4f(0.0), share, counts),
        alpha,
        select(before, select(behind, -abs(before), is_full), touches),
        counts & (uncut <= vec4f(step.alpha_max)),
    );
}

// alpha v_alpha, from v_C . colour, and v_C . (the colour behind the Gaussian).
fn through_alpha(b: Blended, before: vec4f, v_dot_c: vec4f, rest: vec4f) -> vec4f {
    let v_alpha = before * v_dot_c - rest / (1.0 - b.alpha);
    return select(vec4f(0.0), v_alpha * b.alpha, b.has_gradient);
}
#else
// What the Gaussian's colour is multiplied by.
fn share_of(w: vec4f) -> vec4f {
    return select(vec4f(0.0), w, w >= vec4f(step.alpha_cut));
}
#endif
