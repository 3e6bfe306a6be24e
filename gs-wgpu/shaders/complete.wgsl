// Completes a target that is masked or in 8 bits: in floats, blended with the background, and equal to
// the rendering where the mask excludes a pixel. One invocation per pixel.

#import prelude: EXCLUDED
#import shared: flat, step

@group(0) @binding(1) var<storage, read> image: array<vec4f>;
// Colours, and as fourth number the alpha, or -1 where the mask excludes the pixel.
#if PACKED
@group(0) @binding(2) var<storage, read> target_image: array<u32>;
#else
@group(0) @binding(2) var<storage, read> target_image: array<vec4f>;
#endif
@group(0) @binding(3) var<storage, read_write> completed: array<vec4f>;

fn target_at(pixel: u32) -> vec4f {
#if PACKED
    let bytes = target_image[pixel];
    let levels = (vec4u(bytes) >> vec4u(0u, 8u, 16u, 24u)) & vec4u(255u);
    return select(vec4f(levels) / 255.0, vec4f(-1.0), bytes == EXCLUDED);
#else
    return target_image[pixel];
#endif
}

@compute @workgroup_size(256)
fn complete(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let pixel = flat(group, groups) * 256u + lane;
    if pixel >= step.size.x * step.size.y {
        return;
    }
    let y = target_at(pixel);
    var color = y.xyz;
    if y.w < 0.0 {
        color = image[pixel].xyz;
    } else if y.w < 1.0 {
        color = y.xyz * y.w + step.background * (1.0 - y.w);
    }
    completed[pixel] = vec4f(color, 0.0);
}
