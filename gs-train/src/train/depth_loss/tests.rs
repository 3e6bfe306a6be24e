use std::sync::Arc;

use gs_core::{Gaussian3d, Parameterization, Rasterizer as _, Scene};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_io::dataset::{DepthMap, PosedImage};
use pollster::FutureExt as _;

use super::*;
use crate::views::{ImageSource, geometry::tests::looking_at};

/// An image with a depth map.
struct Mapped {
    image: Image,
    map: Option<DepthMap>,
}

impl ImageSource for Mapped {
    fn read(&self) -> Result<PosedImage, gs_io::Error> {
        Ok(PosedImage { image: self.image.clone(), alpha: None, mask: None })
    }

    fn depth(&self) -> Result<Option<DepthMap>, gs_io::Error> {
        Ok(self.map.clone())
    }
}

const SIDE: u32 = 60;

/// Depth of the plane z = 0 at a pixel of a camera.
fn depth_of_plane(camera: &Camera, x: u32, y: u32) -> f32 {
    let at = glam::Vec2::new(x as f32, y as f32) + 0.5;
    let ray = camera.rotation.transpose() * ((at - camera.center) / camera.focal).extend(1.0);
    -camera.position().z / ray.z
}

/// Views of the plane z = 0, the first without a depth map. `value` computes the value of a map at a
/// pixel from the number of the view, the pixel's index and the depth there.
fn views(unit: Option<f32>, value: impl Fn(usize, usize, f32) -> f32) -> Vec<PosedView> {
    let view = |number: usize| {
        let angle = 1.3 * number as f32;
        let camera = looking_at(Vec3::new(2.0 * angle.cos(), 2.0 * angle.sin(), 3.0), Vec3::ZERO, SIDE);
        let at = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
        let values = at.enumerate().map(|(i, (x, y))| value(number, i, depth_of_plane(&camera, x, y))).collect();
        let map = (number > 0).then_some(DepthMap { camera, values, unit });
        let image = Image::filled(SIDE, SIDE, [0.5; 3]).unwrap();
        PosedView { name: format!("{number}"), camera, source: Arc::new(Mapped { image, map }) }
    };
    (0..4).map(view).collect()
}

/// Positions on the plane.
fn known() -> Vec<Vec3> {
    (-12..12).flat_map(|y| (-12..12).map(move |x| 0.15 * Vec3::new(x as f32, y as f32, 0.0))).collect()
}

fn scale_and_shift(number: usize) -> (f32, f32) {
    (0.5 + number as f32, 0.3 * number as f32 - 0.4)
}

/// Checks that the fits of these guides give the depths of the plane in views 1 to 3.
fn check_fits(guides: &Guides, views: &[PosedView]) {
    assert_eq!(guides.of_views.iter().map(|guide| guide.view).collect::<Vec<_>>(), [1, 2, 3]);
    for guide in &guides.of_views {
        let view = &views[guide.view];
        let map = view.source.depth().unwrap().unwrap();
        for (x, y) in [(5, 7), (30, 30), (50, 12)] {
            let found = guide.fit.unwrap().known_depth(map.values[(y * SIDE + x) as usize]).unwrap();
            let expected = depth_of_plane(&view.camera, x, y);
            assert!((found / expected).ln().abs() < 0.02, "view {}: {found} instead of {expected}", guide.view);
        }
    }
}

#[test]
fn maps_are_fitted_to_the_first_gaussians_or_used_as_they_are() {
    let shifted = views(None, |number, _, depth| {
        let (scale, shift) = scale_and_shift(number);
        scale / depth + shift + 1.0
    });
    let fitted = Guides::of(&shifted, &known()).unwrap();
    check_fits(&fitted, &shifted);
    assert!(fitted.of_views.iter().all(|guide| guide.fixed));
    let millimetres = views(Some(1e-3), |_, _, depth| 1e3 * depth);
    check_fits(&Guides::of(&millimetres, &[]).unwrap(), &millimetres);
    let loose = Guides::of(&shifted, &[]).unwrap();
    assert!(loose.of_views.iter().all(|guide| !guide.fixed && guide.fit.is_none()));
    let noise = views(None, |number, i, _| 1.0 + ((i * 7919 + number * 31) % 97) as f32);
    assert!(Guides::of(&noise, &known()).unwrap().of_views.iter().all(|guide| guide.fit.is_none()));
}

