//! The images that benchmarks fit: the Kodak images if they are there, else a synthetic one.

use std::{error::Error, path::PathBuf};

use gs_conformance::data;
use gs_core::Image;

/// An image and its name.
#[derive(Debug, Clone)]
pub(crate) struct BenchImage {
    /// The file name without extension.
    pub(crate) name: String,
    /// The pixels.
    pub(crate) image: Image,
}

/// The images for benchmarks.
#[derive(Debug)]
pub(crate) struct BenchImages {
    /// Sorted by name.
    pub(crate) all: Vec<BenchImage>,
    /// Origin of the images, for the report.
    pub(crate) origin: String,
}

impl BenchImages {
    /// Loads the images in the folder `kodak` of the test data; without them, makes a synthetic
    /// image of the same size.
    pub(crate) fn load() -> Result<Self, Box<dyn Error>> {
        let mut paths: Vec<PathBuf> = match std::fs::read_dir(data::folder().join("kodak")) {
            Ok(folder) => folder.map(|entry| Ok(entry?.path())).collect::<Result<_, std::io::Error>>()?,
            Err(_) => Vec::new(),
        };
        paths.retain(|path| path.extension().is_some_and(|ending| ending == "png"));
        paths.sort();
        let all = paths
            .iter()
            .map(|path| {
                let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                Ok(BenchImage { name, image: gs_io::read_image(path)?.image })
            })
            .collect::<Result<Vec<_>, gs_io::Error>>()?;
        if all.is_empty() {
            let image = synthetic(768, 512);
            let origin = "a SYNTHETIC image, as the Kodak images were not found".to_owned();
            return Ok(Self { all: vec![BenchImage { name: "synthetic".to_owned(), image }], origin });
        }
        let origin = format!("{} images of the Kodak test set, 768x512 or 512x768 px", all.len());
        Ok(Self { all, origin })
    }
}

/// Similar to a natural image: waves in all directions whose amplitude falls with frequency, and
/// discs with sharp edges that hide each other.
fn synthetic(width: u32, height: u32) -> Image {
    // Multiples of irrational numbers are evenly spread and the same on every machine.
    let spread = |i: u32, step: f32| (i as f32 * step).fract();
    let waves: Vec<[f32; 5]> = (1..=24)
        .map(|i| {
            let (angle, frequency) = (i as f32 * 2.4, 0.01 * 1.2f32.powi(i as i32));
            let hue = spread(i, 0.755);
            [angle.cos() * frequency, angle.sin() * frequency, i as f32, 0.002 / frequency, hue]
        })
        .collect();
    let discs: Vec<([f32; 2], f32, [f32; 3])> = (1..=80)
        .map(|i| {
            let center = [spread(i, 0.754_877_7) * width as f32, spread(i, 0.569_840_3) * height as f32];
            (center, 120.0 / (i as f32).sqrt(), [0.618_034, 0.414_213_6, 0.732_050_8].map(|step| spread(i, step)))
        })
        .collect();
    let color = |column: u32, row: u32| {
        let (x, y) = (column as f32 + 0.5, row as f32 + 0.5);
        let disc = discs.iter().rev().find(|([u, v], radius, _)| (x - u).hypot(y - v) < *radius);
        let mut color = disc.map_or([0.5; 3], |(_, _, color)| *color);
        for [u, v, phase, amplitude, hue] in &waves {
            let wave = amplitude * (u * x + v * y + phase).sin();
            color[0] += wave * (1.0 - 0.5 * hue);
            color[1] += wave;
            color[2] += wave * (0.5 + 0.5 * hue);
        }
        color.map(|c| c.clamp(0.0, 1.0))
    };
    Image::from_fn(width, height, color).expect("the size is possible")
}
