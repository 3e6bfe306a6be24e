//! Pictures of popping: successive frames in both ways, and their differences.

use gs_core::{Image, constants::SSIM_WINDOW};
use gs_train::Error;

use super::comparison::Moment;

/// Factor by which differences are enlarged.
const DIFFERENCE_GAIN: f32 = 4.0;

/// Longest side of the part that is shown, px.
const PART_PX: u32 = 96;

/// Approximate longest side of the enlarged part, px.
const SHOWN_PX: u32 = 384;

/// Gap between two parts, px.
const GAP_PX: u32 = 8;

/// A picture of the place where popping shows best in a flight: a row for each way of drawing, with the frame before the
/// jump, the one after it, and the difference ½ + gain · (after − before).
pub(super) fn picture(moment: &Moment) -> Result<Image, Error> {
    let rows = &moment.frames;
    // The jump is between the first or the last two frames; the first way shows between which.
    let size = rows[0][0].size();
    let window = Part::around(moment.pixel, size, SSIM_WINDOW as u32);
    let change = |k: usize| window.change(&rows[0][k], &rows[0][k + 1]);
    let at = usize::from(change(1) > change(0));
    let part = Part::around(moment.pixel, size, PART_PX);
    let cell_color = |row: &[Image], column: usize, pixel: (u32, u32)| {
        let [before, after] = [&row[at], &row[at + 1]].map(|factor| factor.pixel(part.x + pixel.0, part.y + pixel.1));
        match column {
            0 => before,
            1 => after,
            _ => [0, 1, 2].map(|c| 0.5 + DIFFERENCE_GAIN * (after[c] - before[c])),
        }
    };
    let factor = (SHOWN_PX / part.width.max(part.height)).max(1);
    let (cell_width, cell_height) = (part.width * factor, part.height * factor);
    Ok(Image::from_fn(3 * cell_width + 2 * GAP_PX, 2 * cell_height + GAP_PX, |x, y| {
        let ((column, x), (row, y)) = (cell(x, cell_width), cell(y, cell_height));
        if x >= cell_width || y >= cell_height {
            return [1.0; 3];
        }
        cell_color(&rows[row], column, (x / factor, y / factor))
    })?)
}

/// Index of a cell in a row or column, and the position in it; beyond `side` is the gap.
fn cell(at: u32, side: u32) -> (usize, u32) {
    ((at / (side + GAP_PX)) as usize, at % (side + GAP_PX))
}

/// A part of a picture, px.
#[derive(Clone, Copy)]
struct Part {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl Part {
    /// A square centred at a pixel, moved inside the picture; smaller if the picture is.
    fn around((x, y): (u32, u32), (width, height): (u32, u32), side: u32) -> Self {
        let (w, h) = (width.min(side), height.min(side));
        let start = |middle: u32, part: u32, whole: u32| middle.saturating_sub(part / 2).min(whole - part);
        Self { x: start(x, w, width), y: start(y, h, height), width: w, height: h }
    }

    /// Σ |after − before| over the part.
    fn change(&self, before: &Image, after: &Image) -> f32 {
        let rows = (self.y..self.y + self.height).flat_map(|y| (self.x..self.x + self.width).map(move |x| (x, y)));
        rows.map(|(x, y)| {
            let (a, b) = (before.pixel(x, y), after.pixel(x, y));
            (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f32>()
        })
        .sum()
    }
}
