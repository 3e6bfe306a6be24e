//! The colour space that an image file declares, and conversion to sRGB.
//!
//! In PNG, cICP takes precedence over an ICC profile, that over sRGB, and that over gAMA and cHRM.
//! *Source:* the PNG specification, third edition, §4.3.

use std::sync::{Arc, Mutex, PoisonError};

use moxcms::{
    Chromaticity, CicpProfile, ColorPrimaries, ColorProfile, DataColorSpace, Layout, MatrixCoefficients, ProfileText,
    RenderingIntent, ToneReprCurve, TransformF32Executor, TransformOptions, XyY,
};

use super::{IccProfile, ImageRemark};

/// Largest change of a colour by which a conversion is skipped, so that colours stay bit-identical:
/// one step of 8 bits. Profiles and conversions are rounded, too.
const SAME: f32 = 1.0 / 255.0;

/// Relative tolerance within which a PNG's gamma counts as 1/2.2, that of sRGB: libpng's threshold.
/// Files have 0.45455.
const GAMMA_TOLERANCE: f64 = 0.05;

/// Longest profile with which colours are kept: those of cameras, screens and editors have less, and
/// longer ones weigh too much in a small file.
const MOST_KEPT_BYTES: usize = 4096;

/// Pixels per call of the conversion.
const CHUNK: usize = 4096;

/// The transfer functions of HDR (ITU-T H.273): PQ and HLG.
const HDR: [u8; 2] = [16, 18];

/// The last ICC profile with its conversion. The images of a data set share their profile, and
/// building its tables takes milliseconds.
static LAST: Mutex<Option<(Vec<u8>, Colors)>> = Mutex::new(None);

/// How an image's colours are converted.
#[derive(Clone)]
pub(super) enum Colors {
    /// Not at all: they are sRGB, or the file declares nothing.
    AsStored,
    /// To sRGB, by this conversion.
    Converted(Conversion),
    /// Not at all: they are in a colour space that cannot be converted, for this reason.
    Ignored(String),
}

/// A conversion to sRGB.
#[derive(Clone)]
pub(super) struct Conversion {
    transform: Arc<TransformF32Executor>,
    /// Whether the input is grey.
    grey: bool,
    from: String,
    /// The profile, if colours can be kept as they are with it.
    profile: Option<IccProfile>,
}

