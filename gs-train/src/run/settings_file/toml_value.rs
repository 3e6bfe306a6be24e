//! Reads values from TOML text; errors say at which byte they are.
//!
//! Two things that the toml crate reads are errors here, because no settings have them: dates
//! without quotes, and maps whose keys are not strings.
//!
//! The toml crate's own deserializer gives the compiler each structure three times: as a table, as a
//! date, and with its place. Settings have many structures, and here each is compiled once.

use std::{fmt, slice};

use gs_core::counted;
use serde::de::{
    self, DeserializeOwned, DeserializeSeed, Deserializer, EnumAccess, MapAccess, SeqAccess, VariantAccess, Visitor,
    value::StrDeserializer,
};
use toml::{
    Spanned,
    de::{DeString, DeTable, DeValue},
};

/// Reads a value from the text of a TOML file.
///
/// # Errors
/// Where the text is not TOML, or its tables are not those of the type.
pub(crate) fn from_toml<T: DeserializeOwned>(text: &str) -> Result<T, Misread> {
    let table = DeTable::parse(text)
        .map_err(|error| Misread { start: error.span().map(|span| span.start), message: error.message().to_owned() })?;
    T::deserialize(Place { value: &DeValue::Table(table.into_inner()), start: 0 })
}

/// Why a text cannot be read.
#[derive(Debug)]
pub(crate) struct Misread {
    /// The byte of the text at which it is, where known.
    pub(crate) start: Option<usize>,
    pub(crate) message: String,
}

impl fmt::Display for Misread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Misread {}

impl de::Error for Misread {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self { start: None, message: message.to_string() }
    }
}

/// The result, with the place of an error that has none yet.
fn at<T>(start: usize, result: Result<T, Misread>) -> Result<T, Misread> {
    result.map_err(|error| Misread { start: error.start.or(Some(start)), ..error })
}

/// A value and the byte at which it starts.
#[derive(Clone, Copy)]
struct Place<'a> {
    value: &'a DeValue<'a>,
    start: usize,
}

impl<'a> Place<'a> {
    fn of(value: &'a Spanned<DeValue<'a>>) -> Self {
        Self { value: value.get_ref(), start: value.span().start }
    }

    fn refuse<T>(self, problem: impl fmt::Display) -> Result<T, Misread> {
        at(self.start, Err(de::Error::custom(problem)))
    }

    fn visit<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misread> {
        match self.value {
            DeValue::String(text) => visitor.visit_str(text),
            DeValue::Integer(number) => {
                let (digits, radix) = (number.as_str(), number.radix());
                match (i64::from_str_radix(digits, radix), u64::from_str_radix(digits, radix)) {
                    (Ok(number), _) => visitor.visit_i64(number),
                    (_, Ok(number)) => visitor.visit_u64(number),
                    _ => self.refuse("the integer has more than 64 bits"),
                }
            }
            DeValue::Float(number) => match number.as_str().parse::<f64>() {
                Ok(value) if value.is_finite() || !number.as_str().ends_with(|c: char| c.is_ascii_digit()) => {
                    visitor.visit_f64(value)
                }
                _ => self.refuse("the number is too large"),
            },
            DeValue::Boolean(value) => visitor.visit_bool(*value),
            DeValue::Datetime(date) => {
                self.refuse(format!("{date} is a date, but no setting is a date: put text in quotes"))
            }
            DeValue::Array(values) => {
                let mut elements = Elements(values.iter());
                let read = visitor.visit_seq(&mut elements)?;
                match elements.0.len() {
                    0 => Ok(read),
                    more => self.refuse(format!("expected {} values, found {}", values.len() - more, values.len())),
                }
            }
            DeValue::Table(table) => visitor.visit_map(Entries { entries: table.iter(), value: None }),
        }
    }
}

