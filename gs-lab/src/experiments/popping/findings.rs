//! The findings of camera flights, for the experiment and for any scene.

use super::*;

/// Factor by which differences are enlarged.
pub(super) const DIFFERENCE_GAIN: f32 = 4.0;

/// Half the step leaves at least this share of a jump's highest flicker, and a quarter of motion's.
const STAYS: f64 = 0.8;

/// The caption of a picture made by [`pictures::picture`].
pub(super) fn caption(what: &str, step_degrees: f64) -> String {
    format!(
        "{what}: above with the global sort, below with the per-pixel sort. Two frames {step_degrees:.3}° apart, and their \
         difference, {DIFFERENCE_GAIN} times as large, around grey."
    )
}

impl PoppingComparison {
    /// Table, chart and picture of a scene with the name `what`. `picture` is made by
    /// [`PoppingComparison::picture`].
    pub fn findings(&self, what: &str, picture: Picture) -> Findings {
        let AtStep { step_degrees, orders } = self.finest();
        Findings {
            method: format!(
                "{what}: {} stretches of an orbit, frames {step_degrees:.4}° apart, rendered in both orders. Jumps are measured by the second difference \
                 of three frames, averaged with SSIM's window: half the step leaves a quarter of motion, and all of a jump.",
                orders[0].squares_per_degree.len(),
            ),
            claims: Vec::new(),
            charts: vec![trajectory_chart(what, self)],
            tables: vec![Table { rows: rows(self), ..table("popping", format!("{what}: what jumps"), &STEP_COLUMNS) }],
            pictures: vec![picture],
        }
    }

    /// A picture of the place where popping shows best. The arguments are those of [`compare`].
    ///
    /// # Errors
    /// Those of the backend.
    pub fn picture<R: gs_core::Optimizer<Scene3d>>(
        &self,
        rasterizer: &R,
        scene: &Scene3d,
        render: &RenderSettings,
        what: &str,
    ) -> Result<Picture, Error> {
        let caption = caption(what, self.finest().step_degrees);
        pictures::picture(rasterizer, scene, &self.moment, render, ("popping", caption))
    }

    /// The share of the highest flicker that half the step leaves, for each of [`ORDERS`].
    pub(crate) fn left_by_half_a_step(&self) -> [f64; 2] {
        [0, 1].map(|order| self.steps[0].orders[order].highest / self.steps[1].orders[order].highest)
    }
}

const STEP_COLUMNS: [&str; 5] =
    ["step, °", "order", "jumps, levels² per degree", "visible jumps per pixel and degree", "highest flicker, levels"];

fn table(name: &'static str, title: String, columns: &[&'static str]) -> Table {
    Table { name, title, columns: columns.to_vec(), rows: Vec::new() }
}

fn rows(comparison: &PoppingComparison) -> Vec<Vec<Cell>> {
    let of_step = |at: &AtStep| {
        let of_order = |(order, popping): (Order, &Popping)| -> Vec<Cell> {
            vec![
                Cell::Significant(at.step_degrees, 3),
                order.name().into(),
                Cell::Significant(popping.squares(), 3),
                Cell::Significant(popping.times(), 3),
                Cell::Significant(popping.highest, 3),
            ]
        };
        ORDERS.into_iter().zip(&at.orders).map(of_order).collect::<Vec<_>>()
    };
    comparison.steps.iter().flat_map(of_step).collect()
}

fn trajectory_chart(what: &str, comparison: &PoppingComparison) -> Figure {
    let curve = |(order, popping): (Order, &Popping)| {
        let points = (1..).zip(&popping.trajectory).map(|(triple, &levels)| (f64::from(triple), levels));
        Series::line(order.name(), points.collect())
    };
    Figure {
        name: "flicker".to_owned(),
        title: format!("{what}: flicker, frame by frame"),
        x: Axis::linear("frame, stretch after stretch"),
        y: Axis::linear("root mean square second difference, 8-bit levels"),
        marks: Marks::lines(ORDERS.into_iter().zip(&comparison.finest().orders).map(curve).collect()),
    }
}

impl PoppingMeasured {
    pub(crate) fn findings(&self) -> Findings {
        let discs = table("discs", "Two discs through each other".to_owned(), &STEP_COLUMNS);
        let sizes = self.ball.iter();
        Findings {
            method: format!(
                "Scenes made by formulas, {SIDE_PX}×{SIDE_PX} px, with a camera on an orbit: two flat Gaussians through each other, and a ball \
                 half sunk in a sea, both covered with flat Gaussians of {} px. Frames {STEP_DEGREES}° apart at {} places, in both \
                 orders. Jumps are distinguished from motion by the second difference of three frames, averaged with SSIM's window: half \
                 the step leaves a quarter of motion, and all of a jump.",
                sizes.map(|of| of.sigma_px.to_string()).collect::<Vec<_>>().join(", "),
                self.extent.choose(8, 4)
            ),
            claims: vec![self.pops_claim(), self.size_claim()],
            charts: vec![trajectory_chart("Two discs", &self.discs), self.size_chart()],
            tables: vec![Table { rows: rows(&self.discs), ..discs }, self.size_table()],
            pictures: self.pictures.clone(),
        }
    }

