// Stage `place` of 3D scenes: moves splats and their tile counts into the order of blending. One
// invocation per Gaussian, and one more for the final 0.

#import shared: flat, Splat, step

// Place -> index.
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> projected: array<Splat>;
@group(0) @binding(3) var<storage, read> counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> placed: array<Splat>;
// [N + 1]
@group(0) @binding(5) var<storage, read_write> placed_counts: array<u32>;
#if PER_PIXEL
@group(0) @binding(6) var<storage, read> pixel_depths: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> placed_depths: array<vec4f>;
#endif

@compute @workgroup_size(64)
fn place(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let at = flat(group, groups) * 64u + lane;
    if at > step.gaussians {
        return;
    }
    var count = 0u;
    if at < step.gaussians {
        let index = order[at];
        placed[at] = projected[index];
        count = counts[index];
#if PER_PIXEL
        placed_depths[at] = pixel_depths[index];
#endif
    }
    placed_counts[at] = count;
}
