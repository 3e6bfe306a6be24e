// Stage `queue`, for the sort at each pixel: the tiles' sorted entries as `blend_by_depth` reads
// them, each with the least depth of itself and all later entries in the tile. One work group per
// tile, which starts at the end of the list.

#import prelude: TILE_COLUMNS, TILE_ROWS
#import shared: NO_DEPTH, flat, Queued, Splat, step
#import least_depth: least_depth

@group(0) @binding(1) var<storage, read> tile_start: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<vec2u>;
@group(0) @binding(4) var<storage, read> projected: array<Splat>;
// By place: depth, its slope, and the bits of the index.
@group(0) @binding(5) var<storage, read> depths: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> queue: array<Queued>;

const INVOCATIONS: u32 = 256u;

var<workgroup> least: array<f32, INVOCATIONS>;

@compute @workgroup_size(INVOCATIONS)
fn queue_up(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let tile = flat(group, groups);
    if tile >= step.tiles.x * step.tiles.y {
        return;
    }
    let corner = vec2u(tile % step.tiles.x, tile / step.tiles.x) * vec2u(TILE_COLUMNS, TILE_ROWS);
    let start = tile_start[tile];
    let end = tile_start[tile + 1u];
    var behind = NO_DEPTH;
    for (var block = (end - start + INVOCATIONS - 1u) / INVOCATIONS; block > 0u; block--) {
        let at = start + (block - 1u) * INVOCATIONS + lane;
        var q: Queued;
        q.lower = NO_DEPTH;
        if at < end {
            let slot = order[at];
            let entry = entries[slot];
            let s = projected[entry.x];
            let d = depths[entry.x];
            // An entry without rows reaches nothing. The bounds of others have a margin; the pixels
            // decide exactly.
            let is_there = entry.y != 0u;
            let reach = select(-1.0, s.reach * 1.0001 + 1e-4, is_there);
            let lower = select(NO_DEPTH, least_depth(s, d.x, d.yz, corner), is_there);
            q = Queued(s.mean, s.inverse_xx, s.slope, s.c, s.opacity, reach, lower, d.yz, d.x, bitcast<u32>(d.w), s.color, slot);
        }
        least[lane] = q.lower;
        workgroupBarrier();
        for (var apart = 1u; apart < INVOCATIONS; apart *= 2u) {
            let other = least[min(lane + apart, INVOCATIONS - 1u)];
            workgroupBarrier();
            least[lane] = min(least[lane], other);
            workgroupBarrier();
        }
        if at < end {
            q.lower = min(least[lane], behind);
            queue[at] = q;
        }
        behind = min(behind, least[0]);
        workgroupBarrier();
    }
}
