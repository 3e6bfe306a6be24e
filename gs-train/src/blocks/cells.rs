//! The ground of a scene, and its division into cells of equal work.

use glam::{DVec2, DVec3, Vec3};
use gs_core::{Error, Scene3d};
use gs_io::{Edit, WorldFrame};
use serde::{Deserialize, Serialize};

/// The two directions along the ground, world axes by default: x right, z forward.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ground {
    /// A unit vector along the ground.
    pub right: DVec3,
    /// The unit vector along the ground that is orthogonal to it.
    pub forward: DVec3,
}

impl Ground {
    /// The plane that holds most Gaussians of a scene, as [`Edit::Up`] finds it; where there is none, that of the
    /// axes x and z.
    pub fn of(scene: &Scene3d) -> Self {
        let levelled = Edit::Up(None)
            .map(scene, WorldFrame::WORLD)
            .ok()
            .flatten()
            .map_or(glam::DMat3::IDENTITY, |map| map.matrix3);
        let from_levelled = levelled.transpose();
        Self { right: from_levelled * DVec3::X, forward: from_levelled * DVec3::Z }
    }

    /// A place on the ground: along [`Self::right`] and along [`Self::forward`], world units.
    pub fn place(&self, point: Vec3) -> DVec2 {
        let point = point.as_dvec3();
        DVec2::new(point.dot(self.right), point.dot(self.forward))
    }
}

/// A number of columns, along [`Ground::right`], and of rows, along [`Ground::forward`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Grid {
    /// Columns, at least 1.
    pub columns: u32,
    /// Rows, at least 1.
    pub rows: u32,
}

/// A rectangle of the ground, open to infinity where it has no bound. The lower bounds are part of it, the upper ones
/// are not, so that cells that share a bound share no place.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cell {
    /// Lower bounds.
    pub from: [Option<f64>; 2],
    /// Upper bounds.
    pub to: [Option<f64>; 2],
}

impl Cell {
    /// Whether the place lies in the cell.
    pub fn contains(&self, place: DVec2) -> bool {
        let axis = |axis: usize| {
            self.from[axis].is_none_or(|from| place[axis] >= from) && self.to[axis].is_none_or(|to| place[axis] < to)
        };
        axis(0) && axis(1)
    }

    /// The distance of a place from the cell, world units; 0 in it.
    pub(super) fn distance(&self, place: DVec2) -> f64 {
        let beyond = |axis: usize| {
            let before = self.from[axis].map_or(0.0, |from| from - place[axis]);
            before.max(self.to[axis].map_or(0.0, |to| place[axis] - to)).max(0.0)
        };
        DVec2::new(beyond(0), beyond(1)).length()
    }

    /// The cell with each of its bounds so far out that the strip before it, as long as the cell, has this share of the
    /// cell's work; open where there is not so much.
    pub(super) fn widened(&self, share: f64, places: &[DVec2], work: &[f64]) -> Self {
        let own =
            places.iter().zip(work).filter(|(place, _)| self.contains(**place)).map(|(_, work)| work).sum::<f64>();
        // The sign is that of the direction outwards.
        let moved = |bound: Option<f64>, axis: usize, sign: f64| {
            let bound = bound?;
            let mut strip = *self;
            (strip.from[axis], strip.to[axis]) = if sign > 0.0 { (Some(bound), None) } else { (None, Some(bound)) };
            let mut members: Vec<usize> = (0..places.len()).filter(|&index| strip.contains(places[index])).collect();
            members.sort_by(|&a, &b| (sign * places[a][axis]).total_cmp(&(sign * places[b][axis])).then(a.cmp(&b)));
            let mut sum = 0.0;
            let reaches = |index: &&usize| {
                sum += work[**index];
                sum >= share * own
            };
            if share > 0.0 { members.iter().find(reaches).map(|&index| places[index][axis]) } else { Some(bound) }
        };
        Self {
            from: [0, 1].map(|axis| moved(self.from[axis], axis, -1.0)),
            to: [0, 1].map(|axis| moved(self.to[axis], axis, 1.0)),
        }
    }
}

fn ordered(members: &[usize], places: &[DVec2], axis: usize) -> Vec<usize> {
    let mut order = members.to_vec();
    order.sort_by(|&a, &b| places[a][axis].total_cmp(&places[b][axis]).then(a.cmp(&b)));
    order
}

/// Divides the ground into columns of equal work, and each column into rows of equal work. The cells are in the order
/// of their columns, then of their rows. Work is not negative, one number for each place.
///
/// # Errors
/// [`Error::Setting`] where some cell would have no place with work.
pub(super) fn divide(grid: Grid, places: &[DVec2], work: &[f64]) -> Result<Vec<Cell>, Error> {
    let with_work: Vec<usize> = (0..places.len()).filter(|&index| work[index] > 0.0).collect();
    let mut cells = Vec::new();
    for (column, members) in parts(&with_work, places, work, 0, grid.columns).ok_or_else(|| too_many(grid))? {
        for (row, _) in parts(&members, places, work, 1, grid.rows).ok_or_else(|| too_many(grid))? {
            cells.push(Cell { from: [column[0], row[0]], to: [column[1], row[1]] });
        }
    }
    Ok(cells)
}

