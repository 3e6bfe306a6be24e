// Stage `ranges`: where each tile's entries begin in the sorted list; before that all are 0. One invocation an entry.

@group(0) @binding(1) var<storage, read> status: Status;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
// [tiles + 1]
@group(0) @binding(3) var<storage, read_write> tile_start: array<u32>;

@compute @workgroup_size(64)
fn ranges(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = flat(group, groups) * 64u + lane;
    if index >= status.entries {
        return;
    }
    let tile = keys[index] >> step.depth_bits;
    if index > 0u {
        for (var t = (keys[index - 1u] >> step.depth_bits) + 1u; t <= tile; t++) {
            tile_start[t] = index;
        }
    }
    if index + 1u == status.entries {
        for (var t = tile + 1u; t <= step.tiles.x * step.tiles.y * CLASSES; t++) {
            tile_start[t] = status.entries;
        }
    }
}
