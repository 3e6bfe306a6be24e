//! SOG version 2, PlayCanvas's format for the web: the numbers of all Gaussians as pixels of
//! lossless WebP images. [`read`] reads them, [`encode`] makes them.
//!
//! | image | pixel of a Gaussian |
//! |---|---|
//! | `means_l`, `means_u` | low and high bytes of x, y, z: 16 bits between the least and the largest ln-distance, sign(x) ln(1 + abs(x)) |
//! | `scales` | three indices into a table of 256 ln-scales |
//! | `quats` | the three smaller components, (byte / 255 − 1/2) √2, and 252 plus the index of the largest |
//! | `sh0` | three indices into a table of 256 coefficients, and the opacity in 255 steps |
//! | `shN_labels` | number of its row in a palette of SH of degrees 1 to 3, two bytes |
//! | `shN_centroids` | the palette: 64 rows in a line, a pixel per coefficient, indices into a table of 256 |
//!
//! `meta.json` names the images and has tables and ranges. All files are in a ZIP archive, `.sog`,
//! or in a folder. Axes are the same as in a PLY. Gaussians are written along a Morton curve, so that
//! neighbours in the image are neighbours in space, which the image coding needs.
//!
//! *Source:* PlayCanvas, "SOG file format"; checked against `@playcanvas/splat-transform`.

mod bundle;
mod codebook;
mod meta;
mod order;
mod palette;
mod planes;

use std::borrow::Cow;

use glam::Vec3;
use gs_core::{Scene, Scene3d, examination::EXTREME_COLOR};

pub(crate) use self::{bundle::recognises_bundle, meta::META};
use self::{
    bundle::{Files, bundled},
    codebook::Codebook,
    meta::{Coded, Means, Meta, Named, Palette},
    order::Grid,
    palette::Clusters,
    planes::{Plane, PlaneSize},
};
use super::{
    Encoded3d, File3d, Format3d, TrainedWith,
    conversion_loss::{Clamp, ConversionLoss},
    options::ToWrite,
    source::Source,
    values::{UnitRotations, byte_of_logit, largest_of, logit_of_step, rest_of_degree, with_largest},
};
use crate::error::Error;

/// Rows of the palette in a line of `shN_centroids`.
const PALETTE_COLUMNS: usize = 64;

/// Most rows of a palette: labels have 16 bits.
const MAX_PALETTE: usize = 1 << 16;

/// The largest component of a quaternion, w, x, y or z, is stored as its index plus this.
const LARGEST: u8 = 252;

/// Reads a bundle, or a `meta.json` with the images next to it.
pub(crate) fn read(source: &Source<'_>, format: Format3d) -> Result<File3d, Error> {
    let mut files = Files::of(source)?;
    let meta = Meta::parse(source, &files.meta()?)?;
    let count = meta.count as usize;
    let degree = meta.sh_n.as_ref().map_or(0, |palette| palette.bands);
    files.check_claim(u64::from(meta.count) * 4 * (14 + rest_of_degree(degree) as u64))?;
    let mut plane = |named: &[String], index: usize| Plane::read(&mut files, named, index, count);

    let (low, high) = (plane(&meta.means.files, 0)?, plane(&meta.means.files, 1)?);
    let grid = Grid { mins: meta.means.mins, maxs: meta.means.maxs };
    let word = |i: usize, axis: usize| u16::from_le_bytes([low.pixel(i)[axis], high.pixel(i)[axis]]);
    let means = (0..count).map(|i| grid.mean([0, 1, 2].map(|axis| word(i, axis)))).collect();

    let quats = plane(&meta.quats.files, 0)?;
    let rotations: Option<Vec<_>> = (0..count).map(|i| rotation(quats.pixel(i))).collect();
    let rotations =
        rotations.ok_or_else(|| source.damaged(0, "quaternions whose fourth byte is 252 to 255", "others"))?;

    let scales = plane(&meta.scales.files, 0)?;
    let log_scales = decoded(source, &meta.scales.codebook, (0..count).map(|i| scales.pixel(i)))?;

    let colors = plane(&meta.sh0.files, 0)?;
    let constant = decoded(source, &meta.sh0.codebook, (0..count).map(|i| colors.pixel(i)))?;
    let opacity_logits = (0..count).map(|i| logit_of_step(colors.pixel(i)[3].into(), 255)).collect();

    let mut scene = Scene3d { means, log_scales, rotations, opacity_logits, sh_degree: degree, sh: constant };
    if let Some(palette) = &meta.sh_n {
        let labels = plane(&palette.files, 1)?;
        scene.sh = with_palette(source, &mut files, palette, &scene, &labels)?;
    }
    let trained_with = meta.antialias.map_or_else(TrainedWith::default, TrainedWith::of_spz_flag);
    Ok(File3d { trained_with, ..File3d::of(format, scene) }.beside(files.read))
}

