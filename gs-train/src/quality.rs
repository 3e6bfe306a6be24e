//! The measure of a running fit, in one pass over the two images, so that watching a fit stays cheap.

use gs_core::Image;

/// L1 and PSNR of `image` against `target`, both clamped to 0..=1; the images have one size.
///
/// What [`gs_core::metrics`] gives for the clamped images, without making them.
pub(crate) fn l1_and_psnr(image: &Image, target: &Image) -> (f64, f64) {
    debug_assert_eq!(image.size(), target.size());
    let row = image.width() as usize * 3;
    let (rendered, wanted) = (image.pixels().as_flattened(), target.pixels().as_flattened());
    let (mut absolute, mut squared) = (0.0f64, 0.0f64);
    for (rendered, wanted) in rendered.chunks(row).zip(wanted.chunks(row)) {
        let (mut row_absolute, mut row_squared) = ([0.0f32; 8], [0.0f32; 8]);
        let mut add = |lane: usize, a: f32, b: f32| {
            let difference = a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0);
            row_absolute[lane] += difference.abs();
            row_squared[lane] += difference * difference;
        };
        // Eight sums side by side, so that the compiler may use vectors.
        let (a, a_rest) = rendered.as_chunks::<8>();
        let (b, b_rest) = wanted.as_chunks::<8>();
        for (a, b) in a.iter().zip(b) {
            for lane in 0..8 {
                add(lane, a[lane], b[lane]);
            }
        }
        for (lane, (&a, &b)) in a_rest.iter().zip(b_rest).enumerate() {
            add(lane, a, b);
        }
        absolute += row_absolute.iter().map(|&v| f64::from(v)).sum::<f64>();
        squared += row_squared.iter().map(|&v| f64::from(v)).sum::<f64>();
    }
    let values = wanted.len() as f64;
    (absolute / values, -10.0 * (squared / values).log10())
}

#[cfg(test)]
mod tests {
    use gs_core::metrics;

    use super::*;

    #[test]
    fn agrees_with_the_metrics_of_the_clamped_images() {
        let wave =
            |phase: f32| move |x: u32, y: u32| [0.0, 0.7, 1.3].map(|c| (x as f32 * 0.7 + y as f32 + c + phase).sin());
        let a = Image::from_fn(37, 21, wave(0.0)).unwrap();
        let b = Image::from_fn(37, 21, wave(0.1)).unwrap();
        let (l1, psnr) = l1_and_psnr(&a, &b);
        let (a, b) = (a.clamped(), b.clamped());
        assert!((l1 - metrics::mean_absolute_error(&a, &b).unwrap()).abs() < 1e-7);
        assert!((psnr - metrics::psnr(&a, &b).unwrap()).abs() < 1e-4);
        assert!(psnr > 10.0 && psnr < 60.0, "{psnr}");
        assert_eq!(l1_and_psnr(&a, &a), (0.0, f64::INFINITY));
    }
}
