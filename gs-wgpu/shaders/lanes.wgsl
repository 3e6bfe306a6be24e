// What lanes of a CPU's vector make of their numbers together, where a work group is one subgroup.

#if VECTORS
fn sum_of_lanes(x: f32) -> f32 {
    let pairs = x + subgroupShuffleXor(x, 1u);
    let fours = pairs + subgroupShuffleXor(pairs, 2u);
    return fours + subgroupShuffleXor(fours, 4u);
}
#endif
