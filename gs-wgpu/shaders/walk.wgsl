// Where a blend kernel begins to walk along a tile's list, and where it ends. Software drivers end loops silently after so many iterations;
// so lists that are longer than one dispatch can walk along take several, SEGMENTED, and between those the pixels' state stands in the
// images' fourth numbers.

struct Walk {
    first: u32,
    end: u32,
    // Of the list.
    begins: bool,
    ends: bool,
}

#if SEGMENTED
// How many entries the dispatches before this one have walked along, and how many this one does at most.
@group(0) @binding(9) var<uniform> segment: vec4u;
#endif

fn walk_along(start: u32, end: u32) -> Walk {
#if SEGMENTED
    let first = start + min(segment.x, end - start);
    let last = first + min(segment.y, end - first);
    return Walk(first, last, segment.x == 0u, last == end);
#else
    return Walk(start, end, true, true);
#endif
}

// Whether there is anything to do: an empty list, too, is drawn once.
fn is_due(walk: Walk) -> bool {
    return walk.begins || walk.first < walk.end;
}
