//! Reads rows of a PLY's elements in any of its three encodings.

use super::header::{Element, Encoding, Header, Value};
use crate::{
    error::Error,
    scene3d::{source::Source, values::Number},
};

/// Calls `row` with the chosen columns of each row of the element at `start`, and returns where the
/// next element starts; where an element has no columns at all, there are no rows to call it with,
/// whatever their number. Numbers of all types fit an `f64`. How many rows there can be is held
/// against the file's size first, so `row` may allocate.
///
/// `wanted` are indices of scalar properties.
pub(crate) fn read(
    source: &Source<'_>,
    header: &Header,
    element: &Element,
    start: usize,
    wanted: &[usize],
    row: impl FnMut(&[f64]),
) -> Result<usize, Error> {
    for &column in wanted {
        let property = &element.properties[column];
        if let Value::List(..) = property.value {
            let expected = format!("one number as property {}", property.name);
            return Err(source.damaged(property.byte, expected, "a list"));
        }
    }
    let left = source.bytes.len() - start;
    // In text, a number takes a character and, except the last, a space.
    let (least, more) = match header.encoding {
        Encoding::Ascii => (2 * element.properties.len(), 1),
        _ => (element.properties.iter().map(least_bytes).sum(), 0),
    };
    if element.count.saturating_mul(least as u64) > left as u64 + more {
        let expected = format!("{} rows of element {}", element.count, element.name);
        return Err(source.damaged(source.bytes.len(), expected, format!("the end of the file, {left} bytes on")));
    }
    if element.properties.is_empty() {
        return Ok(start);
    }
    match header.encoding {
        Encoding::Ascii => read_text(source, element, start, wanted, row),
        Encoding::LittleEndian => read_binary::<true>(source, element, start, wanted, row),
        Encoding::BigEndian => read_binary::<false>(source, element, start, wanted, row),
    }
}

/// Smallest size of a property in a binary row, bytes.
fn least_bytes(property: &super::header::Property) -> usize {
    match property.value {
        Value::Scalar(number) | Value::List(number, _) => number.bytes(),
    }
}

/// The index of each property among the wanted ones; a property may be wanted once only.
fn targets(element: &Element, wanted: &[usize]) -> Vec<Option<usize>> {
    (0..element.properties.len()).map(|column| wanted.iter().position(|&w| w == column)).collect()
}

fn read_binary<const LITTLE: bool>(
    source: &Source<'_>,
    element: &Element,
    start: usize,
    wanted: &[usize],
    mut row: impl FnMut(&[f64]),
) -> Result<usize, Error> {
    let has_lists = element.properties.iter().any(|p| matches!(p.value, Value::List(..)));
    let mut numbers = vec![0.0; wanted.len()];
    if !has_lists {
        let offsets: Vec<usize> =
            element.properties.iter().scan(0, |end, p| Some(std::mem::replace(end, *end + least_bytes(p)))).collect();
        let stride: usize = element.properties.iter().map(least_bytes).sum();
        let columns: Vec<(usize, Number)> =
            wanted.iter().map(|&w| (offsets[w], scalar_of(element.properties[w].value))).collect();
        let rows = source.slice(start, element.count.saturating_mul(stride as u64), &element.name)?;
        let all_floats = LITTLE && columns.iter().all(|&(_, kind)| kind == Number::F32);
        for bytes in rows.chunks_exact(stride) {
            if all_floats {
                // What 3DGS writes; a decision per number would take most of the time.
                for (number, &(offset, _)) in numbers.iter_mut().zip(&columns) {
                    let [a, b, c, d] = [bytes[offset], bytes[offset + 1], bytes[offset + 2], bytes[offset + 3]];
                    *number = f32::from_le_bytes([a, b, c, d]).into();
                }
            } else {
                for (number, &(offset, kind)) in numbers.iter_mut().zip(&columns) {
                    *number = kind.decode::<LITTLE>(&bytes[offset..]);
                }
            }
            row(&numbers);
        }
        return Ok(start + rows.len());
    }
    let targets = targets(element, wanted);
    let mut at = start;
    for _ in 0..element.count {
        for (property, target) in element.properties.iter().zip(&targets) {
            match property.value {
                Value::Scalar(kind) => {
                    let value = kind.decode::<LITTLE>(source.slice(at, kind.bytes() as u64, &property.name)?);
                    at += kind.bytes();
                    if let Some(target) = *target {
                        numbers[target] = value;
                    }
                }
                Value::List(length, item) => {
                    let items = length.decode::<LITTLE>(source.slice(at, length.bytes() as u64, &property.name)?);
                    let items = check_length(source, at, items)?;
                    at += length.bytes();
                    at += source.slice(at, items.saturating_mul(item.bytes() as u64), &property.name)?.len();
                }
            }
        }
        row(&numbers);
    }
    Ok(at)
}

fn read_text(
    source: &Source<'_>,
    element: &Element,
    start: usize,
    wanted: &[usize],
    mut row: impl FnMut(&[f64]),
) -> Result<usize, Error> {
    let targets = targets(element, wanted);
    let mut words = Words { source, at: start };
    let mut numbers = vec![0.0; wanted.len()];
    for _ in 0..element.count {
        for (property, target) in element.properties.iter().zip(&targets) {
            match property.value {
                Value::Scalar(_) => {
                    let value = words.number()?;
                    if let Some(target) = *target {
                        numbers[target] = value;
                    }
                }
                Value::List(..) => {
                    let items = words.number()?;
                    for _ in 0..check_length(source, words.at, items)? {
                        words.number()?;
                    }
                }
            }
        }
        row(&numbers);
    }
    Ok(words.at)
}

fn scalar_of(value: Value) -> Number {
    match value {
        Value::Scalar(number) | Value::List(_, number) => number,
    }
}

fn check_length(source: &Source<'_>, byte: usize, length: f64) -> Result<u64, Error> {
    if length >= 0.0 && length.fract() == 0.0 && length <= f64::from(u32::MAX) {
        return Ok(length as u64);
    }
    Err(source.damaged(byte, "the length of a list", format!("{length}")))
}

/// Numbers in text, separated by white space.
struct Words<'a> {
    source: &'a Source<'a>,
    at: usize,
}

impl Words<'_> {
    fn number(&mut self) -> Result<f64, Error> {
        let bytes = self.source.bytes;
        let rest = &bytes[self.at..];
        let start = self.at + rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
        let len = bytes[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(bytes.len() - start);
        self.at = start + len;
        let word = &bytes[start..self.at];
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.ok_or_else(|| {
            let found = match len {
                0 => "the end of the file".to_owned(),
                _ => format!("{:?}", String::from_utf8_lossy(&word[..len.min(40)])),
            };
            self.source.damaged(start, "a number", found)
        })
    }
}
