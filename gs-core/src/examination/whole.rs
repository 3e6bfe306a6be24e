//! Findings that depend on the other Gaussians: duplicates and outliers.

use glam::Vec3;

use super::{finding::OUTLIER_DISTANCES, kinds::Examinable};

/// Reports the Gaussians among these that have mean, scales and rotation of an earlier one.
pub(super) fn duplicates<S: Examinable>(scene: &S, among: &[usize], found: &mut dyn FnMut(usize)) {
    let mut order = among.to_vec();
    // Equals end up side by side, the earliest of them first.
    order.sort_unstable_by_key(|&index| (scene.shape_bits(index), index));
    for pair in order.windows(2) {
        if scene.shape_bits(pair[0]) == scene.shape_bits(pair[1]) {
            found(pair[1]);
        }
    }
}

/// Reports the Gaussians among these, whose means are finite, that are more than
/// [`OUTLIER_DISTANCES`] times the median distance from the middle. The middle is the median of
/// each coordinate, which outliers do not move.
pub(super) fn outliers<S: Examinable>(scene: &S, among: &[usize], found: &mut dyn FnMut(usize)) {
    let coordinate = |axis: usize| median(among.iter().map(|&index| scene.place(index)[axis]).collect());
    let [Some(x), Some(y), Some(z)] = [0, 1, 2].map(coordinate) else { return };
    let middle = Vec3::new(x, y, z).as_dvec3();
    // In f64, whose squares do not overflow.
    let distance = |index: usize| scene.place(index).as_dvec3().distance(middle);
    let Some(usual) = median(among.iter().map(|&index| distance(index) as f32).collect()) else { return };
    if usual > 0.0 && usual.is_finite() {
        let limit = f64::from(usual) * f64::from(OUTLIER_DISTANCES);
        among.iter().filter(|&&index| distance(index) > limit).for_each(|&index| found(index));
    }
}

/// The middle one of the values; of an even number the upper of the two.
fn median(mut values: Vec<f32>) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}
