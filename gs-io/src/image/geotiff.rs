//! Images as TIFF files, and the places of their pixels on a map: GeoTIFF tags and world files.

use std::{
    io::{self, Cursor},
    path::{Path, PathBuf},
};

use glam::DVec2;
use gs_core::{Image, check_len, to_8_bits};
use tiff::{
    TiffResult,
    encoder::{Compression, DeflateLevel, Predictor, TiffEncoder, colortype},
    tags::{ExtraSamples, Tag},
};

use crate::{atomic::write_atomically, error::Error};

/// Where the pixels of an image are on a map.
///
/// Column `i` and row `j` are at `corner + i · column + j · row`. Whole numbers are the corners of
/// pixels; their centres are at ½.
///
/// ```
/// use glam::dvec2;
/// use gs_io::GeoReference;
///
/// // North is up, and a pixel is 0.5 m wide.
/// let (corner, column, row) = (dvec2(512_300.0, 5_412_400.0), dvec2(0.5, 0.0), dvec2(0.0, -0.5));
/// let place = GeoReference { corner, column, row, epsg: Some(32632) };
/// assert_eq!(place.world_file(), "0.5\n0\n0\n-0.5\n512300.25\n5412399.75\n");
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeoReference {
    /// Easting and northing of the upper left corner of the upper left pixel, map units; finite.
    pub corner: DVec2,
    /// The step from a pixel to the one to its right, map units; finite and not 0.
    pub column: DVec2,
    /// The step from a pixel to the one below, map units; finite and not parallel to `column`.
    pub row: DVec2,
    /// EPSG code of the projected coordinate system, 1024 to 32766; `None` where it is not known.
    pub epsg: Option<u16>,
}

impl GeoReference {
    /// The text of a world file, which GIS programs read next to an image.
    ///
    /// Its six lines are the steps per column in x and y, the steps per row in x and y, and the
    /// centre of the upper left pixel (<https://en.wikipedia.org/wiki/World_file>). It does not name
    /// the coordinate system.
    pub fn world_file(&self) -> String {
        let Self { corner, column, row, .. } = *self;
        let center = corner + 0.5 * (column + row);
        let lines = [column.x, column.y, row.x, row.y, center.x, center.y];
        // Adding 0 makes 0 of -0.
        lines.map(|number| format!("{}\n", number + 0.0)).concat()
    }

    /// The tags of GeoTIFF 1.1 (OGC 19-008r4, clause 7.3) that contain doubles: a pixel scale and a
    /// tie point if north is up and east is to the right, otherwise a matrix.
    fn doubles(&self) -> Vec<(Tag, Vec<f64>)> {
        let Self { corner: DVec2 { x, y }, column, row, .. } = *self;
        if column.y == 0.0 && row.x == 0.0 && column.x > 0.0 && row.y < 0.0 {
            let tie_point = vec![0.0, 0.0, 0.0, x, y, 0.0];
            return vec![(Tag::ModelPixelScaleTag, vec![column.x, -row.y, 0.0]), (Tag::ModelTiepointTag, tie_point)];
        }
        let rows = [[column.x, row.x, 0.0, x], [column.y, row.y, 0.0, y], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
        vec![(Tag::ModelTransformationTag, rows.concat())]
    }

    /// The GeoKey directory of GeoTIFF 1.1 (clause 7.1.2): version 1.1.1 and three keys.
    fn keys(&self) -> Vec<u16> {
        let model_type = [1024, 0, 1, 1]; // a projected system
        let raster_type = [1025, 0, 1, 1]; // pixels are areas
        let projected_crs = [3072, 0, 1, self.epsg.unwrap_or(0)]; // 0: intentionally omitted
        [[1, 1, 1, 3], model_type, raster_type, projected_crs].concat()
    }
}

/// Writes an 8-bit TIFF, atomically: RGB, or RGBA with `alpha`.
///
/// `alpha` is `[height · width]`, row-major. Colours are not multiplied by it. With a `place` on a
/// map, the file is a GeoTIFF 1.1 whose pixels are areas.
///
/// Values are clamped to 0..=1 and rounded to the nearest of 256 steps; NaN becomes 0. The file is
/// compressed by Deflate.
///
/// # Errors
/// Those of [`write_atomically`]; [`Error::Content`] for an alpha that is not as long as the image.
pub fn write_tiff(
    path: impl AsRef<Path>,
    image: &Image,
    alpha: Option<&[f32]>,
    place: Option<&GeoReference>,
) -> Result<(), Error> {
    let path = path.as_ref();
    let pixels = image.pixels().len();
    check_len("alpha", pixels, alpha.map_or(pixels, <[f32]>::len)).map_err(Error::content(path))?;
    write_atomically(path, |file| {
        let bytes = match alpha {
            None => encode::<colortype::RGB8>(image, image.pixels().as_flattened().iter().copied(), place),
            Some(alpha) => {
                let pixels = image.pixels().iter().zip(alpha);
                encode::<colortype::RGBA8>(image, pixels.flat_map(|([r, g, b], a)| [*r, *g, *b, *a]), place)
            }
        };
        file.write_all(&bytes.map_err(io::Error::other)?)
    })
}

/// The bytes of a TIFF with these samples.
fn encode<C: colortype::ColorType<Inner = u8>>(
    image: &Image,
    samples: impl Iterator<Item = f32>,
    place: Option<&GeoReference>,
) -> TiffResult<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    let encoder = TiffEncoder::new(&mut bytes)?.with_compression(Compression::Deflate(DeflateLevel::Fast));
    let mut encoder = encoder.with_predictor(Predictor::Horizontal);
    let mut encoder = encoder.new_image::<C>(image.width(), image.height())?;
    let tags = encoder.encoder();
    if C::BITS_PER_SAMPLE.len() == 4 {
        tags.write_tag(Tag::ExtraSamples, ExtraSamples::UnassociatedAlpha.to_u16())?;
    }
    if let Some(place) = place {
        for (tag, numbers) in place.doubles() {
            tags.write_tag(tag, &numbers[..])?;
        }
        tags.write_tag(Tag::GeoKeyDirectoryTag, &place.keys()[..])?;
    }
    encoder.write_data(&samples.map(to_8_bits).collect::<Vec<u8>>())?;
    Ok(bytes.into_inner())
}

