//! The status of a run, beside the bar or in a line of its own, in as many words as there is room
//! for.

use gs_core::{counted, duration};

/// The width of the bar, columns.
const BAR: usize = 10;

/// The status of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Status {
    /// Steps of the whole run.
    pub(crate) steps: u32,
    pub(crate) gaussians: u32,
    pub(crate) loss: f32,
    /// PSNR before rounding to 8 bits, measured or estimated from the loss, dB.
    pub(crate) psnr: Option<f64>,
    /// Steps per second.
    pub(crate) rate: f64,
    /// Time left, s.
    pub(crate) left: f64,
}

impl Status {
    /// The whole status.
    pub(crate) fn whole(&self) -> String {
        joined(&self.parts())
    }

    /// The part of the status that a line of `columns` has room for beside the bar and the count of
    /// steps. The least important parts are left out first.
    pub(crate) fn within(&self, columns: usize) -> String {
        let steps = 2 * self.steps.to_string().len() + 1;
        // A space before the steps, and two behind them.
        let room = columns.saturating_sub(BAR + 1 + steps + 2);
        let mut parts = self.parts();
        // The loss, the speed, the count, the quality, the time left.
        for place in [1, 3, 0, 2, 4] {
            if joined(&parts).chars().count() <= room {
                break;
            }
            parts[place].clear();
        }
        joined(&parts)
    }

    fn parts(&self) -> [String; 5] {
        let Self { gaussians, loss, psnr, rate, left, .. } = *self;
        // Slow steps have a digit more.
        let rate = if rate < 9.95 { format!("{rate:.1} it/s") } else { format!("{rate:.0} it/s") };
        [
            counted(gaussians, "Gaussian"),
            format!("loss {loss:.2e}"),
            psnr.map_or_else(String::new, |psnr| format!("PSNR ~{psnr:.1} dB")),
            rate,
            format!("{} left", duration(left)),
        ]
    }
}

fn joined(parts: &[String]) -> String {
    parts.iter().filter(|part| !part.is_empty()).map(String::as_str).collect::<Vec<_>>().join("  ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(steps: u32, psnr: Option<f64>) -> Status {
        Status { steps, gaussians: 9000, loss: 2.31e-3, psnr, rate: 820.4, left: 12.3 }
    }

    #[test]
    fn a_narrow_line_keeps_the_bar_and_the_important_parts() {
        let fit = status(400, Some(31.234));
        assert_eq!(fit.whole(), "9000 Gaussians  loss 2.31e-3  PSNR ~31.2 dB  820 it/s  12 s left");
        // The room of 80 and of 60 columns, without that for what a terminal echoes.
        assert_eq!(fit.within(76), "9000 Gaussians  PSNR ~31.2 dB  820 it/s  12 s left");
        assert_eq!(fit.within(56), "PSNR ~31.2 dB  12 s left");
        assert_eq!(status(30_000, None).within(56), "9000 Gaussians  12 s left");
        for columns in 0..120 {
            let text = fit.within(columns);
            assert!(text.is_empty() || BAR + " 400/400  ".len() + text.len() <= columns, "{columns}: {text}");
        }
    }

    #[test]
    fn one_is_singular() {
        assert!(Status { gaussians: 1, ..status(1, None) }.whole().starts_with("1 Gaussian  loss"));
    }
}
