//! Pictures of scenes as their files say, on any backend.

use gs_core::{
    Camera, Canvas, Culled, Error, Image, Parameterization, Rasterizer, RenderSettings, Scene2d, Scene3d,
    effects::Background,
};

use crate::{
    image::{StoredImage, straight},
    scene2d::File2d,
    scene3d::File3d,
};

impl File3d {
    /// Renders the scene as its training rendered it: [`Self::render_settings`] before black.
    ///
    /// `camera` is in the axes and the unit of the file;
    /// [`Bulk::overview`](gs_core::view::Bulk::overview) finds one. The image is not clamped.
    ///
    /// # Errors
    /// Those of the backend.
    pub async fn render<R: Rasterizer<Scene3d>>(&self, on: &R, camera: &Camera) -> Result<Image, Error> {
        on.render(&self.scene, camera, &self.render_settings(None)).await
    }

    /// Renders the scene as [`Self::render`] does, but with alpha in place of the background; see
    /// [`draw_with_alpha`].
    ///
    /// # Errors
    /// Those of the backend.
    pub async fn render_with_alpha<R: Rasterizer<Scene3d>>(
        &self,
        on: &R,
        camera: &Camera,
    ) -> Result<StoredImage, Error> {
        let splats = on.upload(&self.scene, Parameterization::ScaleRotation)?;
        Ok(draw_with_alpha(on, &splats, camera, &self.render_settings(None)).await?.0)
    }
}

impl File2d {
    /// Renders the scene at the size of its image. Colours are in the file's colour space
    /// ([`Self::in_srgb`]), and not clamped.
    ///
    /// # Errors
    /// Those of the backend.
    pub async fn render<R: Rasterizer<Scene2d>>(&self, on: &R) -> Result<Image, Error> {
        on.render(&self.scene, &Canvas::new(self.width, self.height), &self.settings).await
    }
}

/// Draws splats of a 3D scene with alpha in place of a background, and returns the numbers of
/// Gaussians left out, too.
///
/// Alpha is 1 − T, where T is the transmittance of the scene ([`Output::Alpha`]), in 8 bits; colours
/// are straight, as [`write_png_with`](crate::write_png_with) writes them. Composited over a colour,
/// the image is that of [`Rasterizer::draw`] before that colour, up to the rounding of alpha. Straight
/// colours above 1 are cut off in a PNG.
///
/// [`Output::Alpha`]: gs_core::Output::Alpha
///
/// # Errors
/// Those of the backend.
pub async fn draw_with_alpha<R: Rasterizer<Scene3d>>(
    on: &R,
    splats: &R::Splats,
    camera: &Camera,
    settings: &RenderSettings,
) -> Result<(StoredImage, Culled), Error> {
    let colors = settings.with(|s| s.effects.background = Background::None);
    let (premultiplied, culled) = on.draw(splats, camera, &colors).await?;
    let (alpha, _) = on.draw(splats, camera, &settings.of_alpha()).await?;
    let (image, alpha) = straight(premultiplied, &alpha)?;
    Ok((StoredImage { image, alpha: Some(alpha), profile: None, remarks: Vec::new() }, culled))
}

#[cfg(test)]
mod tests {
    use gs_core::{
        Blend, Gaussian3d,
        effects::{Antialias, Order},
        metrics,
        view::Bulk,
    };
    use gs_cpu::{CpuRasterizer, CpuSettings};
    use pollster::FutureExt as _;

    use super::*;
    use crate::{TrainedWith, WriteOptions3d, read_3d, write_3d};

    /// Small Gaussians with colours of SH degree 1, the later ones in front.
    fn scene() -> Scene3d {
        let gaussian = |i: usize| {
            let at = |k: usize| ((i * 31 + k * 17 + 7) % 29) as f32 / 14.5 - 1.0;
            Gaussian3d {
                mean: [at(0), at(1), 3.0 - 0.05 * i as f32].into(),
                log_scale: [-1.5 + at(2), -1.5 + at(3), -1.5].into(),
                rotation: [1.0, at(4), 0.3, 0.1],
                opacity_logit: 2.0 * at(5),
                sh: (0..4).map(|k| [at(k), at(k + 3), at(k + 6)].into()).collect(),
            }
        };
        (0..40).map(gaussian).collect()
    }

    fn written(trained_with: TrainedWith) -> (File3d, Camera, CpuRasterizer) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.ply");
        write_3d(&path, &scene(), &WriteOptions3d::default().with(|s| s.trained_with = trained_with)).unwrap();
        let file = read_3d(&path).unwrap();
        let camera = Bulk::of(&file.scene).unwrap().overview(48, 36, 1.0, [0.0, -1.0, 0.0].into()).unwrap();
        (file, camera, CpuRasterizer::new(CpuSettings::default()).unwrap())
    }

    #[test]
    fn a_file_is_rendered_as_its_training_rendered_it() {
        let trained = TrainedWith::default().with(|s| {
            s.antialias = Some(Antialias::Mip);
            s.order = Some(Order::Global);
        });
        let (file, camera, cpu) = written(trained);
        let found = file.render(&cpu, &camera).block_on().unwrap();
        let mut settings = RenderSettings::blended(Blend::Over).on([0.0; 3]);
        (settings.effects.sh_degree, settings.effects.order, settings.effects.antialias) =
            (1, Order::Global, Antialias::Mip);
        assert_eq!(found, cpu.render(&scene(), &camera, &settings).block_on().unwrap());
        let other = cpu.render(&scene(), &camera, &RenderSettings::default()).block_on().unwrap();
        assert!(metrics::psnr(&found, &other).unwrap() < 35.0, "the settings make no difference");
    }

    #[test]
    fn alpha_and_straight_colours_make_the_picture_before_any_background() {
        let (file, camera, cpu) = written(TrainedWith::default());
        let transparent = file.render_with_alpha(&cpu, &camera).block_on().unwrap();
        let alpha = transparent.alpha.clone().unwrap();
        assert!(alpha.contains(&0.0) && alpha.iter().any(|&alpha| alpha > 0.8), "{alpha:?}");
        for background in [[0.0; 3], [1.0; 3], [0.2, 0.9, 0.5]] {
            let settings = file.render_settings(None).on(background);
            let expected = cpu.render(&file.scene, &camera, &settings).block_on().unwrap().clamped();
            let found = transparent.clone().on(background).unwrap().image.clamped();
            let off = found.pixels().as_flattened().iter().zip(expected.pixels().as_flattened());
            let off = off.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 1.0 / 255.0, "{background:?}: {off}");
        }
    }

    #[test]
    fn a_2d_file_is_rendered_at_the_size_of_its_image() {
        let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
        let settings = RenderSettings::default().on([0.25, 0.5, 0.75]);
        let file = File2d { width: 7, height: 5, settings, ..File2d::default() };
        assert_eq!(file.render(&cpu).block_on(), Image::filled(7, 5, [0.25, 0.5, 0.75]));
    }
}
