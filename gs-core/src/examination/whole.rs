//! Findings that depend on the other Gaussians: duplicates, outliers, and values of another meaning.

use glam::{DVec3, Vec3};

use super::{
    finding::{Finding, OUTLIER_DISTANCES, SUSPECT_SIZE},
    kinds::Examinable,
};

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
    let Some((middle, usual)) = middle_and_distance(scene, among) else { return };
    let distance = |index: usize| scene.place(index).as_dvec3().distance(middle);
    if usual > 0.0 && usual.is_finite() {
        let limit = f64::from(usual) * f64::from(OUTLIER_DISTANCES);
        among.iter().filter(|&&index| distance(index) > limit).for_each(|&index| found(index));
    }
}

/// The median of each coordinate, and the median distance from there.
fn middle_and_distance<S: Examinable>(scene: &S, among: &[usize]) -> Option<(DVec3, f32)> {
    let coordinate = |axis: usize| median(among.iter().map(|&index| scene.place(index)[axis]).collect());
    let [Some(x), Some(y), Some(z)] = [0, 1, 2].map(coordinate) else { return None };
    let middle = Vec3::new(x, y, z).as_dvec3();
    // In f64, whose squares do not overflow.
    let distance = |index: usize| scene.place(index).as_dvec3().distance(middle) as f32;
    Some((middle, median(among.iter().map(|&index| distance(index)).collect())?))
}

/// Reports all Gaussians among these if their scales or opacities look as if an exporter had stored
/// them as they are, without logarithm or logit.
pub(super) fn activated<S: Examinable>(scene: &S, among: &[usize], found: &mut dyn FnMut(usize, Finding)) {
    /// Fewest Gaussians that say anything.
    const FEWEST: usize = 10;
    let stored: Vec<([f32; 3], f32)> = among.iter().filter_map(|&index| scene.stored(index)).collect();
    let Some((_, usual)) = middle_and_distance(scene, among).filter(|_| stored.len() >= FEWEST) else { return };
    let scales = stored.iter().flat_map(|(scales, _)| scales);
    let sizes = stored.iter().map(|(scales, _)| scales.iter().fold(f32::MIN, |a, b| a.max(*b)).exp()).collect();
    let are_large = median(sizes).is_some_and(|size| size > SUSPECT_SIZE * usual);
    if are_large && scales.clone().all(|scale| *scale > 0.0) {
        among.iter().for_each(|&index| found(index, Finding::ActivatedScale));
    }
    let opacities = stored.iter().map(|(_, opacity)| *opacity);
    let (low, high) = opacities.fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(v), high.max(v)));
    // Equal ones are how training begins.
    if low >= 0.0 && high <= 1.0 && high - low > 0.1 {
        among.iter().for_each(|&index| found(index, Finding::ActivatedOpacity));
    }
}

/// The middle one of the values; of an even number the upper of the two.
fn median(mut values: Vec<f32>) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}
