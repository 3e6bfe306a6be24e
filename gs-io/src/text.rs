//! Text with byte-order marks, in another encoding than UTF-8, with percent signs, and for shells.

use std::path::Path;

use crate::error::Error;

/// The mark with which some programs, most of them on Windows, begin text in UTF-8.
const MARK: &[u8] = b"\xef\xbb\xbf";

/// The bytes of a text file after its byte-order mark, if it has one. `path` is for the message.
///
/// # Errors
/// [`Error::Unusable`] for text in UTF-16, with a mark or without.
pub fn utf8_text<'b>(path: &Path, bytes: &'b [u8]) -> Result<&'b [u8], Error> {
    let is_ascii = |byte: &u8| byte.is_ascii_graphic() || byte.is_ascii_whitespace();
    let utf_16 =
        || Error::unusable(path, "is text in UTF-16, but must be in UTF-8", "save it again with that encoding");
    match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => Err(utf_16()),
        [0, letter, ..] | [letter, 0, ..] if is_ascii(letter) => Err(utf_16()),
        _ => Ok(bytes.strip_prefix(MARK).unwrap_or(bytes)),
    }
}

/// A uri or a path of one without percent signs; `None` where it is not text, or has a null.
pub fn percent_decoded(uri: &str) -> Option<String> {
    let mut parts = uri.split('%');
    let mut bytes = parts.next()?.as_bytes().to_vec();
    for part in parts {
        bytes.push(u8::from_str_radix(part.get(..2)?, 16).ok()?);
        bytes.extend(&part.as_bytes()[2..]);
    }
    String::from_utf8(bytes).ok().filter(|name| !name.contains('\0'))
}

/// A path quoted for a shell command.
pub(crate) fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    match text.contains(|c: char| c.is_whitespace() || "'\"$&;()<>|*?`!#".contains(c)) {
        false => text,
        true => format!("'{}'", text.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_byte_order_mark_is_skipped_and_utf_16_is_named() {
        let path = Path::new("a.json");
        for (bytes, text) in [("\u{feff}{}", "{}"), ("{}", "{}"), ("", ""), ("\u{feff}", ""), ("é", "é")] {
            assert_eq!(utf8_text(path, bytes.as_bytes()).unwrap(), text.as_bytes());
        }
        for bytes in [&b"\xff\xfe{\0}\0"[..], b"\xfe\xff\0{\0}", b"{\0}\0", b"\0{\0}"] {
            let error = utf8_text(path, bytes).unwrap_err().to_string();
            assert_eq!(error, "a.json: is text in UTF-16, but must be in UTF-8; save it again with that encoding");
        }
    }
}
