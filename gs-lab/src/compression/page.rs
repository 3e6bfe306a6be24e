//! The page of an encoded image: the image next to what was made of it, what is wrong with that, and
//! the same in other formats.

use gs_core::Image;
use gs_io::png_bytes;
use gs_train::ImageQuality;
use maud::{Markup, html};

use super::{CODECS, Codec, Coded, Original, RateCurve};
use crate::{
    error::Error,
    report::{
        figure::{Axis, Dots, Figure, Marks, Series},
        html,
    },
};

/// Factor of differences in the error map.
const ERROR_GAIN: f32 = 8.0;

/// Pixels of an image up to which other formats are compared: a curve of AVIF takes seconds for each
/// megapixel.
const MOST_PX_COMPARED: usize = 4_000_000;

/// Longer side of the pictures in the page, px, about.
const LONGEST_PX: u32 = 2048;

/// An encoded image.
#[derive(Debug)]
pub struct EncodePage<'a> {
    /// The image's name, without folders.
    pub name: &'a str,
    /// The image.
    pub original: &'a Image,
    /// The rendering of the decoded file, not rounded.
    pub decoded: &'a Image,
    /// Size of the file.
    pub bytes: u64,
    /// Gaussians in it.
    pub gaussians: usize,
    /// Time of encoding, s.
    pub seconds: f64,
}

/// What a format makes of the image.
struct Rival {
    codec: &'static Codec,
    /// The files of its curve, or why there are none.
    files: Result<Vec<Coded>, String>,
    /// The best file of at most our size.
    equal: Option<Coded>,
}

/// The page as HTML, in a single file. It takes some seconds, in which other formats' programs encode
/// the image in many qualities.
///
/// # Errors
/// [`Error::Path`] where there is no place for temporary files, [`Error::Picture`] where a figure
/// cannot be drawn, [`Error::Fit`] where the images differ in size.
pub fn page(of: &EncodePage<'_>) -> Result<String, Error> {
    let quality = ImageQuality::as_written(of.decoded, of.original).map_err(gs_train::Error::from)?;
    let rivals = rivals(of)?;
    let body = html! {
        header {
            p.kind { "Encoded image" }
            h1 { (of.name) }
            (facts(of, &quality))
        }
        main {
            (pictures(of, &quality, &rivals))
            (comparison(of, &quality, &rivals)?)
        }
    };
    Ok(html::page(&format!("{}, encoded", of.name), &body))
}

impl EncodePage<'_> {
    fn bpp(&self, bytes: u64) -> f64 {
        bytes as f64 * 8.0 / self.original.pixels().len() as f64
    }
}

fn rivals(of: &EncodePage<'_>) -> Result<Vec<Rival>, Error> {
    if of.original.pixels().len() > MOST_PX_COMPARED {
        return Ok(Vec::new());
    }
    let original = Original::new(of.original)?;
    let there = CODECS.iter().filter(|codec| codec.is_there());
    Ok(there
        .map(|codec| {
            let made = codec.files(&original, codec.levels).and_then(|files| {
                let equal = codec.within(&original, of.bytes, &files)?;
                Ok((files, equal))
            });
            match made {
                Ok((files, equal)) => Rival { codec, files: Ok(files), equal },
                Err(error) => Rival { codec, files: Err(error.to_string()), equal: None },
            }
        })
        .collect())
}

fn facts(of: &EncodePage<'_>, quality: &ImageQuality) -> Markup {
    let (width, height) = of.original.size();
    let mut facts = vec![
        ("image", format!("{width}×{height} px")),
        ("file", format!("{} bytes, {:.3} bits per pixel", grouped(of.bytes), of.bpp(of.bytes))),
        ("Gaussians", grouped(of.gaussians as u64)),
        ("PSNR", decibels(quality.psnr)),
        ("SSIM", format!("{:.4}", quality.ssim)),
        ("MS-SSIM", ms_ssim(quality)),
        ("encoded in", format!("{:.1} s", of.seconds)),
    ];
    facts.retain(|(_, value)| value != "–");
    html! { dl.facts { @for (name, value) in facts { div { dt { (name) } dd { (value) } } } } }
}

/// A picture of the page.
struct Shown {
    name: String,
    image: Image,
    about: String,
}