/// Writes the world file of a picture next to it, atomically, and returns the path of that file.
///
/// It is `plan.pgw` for `plan.png`, and `plan.tfw` for `plan.tif` and `plan.tiff`. For other names,
/// nothing is written.
///
/// # Errors
/// Those of [`write_atomically`].
pub fn write_world_file(picture: impl AsRef<Path>, place: &GeoReference) -> Result<Option<PathBuf>, Error> {
    let picture = picture.as_ref();
    let ending = match picture.extension().and_then(|ending| ending.to_str()).map(str::to_lowercase).as_deref() {
        Some("png") => "pgw",
        Some("tif" | "tiff") => "tfw",
        _ => return Ok(None),
    };
    let path = picture.with_extension(ending);
    write_atomically(&path, |file| file.write_all(place.world_file().as_bytes()))?;
    Ok(Some(path))
}

#[cfg(test)]
mod tests {
    use std::{fs, fs::File};

    use glam::dvec2;
    use tiff::decoder::Decoder;

    use super::*;

    /// A coloured picture with a north that is up, 0.25 to a pixel.
    fn picture_and_place() -> (Image, GeoReference) {
        let image = Image::from_fn(7, 5, |x, y| [x as f32 / 6.0, y as f32 / 4.0, 0.2]).unwrap();
        let (corner, column, row) = (dvec2(512_345.125, 5_412_345.1 + 1e-7), dvec2(0.25, 0.0), dvec2(0.0, -0.25));
        (image, GeoReference { corner, column, row, epsg: None })
    }

    #[test]
    fn a_geotiff_has_the_tags_of_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plan.tif");
        let (image, place) = picture_and_place();
        let written = |place: Option<&GeoReference>| {
            write_tiff(&path, &image, None, place).unwrap();
            Decoder::new(File::open(&path).unwrap()).unwrap()
        };
        let mut file = written(Some(&place));
        assert_eq!(file.get_tag_f64_vec(Tag::ModelPixelScaleTag).unwrap(), [0.25, 0.25, 0.0]);
        let tie_point = file.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap();
        assert_eq!(tie_point, [0.0, 0.0, 0.0, place.corner.x, place.corner.y, 0.0]);
        let keys = file.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).unwrap();
        assert_eq!(keys, [1, 1, 1, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 0]);
        assert!(file.find_tag(Tag::ModelTransformationTag).unwrap().is_none());

        // From below, x runs to the left; a turned plan is a matrix, too.
        let (column, row) = (dvec2(-0.25, 0.0), dvec2(0.0, -0.25));
        let mut file = written(Some(&GeoReference { column, row, epsg: Some(32632), ..place }));
        assert!(file.find_tag(Tag::ModelPixelScaleTag).unwrap().is_none());
        let matrix = file.get_tag_f64_vec(Tag::ModelTransformationTag).unwrap();
        assert_eq!(matrix[..8], [-0.25, 0.0, 0.0, place.corner.x, 0.0, -0.25, 0.0, place.corner.y]);
        assert_eq!(matrix[8..], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!(file.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).unwrap()[15], 32632);

        assert!(written(None).find_tag(Tag::GeoKeyDirectoryTag).unwrap().is_none());
    }

    #[test]
    fn pixels_of_a_tiff_are_those_of_a_png() {
        let folder = tempfile::tempdir().unwrap();
        let [tiff, png] = ["plan.tif", "plan.png"].map(|name| folder.path().join(name));
        let (image, place) = picture_and_place();
        let alpha: Vec<f32> = (0..35).map(|i| i as f32 / 34.0).collect();
        for alpha in [None, Some(&alpha[..])] {
            write_tiff(&tiff, &image, alpha, Some(&place)).unwrap();
            crate::write_png_with(&png, &image, crate::PngExtras { alpha, profile: None }).unwrap();
            assert_eq!(crate::read_stored_image(&tiff).unwrap(), crate::read_stored_image(&png).unwrap());
        }
        let mut file = Decoder::new(File::open(&tiff).unwrap()).unwrap();
        assert_eq!(file.get_tag_u32(Tag::ExtraSamples).unwrap(), 2, "unassociated alpha");
        let error = write_tiff(&tiff, &image, Some(&alpha[1..]), None).unwrap_err();
        assert!(matches!(error, Error::Content { .. }), "{error}");
    }

    #[test]
    fn world_files_are_named_after_their_picture() {
        let folder = tempfile::tempdir().unwrap();
        let (_, place) = picture_and_place();
        for (picture, expected) in [("a.png", "a.pgw"), ("a.b.TIF", "a.b.tfw"), ("c.tiff", "c.tfw")] {
            let path = write_world_file(folder.path().join(picture), &place).unwrap().unwrap();
            assert_eq!(path, folder.path().join(expected));
            assert_eq!(fs::read_to_string(path).unwrap(), place.world_file());
        }
        assert_eq!(write_world_file(folder.path().join("plan"), &place).unwrap(), None);
        let numbers: Vec<f64> = place.world_file().lines().map(|line| line.parse().unwrap()).collect();
        let center = place.corner + dvec2(0.125, -0.125);
        assert_eq!(numbers, [0.25, 0.0, 0.0, -0.25, center.x, center.y]);
    }
}
