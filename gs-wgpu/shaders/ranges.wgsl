// Stage `ranges`: finds each tile's entries in the sorted list by binary search. One invocation per
// tile.

#import prelude: BY_COEFFICIENT, BY_GAUSSIAN
#import shared: flat, step
#import counted: Counted

@group(0) @binding(1) var<storage, read_write> status: Counted;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
// [tiles + 1]
@group(0) @binding(3) var<storage, read_write> tile_start: array<u32>;
// As in `sizes.wgsl`.
@group(0) @binding(4) var<storage, read_write> indirect: array<atomic<u32>>;

// The first place, from `low` on, of an entry of this list or a later one.
fn place_of(list: u32, low: u32) -> u32 {
    var first = low;
    var end = status.entries;
    while first < end {
        let middle = first + (end - first) / 2u;
        if (keys[middle] >> step.depth_bits) < list {
            first = middle + 1u;
        } else {
            end = middle;
        }
    }
    return first;
}

@compute @workgroup_size(64)
fn ranges(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let tile = flat(group, groups) * 64u + lane;
    if tile >= step.tiles.x * step.tiles.y {
        return;
    }
    let start = place_of(tile, 0u);
    let end = place_of(tile + 1u, start);
    tile_start[tile] = start;
    if tile + 1u == step.tiles.x * step.tiles.y {
        tile_start[tile + 1u] = end;
    }
    if end - start > step.longest_list {
        // Adam changes nothing in this pass and the pending ones after it, as for entries that do
        // not fit.
        atomicMax(&status.longest, end - start);
        atomicMax(&status.overflow, status.entries);
        for (var axis = 0u; axis < 3u; axis++) {
            atomicStore(&indirect[BY_GAUSSIAN + axis], 0u);
            atomicStore(&indirect[BY_COEFFICIENT + axis], 0u);
        }
    }
}
