//! Output of the program: results on standard output, everything else on standard error.
//!
//! All text leaves through here. Names of files, contents of data sets and quotes of parsers were
//! written by others, and could control the terminal. So invisible characters are written as
//! escapes.

use std::{
    borrow::Cow,
    fmt::Display,
    io::{self, Write},
    path::Path,
};

use serde::Serialize;

use crate::failure::Failure;

/// How much a long-running command prints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Verbosity {
    /// Progress.
    #[default]
    Normal,
    /// Also rounds of density control, Gaussians whose scales reach a bound, and the effects that
    /// are simulated.
    Verbose,
}

/// Foreign text as one line. Control characters, including line breaks, and characters that only
/// change how others are shown (such as U+202E, which reverses the rest of a line) become escapes
/// such as `\u{1b}`.
///
/// Everything that is printed goes through this line by line. Texts of several lines call it for
/// their foreign parts, which might otherwise pretend to be lines of their own.
pub(crate) fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, |c, line| line.extend(c.escape_default()))
}

fn escaped(text: &str, escape: impl Fn(char, &mut String)) -> Cow<'_, str> {
    if !text.contains(is_invisible) {
        return Cow::Borrowed(text);
    }
    let mut line = String::with_capacity(text.len() + 16);
    text.chars().for_each(|c| if is_invisible(c) { escape(c, &mut line) } else { line.push(c) });
    Cow::Owned(line)
}

/// Unicode's control and format characters, and its separators of lines and paragraphs (categories
/// Cc, Cf, Zl and Zp).
fn is_invisible(c: char) -> bool {
    c.is_control()
        || matches!(c,
            '\u{ad}' | '\u{600}'..='\u{605}' | '\u{61c}' | '\u{6dd}' | '\u{70f}' | '\u{890}' | '\u{891}' | '\u{8e2}'
            | '\u{180e}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}'
            | '\u{fff9}'..='\u{fffb}' | '\u{110bd}' | '\u{110cd}' | '\u{13430}'..='\u{1343f}' | '\u{1bca0}'..='\u{1bca3}'
            | '\u{1d173}'..='\u{1d17a}' | '\u{e0000}'..='\u{e007f}')
}

/// Lines that are safe to print.
fn lines(text: impl Display) -> String {
    text.to_string().split('\n').map(printable).collect::<Vec<_>>().join("\n")
}

/// Prints a result to standard output.
pub(crate) fn result(text: impl Display) -> Result<(), Failure> {
    write_result(&lines(text))
}

/// Prints a result as the flag `--json` asks: as JSON, or as text.
pub(crate) fn answer<D: Display>(json: bool, value: &impl Serialize, text: impl FnOnce() -> D) -> Result<(), Failure> {
    if json { self::json(value) } else { result(text()) }
}

/// Prints a result as JSON to standard output. Numbers that JSON has no form for (∞, NaN) become
/// `null`.
pub(crate) fn json(value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|error| Failure::failed(error).at("summary"))?;
    let text: Vec<Cow<'_, str>> = text.split('\n').map(json_line).collect();
    write_result(&text.join("\n"))
}

/// A line of JSON with escapes for all invisible characters: JSON prescribes them for the first 32
/// only.
fn json_line(line: &str) -> Cow<'_, str> {
    escaped(line, |c, line| c.encode_utf16(&mut [0; 2]).iter().for_each(|unit| *line += &format!("\\u{unit:04x}")))
}

fn write_result(text: &str) -> Result<(), Failure> {
    let mut stdout = io::stdout().lock();
    writeln!(stdout, "{text}").and_then(|()| stdout.flush()).map_err(Failure::output)
}

/// Rows of cells as lines, in columns as wide as their widest cell: names on the left, numbers, from
/// the second column on, on the right.
pub(crate) fn in_columns(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|column| width(column).unwrap_or(0)).collect();
    let padded = |(column, (cell, &width)): (usize, (&String, &usize))| match column {
        0 => format!("{cell:<width$}"),
        _ => format!("{cell:>width$}"),
    };
    let line = |row: &Vec<String>| row.iter().zip(&widths).enumerate().map(padded).collect::<Vec<_>>().join("  ");
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// Prints a line to standard error. Errors of writing are ignored.
pub(crate) fn note(line: impl Display) {
    let _ = writeln!(io::stderr().lock(), "{}", lines(line));
}

/// A path as one word of a shell's command line.
pub(crate) fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |character: char| character.is_alphanumeric() || "/\\:._-+=@%,".contains(character);
    match text.chars().all(plain) {
        true => text,
        false => format!("'{}'", text.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invisible_characters_are_escaped() {
        assert_eq!(printable("a\u{1b}]0;title\u{7}\r\nb\tc"), r"a\u{1b}]0;title\u{7}\r\nb\tc");
        assert_eq!(
            printable("gnp.\u{202e}exe\u{9b}2J\u{2028}\u{feff}\u{e0041}"),
            r"gnp.\u{202e}exe\u{9b}2J\u{2028}\u{feff}\u{e0041}"
        );
        for shown in ["", "a b", "e\u{301}té – 写真.png", "it's \"quoted\" \\ here", "9.41\u{202f}AM"] {
            assert!(matches!(printable(shown), Cow::Borrowed(same) if same == shown), "{shown}");
        }
        assert_eq!(lines("one\ntwo\r"), "one\ntwo\\r");
    }

    #[test]
    fn paths_are_single_words_of_a_command_line() {
        assert_eq!(quoted(Path::new("out/a-1.png")), "out/a-1.png");
        assert_eq!(quoted(Path::new("my pictures/it's.png")), r"'my pictures/it'\''s.png'");
    }

    #[test]
    fn json_stays_json() {
        let hostile = "\u{1b}[2J\u{9b}2J \u{202e}\u{7f}\u{e0041}\n";
        let text = serde_json::to_string(hostile).unwrap();
        let safe = json_line(&text);
        assert!(!safe.contains(is_invisible), "{safe:?}");
        assert_eq!(serde_json::from_str::<String>(&safe).unwrap(), hostile);
    }
}
