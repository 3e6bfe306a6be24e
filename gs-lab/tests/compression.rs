//! The files and curves of the bench on compression, whose program runs no tests itself.

#[allow(dead_code)]
#[path = "../benches/compression/codec.rs"]
mod codec;
#[allow(dead_code)]
#[path = "../benches/compression/curve.rs"]
mod curve;

use gs_core::Image;
use gs_train::ImageQuality;

use self::{
    codec::{CODECS, Coded, Original},
    curve::{RateCurve, ms_ssim_decibels},
};

#[test]
fn better_levels_have_larger_and_better_files() {
    let wave = |x: u32, y: u32| ((x * x + 3 * y) as f32 * 0.02).sin() * 0.4 + 0.5;
    let image = Image::from_fn(96, 64, |x, y| [wave(x, y), wave(y, x), 0.3]).unwrap();
    let original = Original::new(&image).unwrap();
    for codec in CODECS.iter().filter(|codec| codec.is_there()) {
        let known = codec.files(&original, &codec.levels[2..5]).unwrap();
        let psnr = |file: &Coded| ImageQuality::as_written(&file.picture, &image).unwrap().psnr;
        let rises = |value: &dyn Fn(&Coded) -> f64| known.windows(2).all(|pair| value(&pair[0]) < value(&pair[1]));
        assert!(rises(&|file| file.bytes as f64) && rises(&psnr), "{}", codec.name);
    }
}

/// Files whose size doubles each 3 dB, times `factor`.
fn curve(factor: f64, psnrs: &[f64]) -> RateCurve {
    RateCurve::new(psnrs.iter().map(|&psnr| (factor * 2f64.powf((psnr - 30.0) / 3.0), psnr))).unwrap()
}

#[test]
fn equal_ratios_are_the_bd_rate_whatever_the_points() {
    let ours = curve(0.75, &[24.0, 27.5, 31.0, 33.0, 36.0]);
    let theirs = curve(1.0, &[25.0, 28.0, 30.5, 35.0]);
    let rate = ours.bd_rate(&theirs, 0.0..=f64::INFINITY).unwrap();
    assert!((rate + 0.25).abs() < 1e-9, "{rate}");
    let rate = theirs.bd_rate(&ours, 0.5..=2.0).unwrap();
    assert!((rate - 1.0 / 3.0).abs() < 1e-9, "{rate}");
    assert!(ours.bd_rate(&theirs, 1e-9..=1e-8).is_none() && ours.bd_rate(&theirs, 90.0..=99.0).is_none());
    assert!((theirs.quality_at(1.0).unwrap() - 30.0).abs() < 1e-6);
    assert!((theirs.bpp_at(33.0).unwrap() - 2.0).abs() < 1e-6 && theirs.bpp_at(36.0).is_none());
}

#[test]
fn only_sizes_in_the_range_count() {
    // Half the size up to 30 dB, and the same above.
    let theirs = curve(1.0, &[24.0, 27.0, 30.0, 30.01, 33.0, 36.0]);
    let ours = RateCurve::new(
        [24.0f64, 27.0, 30.0, 30.01, 33.0, 36.0]
            .map(|q| (2f64.powf((q - 30.0) / 3.0) * if q > 30.0 { 1.0 } else { 0.5 }, q)),
    )
    .unwrap();
    let small = ours.bd_rate(&theirs, 0.0..=0.5).unwrap();
    let all = ours.bd_rate(&theirs, 0.0..=9.0).unwrap();
    assert!((small + 0.5).abs() < 0.01 && all > -0.35, "{small} {all}");
}

#[test]
fn a_curve_rises_between_its_points_and_leaves_out_worse_files() {
    let curve = RateCurve::new([(0.1, 25.0), (0.2, 30.0), (0.3, 29.0), (0.9, 30.5), (1.0, 40.0), (2.0, f64::INFINITY)]);
    let curve = curve.unwrap();
    assert_eq!(curve.points.len(), 4);
    let rates: Vec<f64> = (0..=150).map(|k| curve.bpp_at(25.0 + 0.1 * f64::from(k)).unwrap()).collect();
    assert!(rates.windows(2).all(|pair| pair[0] < pair[1]), "{rates:?}");
    assert!(RateCurve::new([(0.1, 25.0)]).is_none());
    assert!((ms_ssim_decibels(0.99) - 20.0).abs() < 1e-9);
}
