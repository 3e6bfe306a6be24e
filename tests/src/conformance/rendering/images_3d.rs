//! Cases of images and counts of culled Gaussians of 3D scenes, compared with the oracle's.

use glam::Vec3;
use gs_core::{
    Camera, Culled, Gaussian3d, Image, Optimizer, Parameterization, RenderSettings, Scene, Scene3d,
    effects::{Antialias, Blend, Order},
};
use pollster::FutureExt as _;

use crate::conformance::{
    check_image, is_refused,
    rendering::{BLENDS, other_accuracies},
};
use crate::{
    failure::Failure,
    oracle::Oracle,
    scenes::{Draw, Kind3d},
    subject::Subject,
};

/// Images match for every kind of scene, both blends, with and without background.
pub(crate) fn images_match_3d<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in BLENDS {
        for (seed, kind) in (2100..).zip(Kind3d::ALL) {
            let draw = Draw::for_3d(kind, blend, 40, (48, 37), seed);
            check_image(rasterizer, &draw)?;
            check_image(rasterizer, &draw.on([0.9, 0.2, 0.5]))?;
        }
    }
    Ok(())
}

/// Images match in the order of the scene and, unless the backend refuses it, with a sort at each
/// pixel.
pub(crate) fn orders_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for order in [Order::Index, Order::PerPixel] {
        for (seed, kind) in (2120..).zip(Kind3d::ALL) {
            let draw = Draw::for_3d(kind, Blend::Over, 40, (48, 37), seed).on([0.2, 0.5, 0.1]).in_order(order);
            if order == Order::Index || !is_refused(rasterizer, &draw)? {
                check_image(rasterizer, &draw)?;
            }
        }
    }
    Ok(())
}

/// Images match for every kind of scene with a dilated Σ′, with and without compensation.
pub(crate) fn antialiased_images_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for (antialias, blend) in [
        (Antialias::Dilate, Blend::Over),
        (Antialias::Mip, Blend::Over),
        (Antialias::Mip, Blend::Sum),
        (Antialias::Compensated, Blend::Over),
    ] {
        for (seed, kind) in (2140..).zip(Kind3d::ALL) {
            check_image(rasterizer, &Draw::for_3d(kind, blend, 40, (48, 37), seed).antialiased(antialias))?;
        }
    }
    Ok(())
}

/// Images match for scenes of SH degree 0 to 3 rendered with degree 0 to 3: the lower one applies.
pub(crate) fn sh_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for seed in 2160..2164 {
        for sh_degree in 0..=3 {
            let mut draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 25, (33, 24), seed);
            draw.settings.effects.sh_degree = sh_degree;
            check_image(rasterizer, &draw)?;
        }
    }
    Ok(())
}

/// Images match for sizes of one pixel, of one column, and on either side of a tile's edge.
pub(crate) fn sizes_match_3d<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    let sizes = [(1, 1), (1, 17), (17, 1), (15, 15), (16, 16), (17, 17), (129, 3), (3, 129), (64, 32), (31, 33)];
    for blend in BLENDS {
        for (seed, size) in (2200..).zip(sizes) {
            let draw = |kind, count| Draw::for_3d(kind, blend, count, size, seed).on([0.1, 0.2, 0.3]);
            check_image(rasterizer, &draw(Kind3d::Overlapping, 12))?;
            check_image(rasterizer, &draw(Kind3d::Large, 1))?;
        }
    }
    Ok(())
}

/// Images match with other cuts, clamps and minimum transmittances.
pub(crate) fn accuracies_match_3d<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in BLENDS {
        for (seed, accuracy) in (2240..).zip(other_accuracies()) {
            for kind in [Kind3d::Typical, Kind3d::Opaque] {
                let mut draw = Draw::for_3d(kind, blend, 30, (40, 30), seed);
                draw.settings.accuracy = accuracy;
                check_image(rasterizer, &draw).map_err(|failure| failure.at(format!("{accuracy:?}")))?;
            }
        }
    }
    Ok(())
}

/// A view without Gaussians shows the background only.
pub(crate) fn empty_space_shows_the_background<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    let mut away = Draw::for_3d(Kind3d::Typical, Blend::Over, 9, (19, 18), 2260);
    // A camera that looks backwards: x and z change their signs.
    away.view.rotation = glam::Mat3::from_diagonal(Vec3::new(-1.0, 1.0, -1.0)) * away.view.rotation;
    away.view.translation *= Vec3::new(-1.0, 1.0, -1.0);
    for scene in [Scene3d::default(), away.scene.clone()] {
        for blend in BLENDS {
            let mut settings = away.settings;
            settings.effects.blend = blend;
            for (settings, color) in [(settings, [0.0; 3]), (settings.on([0.25, 2.0, -1.0]), [0.25, 2.0, -1.0])] {
                let image = rasterizer.render(&scene, &away.view, &settings).block_on()?;
                let count = scene.len();
                Failure::unless(image == Image::filled(19, 18, color)?, || {
                    format!("{count} Gaussians behind the camera leave an image that is not all {color:?}")
                })?;
            }
        }
    }
    Ok(())
}

