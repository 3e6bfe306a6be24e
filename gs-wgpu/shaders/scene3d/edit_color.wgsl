// Stage `edit` for SH coefficients; `edit.wgsl` has the rest. One invocation per coefficient, with
// its three channels.

#import shared: flat, step
#import sources: NONE, Source

@group(0) @binding(1) var<storage, read> sources: array<Source>;
// [.., coefficients, 3] each.
@group(0) @binding(2) var<storage, read> fresh: array<f32>;
@group(0) @binding(3) var<storage, read> sh: array<f32>;
@group(0) @binding(6) var<storage, read_write> edited_sh: array<f32>;
// Moments as in `adam_color.wgsl`.
#if PACKED
@group(0) @binding(4) var<storage, read> base_moments: array<f32>;
@group(0) @binding(5) var<storage, read> packed_moments: array<u32>;
@group(0) @binding(7) var<storage, read_write> edited_base: array<f32>;
@group(0) @binding(8) var<storage, read_write> edited_packed: array<u32>;
#else
@group(0) @binding(4) var<storage, read> first_moments: array<f32>;
@group(0) @binding(5) var<storage, read> second_moments: array<f32>;
@group(0) @binding(7) var<storage, read_write> edited_first: array<f32>;
@group(0) @binding(8) var<storage, read_write> edited_second: array<f32>;
#endif

@compute @workgroup_size(64)
fn edit_color(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let at = flat(group, groups) * 64u + lane;
    if at >= step.gaussians * step.coefficients {
        return;
    }
    let slot = at / step.coefficients;
    let source = sources[slot];
    let k = at % step.coefficients;
    let place = 3u * (source.parameters * step.coefficients + k);
    let inherits = source.moments != NONE;
    for (var channel = 0u; channel < 3u; channel++) {
        var value = 0.0;
        if source.is_fresh == 1u {
            value = fresh[place + channel];
        } else {
            value = sh[place + channel];
        }
        edited_sh[3u * at + channel] = value;
        var moments = vec2f(0.0);
#if PACKED
        if k > 0u {
            let rest = step.coefficients - 1u;
            var both = 0u;
            if inherits {
                both = packed_moments[3u * (source.moments * rest + k - 1u) + channel];
            }
            edited_packed[3u * (slot * rest + k - 1u) + channel] = both;
            continue;
        }
        let heritage = 6u * source.moments + channel;
        if inherits {
            moments = vec2f(base_moments[heritage], base_moments[heritage + 3u]);
        }
        edited_base[6u * slot + channel] = moments.x;
        edited_base[6u * slot + channel + 3u] = moments.y;
#else
        let heritage = 3u * (source.moments * step.coefficients + k) + channel;
        if inherits {
            moments = vec2f(first_moments[heritage], second_moments[heritage]);
        }
        edited_first[3u * at + channel] = moments.x;
        edited_second[3u * at + channel] = moments.y;
#endif
    }
}
