//! Values of flags: numbers in a range, sizes, rectangles, colours, views, axes.

use std::{
    fmt,
    ops::{Bound, RangeBounds},
    path::PathBuf,
    str::FromStr,
};

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use glam::{Vec2, Vec3};
use gs_core::{Canvas, Choice};

use crate::failure::Failure;

/// A parser of whole numbers in this range. Its errors name the range.
pub(crate) fn whole<T: Copy + Into<i128> + TryFrom<i128>>(
    range: impl RangeBounds<T>,
) -> impl Fn(&str) -> Result<T, String> + Clone {
    let end = |bound: Bound<&T>| match bound {
        Bound::Included(&value) => Some(value.into()),
        Bound::Excluded(&value) => Some(value.into() - 1),
        Bound::Unbounded => None,
    };
    let (least, most): (i128, Option<i128>) = (end(range.start_bound()).unwrap_or(0), end(range.end_bound()));
    move |text| {
        let in_range = |value: &i128| *value >= least && most.is_none_or(|most| *value <= most);
        let value = text.trim().parse::<i128>().map_err(|_| "must be a whole number".to_owned())?;
        match (Some(value).filter(in_range).and_then(|value| T::try_from(value).ok()), most) {
            (Some(value), _) => Ok(value),
            (None, Some(most)) => Err(format!("must be from {least} to {most}")),
            (None, None) if value < least => Err(format!("must be at least {least}")),
            (None, None) => Err("is too large".to_owned()),
        }
    }
}

/// A parser of a setting of the libraries by name. The help lists all its values.
pub(crate) fn by_name<T: Choice>() -> impl TypedValueParser<Value = T> {
    one_of(T::CHOICES)
}

/// [`by_name`] for some of the values.
pub(crate) fn one_of<T: Choice>(choices: &'static [T]) -> impl TypedValueParser<Value = T> {
    let possible = choices.iter().map(|choice| PossibleValue::new(choice.name()).help(choice.summary()));
    PossibleValuesParser::new(possible).map(|name| T::from_name(&name).expect("it is one of the possible values"))
}

/// A parser of numbers of bytes, with k for thousands and M for millions.
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let (number, unit) = match text.char_indices().last() {
        Some((end, 'k' | 'K')) => (&text[..end], 1e3),
        Some((end, 'm' | 'M')) => (&text[..end], 1e6),
        Some((end, 'g' | 'G')) => (&text[..end], 1e9),
        _ => (text, 1.0),
    };
    match number.parse::<f64>() {
        Ok(count) if count > 0.0 && count * unit < 1e12 => Ok((count * unit) as u64),
        _ => Err("write it as a number of bytes, such as 40000, 40k, 1.5M or 4G".to_owned()),
    }
}

/// A parser of numbers above 0.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("must be a positive number".to_owned()),
    }
}

/// A size in pixels, written WxH.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Size {
    /// Columns, at least 1.
    pub(crate) width: u32,
    /// Rows, at least 1.
    pub(crate) height: u32,
}

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once(['x', 'X', '×']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
        match parsed {
            Some((width, height)) if width > 0 && height > 0 => Ok(Self { width, height }),
            _ => Err("write it as WIDTHxHEIGHT in whole pixels, such as 1536x1024".into()),
        }
    }
}

/// The canvas of a 2D scene of this size, in as many pixels unless a flag gives another number.
pub(crate) fn canvas((width, height): (u32, u32), size: Option<Size>) -> Result<Canvas, Failure> {
    let whole = Canvas::new(width, height);
    let canvas = size.map_or(whole, |Size { width, height }| whole.resized(width, height));
    canvas.validate().map_err(|error| Failure::usage(error).at("--size"))?;
    Ok(canvas)
}

/// A rectangle of the plane, written X,Y,W,H.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Region {
    /// Top-left corner, px of the original image.
    pub(crate) origin: Vec2,
    /// Width and height, px of the original image; both positive.
    pub(crate) extent: Vec2,
}

impl FromStr for Region {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match numbers::<4>(text) {
            Some([x, y, width, height]) if width > 0.0 && height > 0.0 => {
                Ok(Self { origin: Vec2::new(x, y), extent: Vec2::new(width, height) })
            }
            _ => Err("write it as X,Y,WIDTH,HEIGHT in pixels of the original image, such as 100,50,64,48".into()),
        }
    }
}

/// A colour, written R,G,B, or black or white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Color(pub(crate) [f32; 3]);

impl FromStr for Color {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "black" => return Ok(Self([0.0; 3])),
            "white" => return Ok(Self([1.0; 3])),
            _ => {}
        }
        match numbers::<3>(text) {
            Some(rgb) if rgb.iter().all(|v| (0.0..=1.0).contains(v)) => Ok(Self(rgb)),
            _ => Err("write it as R,G,B, each from 0 to 1, such as 1,1,1 for white".into()),
        }
    }
}

impl fmt::Display for Color {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            [0.0, 0.0, 0.0] => f.write_str("black"),
            [1.0, 1.0, 1.0] => f.write_str("white"),
            [r, g, b] => write!(f, "{r},{g},{b}"),
        }
    }
}

