//! Gaussians that no training view shows.

use glam::Vec2;
use gs_core::{Camera, RenderSettings, Scene, Scene3d, math::perspective::Perspective};

use super::evidence::ellipsoid;

/// The Gaussians that none of these cameras shows, by index; none if that would be all.
///
/// No image says anything about them, but another view may show them.
pub(super) fn unseen<'a>(
    scene: &Scene3d,
    cameras: impl IntoIterator<Item = &'a Camera>,
    render: &RenderSettings,
) -> Vec<u32> {
    let views: Vec<(Perspective, Vec2)> = (cameras.into_iter())
        .map(|camera| (Perspective::new(camera, render), Vec2::new(camera.width as f32, camera.height as f32)))
        .collect();
    let is_seen = |index: usize| {
        let g = ellipsoid(scene, index);
        views.iter().any(|(perspective, size)| {
            let Ok(seen) = perspective.project(&g) else { return false };
            // The box around the ellipse on which α falls to the cut.
            let sigmas2 = 2.0 * (seen.opacity / render.accuracy.alpha_cut).ln();
            if !(sigmas2 > 0.0) {
                return false;
            }
            let [xx, _, yy] = seen.covariance;
            let reach = Vec2::new((sigmas2 * xx).sqrt(), (sigmas2 * yy).sqrt());
            (seen.mean + reach).cmpgt(Vec2::ZERO).all() && (seen.mean - reach).cmplt(*size).all()
        })
    };
    let unseen: Vec<u32> = (0..scene.len()).filter(|&index| !is_seen(index)).map(|index| index as u32).collect();
    if unseen.len() == scene.len() { Vec::new() } else { unseen }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use gs_core::{Gaussian3d, logit};

    use super::*;

    /// Cameras at the origin that look along z: a Gaussian in the middle, one behind them, one
    /// next to the image whose ellipse reaches into it, one whose ellipse does not, and a
    /// transparent one.
    #[test]
    fn only_what_reaches_into_no_image_is_unseen() {
        let mut scene = Scene3d::default();
        let mut push = |mean: Vec3, scale: f32, opacity: f32| {
            scene.push(Gaussian3d {
                mean,
                log_scale: Vec3::splat(scale.ln()),
                rotation: [1.0, 0.0, 0.0, 0.0],
                opacity_logit: logit(opacity),
                sh: vec![Vec3::ZERO],
            });
        };
        push(Vec3::new(0.0, 0.0, 4.0), 0.1, 0.5);
        push(Vec3::new(0.0, 0.0, -4.0), 0.1, 0.5);
        push(Vec3::new(5.0, 0.0, 4.0), 0.5, 0.9);
        push(Vec3::new(5.0, 0.0, 4.0), 0.1, 0.9);
        push(Vec3::new(0.0, 0.0, 4.0), 0.1, 0.001);
        // 90 degrees wide: at z = 4 the image ends at x = 4.
        let camera = Camera::looking_forward(40, 40, std::f32::consts::FRAC_PI_2);
        let render = RenderSettings::default();
        assert_eq!(unseen(&scene, [&camera], &render), [1, 3, 4]);
        let hidden = Scene3d { means: vec![Vec3::new(0.0, 0.0, -4.0); 5], ..scene };
        assert!(unseen(&hidden, [&camera], &render).is_empty(), "a scene is never left without Gaussians");
    }
}
