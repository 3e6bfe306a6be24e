//! The terminal as the bar sees it: a little narrower than it is.
//!
//! The bar fills its line to the end, so that whatever the terminal echoes comes on the next line; and then the bar can no longer be
//! taken back. Ctrl-C is echoed as two characters, for which this leaves room.

use std::io;

use console::Term;
use indicatif::TermLike;

/// Room for what is echoed, in columns: that of Ctrl-C twice.
const ECHO: u16 = 4;

/// Standard error.
#[derive(Debug)]
pub(crate) struct Terminal(Term);

impl Default for Terminal {
    fn default() -> Self {
        Self(Term::buffered_stderr())
    }
}

impl TermLike for Terminal {
    fn width(&self) -> u16 {
        self.0.size().1.saturating_sub(ECHO)
    }

    fn height(&self) -> u16 {
        self.0.size().0
    }

    fn move_cursor_up(&self, n: usize) -> io::Result<()> {
        self.0.move_cursor_up(n)
    }

    fn move_cursor_down(&self, n: usize) -> io::Result<()> {
        self.0.move_cursor_down(n)
    }

    fn move_cursor_right(&self, n: usize) -> io::Result<()> {
        self.0.move_cursor_right(n)
    }

    fn move_cursor_left(&self, n: usize) -> io::Result<()> {
        self.0.move_cursor_left(n)
    }

    fn write_line(&self, line: &str) -> io::Result<()> {
        self.0.write_line(line)
    }

    fn write_str(&self, text: &str) -> io::Result<()> {
        self.0.write_str(text)
    }

    fn clear_line(&self) -> io::Result<()> {
        self.0.clear_line()
    }

    fn flush(&self) -> io::Result<()> {
        self.0.flush()
    }
}
