//! The findings of camera flights around scenes whose popping is known.

use super::*;

/// Half the step leaves at least this share of a jump's highest flicker, and a quarter of motion's.
const STAYS: f64 = 0.8;

impl PoppingMeasured {
    pub(super) fn findings(&self) -> Findings {
        let sizes = self.ball.iter();
        Findings {
            method: format!(
                "Scenes made by formulas, {SIDE_PX}×{SIDE_PX} px, with a camera on an orbit: two flat Gaussians through each other, and a ball \
                 half sunk in a sea, both covered with flat Gaussians of {} px. Frames {STEP_DEGREES}° apart at {} places, in both \
                 orders. Jumps are distinguished from motion by the second difference of three frames, averaged with SSIM's window: half \
                 the step leaves a quarter of motion, and all of a jump.",
                sizes.map(|of| of.sigma_px.to_string()).collect::<Vec<_>>().join(", "),
                if self.is_quick { 4 } else { 8 }
            ),
            claims: vec![self.pops_claim(), self.size_claim()],
            charts: vec![trajectory_chart("Two discs", &self.discs), self.size_chart()],
            tables: vec![
                Table::new("discs", "Two discs through each other", &STEP_COLUMNS, rows(&self.discs)),
                self.size_table(),
            ],
            pictures: self.pictures.clone(),
        }
    }

    fn pops_claim(&self) -> Claim {
        // The share of the highest flicker that half the step leaves, with the global sort.
        let tile = self.discs.steps[0].tile().highest / self.discs.steps[1].tile().highest;
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
        Table::new("ball", "A ball in a sea", &columns.collect::<Vec<_>>(), rows.collect())
    }
}
