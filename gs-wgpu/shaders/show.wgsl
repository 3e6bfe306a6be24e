// Copies an image to a texture of its size with one triangle that covers it. Needs no shared file.

struct Shown {
    width: u32,
    // 1 if the texture's format encodes sRGB, and so needs linear values.
    encodes: u32,
    unused: vec2u,
}

@group(0) @binding(0) var<uniform> shown: Shown;
@group(0) @binding(1) var<storage, read> image: array<vec4f>;

@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn color(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let value = clamp(image[u32(at.y) * shown.width + u32(at.x)].xyz, vec3f(0.0), vec3f(1.0));
    let linear = select(pow((value + 0.055) / 1.055, vec3f(2.4)), value / 12.92, value <= vec3f(0.04045));
    return vec4f(select(value, linear, shown.encodes == 1u), 1.0);
}
