//! The layout of help texts: lists keep their columns at any width of the terminal.

use clap::Command;
use console::Term;

/// Columns of the help if neither the terminal nor the environment defines them, as in clap.
const WIDTH: usize = 100;

/// The command with the texts below its help, and below that of its subcommands, wrapped for the
/// terminal.
pub(crate) fn wrapped(command: Command) -> Command {
    let columns = || std::env::var("COLUMNS").ok()?.parse().ok();
    let width = Term::stdout().size_checked().map(|(_, columns)| columns.into()).or_else(columns).unwrap_or(WIDTH);
    wrapped_at(command, width)
}

fn wrapped_at(command: Command, width: usize) -> Command {
    let text = command.get_after_help().map(|text| wrap(&text.to_string(), width));
    let command = match text {
        Some(text) => command.after_help(text),
        None => command,
    };
    command.mut_subcommands(|subcommand| wrapped_at(subcommand, width))
}

/// Wraps each line. A line of a list, "  name   what it is", continues below "what it is".
fn wrap(text: &str, width: usize) -> String {
    text.lines().map(|line| wrap_line(line, width)).collect::<Vec<_>>().join("\n")
}

fn wrap_line(line: &str, width: usize) -> String {
    let (mut lines, mut current) = (Vec::new(), String::new());
    let indent = " ".repeat(second_column(line).filter(|column| 2 * column <= width).unwrap_or_else(|| margin(line)));
    // Words with the spaces in front of them.
    for word in line.split_inclusive(' ').fold(Vec::<String>::new(), joined_spaces) {
        let is_first = current.trim().is_empty();
        if !is_first && current.chars().count() + word.trim_end().chars().count() > width {
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
    (start > 0).then(|| gap + margin(&line[gap..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_keep_their_columns() {
        let text = "A text of more than twenty columns.\n\nList:\n  a    one\n  bc   two words and more\n";
        let expected = "A text of more than\ntwenty columns.\n\nList:\n  a    one\n  bc   two words and\n       more";
        assert_eq!(wrap(text, 20), expected);
        assert_eq!(wrap(text.trim_end(), 100), text.trim_end());
        assert_eq!(wrap("  a-long-name   then words", 16), "  a-long-name\n  then words", "no room for two columns");
    }
}
