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

    /// Images that are not of the Kodak set: those in the folder `images` of the test data, and two
    /// photographs of the data set `banana`. Those that are not there are left out.
    pub(crate) fn others() -> Result<Vec<BenchImage>, Box<dyn Error>> {
        let folder = |name: &str| gs_io::image_files(data::folder().join(name)).unwrap_or_default();
        let views = folder("banana/images_2");
        let two = views.iter().step_by((views.len() / 2).max(1)).take(2).cloned();
        let read = |path: PathBuf| {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            Ok(BenchImage { name, image: gs_io::read_image(&path)?.image })
        };
        folder("images").into_iter().chain(two).map(read).collect()
    }

    /// The image for measurements of a single one: kodim04, a portrait, or else the first.
    pub(crate) fn portrait(&self) -> &BenchImage {
        self.all.iter().find(|image| image.name == "kodim04").unwrap_or(&self.all[0])
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

/// The middle of an image, or all of it if it is smaller.
pub(crate) fn cropped(image: &Image, width: u32, height: u32) -> Image {
    let (width, height) = (width.min(image.width()), height.min(image.height()));
    let (left, top) = ((image.width() - width) / 2, (image.height() - height) / 2);
    Image::from_fn(width, height, |x, y| image.pixel(left + x, top + y)).expect("a part has a possible size")
}

/// An image at half its size: means of 2×2 pixels. Both sides must be at least 2 px.
pub(crate) fn halved(image: &Image) -> Image {
    let color = |x: u32, y: u32| {
        let of = |dx, dy| image.pixel(2 * x + dx, 2 * y + dy);
        let [a, b, c, d] = [of(0, 0), of(1, 0), of(0, 1), of(1, 1)];
        [0, 1, 2].map(|k| 0.25 * (a[k] + b[k] + c[k] + d[k]))
    };
    Image::from_fn(image.width() / 2, image.height() / 2, color).expect("half a size is possible")
}