/// All pictures, side by side or one at a time in the same place, without a script.
fn pictures(of: &EncodePage<'_>, quality: &ImageQuality, rivals: &[Rival]) -> Markup {
    let (width, height) = of.original.size();
    let reduction = width.max(height).div_ceil(LONGEST_PX).max(1);
    let about = |bytes: u64, quality: &ImageQuality| format!("{} bytes, {}", grouped(bytes), decibels(quality.psnr));
    let mut shown = vec![
        Shown { name: "original".to_owned(), image: of.original.clone(), about: String::new() },
        Shown { name: "gsi".to_owned(), image: of.decoded.clone(), about: about(of.bytes, quality) },
    ];
    for Rival { codec, equal, .. } in rivals {
        if let Some(file) = equal {
            let (name, image) = (codec.name.to_owned(), file.picture.clone());
            shown.push(Shown { name, image, about: about(file.bytes, &file.quality) });
        }
    }
    shown.push(Shown {
        name: "error of gsi".to_owned(),
        image: error_map(of.original, of.decoded),
        about: format!("absolute difference × {ERROR_GAIN}, black is none"),
    });
    html! {
        section.flip {
            h2 { "Pictures" }
            p {
                "Choose one picture and change to another: it appears in the same place, so differences flicker."
                @if !rivals.is_empty() {
                    " The other formats’ files are the best that have at most as many bytes as the .gsi file."
                }
                @if reduction > 1 { " The pictures are reduced by " (reduction) " in both directions." }
            }
            div.choices {
                label { input type="radio" name="shown" checked; " all" }
                @for Shown { name, .. } in &shown { label { input type="radio" name="shown"; " " (name) } }
            }
            div.flipped {
                @for Shown { name, image, about } in &shown {
                    figure {
                        img src=(html::data_uri("png", &png_bytes(&reduced(image, reduction)))) alt=(name);
                        figcaption { b { (name) } @if !about.is_empty() { ": " (about) } }
                    }
                }
            }
        }
    }
}

/// |a − b| times [`ERROR_GAIN`].
fn error_map(a: &Image, b: &Image) -> Image {
    let b = b.rounded_to_8_bits();
    let pixel = |x: u32, y: u32| {
        let (a, b) = (a.pixel(x, y), b.pixel(x, y));
        std::array::from_fn(|k| ((a[k] - b[k]).abs() * ERROR_GAIN).min(1.0))
    };
    Image::from_fn(a.width(), a.height(), pixel).expect("the size of an image is possible")
}

/// Means of `by`×`by` pixels.
fn reduced(image: &Image, by: u32) -> Image {
    if by == 1 {
        return image.clone();
    }
    let pixel = |x: u32, y: u32| {
        let of = (0..by * by).map(|k| image.pixel(x * by + k % by, y * by + k / by));
        of.fold([0.0; 3], |sum: [f32; 3], p| std::array::from_fn(|k| sum[k] + p[k] / (by * by) as f32))
    };
    Image::from_fn((image.width() / by).max(1), (image.height() / by).max(1), pixel)
        .expect("a smaller size is possible")
}

fn comparison(of: &EncodePage<'_>, quality: &ImageQuality, rivals: &[Rival]) -> Result<Markup, Error> {
    if rivals.is_empty() {
        return Ok(html! {
            section {
                h2 { "Other formats" }
                p { "They are compared for images of up to " (MOST_PX_COMPARED / 1_000_000) " megapixels." }
            }
        });
    }
    let drawn = html::figure(&figure(of, quality, rivals))?;
    let absent: Vec<&str> = CODECS.iter().filter(|codec| !codec.is_there()).map(|codec| codec.name).collect();
    Ok(html! {
        section {
            h2 { "Other formats" }
            div.wide { table.numbers {
                thead { tr {
                    th { "format" } th { "bytes" } th { "bits/px" } th { "PSNR, dB" } th { "MS-SSIM" }
                    th { "bytes at the PSNR of gsi" }
                } }
                tbody {
                    tr {
                        td { b { "gsi" } } td { (grouped(of.bytes)) } td { (format!("{:.3}", of.bpp(of.bytes))) }
                        td { (digits(quality.psnr)) } td { (ms_ssim(quality)) } td { (grouped(of.bytes)) }
                    }
                    @for rival in rivals { (row(of, quality, rival)) }
                }
            } }
            div.figures { (drawn) }
            p.small { "The files were made with" }
            ul.small { @for Rival { codec, .. } in rivals { li { (codec.name) ": " code { (codec.maker()) } } } }
            @if !absent.is_empty() {
                p.small.quiet { "Left out, as the programs that make them were not found: " (absent.join(", ")) "." }
            }
            p.small.quiet {
                "PSNR and SSIM are those of the decoded 8-bit picture in RGB. The last column is interpolated "
                "between files; “–” is outside them."
            }
        }
    })
}