/// The triples that bytes stand for.
fn decoded<'a>(
    source: &Source<'_>,
    codebook: &[Option<f32>],
    pixels: impl Iterator<Item = &'a [u8; 4]>,
) -> Result<Vec<Vec3>, Error> {
    let value = |byte: u8| codebook.get(usize::from(byte)).map(|value| value.unwrap_or(f32::NAN));
    let triple = |&[a, b, c, _]: &[u8; 4]| Some(Vec3::new(value(a)?, value(b)?, value(c)?));
    let all: Option<Vec<_>> = pixels.map(triple).collect();
    let expected = || format!("indices below {}, the length of a codebook", codebook.len());
    all.ok_or_else(|| source.damaged(0, expected(), "others"))
}

/// Coefficients of all degrees: the constant ones of `scene`, and those of the palette.
fn with_palette(
    source: &Source<'_>,
    files: &mut Files<'_>,
    palette: &Palette,
    scene: &Scene3d,
    labels: &Plane,
) -> Result<Vec<Vec3>, Error> {
    let rest = rest_of_degree(palette.bands) / 3;
    let rows = palette.count as usize;
    let centroids = Plane::read(files, &palette.files, 0, rows.div_ceil(PALETTE_COLUMNS) * PALETTE_COLUMNS * rest)?;
    if centroids.width != PALETTE_COLUMNS * rest {
        let expected = format!("a palette of {} columns", PALETTE_COLUMNS * rest);
        return Err(source.damaged(0, expected, centroids.width.to_string()));
    }
    let table = decoded(source, &palette.codebook, (0..rows * rest).map(|k| centroids.pixel(k)))?;
    let mut sh = Vec::with_capacity(scene.means.len() * (1 + rest));
    for (i, constant) in scene.sh.iter().enumerate() {
        let [low, high, ..] = *labels.pixel(i);
        let row = usize::from(u16::from_le_bytes([low, high]));
        let coefficients = table.get(row * rest..(row + 1) * rest);
        let coefficients =
            coefficients.ok_or_else(|| source.damaged(0, format!("labels below {rows}"), row.to_string()))?;
        sh.push(*constant);
        sh.extend(coefficients);
    }
    Ok(sh)
}

/// The quaternion (w, x, y, z) of a pixel; `None` for an impossible index of the largest component.
fn rotation(&[a, b, c, index]: &[u8; 4]) -> Option<[f32; 4]> {
    let largest = usize::from(index.checked_sub(LARGEST)?);
    let smaller = [a, b, c].map(|byte| (f32::from(byte) / 255.0 - 0.5) * std::f32::consts::SQRT_2);
    Some(with_largest(largest, smaller))
}

/// The pixel of a unit quaternion.
fn pixel_of_rotation(q: [f32; 4]) -> [u8; 4] {
    let largest = largest_of(q);
    let sign = 1.0_f32.copysign(q[largest]);
    let byte = |v: f32| ((sign * v / std::f32::consts::SQRT_2 + 0.5) * 255.0).round() as u8;
    let mut smaller = (0..4).filter(|&k| k != largest).map(|k| byte(q[k]));
    let [a, b, c] = std::array::from_fn(|_| smaller.next().unwrap_or(0));
    [a, b, c, LARGEST + largest as u8]
}

