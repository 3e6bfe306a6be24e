//! Findings that depend on the other Gaussians: duplicates, outliers, and values of another meaning.

use glam::{DVec3, Vec3};

use super::{
    finding::{Finding, OUTLIER_DISTANCES, SIZE_SKEW},
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

/// Reports all Gaussians with finite values if their scales or opacities look as if an exporter had
/// stored them as they are, without logarithm or logit.
pub(super) fn activated<S: Examinable>(scene: &S, found: &mut dyn FnMut(usize, Finding)) {
    /// Fewest Gaussians that say anything.
    const FEWEST: usize = 10;
    // Those of activated scales in a small unit cannot be drawn: exp of 100 is infinite.
    let is_finite = |&(index, (scales, opacity)): &(usize, ([f32; 3], f32))| {
        scene.place(index).is_finite() && scales.iter().all(|scale| scale.is_finite()) && !opacity.is_nan()
    };
    let stored = (0..scene.len()).filter_map(|index| Some((index, scene.stored(index)?)));
    let (indices, stored): (Vec<_>, Vec<_>) = stored.filter(is_finite).unzip();
    let Some((_, extent)) = middle_and_distance(scene, &indices).filter(|_| stored.len() >= FEWEST) else { return };
    if are_sizes(stored.iter().flat_map(|(scales, _)| *scales).collect(), extent) {
        indices.iter().for_each(|&index| found(index, Finding::ActivatedScale));
    }
    let opacities = stored.iter().map(|(_, opacity)| *opacity);
    let (low, high) = opacities.fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(v), high.max(v)));
    // Equal ones are how training begins.
    if low >= 0.0 && high <= 1.0 && high - low > 0.1 {
        indices.iter().for_each(|&index| found(index, Finding::ActivatedOpacity));
    }
}

/// Whether values that should be ln-scales are rather scales, whatever the unit: all are above 0, and the
/// upper ones spread much further than the lower ones, as sizes do and their logarithms do not; or the sizes of
/// which they would be the logarithms are nearly equal, or much larger than the scene.
fn are_sizes(mut values: Vec<f32>, extent: f32) -> bool {
    values.sort_unstable_by(f32::total_cmp);
    let [low, middle, high] = [5, 50, 95].map(|percent| values[(values.len() - 1) * percent / 100]);
    let are_skewed = high - middle > SIZE_SKEW * (middle - low) && middle > low;
    let would_be_equal = high - low < 0.5 && high > 2.0 * low;
    let would_be_enormous = extent > 0.0 && high > (10.0 * extent).ln();
    values[0] > 0.0 && (are_skewed || would_be_equal || would_be_enormous)
}

/// The middle one of the values; of an even number the upper of the two.
fn median(mut values: Vec<f32>) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}
