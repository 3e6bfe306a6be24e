// Stage `sizes`: counts the entries, checks that they fit, and sets the sizes of the dispatches
// that depend on them. Before `adam`, `stop_unfinished` decides whether the step is taken. One
// invocation each.

#import prelude: BY_COEFFICIENT, BY_GAUSSIAN, BY_HISTOGRAM, BY_SORT_BLOCK, SORT_BLOCK
#import shared: Status, step

@group(0) @binding(1) var<storage, read> offsets: array<u32>;
@group(0) @binding(2) var<storage, read_write> status: Status;
// Work groups along x, y, z, at each of the BY_… offsets.
@group(0) @binding(3) var<storage, read_write> indirect: array<u32>;

// Largest number of work groups along an axis.
override MOST_GROUPS: u32 = 65535u;

fn put(at: u32, groups: u32) {
    let across = clamp(groups, 1u, MOST_GROUPS);
    indirect[at] = select(across, 0u, groups == 0u);
    indirect[at + 1u] = (groups + across - 1u) / across;
    indirect[at + 2u] = 1u;
}

@compute @workgroup_size(1)
fn sizes() {
    let entries = offsets[step.gaussians];
    status.longest = 0u;
    if entries > step.entry_capacity || status.overflow != 0u {
        status.overflow = max(status.overflow, entries);
        status.entries = 0u;
        put(BY_GAUSSIAN, 0u);
        put(BY_SORT_BLOCK, 0u);
        put(BY_HISTOGRAM, 0u);
        put(BY_COEFFICIENT, 0u);
        return;
    }
    status.entries = entries;
    let blocks = (entries + SORT_BLOCK - 1u) / SORT_BLOCK;
    put(BY_GAUSSIAN, (step.gaussians + 63u) / 64u);
    put(BY_SORT_BLOCK, blocks);
    put(BY_HISTOGRAM, (16u * blocks + 1023u) / 1024u);
    put(BY_COEFFICIENT, (step.gaussians * step.coefficients + 63u) / 64u);
}

// Before `adam`, with a sort at each pixel: an unfinished pixel stops this step and the pending
// ones after it.
@compute @workgroup_size(1)
fn stop_unfinished() {
    if status.unfinished != 0u {
        status.overflow = max(status.entries, 1u);
        put(0u, 0u);
        put(9u, 0u);
    }
}