fn too_many(Grid { columns, rows }: Grid) -> Error {
    let allowed = "fewer: some would have no Gaussian that a view shows";
    Error::setting("the number of blocks", format!("{columns}x{rows}"), allowed)
}

/// The bounds and the members of parts of equal work along an axis; `None` where a part would be empty.
#[expect(clippy::type_complexity, reason = "bounds and members")]
fn parts(
    members: &[usize],
    places: &[DVec2],
    work: &[f64],
    axis: usize,
    count: u32,
) -> Option<Vec<([Option<f64>; 2], Vec<usize>)>> {
    let mut left = ordered(members, places, axis);
    let mut from = None;
    let mut found = Vec::new();
    for part in (1..=count).rev() {
        let wanted = left.iter().map(|&index| work[index]).sum::<f64>() / f64::from(part);
        let mut sum = 0.0;
        let reaches = |&index: &usize| {
            sum += work[index];
            sum >= wanted
        };
        // The bound is the coordinate of a Gaussian, which begins the next part with all that have the same one.
        let end = if part == 1 { left.len() } else { left.iter().position(reaches)? + 1 };
        let bound = left.get(end).map(|&index| places[index][axis]);
        let end = bound.map_or(left.len(), |bound| left.partition_point(|&index| places[index][axis] < bound));
        if end == 0 || (part > 1 && bound.is_none()) {
            return None;
        }
        let others = left.split_off(end);
        found.push(([from, bound], std::mem::replace(&mut left, others)));
        from = bound;
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places on a lattice whose work grows to the right.
    fn lattice() -> (Vec<DVec2>, Vec<f64>) {
        let places: Vec<DVec2> = (0..400).map(|i| DVec2::new(f64::from(i % 20), f64::from(i / 20))).collect();
        let work = places.iter().map(|place| 1.0 + place.x).collect();
        (places, work)
    }

    #[test]
    fn cells_have_equal_work_and_cover_the_plane_once() {
        let spread = |i: i32, by: f64| 60.0 * (f64::from(i) * by).fract() - 20.0;
        let places: Vec<DVec2> = (0..2_000).map(|i| DVec2::new(spread(i, 0.754_877), spread(i, 0.569_84))).collect();
        let work: Vec<f64> = places.iter().map(|place| 30.0 + place.x).collect();
        let cells = divide(Grid { columns: 4, rows: 3 }, &places, &work).unwrap();
        assert_eq!(cells.len(), 12);
        let total: f64 = work.iter().sum();
        for cell in &cells {
            let own: f64 = places.iter().zip(&work).filter(|(place, _)| cell.contains(**place)).map(|(_, w)| w).sum();
            assert!((own / total * 12.0 - 1.0).abs() < 0.02, "{own} of {total}");
        }
        for place in places.iter().map(|place| 2.0 * *place).chain(places.iter().copied()) {
            assert_eq!(cells.iter().filter(|cell| cell.contains(place)).count(), 1, "{place}");
        }
        let one = divide(Grid { columns: 1, rows: 1 }, &[DVec2::ZERO], &[1.0]).unwrap();
        assert_eq!(one, [Cell::default()]);
    }

    #[test]
    fn cells_without_work_are_refused() {
        let (places, mut work) = lattice();
        assert!(divide(Grid { columns: 21, rows: 1 }, &places, &work).is_err());
        work.iter_mut().skip(3).for_each(|work| *work = 0.0);
        assert!(divide(Grid { columns: 2, rows: 1 }, &places, &work).is_ok());
        assert!(divide(Grid { columns: 4, rows: 1 }, &places, &work).is_err());
        assert!(divide(Grid { columns: 1, rows: 1 }, &places, &[0.0; 400]).is_err());
    }

    #[test]
    fn margins_have_their_share_of_the_work() {
        let (places, work) = lattice();
        let cell = Cell { from: [None, Some(5.0)], to: [Some(8.0), Some(9.0)] };
        // A row of the cell, of four, has a quarter of its work; columns further right have more work.
        let wide = cell.widened(0.3, &places, &work);
        assert_eq!(wide, Cell { from: [None, Some(3.0)], to: [Some(9.0), Some(10.0)] });
        assert_eq!(cell.widened(0.0, &places, &work), cell);
        let distance = |x: f64, y: f64| cell.distance(DVec2::new(x, y));
        assert_eq!(
            [distance(-9.0, 6.0), distance(9.0, 6.0), distance(11.0, 1.0), distance(8.0, 9.0)],
            [0.0, 1.0, 5.0, 0.0]
        );
        assert_eq!(cell.widened(9.0, &places, &work), Cell { from: [None, None], to: [None, None] });
    }
}