    fn pops_claim(&self) -> Claim {
        let [tile, _] = self.discs.left_by_half_a_step();
        let highest = self.discs.finest().orders.each_ref().map(|popping| popping.highest);
        let coarse = self.ball[0].comparison.finest();
        let more = |of: &OfSize| of.comparison.finest().tile().squares() > of.comparison.finest().pixel().squares();
        Claim {
            name: "colours-pop".to_owned(),
            statement: "Sorting by one depth per Gaussian and tile can make colours pop where Gaussians intersect or tiles meet, as the order \
                        of blending flips while the camera moves.".to_owned(),
            section: "§5.4".to_owned(),
            circumstances: vec![
                Circumstance::once("two discs through each other jump, whatever the step", tile >= STAYS),
                Circumstance::once("with the per-pixel sort nothing jumps visibly", highest[1] < VISIBLE_LEVELS),
                Circumstance::counted(
                    "sizes of the Gaussians of the ball in the sea at which more jumps with the global sort",
                    self.ball.iter().map(more),
                ),
                Circumstance::once("tile borders are visible in the picture", self.grid_trace > 1.0),
            ],
            measured: format!(
                "As the means of the discs change their order of depth, the flicker of a window rises to {:.0} of 255 levels, and half the step \
                 leaves {:.0} % of it; with the per-pixel sort it is {:.2} levels. Around the ball in the sea, of Gaussians of {} px, flicker \
                 rises to {:.1} levels against {:.1}, and the squares of what jumps come to {:.3} levels² per degree against {:.3}. Tiles \
                 leave no trace: with their grid elsewhere no pixel differs by more than {:.4} levels, as a Gaussian has the same depth in \
                 every tile.",
                highest[0],
                100.0 * tile,
                highest[1],
                self.ball[0].sigma_px,
                coarse.tile().highest,
                coarse.pixel().highest,
                coarse.tile().squares(),
                coarse.pixel().squares(),
                self.grid_trace
            ),
            numbers: vec![
                Number::new("highest flicker of the discs, global", highest[0], "levels"),
                Number::new("highest flicker of the discs, per-pixel", highest[1], "levels"),
                Number::new("left by half the step, global", tile, ""),
                Number::new("jumps around the ball in the sea, global", coarse.tile().squares(), "levels² per degree"),
                Number::new(
                    "jumps around the ball in the sea, per-pixel",
                    coarse.pixel().squares(),
                    "levels² per degree",
                ),
                Number::new("difference by where tiles meet", self.grid_trace, "levels"),
            ],
        }
    }

    fn size_claim(&self) -> Claim {
        let squares: Vec<f64> = self.ball.iter().map(|of| of.comparison.finest().tile().squares()).collect();
        let (largest, smallest) = (&self.ball[0], &self.ball[self.ball.len() - 1]);
        let highest = [largest, smallest].map(|of| of.comparison.finest().tile().highest);
        let numbers = self.ball.iter().zip(&squares).map(|(of, &squares)| {
            Number::new(format!("jumps with Gaussians of {} px", of.sigma_px), squares, "levels² per degree")
        });
        Claim {
            name: "negligible-at-pixel-size".to_owned(),
            statement: "That one depth per Gaussian is not right at every pixel becomes negligible as Gaussians converge to the size of \
                        pixels.".to_owned(),
            section: "§2.3.1".to_owned(),
            circumstances: vec![
                Circumstance::counted(
                    "halvings of σ after which less jumps",
                    squares.windows(2).map(|pair| pair[1] < pair[0]),
                ),
                Circumstance::once(
                    format!("with Gaussians of {} px nothing jumps visibly", smallest.sigma_px),
                    highest[1] < VISIBLE_LEVELS,
                ),
            ],
            measured: format!(
                "The same ball in the same sea, with the global sort: of {} Gaussians of {} px the squares of what jumps come to \
                 {:.3} levels² per degree and flicker rises to {:.1} levels, of {} Gaussians of {} px to {:.4} and {:.1}.",
                largest.gaussians,
                largest.sigma_px,
                squares[0],
                highest[0],
                smallest.gaussians,
                smallest.sigma_px,
                squares[squares.len() - 1],
                highest[1],
            ),
            numbers: numbers.collect(),
        }
    }

    fn size_chart(&self) -> Figure {
        let curve = |order: usize| {
            let points = self.ball.iter().rev();
            let squares = points.map(|of| (of.sigma_px.into(), of.comparison.finest().orders[order].squares()));
            Series::dotted(ORDERS[order].name(), squares.collect())
        };
        Figure {
            name: "size".to_owned(),
            title: "A ball in a sea: what jumps, by the size of the Gaussians".to_owned(),
            x: Axis::logarithmic("σ, px"),
            y: Axis::logarithmic("jumps, 8-bit levels² per degree"),
            marks: Marks::lines(vec![curve(0), curve(1)]),
        }
    }

    fn size_table(&self) -> Table {
        let columns = ["σ, px", "Gaussians"].into_iter().chain(STEP_COLUMNS);
        let rows = self.ball.iter().flat_map(|of| {
            let head: [Cell; 2] = [Cell::Significant(of.sigma_px.into(), 2), of.gaussians.into()];
            rows(&of.comparison).into_iter().map(move |row| head.iter().cloned().chain(row).collect())
        });
        Table { rows: rows.collect(), ..table("ball", "A ball in a sea".to_owned(), &columns.collect::<Vec<_>>()) }
    }
}