/// Culled Gaussians are counted by cause, and do not change the image.
pub(crate) fn causes_are_counted<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    let view = Camera { near: 0.5, ..Camera::looking_forward(24, 18, 1.2) };
    let good = Gaussian3d {
        mean: Vec3::new(0.1, -0.2, 3.0),
        log_scale: Vec3::new(-1.5, -2.0, -1.0),
        rotation: [0.9, 0.1, -0.3, 0.2],
        opacity_logit: 0.5,
        sh: vec![Vec3::new(0.2, 0.6, 0.9)],
    };
    let at = |mean| Gaussian3d { mean, ..good.clone() };
    let left_out = [
        at(Vec3::new(0.1, -0.2, -3.0)),
        at(Vec3::new(0.0, 0.0, 0.0)),
        at(Vec3::new(0.1, -0.2, 0.499)),
        Gaussian3d { log_scale: Vec3::splat(-9.0), ..good.clone() },
        Gaussian3d { log_scale: Vec3::new(-12.0, -12.0, -1.0), rotation: [1.0, 0.0, 0.0, 0.0], ..good.clone() },
        Gaussian3d { rotation: [1e-4, 0.0, 0.0, 0.0], ..good.clone() },
        at(Vec3::new(40.0, 0.0, 3.0)),
        at(Vec3::new(0.0, -9.0, 2.0)),
        Gaussian3d { log_scale: Vec3::splat(60.0), ..good.clone() },
    ];
    let transparent = [-8.0, f32::NEG_INFINITY].map(|opacity_logit| Gaussian3d { opacity_logit, ..good.clone() });
    let expected = Culled { not_finite: 1, near: 3, degenerate: 3, transparent: 0, outside: 2 };
    for (blend, transparent, expected) in [
        (Blend::Sum, &transparent[..0], expected),
        (Blend::Over, &transparent[..], Culled { transparent: 2, ..expected }),
    ] {
        let mut settings = RenderSettings::blended(blend);
        settings.effects.order = Order::Global;
        let scene = scene_of(left_out.iter().chain(transparent).chain([&good]));
        let oracle = Oracle::new(view, settings)?.render(&scene.rows());
        Failure::unless(oracle.culled == expected, || format!("the oracle counts {:?}", oracle.culled))?;
        let splats = rasterizer.upload(&scene, Parameterization::ScaleRotation)?;
        let pass = rasterizer.forward(&splats, &view, &settings).block_on()?;
        let found = rasterizer.culled(&pass);
        Failure::unless(found == expected, || format!("{blend:?}: expected {expected:?}, found {found:?}"))?;
        let alone = rasterizer.render(&scene_of([&good]), &view, &settings).block_on()?;
        let image = rasterizer.image(&pass).block_on()?;
        Failure::unless(image == alone, || format!("{blend:?}: Gaussians that are left out change the image"))?;
    }
    // Exactly at the near plane, z = near is drawn.
    let scene = scene_of([&at(Vec3::new(0.0, 0.0, 0.5))]);
    let found = culled(rasterizer, &scene, &view, &RenderSettings::default())?;
    Failure::unless(found == Culled::default(), || format!("at the near plane: {found:?}"))?;

    let mut compared = 0;
    for (seed, kind) in (2270..).zip(Kind3d::ALL.into_iter().cycle().take(36)) {
        let draw = Draw::for_3d(kind, Blend::Over, 8, (32, 24), seed);
        let oracle = Oracle::new(draw.view, draw.settings)?.render(&draw.scene.rows());
        if (0..32 * 24).any(|p| oracle.flip[p].iter().any(|&v| v > 0.0)) {
            continue; // A Gaussian that is all but outside or transparent may be so.
        }
        compared += 1;
        let found = culled(rasterizer, &draw.scene, &draw.view, &draw.settings)?;
        // A backend may list a Gaussian that touches no pixel centre.
        let expected = Culled { outside: found.outside, ..oracle.culled };
        let right = found == expected && found.outside <= oracle.culled.outside;
        Failure::unless(right, || format!("{kind:?}: expected {:?}, found {found:?}", oracle.culled))?;
    }
    if compared < 12 {
        return Err(Failure::Nothing(format!("only {compared} drawn scenes are clear enough to count in")));
    }
    Ok(())
}

pub(crate) fn culled<R: Optimizer<Scene3d>>(
    rasterizer: &R,
    scene: &Scene3d,
    view: &Camera,
    settings: &RenderSettings,
) -> Result<Culled, Failure> {
    let splats = rasterizer.upload(scene, Parameterization::ScaleRotation)?;
    Ok(rasterizer.culled(&rasterizer.forward(&splats, view, settings).block_on()?))
}

fn scene_of<'g>(gaussians: impl IntoIterator<Item = &'g Gaussian3d>) -> Scene3d {
    let mut scene = Scene3d::default();
    gaussians.into_iter().for_each(|g| scene.push(g.clone()));
    scene
}