/// The names of the images that [`encode`] makes of scenes of this degree.
pub(crate) fn image_names(sh_degree: u8) -> &'static [&'static str] {
    const NAMES: [&str; 7] = [
        "means_l.webp",
        "means_u.webp",
        "scales.webp",
        "quats.webp",
        "sh0.webp",
        "shN_centroids.webp",
        "shN_labels.webp",
    ];
    if sh_degree == 0 { &NAMES[..5] } else { &NAMES }
}

/// Encodes a scene as a bundle, or as `meta.json` with the images beside it.
pub(crate) fn encode(to: &ToWrite<'_>) -> Result<Encoded3d, Error> {
    encode_runs(to, &[to.scene.len()])
}

/// Encodes a scene as [`encode`] does, but sorts the Gaussians only within runs of these lengths, which
/// follow each other.
pub(super) fn encode_runs(
    &ToWrite { format, path, scene, options }: &ToWrite<'_>,
    runs: &[usize],
) -> Result<Encoded3d, Error> {
    let rotations = UnitRotations::new(scene, path)?;
    let trained_with = &options.trained_with;
    let count = u32::try_from(scene.len()).ok().filter(|&count| count <= PlaneSize::MAX_PIXELS);
    let too_many = || Error::unsupported(path, format!("a SOG of {} Gaussians", scene.len()), "write a PLY");
    let count = count.ok_or_else(too_many)?;
    let (scene, clamped) = without_extremes(scene);
    let scene = &*scene;
    let grid = Grid::around(&scene.means);
    let words: Vec<[u16; 3]> = scene.means.iter().map(|&mean| grid.words(mean)).collect();
    let order = order::along_morton_curve(&words, runs);
    let size = PlaneSize::for_count(scene.len());
    let mut files = Vec::new();
    let image = |pixel: &dyn Fn(usize) -> [u8; 4]| size.encode(order.iter().map(|&i| pixel(i as usize)));

    let half = |i: usize, part: usize| {
        let [x, y, z] = words[i].map(|word| word.to_le_bytes()[part]);
        [x, y, z, 255]
    };
    files.push(("means_l.webp", image(&|i| half(i, 0))));
    files.push(("means_u.webp", image(&|i| half(i, 1))));

    let scales = Codebook::of(scene.log_scales.iter().flat_map(|scales| scales.to_array()).collect());
    let coded = |book: &Codebook, v: Vec3| v.to_array().map(|v| book.index(v));
    let opaque = |[a, b, c]: [u8; 3], d: u8| [a, b, c, d];
    files.push(("scales.webp", image(&|i| opaque(coded(&scales, scene.log_scales[i]), 255))));
    files.push(("quats.webp", image(&|i| pixel_of_rotation(rotations.get(i)))));

    let len = scene.sh_len();
    let colors = Codebook::of(scene.sh.iter().step_by(len).flat_map(|color| color.to_array()).collect());
    let color = |i: usize| opaque(coded(&colors, scene.sh[i * len]), byte_of_logit(scene.opacity_logits[i]));
    files.push(("sh0.webp", image(&color)));

    let mut palette = None;
    if scene.sh_degree > 0 {
        let clusters = Clusters::of(scene, MAX_PALETTE);
        let book = Codebook::of(clusters.centroids.iter().flat_map(|c| c.to_array()).collect());
        let rows = clusters.centroids.len() / (len - 1);
        let lines = PlaneSize { width: PALETTE_COLUMNS * (len - 1), height: rows.div_ceil(PALETTE_COLUMNS) };
        let pixels = clusters.centroids.iter().map(|&c| opaque(coded(&book, c), 255));
        files.push(("shN_centroids.webp", lines.encode(pixels)));
        let label = |i: usize| {
            let [low, high] = clusters.labels[i].to_le_bytes();
            [low, high, 0, 255]
        };
        files.push(("shN_labels.webp", image(&label)));
        let named = ["shN_centroids.webp", "shN_labels.webp"].map(str::to_owned).to_vec();
        palette = Some(Palette { count: rows as u32, bands: scene.sh_degree, codebook: book.values(), files: named });
    }
    let mut losses = losses(scene, trained_with, palette.as_ref(), &rotations);
    losses.extend(clamped);
    let named = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
    let meta = Meta {
        version: meta::VERSION,
        count,
        antialias: trained_with.antialias.map(|_| trained_with.spz_flag()),
        means: Means { mins: grid.mins, maxs: grid.maxs, files: named(&["means_l.webp", "means_u.webp"]) },
        scales: Coded { codebook: scales.values(), files: named(&["scales.webp"]) },
        quats: Named { files: named(&["quats.webp"]) },
        sh0: Coded { codebook: colors.values(), files: named(&["sh0.webp"]) },
        sh_n: palette,
    };
    let mut encoded = if format == Format3d::SogFolder {
        let beside = files.into_iter().map(|(name, bytes)| (path.with_file_name(name), bytes)).collect();
        Encoded3d::of(format, meta.text(), losses).beside(beside)
    } else {
        // Readers of streams need the description first.
        files.insert(0, (META, meta.text()));
        Encoded3d::of(format, bundled(&files).map_err(|source| Error::write(path, source))?, losses)
    };
    encoded.written.order = Some(order);
    Ok(encoded)
}

