//! An image where no backward pass follows: drawn a few strips at a time, so that it is in memory once.

use fearless_simd::Level;
use gs_core::{Error, Image};
use rayon::prelude::*;

use crate::{
    lanes::LANES,
    layout::{Grid, Row},
    tiles::Tiles,
};

/// Strips of so many bytes are drawn before they are put into the image: enough for every thread, and nothing beside a large image.
const MOST_BYTES: usize = 32 << 20;

/// How many strips are drawn at once.
fn strips_at_once(grid: &Grid) -> usize {
    (MOST_BYTES / (grid.height * size_of::<Row>())).clamp(1, grid.strips())
}

impl Tiles {
    /// Stage `blend`, into an image.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn draw(&mut self, level: Level) -> Result<Image, Error> {
        let (grid, at_once) = (self.grid, strips_at_once(&self.grid));
        let (width, height) = grid.size();
        let mut image = Image::filled(width, height, [0.0; 3])?;
        for first in (0..grid.strips()).step_by(at_once) {
            let end = (first + at_once).min(grid.strips());
            self.blend_tiles(level, first * grid.bands()..end * grid.bands())?;
            let columns = first * LANES..(end * LANES).min(grid.width);
            let lines = image.pixels_mut().par_chunks_exact_mut(grid.width).enumerate();
            lines.for_each(|(y, line)| grid.put_line(&self.rows, y, &mut line[columns.clone()]));
        }
        Ok(image)
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{Blend, Canvas, Gaussian2d, Parameterization, Rasterizer, RenderSettings, Scene2d};
    use pollster::FutureExt as _;

    use super::*;
    use crate::{CpuRasterizer, CpuSettings};

    #[test]
    fn what_is_drawn_is_what_forward_shows_to_the_bit() {
        let rasterizer = CpuRasterizer::new(CpuSettings { threads: Some(2), level: None }).unwrap();
        let cpu = rasterizer.for_2d();
        // Strips of 3 MiB each, so that some are drawn after others; the last has 9 columns.
        let canvas = Canvas::new(249, 16_384);
        let at_once = strips_at_once(&Grid::new((249, 16_384), 64));
        assert!(at_once > 1 && at_once < 16, "{at_once} of 16 strips");
        let gaussian = |i: u32| Gaussian2d {
            mean: Vec2::new((i * 37 % 249) as f32 + 0.3, (i * 5003 % 16_384) as f32),
            log_scale: Vec2::new(3.0, 1.5),
            rotation: i as f32,
            opacity_logit: 1.0,
            color: Vec3::new(0.2, 0.4, 0.1) * (i % 7) as f32,
        };
        for blend in [Blend::Sum, Blend::Over] {
            let mut scene: Scene2d = (0..300).map(gaussian).collect();
            if blend == Blend::Sum {
                scene.opacity_logits.clear();
            }
            let settings = RenderSettings::blended(blend).on([0.5, 0.25, 0.125]);
            let splats = cpu.upload(&scene, Parameterization::default()).unwrap();
            let pass = cpu.forward(&splats, &canvas, &settings).block_on().unwrap();
            let expected = (cpu.image(&pass).block_on().unwrap(), cpu.culled(&pass));
            assert!(cpu.draw(&splats, &canvas, &settings).block_on().unwrap() == expected, "{blend:?}");
        }
    }
}
