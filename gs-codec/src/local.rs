//! What is known about the surroundings of a Gaussian while it is coded: the Gaussians before it in
//! its own cell and in the cells to the left and above.

use std::sync::LazyLock;

use crate::quantizer::{HALF, sin_cos};

/// Gaussians of a cell that are looked at, the last ones.
const MOST_OF_CELL: usize = 8;

/// Context that one coded Gaussian gives to later ones.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    pub(crate) amplitude: [i32; 3],
    /// Octave of the squared length of the amplitude.
    pub(crate) class: usize,
    /// Area and aspect, units of [`HALF`].
    pub(crate) area: i32,
    pub(crate) aspect: i32,
    /// Twice the angle as a unit vector.
    direction: [f64; 2],
}

impl Seen {
    /// A Gaussian with this amplitude of this class, with (area, aspect), and (angle, directions).
    pub(crate) fn new(amplitude: [i32; 3], class: usize, shape: (i32, i32), turn: (u32, u32)) -> Self {
        let direction = doubled(f64::from(turn.0) / f64::from(turn.1));
        Self { amplitude, class, area: shape.0, aspect: shape.1, direction }
    }
}

/// Cosine and sine of twice an angle of half turns in 0..1.
fn doubled(half_turns: f64) -> [f64; 2] {
    let (sin, cos) = sin_cos(half_turns);
    [cos * cos - sin * sin, 2.0 * sin * cos]
}

/// The middles of 16 sectors of half a turn, as [`doubled`] angles.
static SECTORS: LazyLock<[[f64; 2]; 16]> =
    LazyLock::new(|| std::array::from_fn(|sector| doubled((sector as f64 + 0.5) / 16.0)));

/// Averages over the Gaussians near a cell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Local {
    /// Mean class; 47 without neighbours.
    pub(crate) class: usize,
    /// Mean area and aspect.
    pub(crate) area: i32,
    pub(crate) aspect: i32,
    /// How much areas differ, and whether there are neighbours; below 24.
    pub(crate) spread: usize,
    /// Mean sizes of the chroma amplitudes.
    pub(crate) chroma: [i32; 2],
    /// Main sector of their angles, of 16.
    pub(crate) sector: u32,
    /// How aligned they are, 0 to 3.
    pub(crate) alignment: usize,
    /// The nearest of them.
    pub(crate) nearest: Option<Seen>,
}

/// The Gaussians so far, by cell; only the last three rows are looked at.
#[derive(Debug)]
pub(crate) struct Surroundings {
    columns: usize,
    seen: Vec<Seen>,
    /// First Gaussian of each cell of this row and of the two before, and the end.
    rows: [Vec<usize>; 3],
    /// What is assumed without neighbours: the last Gaussian's.
    last: (i32, i32),
}

impl Surroundings {
    pub(crate) fn new(columns: u32) -> Self {
        let columns = columns as usize;
        Self { columns, seen: Vec::new(), rows: std::array::from_fn(|_| vec![0; columns + 1]), last: (4 * HALF, HALF) }
    }

    /// The next row begins.
    pub(crate) fn start_row(&mut self) {
        self.rows.rotate_right(1);
        self.rows[0].clear();
    }

    /// The next cell of the row begins.
    pub(crate) fn start_cell(&mut self) {
        self.rows[0].push(self.seen.len());
    }

    pub(crate) fn push(&mut self, seen: Seen) {
        self.last = (seen.area, seen.aspect);
        self.seen.push(seen);
    }

    /// The Gaussians of the cell `left` columns to the left of `column` and `up` rows above.
    fn cell(&self, column: u32, left: i32, up: usize) -> &[Seen] {
        let Ok(column) = usize::try_from(column as i32 - left) else { return &[] };
        let row = &self.rows[up];
        let Some(&start) = row.get(column) else { return &[] };
        let end = match row.get(column + 1) {
            Some(&end) => end,
            None if up == 0 => self.seen.len(),
            None => self.rows[up - 1].first().copied().unwrap_or(self.seen.len()),
        };
        if column < self.columns { &self.seen[start.min(end)..end] } else { &[] }
    }