/// The scene with coefficients of at most [`EXTREME_COLOR`]. One of 1e20 would leave no bits of a sum for the
/// others, and so spoil the palette for all.
fn without_extremes(scene: &Scene3d) -> (Cow<'_, Scene3d>, Vec<ConversionLoss>) {
    if !scene.sh.iter().any(|c| c.abs().max_element() > EXTREME_COLOR) {
        return (Cow::Borrowed(scene), Vec::new());
    }
    let [mut constant, mut others] = ["coefficients of degree 0", "coefficients above degree 0"]
        .map(|what| Clamp::new(what, -EXTREME_COLOR, EXTREME_COLOR, 0.0));
    let (mut clamped, len) = (scene.clone(), scene.sh_len());
    for (k, c) in clamped.sh.iter_mut().enumerate() {
        let clamp = if k % len == 0 { &mut constant } else { &mut others };
        *c = c.map(|v| clamp.apply(v));
    }
    (Cow::Owned(clamped), [constant, others].iter().filter_map(Clamp::loss).collect())
}

fn losses(
    scene: &Scene3d,
    trained_with: &TrainedWith,
    palette: Option<&Palette>,
    rotations: &UnitRotations<'_>,
) -> Vec<ConversionLoss> {
    let rounded = |what, to: &str| ConversionLoss::Rounded { what, to: to.to_owned() };
    let mut losses = vec![
        rounded("means", "16 bits along each axis"),
        rounded("scales", "256 values"),
        rounded("rotations", "26 bits"),
        rounded("opacities", "8 bits"),
        rounded("colours", "256 values"),
    ];
    if let Some(palette) = palette {
        losses.push(rounded("higher SH coefficients", &format!("a palette of {}", palette.count)));
    }
    losses.extend(rotations.loss());
    let kept = match trained_with.antialias {
        Some(_) => TrainedWith::of_spz_flag(trained_with.spz_flag()),
        None => TrainedWith::default(),
    };
    losses.extend(trained_with.lost(&kept));
    debug_assert!(scene.sh_degree == 0 || palette.is_some());
    losses
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_come_back_up_to_their_sign() {
        let half = [0.5_f32, -0.5, 0.5, -0.5];
        for q in [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.6, -0.8], half, [-0.8, 0.36, 0.48, 0.0]] {
            let back = rotation(&pixel_of_rotation(q)).unwrap();
            let cosine: f32 = q.iter().zip(back).map(|(a, b)| a * b).sum();
            assert!(cosine.abs() > 0.999_9, "{q:?} {back:?}");
            // Of equal components, another may be the largest after rounding.
            assert!(q == half || pixel_of_rotation(back) == pixel_of_rotation(q), "{q:?}");
        }
        assert_eq!(rotation(&[128, 128, 128, 251]), None);
    }
}
