//! The pictures of a report, embedded in the page: each arm's result in the same window of an image
//! or of a held-out view, and its error there.

use gs_core::Image;
use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};

use super::html::data_uri;
use crate::{
    error::Error,
    result::Results,
    run::{PICTURED_VIEWS, Record},
    study::{Run, TargetContent},
};

/// Side of a picture of an image and of a scene's view, px.
const SIDES: [u32; 2] = [144, 256];
/// JPEG quality of the pictures, 1 to 100.
const QUALITY: u8 = 75;
/// Largest number of characters of all embedded pictures together, of images and of scenes, so that
/// a report of many images and arms stays small.
const MOST_CHARS: [usize; 2] = [300_000, 4_000_000];
/// The error of a channel at which error maps reach their brightest colour.
pub(crate) const FULL_SCALE: f32 = 0.25;

/// An image of the study, or a held-out view of a scene, with the results of the arms.
#[derive(Debug, Clone)]
pub(crate) struct Multiples {
    /// The name of the image, or of scene and view.
    pub(crate) title: String,
    /// Left, top, columns and rows of the window, px.
    pub(crate) window: [u32; 4],
    /// The image or view itself, as a data URI.
    pub(crate) target: String,
    pub(crate) arms: Vec<Multiple>,
}

/// The result of an arm on an image or a view.
#[derive(Debug, Clone)]
pub(crate) struct Multiple {
    pub(crate) arm: usize,
    /// PSNR of the whole image or view, dB.
    pub(crate) psnr: f64,
    pub(crate) reconstruction: String,
    pub(crate) error_map: String,
}

/// A picture of a run that is held against the target.
struct Shown {
    arm: usize,
    psnr: f64,
    view: Option<String>,
    image: Image,
}

/// Pictures of the first seed at a budget, for as many images as fit into [`MOST_CHARS`], at least
/// one. Of scenes, the first view of each comes first, then the second of each.
pub(crate) fn multiples(
    results: &Results<'_>,
    budget: u32,
    picture: impl Fn(&Run, usize) -> Option<Image>,
) -> Result<Vec<Multiples>, Error> {
    let plan = results.plan;
    let is_of_scenes = plan.study.is_of_scenes();
    let (views, most) = if is_of_scenes { (PICTURED_VIEWS, MOST_CHARS[1]) } else { (1, MOST_CHARS[0]) };
    let (mut shown, mut chars) = (Vec::new(), 0);
    for (view, target) in (0..views).flat_map(|view| (0..plan.targets.len()).map(move |target| (view, target))) {
        let Some(multiples) = multiples_of(results, (target, budget), view, &picture)? else { continue };
        chars += multiples.chars();
        if chars > most && !shown.is_empty() {
            break;
        }
        shown.push((target, multiples));
    }
    shown.sort_by_key(|(target, _)| *target);
    Ok(shown.into_iter().map(|(_, multiples)| multiples).collect())
}

/// The pictures of an image, or of a view of a scene; `None` of a scene without such a view.
fn multiples_of(
    results: &Results<'_>,
    (index, budget): (usize, u32),
    number: usize,
    picture: impl Fn(&Run, usize) -> Option<Image>,
) -> Result<Option<Multiples>, Error> {
    let plan = results.plan;
    let (target, seed) = (&plan.targets[index], plan.study.seeds[0]);
    let of_target = || results.rows().filter(|(run, _)| (run.target, run.budget, run.seed) == (index, budget, seed));
    let shown = |(run, record): (&Run, Option<&'_ Record>)| {
        let end = record?.outcome.finished()?;
        let (view, psnr) = match target.content {
            TargetContent::Image(_) => (None, end.psnr),
            TargetContent::Scene(_) => {
                let view = end.views.iter().filter(|view| view.is_shown).nth(number)?;
                (Some(view.name.clone()), view.psnr)
            }
        };
        Some(Shown { arm: run.arm, psnr, view, image: picture(run, number)? })
    };
    let mut arms: Vec<Shown> = of_target().filter_map(shown).collect();
    let view = arms.first().and_then(|shown| shown.view.clone());
    let background = of_target().next().map_or([0.0; 3], |(run, _)| run.settings.render().background_color());
    let Some(image) = target.reference(view.as_deref(), background)? else { return Ok(None) };
    arms.retain(|shown| shown.view == view && shown.image.size() == image.size());
    let side = SIDES[usize::from(view.is_some())];
    let window = telling_window(&image, &arms.iter().map(|shown| &shown.image).collect::<Vec<_>>(), side);
    let title = view.map_or_else(|| target.label().to_owned(), |view| format!("{}, view {view}", target.label()));
    let multiple = |Shown { arm, psnr, image: shown, .. }: &Shown| {
        let part = cut(shown, window);
        let error_map = pack(&title, &error_map(&part, &cut(&image, window)))?;
        Ok::<_, Error>(Multiple { arm: *arm, psnr: *psnr, reconstruction: pack(&title, &part)?, error_map })
    };
    let (packed, arms) = (pack(&title, &cut(&image, window))?, arms.iter().map(multiple).collect::<Result<_, _>>()?);
    Ok(Some(Multiples { title, window, target: packed, arms }))
}

