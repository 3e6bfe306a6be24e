//! The layout of texts on a terminal: lines break between words, and lists keep their columns.

use clap::Command;
use console::{Term, measure_text_width};

/// Columns of the help if neither the terminal nor the environment defines them, as in clap.
const WIDTH: usize = 100;

/// The command with this list in place of its list of subcommands, and with the texts below its help,
/// and below that of its subcommands, wrapped for the terminal.
pub(crate) fn wrapped(command: Command, subcommands: &str) -> Command {
    let columns = || std::env::var("COLUMNS").ok()?.parse().ok();
    let width = Term::stdout().size_checked().map(|(_, columns)| columns.into()).or_else(columns).unwrap_or(WIDTH);
    let list = wrap(subcommands, width);
    let template =
        format!("{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}\n\nOptions:\n{{options}}{{after-help}}");
    wrapped_at(command, width).help_template(template)
}

fn wrapped_at(command: Command, width: usize) -> Command {
    let text = command.get_after_help().map(|text| wrap(&text.to_string(), width));
    let command = match text {
        Some(text) => command.after_help(text),
        None => command,
    };
    command.mut_subcommands(|subcommand| wrapped_at(subcommand, width))
}

/// Wraps each line between words. A line of a list, "name   what it is", continues below "what it is".
pub(crate) fn wrap(text: &str, width: usize) -> String {
    text.split('\n').map(|line| wrap_line(line, width)).collect::<Vec<_>>().join("\n")
}

fn wrap_line(line: &str, width: usize) -> String {
    let (mut lines, mut current) = (Vec::new(), String::new());
    let indent = " ".repeat(second_column(line).filter(|column| 2 * column <= width).unwrap_or_else(|| margin(line)));
    // Words with the spaces in front of them.
    for word in line.split_inclusive(' ').fold(Vec::<String>::new(), joined_spaces) {
        let is_first = current.trim().is_empty();
        if !is_first && measure_text_width(&current) + measure_text_width(word.trim_end()) > width {
            lines.push(std::mem::replace(&mut current, indent.clone()));
        }
        current += &word;
    }
    lines.push(current);
    lines.iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n")
}

/// Adds a piece that ends in a space; pieces of spaces alone belong to the word before.
fn joined_spaces(mut words: Vec<String>, piece: &str) -> Vec<String> {
    match words.last_mut() {
        Some(last) if piece.trim().is_empty() || last.trim().is_empty() => last.push_str(piece),
        _ => words.push(piece.to_owned()),
    }
    words
}

/// Spaces at the beginning of a line.
fn margin(line: &str) -> usize {
    line.len() - line.trim_start().len()
}

/// Where the second column of a list begins: after two or more spaces.
fn second_column(line: &str) -> Option<usize> {
    let start = margin(line);
    let gap = start + line[start..].find("  ")?;
    Some(gap + margin(&line[gap..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_keep_their_columns() {
        let text = "A text of more than twenty columns.\n\nList:\n  a    one\n  bc   two words and more\n";
        let expected = "A text of more than\ntwenty columns.\n\nList:\n  a    one\n  bc   two words and\n       more\n";
        assert_eq!(wrap(text, 20), expected);
        assert_eq!(wrap(text, 100), text);
        let text = "broken    none\ndoubtful  5 whose scale is\n          2 whose opacity is 7";
        let expected = "broken    none\ndoubtful  5 whose\n          scale is\n          2 whose\n          opacity is\n          7";
        assert_eq!(wrap(text, 20), expected);
        assert_eq!(wrap("  a-long-name   then words", 16), "  a-long-name\n  then words", "no room for two columns");
    }
}