impl<'de> Deserializer<'de> for Place<'_> {
    type Error = Misread;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misread> {
        at(self.start, self.visit(visitor))
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misread> {
        at(self.start, visitor.visit_some(self))
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Misread> {
        at(self.start, visitor.visit_newtype_struct(self))
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Misread> {
        let found = match self.value {
            DeValue::String(name) => return at(self.start, visitor.visit_enum(StrDeserializer::new(name))),
            DeValue::Table(table) if table.len() == 1 => return at(self.start, visitor.visit_enum(Variant(table))),
            DeValue::Table(table) => format!("a table with {}", counted(table.len(), "key")),
            DeValue::Array(_) => "an array".to_owned(),
            DeValue::Integer(number) => format!("the number {number}"),
            DeValue::Float(number) => format!("the number {number}"),
            DeValue::Boolean(value) => value.to_string(),
            DeValue::Datetime(date) => format!("the date {date}"),
        };
        self.refuse(format!("found {found}, expected one of `{}`", variants.join("`, `")))
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map struct identifier ignored_any
    }
}

struct Elements<'a>(slice::Iter<'a, Spanned<DeValue<'a>>>);

impl<'de> SeqAccess<'de> for Elements<'_> {
    type Error = Misread;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Misread> {
        self.0.next().map(|value| seed.deserialize(Place::of(value))).transpose()
    }
}

struct Entries<'a> {
    entries: toml::map::Iter<'a, Spanned<DeString<'a>>, Spanned<DeValue<'a>>>,
    /// The value of the last key.
    value: Option<Place<'a>>,
}

impl<'de> MapAccess<'de> for Entries<'_> {
    type Error = Misread;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Misread> {
        let Some((key, value)) = self.entries.next() else { return Ok(None) };
        self.value = Some(Place::of(value));
        at(key.span().start, seed.deserialize(StrDeserializer::new(key.get_ref()))).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Misread> {
        let place = self.value.take().ok_or_else(|| de::Error::custom("a value was read before its key"))?;
        seed.deserialize(place)
    }
}

/// A variant with values: a table whose only key is the name.
struct Variant<'a>(&'a DeTable<'a>);

impl<'de, 'a> EnumAccess<'de> for Variant<'a> {
    type Error = Misread;
    type Variant = Place<'a>;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Place<'a>), Misread> {
        let (name, value) = self.0.iter().next().ok_or_else(|| de::Error::custom("an empty table names no variant"))?;
        let variant = at(name.span().start, seed.deserialize(StrDeserializer::new(name.get_ref())))?;
        Ok((variant, Place::of(value)))
    }
}

