//! How far the picture has moved from one frame of a video to another, by blocks.

/// The longer side of the small copies in which motion is measured, px.
const SIDE: usize = 160;

/// Side of a block, px.
const BLOCK: usize = 16;

/// Pixels of a small copy to one of the smaller copy in which the shift of the whole is searched.
const COARSE: usize = 4;

/// How far the shift of the whole is searched, of [`COARSE`] px each.
const REACH: i32 = 12;

/// How far around its expected place a block is searched, px.
const AROUND: i32 = 4;

/// How much more similar the whole must be for each pixel of its shift, levels of brightness.
const STILL: f64 = 0.05;

/// How much more similar a block must be for each pixel that its place is off the expected one, levels of all its
/// pixels together: along an edge, all places are alike.
const STEADY: i32 = 30;

/// Mean deviation from its mean above which a block has texture, levels of brightness of 255.
const TEXTURE: f64 = 3.0;

/// Share of the blocks that must have texture.
const TEXTURED: f64 = 0.1;

/// Mean difference of a block to its match, of its mean deviation, above which it is none.
const MISMATCH: f64 = 0.6;

/// Share of the blocks with texture that must be found again.
const FOUND: f64 = 0.3;

/// A shift from one frame to another, px of a small copy.
pub(super) type Shift = (i32, i32);

/// A small copy of a frame.
#[derive(Debug, Clone)]
pub(super) struct Small {
    width: usize,
    height: usize,
    values: Vec<u8>,
    mean: f64,
}

impl Small {
    /// A copy of an image of this width.
    pub(super) fn of(width: usize, pixels: &[u8]) -> Self {
        let longer = width.max(pixels.len() / width.max(1));
        Self::reduced(width, pixels, longer.div_ceil(SIDE).max(1))
    }

    /// The means of squares of pixels of this side.
    fn reduced(width: usize, pixels: &[u8], side: usize) -> Self {
        let (columns, rows) = (width / side, pixels.len() / width.max(1) / side);
        let cell = |column: usize, row: usize| {
            let rows = (row * side..(row + 1) * side).map(|y| &pixels[y * width + column * side..][..side]);
            let sum: usize = rows.flatten().map(|value| usize::from(*value)).sum();
            (sum / (side * side)) as u8
        };
        let cells = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        let values: Vec<u8> = cells.map(|(column, row)| cell(column, row)).collect();
        let mean = values.iter().map(|value| f64::from(*value)).sum::<f64>() / values.len().max(1) as f64;
        Self { width: columns, height: rows, values, mean }
    }

    fn blocks(&self) -> impl Iterator<Item = (usize, usize)> {
        let (columns, rows) = (self.width / BLOCK, self.height / BLOCK);
        (0..rows).flat_map(move |row| (0..columns).map(move |column| (column * BLOCK, row * BLOCK)))
    }

    /// Mean deviation of the values in a block from their mean.
    fn contrast(&self, (x, y): (usize, usize)) -> f64 {
        let values =
            || (y..y + BLOCK).flat_map(|y| &self.values[y * self.width + x..][..BLOCK]).map(|value| f64::from(*value));
        let count = (BLOCK * BLOCK) as f64;
        let mean = values().sum::<f64>() / count;
        values().map(|value| (value - mean).abs()).sum::<f64>() / count
    }

    /// Whether it shows enough that can be found again.
    pub(super) fn is_textured(&self) -> bool {
        let textured = self.blocks().filter(|block| self.contrast(*block) > TEXTURE).count();
        textured > 0 && textured as f64 >= TEXTURED * self.blocks().count() as f64
    }

    /// How far the whole picture has moved in `to`.
    pub(super) fn shift(&self, to: &Self) -> Shift {
        let [from, to] = [self, to].map(|small| Self::reduced(small.width, &small.values, COARSE));
        let reach = |side: usize| REACH.min(side as i32 / 2);
        let offset = (to.mean - from.mean).round() as i32;
        let mut best = (f64::INFINITY, (0, 0));
        for y in -reach(from.height)..=reach(from.height) {
            for x in -reach(from.width)..=reach(from.width) {
                let difference = from.difference(&to, (x, y), offset) + STILL * f64::from(x.abs() + y.abs());
                if difference < best.0 {
                    best = (difference, (x, y));
                }
            }
        }
        let (x, y) = best.1;
        (x * COARSE as i32, y * COARSE as i32)
    }

