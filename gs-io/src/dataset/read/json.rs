//! JSON as Python's `json.dump` and its like write it: with NaN, infinities and numbers in quotes.

use std::{borrow::Cow, path::Path};

use serde::{Deserialize, Deserializer, de::DeserializeOwned, de::Error as _};
use serde_json::Value;

use crate::{atomic::read_file, dataset::FILE, error::Error, text::utf8_text};

/// Literals of Python that JSON does not have, each with a string of the same length for which
/// [`number_of`] gives the number. Positions in messages stay right.
const LITERALS: [(&[u8], &[u8]); 3] =
    [(b"NaN", br#""N""#), (b"-Infinity", br#""-inf"   "#), (b"Infinity", br#""inf"   "#)];

/// A number, finite or not.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Number(pub(crate) f64);

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = Value::deserialize(deserializer)?;
        number_of(&value).map(Self).ok_or_else(|| D::Error::custom(format!("{} is not a number", shown(&value))))
    }
}

/// A matrix by rows; all numbers in one list are rows of four.
#[derive(Debug, Clone)]
pub(crate) struct Matrix(pub(crate) Vec<Vec<f64>>);

impl<'de> Deserialize<'de> for Matrix {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = Value::deserialize(deserializer)?;
        let row = |row: &Value| match row {
            Value::Array(numbers) => numbers.iter().map(number_of).collect::<Option<Vec<f64>>>(),
            Value::Null => Some(vec![f64::NAN; 4]),
            _ => None,
        };
        let is_flat = |values: &&Vec<Value>| values.iter().all(|value| value.is_number() || value.is_string());
        let rows = match value.as_array().filter(is_flat) {
            Some(_) => row(&value).map(|numbers| numbers.chunks(4).map(<[f64]>::to_vec).collect()),
            None => value.as_array().and_then(|rows| rows.iter().map(row).collect()),
        };
        rows.map(Self).ok_or_else(|| D::Error::custom(format!("{} is not a matrix of numbers", shown(&value))))
    }
}

/// The number of a value, which may be in quotes. `null` stands for NaN, as JavaScript writes it.
pub(crate) fn number_of(value: &Value) -> Option<f64> {
    match value {
        Value::Number(number) => number.as_f64(),
        Value::String(text) if text == "N" => Some(f64::NAN),
        Value::String(text) => text.trim().parse().ok(),
        Value::Null => Some(f64::NAN),
        _ => None,
    }
}

/// A value for a message.
pub(crate) fn shown(value: &Value) -> String {
    match number_of(value) {
        Some(number) => number.to_string(),
        None => value.to_string().chars().filter(|c| !c.is_control()).take(40).collect(),
    }
}

/// Reads a file.
pub(crate) fn parse<T: DeserializeOwned>(path: &Path) -> Result<T, Error> {
    let bytes = read_file(path, FILE)?;
    serde_json::from_slice(&without_literals(utf8_text(path, &bytes)?)).map_err(|error| {
        let message = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        Error::unusable(path, message, "it is damaged or of another program: write or fetch it again")
    })
}

/// The text with strings for the [`LITERALS`] outside of strings.
fn without_literals(text: &[u8]) -> Cow<'_, [u8]> {
    let mut result = Cow::Borrowed(text);
    let (mut position, mut in_string) = (0, false);
    while let Some(&byte) = text.get(position) {
        let rest = &text[position..];
        let literal = LITERALS.iter().find(|(literal, _)| !in_string && rest.starts_with(literal));
        position += match (byte, literal) {
            (_, Some((literal, string))) => {
                result.to_mut()[position..position + literal.len()].copy_from_slice(string);
                literal.len()
            }
            (b'\\', None) if in_string => 2,
            (byte, None) => {
                in_string ^= byte == b'"';
                1
            }
        };
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_of_python_become_strings_of_the_same_length() {
        let text = br#"{"a": [NaN, -Infinity,Infinity, 1], "NaN \" Infinity": "NaN", "b\\": NaN}"#;
        let strict = without_literals(text);
        assert_eq!(strict.len(), text.len());
        let value: Value = serde_json::from_slice(&strict).unwrap();
        let numbers: Vec<f64> = value["a"].as_array().unwrap().iter().filter_map(number_of).collect();
        assert!(numbers[0].is_nan() && numbers[1..] == [f64::NEG_INFINITY, f64::INFINITY, 1.0]);
        assert_eq!(value["NaN \" Infinity"], "NaN", "strings stay");
        assert!(number_of(&value["b\\"]).unwrap().is_nan());
        assert!(matches!(without_literals(b"[1, 2]"), Cow::Borrowed(_)));
    }

    #[test]
    fn numbers_may_be_in_quotes() {
        assert_eq!(number_of(&"96".into()), Some(96.0));
        assert_eq!(number_of(&" 9.6e1 ".into()), Some(96.0));
        assert!(number_of(&Value::Null).unwrap().is_nan());
        assert_eq!((number_of(&"wide".into()), number_of(&true.into())), (None, None));
        let shown = [Value::from("wide"), "N".into(), 35.0.into()].map(|value| shown(&value));
        assert_eq!(shown, ["\"wide\"", "NaN", "35"]);
    }
}
