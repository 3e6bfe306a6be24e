//! A flight over a city, and its photographs.

use std::{error::Error, f32::consts::TAU, fs, path::Path};

use glam::{UVec2, Vec3, vec3};
use gs_core::{Camera, Image, Rasterizer, Scene3d};
use gs_density::Rng;
use image::codecs::jpeg::JpegEncoder;
use pollster::FutureExt as _;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};

use super::{
    City,
    lens::RadialLens,
    model::{write_cameras, write_images, write_points},
};

/// Height of the flight above the ground, m.
const ALTITUDE_M: f32 = 75.0;

/// Horizontal field of view, rad: that of a lens of 24 mm on full frame.
const FOV_X: f32 = 1.27;

/// Standard deviations: of ln(exposure), of ln(white balance), of a channel's noise.
const EXPOSURE: f32 = 0.08;
const WHITE_BALANCE: f32 = 0.02;
const NOISE: f32 = 0.008;

/// Standard deviation of points, m.
const POINT_NOISE_M: f32 = 0.05;

/// Quality of the photographs' JPEG files.
const JPEG_QUALITY: u8 = 92;

/// Photographs of a [`City`] from a drone, as a COLMAP data set: five cameras in turn, straight down
/// and obliquely to the four sides. They have one slightly distorted lens, noise, and exposures
/// and white balances of their own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Capture {
    /// The city.
    pub(crate) city: City,
    /// Number of photographs, at least 1.
    pub(crate) views: u32,
    /// Columns of a photograph, px; rows are ¾ of it.
    pub(crate) width: u32,
    /// Number of points, about.
    pub(crate) points: usize,
}

impl Capture {
    /// Renders all photographs and writes the data set into `folder`: `images/` and `sparse/0/`. The
    /// model is written last, so that a folder which has one is complete. `written` hears of each
    /// photograph.
    ///
    /// # Errors
    /// Those of the backend and of writing files.
    pub(crate) fn write<R: Rasterizer<Scene3d>>(
        &self,
        on: &R,
        folder: &Path,
        mut written: impl FnMut(u32),
    ) -> Result<(), Box<dyn Error>> {
        let (images, model) = (folder.join("images"), folder.join("sparse/0"));
        for folder in [&images, &model] {
            fs::create_dir_all(folder)?;
        }
        let mut scene = self.city.scene();
        let lens = self.lens();
        let photographs = self.photographs(&lens);
        let splats = on.upload(&scene, gs_core::Parameterization::ScaleRotation)?;
        for (index, (name, camera)) in photographs.iter().enumerate() {
            let (seen, _) = on.draw(&splats, camera, &self.city.render()).block_on()?;
            let mut photograph = lens.photograph(&seen);
            self.expose(&mut photograph, index as u64);
            write_jpeg(&images.join(name), &photograph)?;
            written(index as u32 + 1);
        }
        self.scatter(&mut scene);
        let file = |name: &str| model.join(name);
        gs_io::write_atomically(file("points3D.txt"), |file| write_points(&scene, self.points, file))?;
        gs_io::write_atomically(file("cameras.txt"), |file| write_cameras(&lens, file))?;
        gs_io::write_atomically(file("images.txt"), |file| write_images(&photographs, file))?;
        Ok(())
    }

    fn lens(&self) -> RadialLens {
        RadialLens::wide(UVec2::new(self.width, self.width * 3 / 4), FOV_X)
    }

    /// Names and cameras of the pictures from which photographs are made, along parallel lines.
    fn photographs(&self, lens: &RadialLens) -> Vec<(String, Camera)> {
        let mut rng = Rng::seed_from_u64(self.city.seed ^ 1);
        let pinhole = lens.pinhole();
        let lines = f64::from(self.views).sqrt().ceil() as u32;
        let at = |index: u32| {
            let (line, along) = (index / lines, index % lines);
            let along = if line % 2 == 0 { along } else { lines - 1 - along };
            let [x, z] = [line, along].map(|i| (i as f32 + 0.5) / lines as f32 * self.city.side());
            let mut jitter = |size: f32| rng.random_range(-size..size);
            let position = vec3(x + jitter(2.0), -ALTITUDE_M + jitter(4.0), z + jitter(2.0));
            let turned = jitter(0.1);
            let angle = TAU * ((index % 5) as f32 / 4.0) + turned;
            let (sideways, up) = match index % 5 {
                4 => (Vec3::ZERO, vec3(turned.sin(), 0.0, turned.cos())),
                _ => (vec3(angle.sin(), 0.0, angle.cos()), -Vec3::Y),
            };
            let camera = pinhole.looking_at(position, position + Vec3::Y + sideways, up);
            (format!("{:05}.jpg", index + 1), camera.expect("`up` is not the viewing direction"))
        };
        (0..self.views).map(at).collect()
    }

    /// Gives a photograph its exposure, white balance and noise.
    fn expose(&self, photograph: &mut Image, index: u64) {
        let mut rng = Rng::seed_from_u64(self.city.seed ^ (index + 2) << 8);
        let mut normal = |deviation: f32| Normal::new(0.0, deviation).expect("finite").sample(&mut rng);
        let exposure = normal(EXPOSURE);
        let gains: [f32; 3] = std::array::from_fn(|_| (exposure + normal(WHITE_BALANCE)).exp());
        for pixel in photograph.pixels_mut() {
            for (value, gain) in pixel.iter_mut().zip(gains) {
                *value = (*value * gain + normal(NOISE)).clamp(0.0, 1.0);
            }
        }
    }

    /// Moves the means as a reconstruction finds points: not exactly.
    fn scatter(&self, scene: &mut Scene3d) {
        let mut rng = Rng::seed_from_u64(self.city.seed ^ 2);
        let noise = Normal::new(0.0, POINT_NOISE_M).expect("finite");
        for mean in &mut scene.means {
            *mean += Vec3::from_array(std::array::from_fn(|_| noise.sample(&mut rng)));
        }
    }
}

/// Writes an image as JPEG.
fn write_jpeg(path: &Path, image: &Image) -> Result<(), gs_io::Error> {
    let bytes: Vec<u8> = image.pixels().as_flattened().iter().map(|value| (value * 255.0).round() as u8).collect();
    gs_io::write_atomically(path, |file| {
        let mut encoder = JpegEncoder::new_with_quality(file, JPEG_QUALITY);
        let encoded = encoder.encode(&bytes, image.width(), image.height(), image::ExtendedColorType::Rgb8);
        encoded.map_err(std::io::Error::other)
    })
}