    /// Mean difference to `to`, moved by a shift, where both overlap.
    fn difference(&self, to: &Self, (x, y): Shift, offset: i32) -> f64 {
        let overlap = |side: usize, shift: i32| (-shift).max(0) as usize..(side as i32 - shift.max(0)) as usize;
        let (columns, rows) = (overlap(self.width, x), overlap(self.height, y));
        let mut sum = 0;
        for row in rows.clone() {
            let from = &self.values[row * self.width..][columns.clone()];
            let start = (row as i32 + y) * to.width as i32 + columns.start as i32 + x;
            let pairs = from.iter().zip(&to.values[start as usize..]);
            sum += pairs.map(|(from, to)| (i32::from(*to) - i32::from(*from) - offset).abs()).sum::<i32>();
        }
        f64::from(sum) / (rows.len() * columns.len()).max(1) as f64
    }
}

/// Finds the blocks of a frame in the frames after it.
#[derive(Debug)]
pub(super) struct Tracker<'a> {
    key: &'a Small,
    blocks: Vec<Block>,
}

#[derive(Debug)]
struct Block {
    at: (usize, usize),
    contrast: f64,
    shift: Shift,
}

impl<'a> Tracker<'a> {
    pub(super) fn new(key: &'a Small) -> Self {
        let blocks = key.blocks().map(|at| Block { at, contrast: key.contrast(at), shift: (0, 0) });
        Self { key, blocks: blocks.filter(|block| block.contrast > TEXTURE).collect() }
    }

    /// How far the blocks have moved in the next frame, on average, of the longer side of the image; infinite
    /// where most are not found. `shift` is that of the whole picture since the frame before.
    pub(super) fn motion(&mut self, frame: &Small, shift: Shift) -> f64 {
        let offset = (frame.mean - self.key.mean).round() as i32;
        let (mut sum, mut found) = (0.0, 0);
        for block in &mut self.blocks {
            let moved = (block.shift.0 + shift.0, block.shift.1 + shift.1);
            let places = &[block.shift, moved][..if shift == (0, 0) { 1 } else { 2 }];
            let matches = places.iter().filter_map(|expected| block.search(self.key, frame, *expected, offset));
            let best = matches.min_by(|a, b| a.0.total_cmp(&b.0));
            // A block may leave the image.
            block.shift = best.map_or(moved, |(_, shift)| shift);
            if best.is_none_or(|(difference, _)| difference <= MISMATCH * block.contrast) {
                found += 1;
                sum += f64::from(block.shift.0).hypot(f64::from(block.shift.1));
            }
        }
        if found == 0 || (found as f64) < FOUND * self.blocks.len() as f64 {
            return f64::INFINITY;
        }
        sum / f64::from(found) / self.key.width.max(self.key.height) as f64
    }
}

impl Block {
    /// The most similar place around an expected shift, and its mean difference; `None` outside of the image.
    fn search(&self, key: &Small, frame: &Small, expected: Shift, offset: i32) -> Option<(f64, Shift)> {
        let mut best: Option<(i32, i32, Shift)> = None;
        for y in expected.1 - AROUND..=expected.1 + AROUND {
            for x in expected.0 - AROUND..=expected.0 + AROUND {
                let place = (self.at.0 as i32 + x, self.at.1 as i32 + y);
                let fits = |at: i32, side: usize| (0..=side as i32 - BLOCK as i32).contains(&at);
                if !fits(place.0, frame.width) || !fits(place.1, frame.height) {
                    continue;
                }
                let place = (place.0 as usize, place.1 as usize);
                let row = |small: &'_ Small, (x, y): (usize, usize), row: usize| (y + row) * small.width + x;
                let steady = STEADY * ((x - expected.0).abs() + (y - expected.1).abs());
                // A place is left as soon as it costs as much as the best one.
                let limit = best.map_or(i32::MAX, |best| best.0) - steady;
                let mut sum = 0;
                for at in 0..BLOCK {
                    let from = &key.values[row(key, self.at, at)..][..BLOCK];
                    let to = &frame.values[row(frame, place, at)..][..BLOCK];
                    let differences = from.iter().zip(to).map(|(a, b)| (i32::from(*b) - i32::from(*a) - offset).abs());
                    sum += differences.sum::<i32>();
                    if sum >= limit {
                        break;
                    }
                }
                if sum < limit {
                    best = Some((sum + steady, sum, (x, y)));
                }
            }
        }
        best.map(|(_, sum, shift)| (f64::from(sum) / (BLOCK * BLOCK) as f64, shift))
    }
}
