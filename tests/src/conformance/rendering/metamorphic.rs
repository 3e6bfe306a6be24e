//! Cases of changes to a scene or a view that must not change the image.

use glam::{Vec2, Vec3};
use gs_core::{Canvas, Gaussian2d, Image, Optimizer, Scene2d, effects::Blend, logit};
use pollster::FutureExt as _;

use crate::{
    failure::Failure,
    oracle::{Oracle, Rendering},
    scenes::{Draw, Kind2d},
    subject::Subject,
    tolerance::compare_images,
};

/// The oracle's error analysis with another image: two images of a backend are both uncertain.
pub(crate) fn around(image: &Image, analysis: &Rendering) -> Rendering {
    Rendering {
        pixels: image.pixels().iter().map(|p| p.map(f64::from)).collect(),
        rounding: analysis.rounding.iter().map(|p| p.map(|v| 2.0 * v)).collect(),
        ..analysis.clone()
    }
}

pub(crate) fn analysis<S: Subject>(draw: &Draw<S>) -> Result<Rendering, Failure> {
    Ok(Oracle::new(draw.view, draw.settings)?.render(&draw.scene.rows()))
}

/// Under `Sum`, the order of the Gaussians does not change the image.
pub(crate) fn order_does_not_matter_under_sum<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    let (size, count) = ((40, 30), 50);
    for draw in [S::typical(Blend::Sum, count, size, 800), S::overlapping(Blend::Sum, count, size, 801)] {
        let image = rasterizer.render(&draw.scene, &draw.view, &draw.settings).block_on()?;
        let again = rasterizer.render(&permuted(&draw.scene), &draw.view, &draw.settings).block_on()?;
        compare_images(&around(&image, &analysis(&draw)?), &again).map_err(|failure| failure.at("permuted"))?;
    }
    Ok(())
}

/// Returns these Gaussians at other indices. 17 and 50 are coprime, so each appears once.
pub(crate) fn permuted<S: Subject>(scene: &S) -> S {
    scene.picked((0..50).map(|i| (i * 17 + 1) % 50))
}

/// Two halves of a Gaussian make the same image as the whole: each has half its colour (`Sum`) or
/// opacity 1 − √(1 − o) (`Over`).
///
/// Under `Over` this holds only where the weight is 1, so the Gaussian is far larger than the
/// image.
pub(crate) fn halves_make_the_whole<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        let mut draw = Draw::new(Kind2d::Typical, blend, 20, (40, 30), 850);
        let opacity = 0.75;
        let whole = Gaussian2d {
            mean: Vec2::new(20.0, 15.0),
            log_scale: if blend == Blend::Sum { Vec2::new(1.5, 0.7) } else { Vec2::splat(1e6f32.ln()) },
            rotation: 0.6,
            opacity_logit: if blend == Blend::Sum { f32::INFINITY } else { logit(opacity) },
            color: Vec3::new(0.8, 0.4, 0.6),
        };
        let half = match blend {
            Blend::Sum => Gaussian2d { color: whole.color * 0.5, ..whole },
            Blend::Over => Gaussian2d { opacity_logit: logit(1.0 - (1.0 - opacity).sqrt()), ..whole },
        };
        let with = |parts: &[Gaussian2d]| -> Scene2d {
            let (front, back) = (draw.scene.iter().take(10), draw.scene.iter().skip(10));
            front.chain(parts.iter().copied()).chain(back).collect()
        };
        let (one, two) = (with(&[whole]), with(&[half, half]));
        let image = rasterizer.render(&one, &draw.view, &draw.settings).block_on()?;
        let again = rasterizer.render(&two, &draw.view, &draw.settings).block_on()?;
        draw.scene = one;
        compare_images(&around(&image, &analysis(&draw)?), &again)
            .map_err(|failure| failure.at(format!("halved under {blend:?}")))?;
    }
    Ok(())
}

/// A canvas of a part of the plane shows that part of the whole image.
pub(crate) fn crops_are_parts_of_the_image<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        for (seed, kind) in (900..).zip([Kind2d::Typical, Kind2d::Opaque, Kind2d::Large]) {
            let draw = Draw::new(kind, blend, 40, (60, 45), seed).on([0.2, 0.3, 0.4]);
            let image = rasterizer.render(&draw.scene, &draw.view, &draw.settings).block_on()?;
            for (x, y, width, height) in [(0, 0, 16, 16), (7, 5, 33, 21), (59, 44, 1, 1), (13, 31, 47, 9)] {
                let view = Canvas::new(width, height)
                    .showing(Vec2::new(x as f32, y as f32), Vec2::new(width as f32, height as f32));
                let part = Image::from_fn(width, height, |i, j| image.pixel(x + i, y + j))?;
                let draw = draw.clone().through(view);
                let crop = rasterizer.render(&draw.scene, &view, &draw.settings).block_on()?;
                let analysis = analysis(&draw)?;
                if analysis.drawn.contains(&true) {
                    compare_images(&around(&part, &analysis), &crop)
                        .map_err(|failure| failure.at(format!("{kind:?}, {blend:?}, crop at ({x}, {y})")))?;
                }
            }
        }
    }
    Ok(())
}
