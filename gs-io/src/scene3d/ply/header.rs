//! The header of a PLY: its elements and their properties.

use crate::{
    error::Error,
    scene3d::{TrainedWith, source::Source, values::Number},
};

/// The encoding of rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// The type of a property.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Value {
    Scalar(Number),
    /// A list: a length of the first type, and as many numbers of the second.
    List(Number, Number),
}

/// A property of an element.
#[derive(Debug)]
pub(crate) struct Property {
    pub(crate) name: String,
    pub(crate) value: Value,
    /// The property's position in the header.
    pub(crate) byte: usize,
}

/// An element.
#[derive(Debug)]
pub(crate) struct Element {
    pub(crate) name: String,
    /// Number of rows that the header claims.
    pub(crate) count: u64,
    pub(crate) properties: Vec<Property>,
}

impl Element {
    /// Index of a property.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }
}

/// A parsed header.
#[derive(Debug)]
pub(crate) struct Header {
    pub(crate) encoding: Encoding,
    pub(crate) elements: Vec<Element>,
    /// Comments without the word `comment`, with single spaces.
    pub(crate) comments: Vec<String>,
    /// Position of the first row.
    pub(crate) data_start: usize,
}

impl Header {
    /// How the scene was trained, by the comments.
    pub(crate) fn trained_with(&self) -> TrainedWith {
        TrainedWith::of_comments(self.comments.iter().map(String::as_str))
    }

    /// Index of an element.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.elements.iter().position(|e| e.name == name)
    }

    /// Parses the lines up to `end_header`.
    pub(crate) fn parse(source: &Source<'_>) -> Result<Self, Error> {
        let mut lines = Lines { source, next: 0 };
        let (byte, line) = lines.next()?;
        if line != "ply" {
            return Err(source.damaged(byte, "`ply`", quoted(line)));
        }
        let mut encoding = None;
        let (mut elements, mut comments) = (Vec::<Element>::new(), Vec::new());
        loop {
            let (byte, line) = lines.next()?;
            let bad = |expected: &str| source.damaged(byte, expected, quoted(line));
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words.as_slice() {
                ["end_header", ..] => break,
                ["comment", text @ ..] => comments.push(text.join(" ")),
                [] | ["obj_info", ..] => {}
                ["format", "ascii", _] => encoding = Some(Encoding::Ascii),
                ["format", "binary_little_endian", _] => encoding = Some(Encoding::LittleEndian),
                ["format", "binary_big_endian", _] => encoding = Some(Encoding::BigEndian),
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| bad("the element's number of rows"))?;
                    elements.push(Element { name: (*name).to_owned(), count, properties: Vec::new() });
                }
                ["property", rest @ ..] => {
                    let number = |name| number_named(name).ok_or_else(|| bad("a type of numbers, such as float"));
                    let (value, name) = match rest {
                        ["list", length, item, name] => (Value::List(number(length)?, number(item)?), name),
                        [scalar, name] => (Value::Scalar(number(scalar)?), name),
                        _ => return Err(bad("`property TYPE NAME`")),
                    };
                    let element = elements.last_mut().ok_or_else(|| bad("`element` before the first `property`"))?;
                    element.properties.push(Property { name: (*name).to_owned(), value, byte });
                }
                _ => return Err(bad("a line of a PLY header")),
            }
        }
        let missing = || source.damaged(0, "a line `format ascii 1.0` or the like", "none");
        Ok(Self { encoding: encoding.ok_or_else(missing)?, elements, comments, data_start: lines.next })
    }
}

/// The type of numbers of this name.
fn number_named(name: &str) -> Option<Number> {
    Some(match name {
        "char" | "int8" => Number::I8,
        "uchar" | "uint8" => Number::U8,
        "short" | "int16" => Number::I16,
        "ushort" | "uint16" => Number::U16,
        "int" | "int32" => Number::I32,
        "uint" | "uint32" => Number::U32,
        "float" | "float32" => Number::F32,
        "double" | "float64" => Number::F64,
        _ => return None,
    })
}

/// A line shortened for a message.
fn quoted(line: &str) -> String {
    format!("{:?}", line.chars().take(60).collect::<String>())
}

struct Lines<'a> {
    source: &'a Source<'a>,
    next: usize,
}

impl<'a> Lines<'a> {
    /// The next line without its end, and its position.
    fn next(&mut self) -> Result<(usize, &'a str), Error> {
        let start = self.next;
        let rest = &self.source.bytes[start..];
        let Some(len) = rest.iter().position(|&b| b == b'\n') else {
            return Err(self.source.damaged(self.source.bytes.len(), "`end_header`", "the end of the file"));
        };
        self.next = start + len + 1;
        let line = rest[..len].strip_suffix(b"\r").unwrap_or(&rest[..len]);
        let text = std::str::from_utf8(line)
            .map_err(|e| self.source.damaged(start + e.valid_up_to(), "a line of text", "bytes that are none"))?;
        Ok((start, text.trim_end()))
    }
}
