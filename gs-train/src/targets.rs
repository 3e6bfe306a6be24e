//! Synthetic targets: what can be fitted without a file.

use gs_core::Image;

/// Side of the paper's target, px.
pub const PAPER_SIDE_PX: u32 = 128;

/// The paper's target (§3.1), 128×128 px: a red disc with a soft edge, and a blue square with a hard one, on white.
///
/// The disc, (0.9, 0.1, 0.1), is centred at (44, 48) and covers sigmoid((24 − r)/2) of a pixel at distance r; the square,
/// (0.1, 0.2, 0.9), fills 72 < x < 112, 68 < y < 108. Pixel centres lie at j + ½.
pub fn paper_target() -> Image {
    let color = |column: u32, row: u32| {
        let (x, y) = (column as f32 + 0.5, row as f32 + 0.5);
        if x > 72.0 && x < 112.0 && y > 68.0 && y < 108.0 {
            return [0.1, 0.2, 0.9];
        }
        let r = (x - 44.0).hypot(y - 48.0);
        let coverage = 1.0 / (1.0 + (-(24.0 - r) / 2.0).exp());
        [0.9, 0.1, 0.1].map(|disc| 1.0 + coverage * (disc - 1.0))
    };
    Image::from_fn(PAPER_SIDE_PX, PAPER_SIDE_PX, color).expect("128x128 px is a possible size")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disc_square_and_background_are_where_the_paper_has_them() {
        let target = paper_target();
        let near = |x, y, c: [f32; 3]| target.pixel(x, y).iter().zip(c).all(|(a, b)| (a - b).abs() < 2e-3);
        assert!(near(44, 48, [0.9, 0.1, 0.1]));
        assert!(near(127, 0, [1.0; 3]));
        assert_eq!(target.pixel(72, 68), [0.1, 0.2, 0.9]);
        assert_eq!(target.pixel(111, 107), [0.1, 0.2, 0.9]);
        assert!(target.pixel(71, 68)[0] > 0.2 && target.pixel(112, 107)[0] > 0.9);
        // Half covered on the circle itself: r = 24 at (44 + 24, 48), between two pixel centres.
        let edge = (target.pixel(67, 48)[1] + target.pixel(68, 48)[1]) / 2.0;
        assert!((edge - 0.55).abs() < 0.01, "{edge}");
    }
}
