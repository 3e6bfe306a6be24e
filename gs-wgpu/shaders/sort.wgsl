// Stage `sort`: one pass of a stable radix sort by four bits, of the tiles' entries (WHICH 1) or of
// the Gaussians by depth (WHICH 2). `sort_count` counts the digits of every block of 1,024 entries;
// after a scan over (digit, block), `sort_scatter` moves each entry to its place. A lane has 16
// consecutive entries, which keeps the order within a digit.

#import prelude: SORT_BLOCK
#import shared: flat, Status, step

struct Pass {
    shift: u32,
}

@group(0) @binding(1) var<storage, read> status: Status;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> histograms: array<u32>;
@group(0) @binding(4) var<uniform> radix_pass: Pass;
@group(0) @binding(5) var<storage, read> order: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> sorted_order: array<u32>;

override WHICH: u32 = 1u;

fn length() -> u32 {
    return select(status.entries, step.gaussians, WHICH == 2u);
}

const SORT_LANES: u32 = 64u;
const PER_LANE: u32 = SORT_BLOCK / SORT_LANES;

// Digit-major: digit d of lane i is at d * SORT_LANES + i.
var<workgroup> digits: array<u32, 16u * SORT_LANES>;

fn count(block: u32, lane: u32) {
    for (var d = 0u; d < 16u; d++) {
        digits[d * SORT_LANES + lane] = 0u;
    }
    let first = block * SORT_BLOCK + lane * PER_LANE;
    for (var k = first; k < min(first + PER_LANE, length()); k++) {
        digits[((keys[k] >> radix_pass.shift) & 15u) * SORT_LANES + lane] += 1u;
    }
    workgroupBarrier();
}

@compute @workgroup_size(64)
fn sort_count(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = flat(group, groups);
    let blocks = (length() + SORT_BLOCK - 1u) / SORT_BLOCK;
    count(block, lane);
    if lane < 16u && block < blocks {
        var sum = 0u;
        for (var i = 0u; i < SORT_LANES; i++) {
            sum += digits[lane * SORT_LANES + i];
        }
        histograms[lane * blocks + block] = sum;
    }
}

@compute @workgroup_size(64)
fn sort_scatter(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = flat(group, groups);
    let blocks = (length() + SORT_BLOCK - 1u) / SORT_BLOCK;
    count(block, lane);
    if lane < 16u && block < blocks {
        var next = histograms[lane * blocks + block];
        for (var i = 0u; i < SORT_LANES; i++) {
            let here = digits[lane * SORT_LANES + i];
            digits[lane * SORT_LANES + i] = next;
            next += here;
        }
    }
    workgroupBarrier();
    let first = block * SORT_BLOCK + lane * PER_LANE;
    for (var k = first; k < min(first + PER_LANE, length()); k++) {
        let key = keys[k];
        let slot = ((key >> radix_pass.shift) & 15u) * SORT_LANES + lane;
        let to = digits[slot];
        digits[slot] = to + 1u;
        sorted_keys[to] = key;
        sorted_order[to] = order[k];
    }
}