/// What is behind a 3D scene: a colour, or nothing, so that the picture has alpha.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Behind {
    /// One colour.
    Solid(Color),
    /// Nothing.
    None,
}

impl Behind {
    /// Parses what commands accept that write no alpha.
    pub(crate) fn solid(text: &str) -> Result<Self, String> {
        match text {
            "none" => Err("only gs render writes transparent pictures".to_owned()),
            _ => text.parse().map(Self::Solid),
        }
    }

    /// Parses what `gs render` accepts.
    pub(crate) fn any(text: &str) -> Result<Self, String> {
        match text {
            "none" => Ok(Self::None),
            _ => text.parse().map(Self::Solid).map_err(|error: String| format!("{error}; or none for alpha")),
        }
    }
}

/// A view of a data set, written DATASET:VIEW.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ViewName {
    /// The data set.
    pub(crate) dataset: PathBuf,
    /// The view's name in it, or the name of its file without the ending.
    pub(crate) view: String,
}

impl FromStr for ViewName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // The first colon may be that of a drive.
        match text.rsplit_once(':') {
            Some((dataset, view)) if !dataset.is_empty() && !view.is_empty() => {
                Ok(Self { dataset: dataset.into(), view: view.to_owned() })
            }
            _ => {
                Err("write it as DATASET:VIEW, such as images/:DSC_0042.JPG; gs info shows what is in a data set"
                    .into())
            }
        }
    }
}

/// A parser of times in minutes, above 0.
pub(crate) fn minutes(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(minutes) if minutes > 0.0 && minutes <= 1e6 => Ok(minutes),
        _ => Err("write a number of minutes above 0, such as 5 or 0.5".to_owned()),
    }
}

/// A parser of axes of space, written x, y, z, -x, -y or -z.
pub(crate) fn axis(text: &str) -> Result<Vec3, String> {
    match text {
        "x" => Ok(Vec3::X),
        "y" => Ok(Vec3::Y),
        "z" => Ok(Vec3::Z),
        "-x" => Ok(Vec3::NEG_X),
        "-y" => Ok(Vec3::NEG_Y),
        "-z" => Ok(Vec3::NEG_Z),
        _ => Err("write x, y, z, -x, -y or -z".to_owned()),
    }
}

/// Exactly `N` finite numbers between commas.
fn numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let values: Option<Vec<f32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    values?.try_into().ok().filter(|values: &[f32; N]| values.iter().all(|v| v.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_parsed() {
        assert_eq!("1536x1024".parse(), Ok(Size { width: 1536, height: 1024 }));
        assert_eq!("0, -1.5,2,3".parse(), Ok(Region { origin: Vec2::new(0.0, -1.5), extent: Vec2::new(2.0, 3.0) }));
        assert_eq!("1,0.5,0".parse(), Ok(Color([1.0, 0.5, 0.0])));
        assert_eq!("white".parse(), Ok(Color([1.0; 3])));
        let view = ViewName { dataset: "C:/dataset".into(), view: "a/b.png".to_owned() };
        assert_eq!("C:/dataset:a/b.png".parse(), Ok(view));
        assert_eq!(axis("-y"), Ok(Vec3::NEG_Y));
    }

    #[test]
    fn sizes_have_units() {
        assert_eq!(["40000", "40k", "1.5M", "4G"].map(bytes), [40_000, 40_000, 1_500_000, 4_000_000_000].map(Ok));
        for wrong in ["", "k", "-4k", "40kB", "1e30"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn errors_of_whole_numbers_name_the_range() {
        let count = whole::<u32>(1..);
        assert_eq!((count("7"), count("1")), (Ok(7), Ok(1)));
        for (text, expected) in [
            ("-5", "must be at least 1"),
            ("0", "must be at least 1"),
            ("4294967296", "is too large"),
            ("1.5", "must be a whole number"),
            ("", "must be a whole number"),
        ] {
            assert_eq!(count(text), Err(expected.to_owned()), "{text}");
        }
        let degree = whole::<u8>(0..=3);
        assert_eq!((degree("3"), degree("4")), (Ok(3), Err("must be from 0 to 3".to_owned())));
        assert_eq!(degree("-1"), Err("must be from 0 to 3".to_owned()));
    }

    #[test]
    fn impossible_values_are_refused() {
        for size in ["", "64", "0x4", "4x0", "-1x4", "4x4x4", "99999999999x1"] {
            assert!(size.parse::<Size>().is_err(), "{size}");
        }
        for region in ["", "1,2,3", "0,0,0,4", "0,0,4,-1", "0,0,nan,4", "0,0,inf,4", "1,2,3,4,5"] {
            assert!(region.parse::<Region>().is_err(), "{region}");
        }
        for color in ["", "1,1", "2,0,0", "NaN,0,0", "#fff"] {
            assert!(color.parse::<Color>().is_err(), "{color}");
        }
        for view in ["", "dataset", ":a", "dataset:"] {
            assert!(view.parse::<ViewName>().is_err(), "{view}");
        }
        assert!(axis("up").is_err());
    }
}