impl Colors {
    /// The colours of an image with this ICC profile.
    pub(super) fn of_profile(icc: &[u8]) -> Self {
        let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, colors)) = last.as_ref().filter(|(known, _)| known == icc) {
            return colors.clone();
        }
        let colors = match ColorProfile::new_from_slice(icc) {
            Ok(profile) => Self::of(&profile, name_of(&profile)).beside(icc, &profile),
            Err(error) => Self::Ignored(format!("the file has a colour profile, which is damaged ({error})")),
        };
        *last = Some((icc.to_vec(), colors.clone()));
        colors
    }

    /// The colours that a PNG's chunks declare.
    pub(super) fn of_png(info: &png::Info<'_>) -> Self {
        if let Some(points) = info.coding_independent_code_points {
            return Self::of_code_points(points);
        }
        match (&info.icc_profile, info.srgb) {
            (Some(icc), _) => Self::of_profile(icc),
            (None, Some(_)) => Self::AsStored,
            (None, None) => Self::of_gamma(info),
        }
    }

    fn of_code_points(points: png::CodingIndependentCodePoints) -> Self {
        let png::CodingIndependentCodePoints { color_primaries, transfer_function, .. } = points;
        let name = format!("CICP {color_primaries}/{transfer_function}");
        if HDR.contains(&transfer_function) || !points.is_video_full_range_image {
            return Self::Ignored(format!("the file says {name}, which is HDR or video and has no place in sRGB"));
        }
        let profile = color_primaries.try_into().and_then(|color_primaries| {
            Ok(ColorProfile::new_from_cicp(CicpProfile {
                color_primaries,
                transfer_characteristics: transfer_function.try_into()?,
                matrix_coefficients: MatrixCoefficients::Bt709,
                full_range: true,
            }))
        });
        match profile {
            Ok(profile) => Self::of(&profile, name),
            Err(_) => Self::Ignored(format!("the file says {name}, which is not known")),
        }
    }

    /// Colours by gAMA and cHRM. If one of them is missing, sRGB's is used.
    fn of_gamma(info: &png::Info<'_>) -> Self {
        let gamma = info.gama_chunk.map(|gamma| f64::from(gamma.into_scaled()) / 1e5);
        let gamma = gamma.filter(|gamma| (gamma * 2.2 - 1.0).abs() > GAMMA_TOLERANCE);
        let mut profile = ColorProfile::new_srgb();
        let mut names = Vec::new();
        if let Some(png::SourceChromaticities { white, red, green, blue }) = info.chrm_chunk {
            let point =
                |(x, y): (png::ScaledFloat, png::ScaledFloat)| Chromaticity::new(x.into_value(), y.into_value());
            let white = XyY::new(white.0.into_value().into(), white.1.into_value().into(), 1.0);
            let primaries = ColorPrimaries { red: point(red), green: point(green), blue: point(blue) };
            profile.update_rgb_colorimetry(white, primaries);
            names.push("other primaries (cHRM)".to_owned());
        }
        if let Some(gamma) = gamma {
            let curve = ToneReprCurve::Parametric(vec![(1.0 / gamma) as f32]);
            profile.cicp = None;
            profile.red_trc = Some(curve.clone());
            profile.green_trc = Some(curve.clone());
            profile.blue_trc = Some(curve);
            names.insert(0, format!("gamma {:.2} (gAMA)", 1.0 / gamma));
        }
        if names.is_empty() { Self::AsStored } else { Self::of(&profile, names.join(" and ")) }
    }

    /// The colours of a profile with this name.
    fn of(profile: &ColorProfile, name: String) -> Self {
        let layout = match profile.color_space {
            DataColorSpace::Rgb => Layout::Rgb,
            DataColorSpace::Gray => Layout::Gray,
            _ => return Self::Ignored(format!("the file has {name}, which is not for RGB or grey")),
        };
        let intents = [RenderingIntent::RelativeColorimetric, RenderingIntent::Perceptual, RenderingIntent::Saturation];
        let transform = intents.into_iter().find_map(|rendering_intent| {
            let options = TransformOptions { rendering_intent, prefer_fixed_point: false, ..Default::default() };
            profile.create_transform_f32(layout, &ColorProfile::new_srgb(), Layout::Rgb, options).ok()
        });
        let Some(transform) = transform else {
            return Self::Ignored(format!("the file has {name}, which cannot be converted"));
        };
        let conversion = Conversion { transform, grey: layout == Layout::Gray, from: name, profile: None };
        let probes = probes(conversion.grey);
        let mut converted = probes.clone();
        conversion.apply(&mut converted);
        let differences = probes.as_flattened().iter().zip(converted.as_flattened()).map(|(a, b)| (a - b).abs());
        if differences.fold(0.0, f32::max) <= SAME { Self::AsStored } else { Self::Converted(conversion) }
    }

    /// These colours, which a file may keep with their profile if that is a matrix and curves.
    fn beside(mut self, icc: &[u8], profile: &ColorProfile) -> Self {
        if let Self::Converted(conversion) = &mut self
            && profile.is_matrix_shaper()
            && profile.lut_a_to_b_perceptual.is_none()
            && profile.lut_a_to_b_colorimetric.is_none()
            && profile.lut_a_to_b_saturation.is_none()
        {
            conversion.profile = IccProfile::new(icc).filter(|icc| icc.bytes().len() <= MOST_KEPT_BYTES);
        }
        self
    }

    /// The profile with which the colours can be kept as they are.
    pub(super) fn profile(&self) -> Option<&IccProfile> {
        match self {
            Self::Converted(conversion) => conversion.profile.as_ref(),
            Self::AsStored | Self::Ignored(_) => None,
        }
    }

    /// Converts pixels to sRGB. Colours outside sRGB are clamped, channel by channel.
    pub(super) fn apply(&self, pixels: &mut [[f32; 3]]) {
        if let Self::Converted(conversion) = self {
            conversion.apply(pixels);
        }
    }

    /// The remark on the conversion.
    pub(super) fn remark(&self) -> Option<ImageRemark> {
        match self {
            Self::AsStored => None,
            Self::Converted(Conversion { from, .. }) => Some(ImageRemark::Converted { from: from.clone() }),
            Self::Ignored(why) => Some(ImageRemark::ProfileIgnored { why: why.clone() }),
        }
    }
}

impl Conversion {
    fn apply(&self, pixels: &mut [[f32; 3]]) {
        let mut stored = Vec::with_capacity(3 * CHUNK);
        for pixels in pixels.chunks_mut(CHUNK) {
            stored.clear();
            if self.grey {
                stored.extend(pixels.iter().map(|pixel| pixel[0]));
            } else {
                stored.extend_from_slice(pixels.as_flattened());
            }
            // The transform only fails if the lengths differ, which they do not.
            if self.transform.transform(&stored, pixels.as_flattened_mut()).is_ok() {
                let within = |value: f32| if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) };
                pixels.as_flattened_mut().iter_mut().for_each(|value| *value = within(*value));
            }
        }
    }
}

/// Colours that show whether a conversion changes anything: all greys of 8 bits, and a coarse cube.
fn probes(grey: bool) -> Vec<[f32; 3]> {
    let greys = (0..256_u16).map(|value| [f32::from(value) / 255.0; 3]);
    if grey {
        return greys.collect();
    }
    let level = |i: u16| f32::from(i) / 8.0;
    let cube = (0..9 * 9 * 9).map(|i| [level(i / 81), level(i / 9 % 9), level(i % 9)]);
    greys.chain(cube).collect()
}

/// What messages call a profile.
fn name_of(profile: &ColorProfile) -> String {
    match title(profile) {
        Some(title) => format!("the colour profile {title}"),
        None => "a colour profile without a name".to_owned(),
    }
}

/// The name in a profile.
pub(super) fn title(profile: &ColorProfile) -> Option<String> {
    let name = match profile.description.as_ref()? {
        ProfileText::PlainString(text) => text.as_str(),
        ProfileText::Localizable(texts) => texts.first().map_or("", |text| text.value.as_str()),
        ProfileText::Description(text) => text.ascii_string.as_str(),
    };
    let name: String = name.trim_matches(['\0', ' ']).chars().take(60).collect();
    Some(name).filter(|name| !name.is_empty())
}
