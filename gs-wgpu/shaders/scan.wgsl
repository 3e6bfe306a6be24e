// Exclusive prefix sums in place, in blocks of 1,024. `scan_blocks` sums each block, `scan_sums`
// computes the start of each block, and `scan_spread` finishes the blocks. WHICH selects the input:
// 0, the tile counts of all Gaussians and a final 0; 1, the histograms of a sort of entries; 2,
// those of a sort of Gaussians.

#import prelude: SORT_BLOCK
#import shared: flat, Status, step

@group(0) @binding(1) var<storage, read_write> data: array<u32>;
@group(0) @binding(2) var<storage, read_write> sums: array<u32>;
@group(0) @binding(3) var<storage, read> status: Status;

override WHICH: u32 = 0u;

// Sums saturate at the largest number, which exceeds every capacity.
fn add(a: u32, b: u32) -> u32 {
    return select(a + b, 0xffffffffu, a + b < a);
}

var<workgroup> shared_sums: array<u32, 256>;

fn length() -> u32 {
    if WHICH == 0u {
        return step.gaussians + 1u;
    }
    let sorted = select(status.entries, step.gaussians, WHICH == 2u);
    return 16u * ((sorted + SORT_BLOCK - 1u) / SORT_BLOCK);
}

// The exclusive prefix sum of one number per lane.
fn scan_group(lane: u32, value: u32) -> u32 {
    shared_sums[lane] = value;
    workgroupBarrier();
    for (var reach = 1u; reach < 256u; reach *= 2u) {
        var before = 0u;
        if lane >= reach {
            before = shared_sums[lane - reach];
        }
        workgroupBarrier();
        shared_sums[lane] = add(shared_sums[lane], before);
        workgroupBarrier();
    }
    if lane == 0u {
        return 0u;
    }
    return shared_sums[lane - 1u];
}

fn load(index: u32) -> u32 {
    if index < length() {
        return data[index];
    }
    return 0u;
}

@compute @workgroup_size(256)
fn scan_blocks(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = flat(group, groups);
    let first = block * 1024u + lane * 4u;
    let sum = add(add(load(first), load(first + 1u)), add(load(first + 2u), load(first + 3u)));
    let before = scan_group(lane, sum);
    if lane == 255u && block * 1024u < length() {
        sums[block] = add(before, sum);
    }
}

@compute @workgroup_size(256)
fn scan_sums(@builtin(local_invocation_index) lane: u32) {
    let blocks = (length() + 1023u) / 1024u;
    var carry = 0u;
    for (var first = 0u; first < blocks; first += 256u) {
        var value = 0u;
        if first + lane < blocks {
            value = sums[first + lane];
        }
        let before = scan_group(lane, value);
        if first + lane < blocks {
            sums[first + lane] = add(carry, before);
        }
        carry = add(carry, shared_sums[255]);
        workgroupBarrier();
    }
}

@compute @workgroup_size(256)
fn scan_spread(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let block = flat(group, groups);
    let first = block * 1024u + lane * 4u;
    let values = vec4u(load(first), load(first + 1u), load(first + 2u), load(first + 3u));
    var before = scan_group(lane, add(add(values.x, values.y), add(values.z, values.w)));
    if block * 1024u < length() {
        before = add(before, sums[block]);
    }
    for (var k = 0u; k < 4u; k++) {
        if first + k < length() {
            data[first + k] = before;
        }
        before = add(before, values[k]);
    }
}
