//! Targets that are computed: images by name, for studies and experiments.

mod thin_lines;

use gs_core::Image;
use gs_train::{DiscAndSquare, Fill};

use self::thin_lines::thin_lines;

/// A target that needs no file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SyntheticTarget {
    name: &'static str,
    recipe: Recipe,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Recipe {
    DiscAndSquare(DiscAndSquare),
    DiscAndSquareInEightBits,
    ThinLines { side_px: u32 },
}

const PAPER: DiscAndSquare = DiscAndSquare::PAPER;

impl SyntheticTarget {
    /// The paper's target.
    pub(crate) const PAPER: Self = Self::varied("paper", PAPER);

    /// The paper's target rounded to 8 bits a channel, as an image file holds it: the disc's faint
    /// rim ends before the border.
    pub(crate) const PAPER_8_BIT: Self = Self { name: "paper-8bit", recipe: Recipe::DiscAndSquareInEightBits };

    /// Dark lines of one pixel, as large as the paper's target.
    pub(crate) const THIN_LINES: Self =
        Self { name: "thin-lines", recipe: Recipe::ThinLines { side_px: PAPER.side_px } };

    /// Dark lines of one pixel in a small image, for fits of a few Gaussians.
    pub(crate) const THIN_LINES_24_PX: Self =
        Self { name: "thin-lines-24px", recipe: Recipe::ThinLines { side_px: 24 } };

    /// All targets: the paper's, then variations of it, then others.
    pub(crate) const ALL: [Self; 13] = [
        Self::PAPER,
        Self::varied("paper-64px", DiscAndSquare { side_px: 64, ..PAPER }),
        Self::varied("paper-256px", DiscAndSquare { side_px: 256, ..PAPER }),
        Self::varied("paper-contrast-50", DiscAndSquare { contrast: 0.5, ..PAPER }),
        Self::varied("paper-contrast-25", DiscAndSquare { contrast: 0.25, ..PAPER }),
        Self::varied("paper-contrast-10", DiscAndSquare { contrast: 0.1, ..PAPER }),
        Self::varied("paper-soft-4px", DiscAndSquare { softness_px: 4.0, ..PAPER }),
        Self::striped("paper-stripes-20px", 20.0),
        Self::striped("paper-stripes-10px", 10.0),
        Self::striped("paper-stripes-5px", 5.0),
        Self::PAPER_8_BIT,
        Self::THIN_LINES,
        Self::THIN_LINES_24_PX,
    ];

    const fn varied(name: &'static str, varied: DiscAndSquare) -> Self {
        Self { name, recipe: Recipe::DiscAndSquare(varied) }
    }

    const fn striped(name: &'static str, period_px: f32) -> Self {
        Self::varied(name, DiscAndSquare { fill: Fill::Stripes { period_px }, ..PAPER })
    }

    /// The target of that name.
    pub(crate) fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|target| target.name == name)
    }

    /// The target's name, in kebab-case.
    pub(crate) const fn name(&self) -> &'static str {
        self.name
    }

    /// Whether the paper's disc and square stand where they do in the paper's target.
    pub(crate) fn has_the_papers_shapes(&self) -> bool {
        match self.recipe {
            Recipe::DiscAndSquare(varied) => varied.side_px == PAPER.side_px,
            Recipe::DiscAndSquareInEightBits => true,
            Recipe::ThinLines { .. } => false,
        }
    }

    /// The image.
    pub(crate) fn image(&self) -> Image {
        let image = match self.recipe {
            Recipe::DiscAndSquare(varied) => varied.image(),
            Recipe::DiscAndSquareInEightBits => PAPER.image().map(in_eight_bits),
            Recipe::ThinLines { side_px } => thin_lines(side_px),
        };
        image.expect("the sides listed are possible")
    }
}

/// Rounds every channel to 8 bits.
fn in_eight_bits(mut image: Image) -> Image {
    image.pixels_mut().as_flattened_mut().iter_mut().for_each(|v| *v = (*v * 255.0).round() / 255.0);
    image
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs_train::paper_target;

    #[test]
    fn targets_are_found_by_name() {
        assert!(SyntheticTarget::ALL.into_iter().all(|target| SyntheticTarget::named(target.name()) == Some(target)));
        assert_eq!(SyntheticTarget::named("papr"), None);
    }

    #[test]
    fn no_two_are_alike_and_each_is_what_its_name_says() {
        let images = SyntheticTarget::ALL.map(|target| target.image());
        for (i, image) in images.iter().enumerate() {
            assert!(!images[..i].contains(image), "{}", SyntheticTarget::ALL[i].name());
            let sides = [("64px", 64), ("256px", 256), ("24px", 24)];
            let side = sides.into_iter().find(|(end, _)| SyntheticTarget::ALL[i].name().ends_with(end));
            assert_eq!(image.width(), side.map_or(128, |(_, side)| side));
        }
        assert_eq!(images[0], paper_target());
        let rounded = SyntheticTarget::PAPER_8_BIT.image();
        let paper = paper_target();
        let mut off = rounded.pixels().as_flattened().iter().zip(paper.pixels().as_flattened());
        assert!(off.all(|(a, b)| (a - b).abs() <= 0.5 / 255.0 + 1e-6));
        assert_eq!(rounded.pixel(0, 0), [1.0; 3], "the rim does not reach the corner");
    }
}