    /// Contexts of the number of Gaussians in the next cell.
    pub(crate) fn count_contexts(&self, column: u32, outside: bool) -> [usize; 3] {
        let count = |left, up| self.cell(column, left, up).len();
        let (west, north) = (self.previous(column, 1), count(0, 1));
        let corners = count(1, 1) + count(-1, 1);
        let far = self.previous(column, 2) + count(0, 2) + count(1, 2) + count(-1, 2);
        [
            4 * west.min(3) + north.min(3),
            (west + north + corners).min(11) + if outside { 12 } else { 0 },
            (far + corners).min(11),
        ]
    }

    /// Number of Gaussians in a cell to the left, before the cell at `column` has begun.
    fn previous(&self, column: u32, left: usize) -> usize {
        let row = &self.rows[0];
        let Some(index) = (column as usize).checked_sub(left) else { return 0 };
        let end = row.get(index + 1).copied().unwrap_or(self.seen.len());
        row.get(index).map_or(0, |&start| end - start)
    }

    /// Averages around the current cell.
    pub(crate) fn local(&self, column: u32) -> Local {
        const CELLS: [(i32, usize, i32); 8] =
            [(0, 0, 4), (1, 0, 3), (0, 1, 3), (1, 1, 2), (-1, 1, 2), (2, 0, 1), (0, 2, 1), (-2, 1, 1)];
        let (mut weight, mut class, mut area, mut aspect, mut chroma) = (0, 0, 0, 0, [0; 2]);
        let (mut cos2, mut sin2, mut total) = (0.0, 0.0, 0.0);
        let mut areas = (i32::MAX, i32::MIN);
        let mut nearest = None;
        for (left, up, w) in CELLS {
            let cell = self.cell(column, left, up);
            nearest = nearest.or(cell.last().copied());
            for seen in &cell[cell.len().saturating_sub(MOST_OF_CELL)..] {
                weight += w;
                class += w * seen.class as i32;
                area += w * seen.area;
                aspect += w * seen.aspect;
                for k in 0..2 {
                    chroma[k] += w * (seen.amplitude[k + 1].abs().min(1 << 12));
                }
                areas = (areas.0.min(seen.area), areas.1.max(seen.area));
                let share = f64::from(w * seen.aspect.min(3 * HALF));
                cos2 += share * seen.direction[0];
                sin2 += share * seen.direction[1];
                total += share;
            }
        }
        if weight == 0 {
            let (area, aspect) = self.last;
            return Local { class: 47, area, aspect, spread: 23, chroma: [0; 2], sector: 0, alignment: 0, nearest };
        }
        let spread = ((areas.1 - areas.0) / (HALF / 2)).min(10) as usize * 2 + usize::from(weight > 8);
        let (sector, length2) = main_sector(cos2, sin2);
        let alignment = if total == 0.0 {
            0
        } else {
            1 + usize::from(length2 > 0.3 * total * total) + usize::from(length2 > 0.7 * total * total)
        };
        let mean = |sum: i32| (2 * sum + weight).div_euclid(2 * weight);
        Local {
            class: mean(class) as usize,
            area: mean(area),
            aspect: mean(aspect),
            spread,
            chroma: chroma.map(mean),
            sector,
            alignment,
            nearest,
        }
    }
}

/// The sector of 16 in which a vector of twice an angle lies, and its squared length.
fn main_sector(cos2: f64, sin2: f64) -> (u32, f64) {
    let mut best = (0, f64::MIN);
    for (sector, [cos, sin]) in SECTORS.iter().enumerate() {
        let dot = cos2 * cos + sin2 * sin;
        if dot > best.1 {
            best = (sector as u32, dot);
        }
    }
    (best.0, cos2 * cos2 + sin2 * sin2)
}