impl<'de> VariantAccess<'de> for Place<'_> {
    type Error = Misread;

    fn unit_variant(self) -> Result<(), Misread> {
        match self.value {
            DeValue::Table(table) if table.is_empty() => Ok(()),
            _ => self.refuse("expected an empty table"),
        }
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Misread> {
        seed.deserialize(self)
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, Misread> {
        self.deserialize_any(visitor)
    }

    fn struct_variant<V: Visitor<'de>>(self, fields: &'static [&'static str], visitor: V) -> Result<V::Value, Misread> {
        let DeValue::Table(table) = self.value else { return self.refuse("expected a table") };
        match table.keys().find(|key| !fields.contains(&&**key.get_ref())) {
            Some(key) => at(key.span().start, Err(de::Error::unknown_field(key.get_ref(), fields))),
            None => self.deserialize_any(visitor),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use serde::Deserialize;

    use super::*;

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Everything {
        small: i8,
        seed: u64,
        share: f32,
        name: String,
        maybe: Option<bool>,
        wrapped: Wrapped,
        shapes: Vec<Shape>,
        rest: BTreeMap<String, toml::Value>,
    }

    #[derive(Debug, PartialEq, Deserialize)]
    struct Wrapped([f64; 2]);

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    enum Shape {
        Dot,
        Disk(f32),
        Ellipse { wide: f32, high: f32 },
    }

    const TEXT: &str = "small = 0x7\nseed = 18_446_744_073_709_551_615\nshare = 3\nname = \"a\\nb\"\nmaybe = true\n\
        wrapped = [-inf, 1e-3]\nshapes = ['dot', { dot = {} }, { disk = 2 }, { ellipse = { wide = 1.5, high = 2 } }]\n\
        [rest]\nlist = [1, 'x', { y = 0b11 }]\nfar.away = false\n";

    fn error<T: DeserializeOwned>(text: &str) -> (Option<usize>, String) {
        from_toml::<T>(text).err().map(|error| (error.start, error.message)).unwrap_or_else(|| panic!("{text} passes"))
    }

    #[test]
    fn values_are_those_that_the_toml_crate_reads() {
        let text = TEXT;
        let expected: Everything = toml::from_str(text).unwrap();
        assert_eq!(from_toml::<Everything>(text).unwrap(), expected);
        assert_eq!((expected.shapes.len(), expected.rest.len()), (4, 2));
    }

    #[test]
    fn errors_are_those_of_the_toml_crate_at_the_same_byte() {
        let text = TEXT.replace("0x7", "7");
        for (from, to) in [
            ("small = 7", "small = 700"),
            ("share = 3", "share = '3'"),
            ("maybe = true", "maybe = []"),
            ("name =", "nam ="),
            ("['dot'", "['dott'"),
            ("{ disk = 2 }", "{ disc = 2 }"),
            ("{ disk = 2 }", "{ disk = [] }"),
            ("seed = 18_446", "seed = 18_446 9"),
        ] {
            assert!(text.contains(from), "{from}");
            let text = text.replacen(from, to, 1);
            let expected = toml::from_str::<Everything>(&text).unwrap_err();
            let found = error::<Everything>(&text);
            assert_eq!(found.1, expected.message(), "{to}");
            assert_eq!(found.0, expected.span().map(|span| span.start), "{to}");
        }
    }

    #[test]
    fn what_the_toml_crate_says_otherwise_is_refused_too() {
        let wide = text_with("{ ellipse = { wide = 1.5, width = 2 } }");
        assert_eq!(
            error::<Everything>(&wide),
            (wide.find("width"), "unknown field `width`, expected `wide` or `high`".into())
        );
        for shape in ["{ dot = 1 }", "{ dot = {}, disk = 1 }", "{}", "3", "{ ellipse = 1 }"] {
            let text = text_with(shape);
            assert_eq!(error::<Everything>(&text).0, Some(text.find("shapes").unwrap() + 10 + inner(shape)), "{shape}");
        }
        assert_eq!(error::<Everything>(&TEXT.replace("1e-3", "1e999")).1, "the number is too large");
        let text = TEXT.replace("1e-3", "0, 1e-3");
        assert_eq!(error::<Everything>(&text).1, "expected 2 values, found 3");
        let long = TEXT.replace("= 18_", "= 118_");
        assert_eq!(error::<Everything>(&long), (long.find("118_"), "the integer has more than 64 bits".into()));
    }

    #[test]
    fn a_date_without_quotes_is_no_text() {
        let text = TEXT.replace("0x7", "7");
        for (from, to) in [
            ("name = \"a\\nb\"", "name = 1979-05-27"),
            ("share = 3", "share = 1979-05-27"),
            ("list = [1,", "list = [1979-05-27,"),
        ] {
            assert!(text.contains(from), "{from}");
            let text = text.replacen(from, to, 1);
            let expected = "1979-05-27 is a date, but no setting is a date: put text in quotes";
            assert_eq!(error::<Everything>(&text), (text.find("1979"), expected.to_owned()));
        }
        let quoted = text.replacen("\"a\\nb\"", "'1979-05-27'", 1);
        assert_eq!(from_toml::<Everything>(&quoted).unwrap().name, "1979-05-27");
    }

    #[test]
    fn what_is_no_variant_is_named_with_the_variants() {
        for (shape, found) in [
            ("3", "the number 3"),
            ("-0.5", "the number -0.5"),
            ("true", "true"),
            ("['dot']", "an array"),
            ("{}", "a table with 0 keys"),
            ("{ dot = {}, disk = 1 }", "a table with 2 keys"),
            ("1979-05-27", "the date 1979-05-27"),
        ] {
            let message = error::<Everything>(&text_with(shape)).1;
            assert_eq!(message, format!("found {found}, expected one of `dot`, `disk`, `ellipse`"));
        }
    }

    fn text_with(shape: &str) -> String {
        let start = TEXT.find("['dot'").unwrap();
        let end = start + TEXT[start..].find('\n').unwrap();
        format!("{}[{shape}]{}", &TEXT[..start], &TEXT[end..]).replace("0x7", "7")
    }

    /// Bytes from the start of a shape to the value that is wrong.
    fn inner(shape: &str) -> usize {
        shape.find("1 }").filter(|_| !shape.contains(',')).unwrap_or(0)
    }
}