fn row(of: &EncodePage<'_>, quality: &ImageQuality, Rival { codec, files, equal }: &Rival) -> Markup {
    let at_equal_psnr = files.as_ref().ok().and_then(|files| {
        let bpp = rate_curve(of, files)?.bpp_at(quality.psnr)?;
        let ratio = bpp / of.bpp(of.bytes) - 1.0;
        let bytes = grouped((of.bytes as f64 * (1.0 + ratio)).round() as u64);
        Some(format!("{bytes} ({})", format!("{:+.0} %", ratio * 100.0).replace('-', "−")))
    });
    html! {
        tr {
            td { (codec.name) }
            @match (files, equal) {
                (Err(why), _) => { td colspan="5" { (why) } }
                (_, None) => { td colspan="4" { "no file is so small" } td { (at_equal_psnr.unwrap_or("–".to_owned())) } }
                (_, Some(file)) => {
                    td { (grouped(file.bytes)) } td { (format!("{:.3}", of.bpp(file.bytes))) }
                    td { (digits(file.quality.psnr)) } td { (ms_ssim(&file.quality)) }
                    td { (at_equal_psnr.unwrap_or("–".to_owned())) }
                }
            }
        }
    }
}

fn rate_curve(of: &EncodePage<'_>, files: &[Coded]) -> Option<RateCurve> {
    RateCurve::new(files.iter().map(|file| (of.bpp(file.bytes), file.quality.psnr)))
}

fn figure(of: &EncodePage<'_>, quality: &ImageQuality, rivals: &[Rival]) -> Figure {
    let mut series = Vec::new();
    for (index, Rival { codec, files, .. }) in rivals.iter().enumerate() {
        let Ok(files) = files else { continue };
        let mut points: Vec<(f64, f64)> = files.iter().map(|file| (of.bpp(file.bytes), file.quality.psnr)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        series.push(Series { style: index + 1, ..Series::dotted(codec.name, points) });
    }
    // The last is on top.
    let own = vec![(of.bpp(of.bytes), quality.psnr)];
    series.push(Series { dots: Dots::Alone, ..Series::line("this gsi file", own) });
    Figure {
        name: "rate-distortion".to_owned(),
        title: "Quality over size".to_owned(),
        x: Axis::logarithmic("bits per pixel"),
        y: Axis::linear("PSNR, dB"),
        marks: Marks::Lines(series),
    }
}

fn grouped(number: u64) -> String {
    crate::report::figure::grouped(&number.to_string())
}

fn digits(psnr: f64) -> String {
    if psnr.is_finite() { format!("{psnr:.2}") } else { "infinite".to_owned() }
}

fn decibels(psnr: f64) -> String {
    if psnr.is_finite() { format!("{psnr:.2} dB") } else { "infinite PSNR".to_owned() }
}

fn ms_ssim(quality: &ImageQuality) -> String {
    quality.ms_ssim.map_or("–".to_owned(), |value| format!("{value:.4}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_stands_alone_and_shows_every_picture_and_number() {
        let wave = |x: u32, y: u32| ((x * x + 3 * y) as f32 * 0.02).sin() * 0.4 + 0.5;
        let original = Image::from_fn(64, 48, |x, y| [wave(x, y), wave(y, x), 0.3]).unwrap();
        let decoded = Image::from_fn(64, 48, |x, y| [wave(x, y) + 0.02, wave(y, x), 0.3]).unwrap();
        let of = EncodePage {
            name: "a<b.png",
            original: &original,
            decoded: &decoded,
            bytes: 1500,
            gaussians: 400,
            seconds: 1.5,
        };
        let page = page(&of).unwrap();
        for part in ["a&lt;b.png", "1,500 bytes, 3.906 bits per pixel", "JPEG", "difference × 8", "this gsi file"] {
            assert!(page.contains(part), "{part}");
        }
        let jpeg = CODECS.iter().filter(|codec| codec.is_there()).count();
        assert_eq!(page.matches("<img ").count(), 3 + jpeg - page.matches("no file is so small").count());
        let outside = page.replace("http://www.w3.org/2000/svg", "");
        assert!(!outside.contains("http") && !outside.contains("<script") && !outside.contains("url("), "no network");
        let error = error_map(&original, &decoded).pixel(3, 3);
        assert!((error[0] - 0.16).abs() < 0.02 && error[1] < 0.02 && error[2] < 0.02, "{error:?}");
        assert_eq!(reduced(&original, 3).size(), (21, 16));
    }
}
