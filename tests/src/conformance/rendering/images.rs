//! Cases of images and counts of culled Gaussians, compared with the oracle's.

use glam::{Vec2, Vec3};
use gs_core::{
    Accuracy, Canvas, Culled, Gaussian2d, Image, Optimizer, Parameterization, RenderSettings, Scene2d,
    effects::{Antialias, Blend},
};
use pollster::FutureExt as _;

use crate::conformance::check_image;
use crate::{
    failure::Failure,
    scenes::{Draw, Kind2d},
};

pub(crate) const BLENDS: [Blend; 2] = [Blend::Sum, Blend::Over];

/// Images match for every kind of scene, both blends, with and without background.
pub(crate) fn images_match<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in BLENDS {
        for (seed, kind) in (100..).zip(Kind2d::ALL) {
            let draw = Draw::new(kind, blend, 40, (48, 37), seed);
            check_image(rasterizer, &draw)?;
            check_image(rasterizer, &draw.on([0.9, 0.2, 0.5]))?;
        }
    }
    Ok(())
}

/// Images match with dilated Gaussians, with and without compensation, also through scaled
/// canvases.
pub(crate) fn antialiased_images_match_2d<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for antialias in [Antialias::Dilate, Antialias::Mip, Antialias::Compensated] {
        for blend in BLENDS {
            for (seed, kind) in (2900..).zip(Kind2d::ALL) {
                let draw = Draw::new(kind, blend, 30, (48, 37), seed).antialiased(antialias);
                check_image(rasterizer, &draw)?;
                check_image(rasterizer, &draw.through(Canvas::new(48, 37).resized(24, 11)))?;
            }
        }
    }
    Ok(())
}

/// Images match for sizes of one pixel, of one column, and on either side of a tile's edge.
pub(crate) fn sizes_match<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let sizes = [(1, 1), (1, 17), (17, 1), (15, 15), (16, 16), (17, 17), (257, 3), (3, 257), (64, 32), (31, 33)];
    for blend in BLENDS {
        for (seed, size) in (200..).zip(sizes) {
            check_image(rasterizer, &Draw::new(Kind2d::Overlapping, blend, 12, size, seed).on([0.1, 0.2, 0.3]))?;
            check_image(rasterizer, &Draw::new(Kind2d::Typical, blend, 30, size, seed))?;
        }
    }
    Ok(())
}

/// Images match through canvases that enlarge, shrink, stretch, and show a part of the plane.
pub(crate) fn canvases_match<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let own = Canvas::new(40, 30);
    let views = [
        own.resized(97, 71),
        own.resized(20, 15),
        own.resized(61, 17),
        own.showing(Vec2::new(10.0, 5.0), Vec2::new(20.0, 15.0)),
        own.showing(Vec2::new(-20.5, -8.25), Vec2::new(80.0, 60.0)),
        own.showing(Vec2::new(31.0, 22.0), Vec2::new(33.3, 9.1)),
    ];
    for blend in BLENDS {
        for (seed, view) in (300..).zip(views) {
            let draw = Draw::new(Kind2d::Typical, blend, 30, (40, 30), seed);
            check_image(rasterizer, &draw.on([0.4, 0.1, 0.7]).through(view))?;
        }
    }
    Ok(())
}

/// Other cuts, clamps and minimum transmittances than the defaults.
pub(crate) fn other_accuracies() -> [Accuracy; 6] {
    let usual = Accuracy::default();
    [
        usual.with(|s| s.alpha_cut = 1e-6),
        usual.with(|s| s.alpha_cut = 0.2),
        usual.with(|s| s.alpha_max = 0.6),
        usual.with(|s| s.transmittance_min = 0.0),
        usual.with(|s| s.transmittance_min = 0.3),
        usual.with(|s| s.alpha_max = 1e-6),
    ]
}

/// Images match with other cuts, clamps and minimum transmittances.
pub(crate) fn other_accuracies_match<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in BLENDS {
        for (seed, accuracy) in (400..).zip(other_accuracies()) {
            for kind in [Kind2d::Typical, Kind2d::Opaque] {
                let mut draw = Draw::new(kind, blend, 30, (40, 30), seed);
                draw.settings.accuracy = accuracy;
                check_image(rasterizer, &draw).map_err(|failure| failure.at(format!("{accuracy:?}")))?;
            }
        }
    }
    Ok(())
}

/// An empty scene shows the background only.
pub(crate) fn empty_scenes_show_the_background<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in BLENDS {
        let settings = RenderSettings::blended(blend);
        for (settings, color) in [(settings, [0.0; 3]), (settings.on([0.25, 2.0, -1.0]), [0.25, 2.0, -1.0])] {
            let image = rasterizer.render(&Scene2d::default(), &Canvas::new(19, 18), &settings).block_on()?;
            Failure::unless(image == Image::filled(19, 18, color)?, || format!("an empty scene is not all {color:?}"))?;
        }
    }
    Ok(())
}

/// Culled Gaussians are counted by cause, and do not change the image.
pub(crate) fn culled_are_counted<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let good = Gaussian2d {
        mean: Vec2::new(12.0, 9.0),
        log_scale: Vec2::new(0.8, 0.3),
        rotation: 0.4,
        opacity_logit: 0.5,
        color: Vec3::new(0.2, 0.6, 0.9),
    };
    let left_out = [
        Gaussian2d { log_scale: Vec2::splat(-5.0), ..good },
        Gaussian2d { log_scale: Vec2::new(0.5, -9.0), ..good },
        Gaussian2d { mean: Vec2::new(4000.0, 9.0), ..good },
        Gaussian2d { mean: Vec2::new(12.0, -700.0), ..good },
        Gaussian2d { mean: Vec2::new(-60.0, -60.0), ..good },
        Gaussian2d { log_scale: Vec2::splat(70.0), ..good },
    ];
    let transparent = [-8.0, f32::NEG_INFINITY].map(|opacity_logit| Gaussian2d { opacity_logit, ..good });
    let expected = Culled { not_finite: 1, degenerate: 2, outside: 3, ..Culled::default() };
    let view = Canvas::new(24, 18);
    for (blend, transparent, expected) in [
        (Blend::Sum, &transparent[..0], expected),
        (Blend::Over, &transparent[..], Culled { transparent: 2, ..expected }),
    ] {
        let settings = RenderSettings::blended(blend);
        let scene: Scene2d = left_out.iter().chain(transparent).chain([&good]).copied().collect();
        let splats = rasterizer.upload(&scene, Parameterization::ScaleRotation)?;
        let pass = rasterizer.forward(&splats, &view, &settings).block_on()?;
        let found = rasterizer.culled(&pass);
        Failure::unless(found == expected, || format!("{blend:?}: expected {expected:?}, found {found:?}"))?;
        let alone = rasterizer.render(&[good].into_iter().collect(), &view, &settings).block_on()?;
        let image = rasterizer.image(&pass).block_on()?;
        Failure::unless(image == alone, || format!("{blend:?}: Gaussians that are left out change the image"))?;
    }
    Ok(())
}
