//! The ground of a scene, and its division into cells of equal work.

use glam::{DVec2, DVec3, Vec3};
use gs_core::{Error, Scene3d};
use gs_io::Edit;
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
        let levelled = Edit::Up(None).map(scene).ok().flatten().map_or(glam::DMat3::IDENTITY, |map| map.matrix3);
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

    /// The cell with its bounds further out by these lengths.
    pub(super) fn widened(&self, by: DVec2) -> Self {
        let moved = |bound: Option<f64>, by: f64| bound.map(|bound| bound + by);
        Self {
            from: [moved(self.from[0], -by.x), moved(self.from[1], -by.y)],
            to: [moved(self.to[0], by.x), moved(self.to[1], by.y)],
        }
    }

    /// The sides of the part of the cell in the box from `least` to `most`; not negative.
    pub(super) fn sides(&self, [least, most]: [DVec2; 2]) -> DVec2 {
        let side = |i: usize| {
            let (from, to) = (self.from[i].unwrap_or(least[i]), self.to[i].unwrap_or(most[i]));
            (to - from).max(0.0)
        };
        DVec2::new(side(0), side(1))
    }

    /// Distance from a place to the nearest bound of the cell, as a share of the cell's side across that bound in the
    /// box; ∞ without bounds.
    pub(super) fn edge_distance(&self, place: DVec2, frame: [DVec2; 2]) -> f64 {
        let sides = self.sides(frame);
        let of =
            |bound: Option<f64>, i: usize| bound.map_or(f64::INFINITY, |bound| (place[i] - bound).abs() / sides[i]);
        [0, 1].into_iter().map(|i| of(self.from[i], i).min(of(self.to[i], i))).fold(f64::INFINITY, f64::min)
    }
}

/// The box of places that holds all but a hundredth of the work on each of its four sides.
pub(super) fn frame(places: &[DVec2], work: &[f64]) -> [DVec2; 2] {
    let at = |share: f64| DVec2::new(quantile(places, work, 0, share), quantile(places, work, 1, share));
    [at(0.01), at(0.99)]
}

/// The coordinate below which this share of the work lies.
fn quantile(places: &[DVec2], work: &[f64], axis: usize, share: f64) -> f64 {
    let all: Vec<usize> = (0..places.len()).collect();
    let order = ordered(&all, places, axis);
    let wanted = share * work.iter().sum::<f64>();
    let mut sum = 0.0;
    let found = order.iter().find(|&&index| {
        sum += work[index];
        sum >= wanted
    });
    found.or(order.last()).map_or(0.0, |&index| places[index][axis])
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
        let (places, work) = lattice();
        let cells = divide(Grid { columns: 4, rows: 3 }, &places, &work).unwrap();
        assert_eq!(cells.len(), 12);
        let total: f64 = work.iter().sum();
        for cell in &cells {
            let own: f64 = places.iter().zip(&work).filter(|(place, _)| cell.contains(**place)).map(|(_, w)| w).sum();
            assert!((own / total * 12.0 - 1.0).abs() < 0.4, "{own} of {total}");
        }
        let spread = |i: i32, by: f64| 60.0 * (f64::from(i) * by).fract() - 20.0;
        for place in (0..2_000).map(|i| DVec2::new(spread(i, 0.754_877), spread(i, 0.569_84))).chain(places) {
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
        assert!(divide(Grid { columns: 3, rows: 1 }, &places, &work).is_ok());
        assert!(divide(Grid { columns: 4, rows: 1 }, &places, &work).is_err());
        assert!(divide(Grid { columns: 1, rows: 1 }, &places, &[0.0; 400]).is_err());
    }

    #[test]
    fn margins_widen_bounded_sides_only() {
        let cell = Cell { from: [None, Some(1.0)], to: [Some(2.0), Some(5.0)] };
        let frame = [DVec2::new(-6.0, 0.0), DVec2::new(9.0, 9.0)];
        assert_eq!(cell.sides(frame), DVec2::new(8.0, 4.0));
        let wide = cell.widened(0.25 * cell.sides(frame));
        assert_eq!(wide, Cell { from: [None, Some(0.0)], to: [Some(4.0), Some(6.0)] });
        assert_eq!(cell.edge_distance(DVec2::new(0.0, 3.0), frame), 0.25);
        assert_eq!(Cell::default().edge_distance(DVec2::ZERO, frame), f64::INFINITY);
    }
}
