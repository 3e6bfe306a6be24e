// The sources of edited arrays.

// Sources of a slot's parameters, moments, step count and statistics: a Gaussian before the edit,
// or (parameters) one of `fresh`. NONE leaves 0.
struct Source {
    parameters: u32,
    moments: u32,
    steps: u32,
    statistics: u32,
    is_fresh: u32,
}

const NONE: u32 = 0xffffffffu;