impl Multiples {
    /// Total length of the data URIs.
    fn chars(&self) -> usize {
        let of_arms = self.arms.iter().map(|arm| arm.reconstruction.len() + arm.error_map.len());
        self.target.len() + of_arms.sum::<usize>()
    }
}

/// The window in which the squared errors of the arms differ most.
fn telling_window(target: &Image, arms: &[&Image], side: u32) -> [u32; 4] {
    let (width, height) = target.size();
    let (columns, rows) = (width.min(side), height.min(side));
    let stride = width as usize + 1;
    // Summed-area table.
    let mut sums = vec![0.0f64; stride * (height as usize + 1)];
    for y in 0..height as usize {
        let mut row = 0.0;
        for x in 0..width as usize {
            let pixel = y * width as usize + x;
            let error = |image: &&Image| squared(image.pixels()[pixel], target.pixels()[pixel]);
            let (low, high) = arms.iter().map(error).fold((f64::MAX, 0.0f64), |(l, h), e| (l.min(e), h.max(e)));
            row += (high - low).max(0.0);
            sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + row;
        }
    }
    let sum = |x: u32, y: u32| {
        let at = |x: u32, y: u32| sums[y as usize * stride + x as usize];
        at(x + columns, y + rows) - at(x, y + rows) - at(x + columns, y) + at(x, y)
    };
    let places = (0..=height - rows).step_by(8).flat_map(|y| (0..=width - columns).step_by(8).map(move |x| (x, y)));
    let best = places.max_by(|a, b| sum(a.0, a.1).total_cmp(&sum(b.0, b.1)));
    let (x, y) = best.unwrap_or((0, 0));
    [x, y, columns, rows]
}

fn squared(a: [f32; 3], b: [f32; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a.clamp(0.0, 1.0) - b).powi(2)).sum()
}

fn cut(image: &Image, [left, top, columns, rows]: [u32; 4]) -> Image {
    Image::from_fn(columns, rows, |x, y| image.pixel(left + x, top + y))
        .expect("a part of an image is of a possible size")
}

/// A map of the largest absolute error of a channel, from black (none) over red to pale yellow
/// ([`FULL_SCALE`] and more). Its brightness rises monotonically, for any colour vision.
fn error_map(image: &Image, target: &Image) -> Image {
    const STOPS: [[f32; 3]; 5] =
        [[0.0, 0.0, 0.02], [0.27, 0.06, 0.36], [0.73, 0.22, 0.33], [0.98, 0.55, 0.15], [0.99, 1.0, 0.75]];
    Image::from_fn(image.width(), image.height(), |x, y| {
        let (a, b) = (image.pixel(x, y), target.pixel(x, y));
        let worst = a.iter().zip(b).map(|(a, b)| (a.clamp(0.0, 1.0) - b).abs()).fold(0.0f32, f32::max);
        let place = (worst / FULL_SCALE).clamp(0.0, 1.0) * (STOPS.len() - 1) as f32;
        let below = (place as usize).min(STOPS.len() - 2);
        let part = place - below as f32;
        std::array::from_fn(|c| STOPS[below][c] + part * (STOPS[below + 1][c] - STOPS[below][c]))
    })
    .expect("as large as an image")
}

/// The image as a data URI.
fn pack(name: &str, image: &Image) -> Result<String, Error> {
    let bytes: Vec<u8> =
        image.pixels().as_flattened().iter().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
    let mut packed = Vec::new();
    JpegEncoder::new_with_quality(&mut packed, QUALITY)
        .write_image(&bytes, image.width(), image.height(), ExtendedColorType::Rgb8)
        .map_err(|error| Error::Picture { name: name.to_owned(), message: error.to_string() })?;
    Ok(data_uri("jpeg", &packed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_lies_where_arms_differ() {
        let target = Image::filled(600, 400, [0.5; 3]).unwrap();
        let spoiled = Image::from_fn(600, 400, |x, y| if x > 450 && y > 300 { [0.9; 3] } else { [0.5; 3] }).unwrap();
        let [left, top, columns, rows] = telling_window(&target, &[&target, &spoiled], SIDES[0]);
        assert!(left > 400 && top > 200 && (columns, rows) == (144, 144), "{left} {top}");
        assert_eq!(telling_window(&Image::filled(20, 10, [0.0; 3]).unwrap(), &[], SIDES[0]), [0, 0, 20, 10]);
    }

    #[test]
    fn larger_errors_are_brighter() {
        let target = Image::filled(64, 1, [0.5; 3]).unwrap();
        let image = Image::from_fn(64, 1, |x, _| [0.5, 0.5 + x as f32 / 63.0 * FULL_SCALE, 0.5]).unwrap();
        let map = error_map(&image, &target);
        let luma = |[r, g, b]: [f32; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
        assert!(map.pixels().windows(2).all(|pair| luma(pair[0]) < luma(pair[1])));
        assert!(pack("a", &map).unwrap().starts_with("data:image/jpeg;base64,/9j/"));
    }
}