#[test]
fn maps_that_fit_no_point_are_fitted_to_renderings() {
    let cpu = CpuRasterizer::new(CpuSettings::default().with(|s| s.threads = Some(1))).unwrap();
    let mut scene = Scene3d::default();
    for y in -40..40 {
        for x in -40..40 {
            scene.push(Gaussian3d {
                mean: 0.1 * Vec3::new(x as f32, y as f32, 0.0),
                log_scale: Vec3::new(0.08f32.ln(), 0.08f32.ln(), 1e-3f32.ln()),
                rotation: [1.0, 0.0, 0.0, 0.0],
                opacity_logit: 3.0,
                sh: vec![Vec3::ZERO],
            });
        }
    }
    let views = views(None, |number, _, depth| {
        let (scale, shift) = scale_and_shift(number);
        scale / depth + shift + 1.0
    });
    let splats = cpu.upload(&scene, Parameterization::ScaleRotation).unwrap();
    let mut maps = DepthMaps::new(Guides::of(&views, &[]).unwrap(), u64::MAX);
    assert_eq!(maps.counts(), Some(DepthMapCounts { maps: 3, used: 0 }));
    assert!(maps.is_due(20, 100) && !maps.is_due(21, 100));
    let mut render = RenderSettings::default();
    render.effects.order = gs_core::effects::Order::Global;
    maps.fit_to_renderings((&cpu, &splats), &views, &render).block_on().unwrap();
    assert_eq!(maps.counts(), Some(DepthMapCounts { maps: 3, used: 3 }));
    check_fits(&maps.guides, &views);
}

#[test]
fn fits_come_back_from_a_checkpoint_and_damaged_ones_are_refused() {
    let views = views(None, |number, _, depth| depth * (1.0 + number as f32) / 3.0);
    let mut guides = Guides::of(&views, &known()).unwrap();
    guides.of_views[1] = Guide { view: 2, fixed: false, fit: None };
    let (key, text) = DepthMaps::<()>::new(guides.clone(), 0).to_metadata().unwrap().unwrap();
    let of = |text: &str, views| Guides::from_metadata(&BTreeMap::from([(key.to_owned(), text.to_owned())]), views);
    assert_eq!(of(&text, 4).unwrap(), guides);
    for (text, views) in [
        (text.as_str(), 3),
        (&text.replace("view = 2", "view = 1"), 4),
        (&text.replace("shift = ", "shift = nan #"), 4),
        (&text.replace("fixed", "fixated"), 4),
    ] {
        assert!(matches!(of(text, views), Err(Error::Checkpoint(_))), "{text}");
    }
    assert_eq!(DepthMaps::<()>::new(Guides::default(), 0).to_metadata().unwrap(), None);
    assert_eq!(Guides::from_metadata(&BTreeMap::new(), 4).unwrap(), Guides::default());
}

#[test]
fn weights_fall_exponentially_and_impossible_ones_are_refused() {
    let loss = DepthLoss { weight: 0.5, decay: 0.01 };
    loss.validate().unwrap();
    for (progress, expected) in [(0.0, 0.5), (0.5, 0.05), (1.0, 0.005)] {
        assert!((loss.at(progress) / expected - 1.0).abs() < 1e-5, "{}", loss.at(progress));
    }
    DepthLoss::default().validate().unwrap();
    for (weight, decay) in [(-1.0, 0.1), (f32::NAN, 0.1), (1.0, 0.0), (1.0, 1.5)] {
        assert!(DepthLoss { weight, decay }.validate().is_err());
    }
}
