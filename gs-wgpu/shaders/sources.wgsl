// Where edited arrays take their contents from.

// Where a slot's parameters, moments, step count and statistics come from: a Gaussian before, or (parameters) one of `fresh`; NONE leaves 0.
struct Source {
    parameters: u32,
    moments: u32,
    steps: u32,
    statistics: u32,
    is_fresh: u32,
}

const NONE: u32 = 0xffffffffu;

