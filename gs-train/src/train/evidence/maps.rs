//! The maps of pixels whose weighted sums are evidence.

use gs_core::Image;
use gs_density::EvidenceRequest;

/// The maps of [`PixelSums`]: 1, e, and whether the error is high; 0 where the mask leaves a pixel
/// out.
pub(super) fn maps(
    rendered: &Image,
    target: &Image,
    mask: Option<&[bool]>,
    request: &EvidenceRequest,
) -> Result<Image, gs_core::Error> {
    let (width, height) = rendered.size();
    let counts = |at: usize| mask.is_none_or(|mask| mask[at]);
    let error = |at: usize| {
        let (c, y) = (rendered.pixels()[at], target.pixels()[at]);
        (0..3).map(|k| (c[k] - y[k]).abs()).sum::<f32>() / 3.0
    };
    let errors = scaled((0..target.pixels().len()).map(error).collect(), counts);
    let edges = if request.edges > 0.0 { scaled(edges(target), counts) } else { vec![0.0; errors.len()] };
    Image::from_fn(width, height, |x, y| {
        let at = (y * width + x) as usize;
        if !counts(at) {
            return [0.0; 3];
        }
        let high = if errors[at] > request.high_error { 1.0 } else { 0.0 };
        [1.0, request.l1 * errors[at] + request.edges * edges[at], high]
    })
}

/// The values, scaled to 0..=1 between the smallest and the largest that count; 0 if all are equal,
/// and for values that are not finite.
fn scaled(mut values: Vec<f32>, counts: impl Fn(usize) -> bool) -> Vec<f32> {
    let (least, most) = (values.iter().enumerate().filter(|&(at, v)| counts(at) && v.is_finite()))
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(least, most), (_, &v)| (least.min(v), most.max(v)));
    let range = most - least;
    for value in &mut values {
        let share = (*value - least) / range;
        *value = if share.is_finite() { share } else { 0.0 };
    }
    values
}

/// The response of the edge filter of [`EvidenceRequest`]; 0 at the border.
fn edges(target: &Image) -> Vec<f32> {
    let (width, height) = (target.width() as usize, target.height() as usize);
    let grey: Vec<f32> = target.pixels().iter().map(|&[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b).collect();
    let mut edges = vec![0.0; grey.len()];
    for y in 1..height.saturating_sub(1) {
        for x in 1..width.saturating_sub(1) {
            let around = (y - 1..=y + 1).flat_map(|row| &grey[row * width + x - 1..=row * width + x + 1]);
            edges[y * width + x] = (9.0 * grey[y * width + x] - around.sum::<f32>()).clamp(0.0, 1.0);
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_are_scaled_within_the_pixels_that_count() {
        let request = EvidenceRequest::default().with(|s| s.high_error = 0.4);
        let rendered = Image::filled(4, 1, [0.5; 3]).unwrap();
        let target = Image::from_fn(4, 1, |x, _| [[0.5; 3], [0.6, 0.5, 0.5], [0.8, 0.5, 0.5], [9.0; 3]][x as usize]);
        let mask = [true, true, true, false];
        let found = maps(&rendered, &target.unwrap(), Some(&mask), &request).unwrap();
        let expected = [[1.0, 0.0, 0.0], [1.0, 1.0 / 3.0, 0.0], [1.0, 1.0, 1.0], [0.0; 3]];
        for (found, expected) in found.pixels().as_flattened().iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 1e-6, "{found} instead of {expected}");
        }
        let exact = maps(&rendered, &rendered, None, &request).unwrap();
        assert!(exact.pixels().iter().all(|&pixel| pixel == [1.0, 0.0, 0.0]));
    }

    #[test]
    fn edges_are_where_the_grey_value_is_above_that_of_its_neighbours() {
        let step = Image::from_fn(5, 3, |x, _| if x < 2 { [0.0; 3] } else { [0.1; 3] }).unwrap();
        let found = edges(&step);
        let expected = [0.0, 0.0, 0.3, 0.0, 0.0];
        assert!(
            found[5..10].iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6),
            "{found:?}"
        );
        assert!(found[..5].iter().chain(&found[10..]).all(|&v| v == 0.0));
    }
}
