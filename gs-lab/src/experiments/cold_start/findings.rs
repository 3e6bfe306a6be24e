//! The findings of the cold start.

use super::*;

/// A fit that ends below this has learnt nothing, dB: a white image has 10.
const NOTHING_DB: f64 = 12.0;

impl ColdStartMeasured {
    pub(crate) fn findings(&self) -> Findings {
        Findings {
            method: format!(
                "The paper's fit, {} steps, from 20 Gaussians of σ {COLD_SCALE_PX} px on the border of the image instead; {}. The \
                 shapes' pull is the gradient with them in the target less the gradient with a white target. The target has 8 bits a \
                 channel, as a file would, so that the disc's faint rim ends before the border.",
                self.iterations,
                seeds_in_words(self.seeds)
            ),
            claims: [
                self.gradient_claim(),
                Some(self.flat_claim()),
                self.variance_claim(),
                Some(self.mechanism_claim()),
            ]
            .into_iter()
            .flatten()
            .collect(),
            charts: vec![Figure {
                name: "loss".to_owned(),
                title: "Loss over steps, seed 0".to_owned(),
                x: Axis::linear("step"),
                y: Axis::logarithmic("loss (L1 + D-SSIM)"),
                marks: Marks::lines(self.losses.clone()),
            }],
            tables: vec![self.trajectories_table(), self.pulls_table()],
            pictures: self.pictures.clone(),
        }
    }

    fn gradient_claim(&self) -> Option<Claim> {
        let white = self.pull(Start::ColdWhite, Loss::L1)?;
        let random = self.pull(Start::ColdRandom, Loss::L1)?;
        let windowed = self.pull(Start::ColdRandom, Loss::PAPER)?;
        let good = self.pull(Start::Good, Loss::L1)?;
        Some(Claim {
            name: "gradient-is-zero",
            statement: "Small Gaussians along the border don't touch the shapes, so their positional gradients are exactly zero.",
            section: "§3.4.1, §5.1, A.1",
            circumstances: vec![
                Circumstance::counted(
                    "starts on the border (white, coloured) that the shapes don't pull under L1",
                    [white, random].map(|pull| pull.moved_by_shapes == 0),
                ),
                Circumstance::once("nor does the window of D-SSIM let them", windowed.moved_by_shapes == 0),
                Circumstance::counted(
                    "starts on the border (white, coloured) whose whole gradient is exactly zero",
                    [white, random].map(|pull| pull.in_all == 0.0),
                ),
            ],
            measured: format!(
                "Under L1 the shapes change the gradients of {} of {} Gaussians on the border, by {}, and in the good start \
                 those of {} of {}, by up to {}. The window of D-SSIM reaches 10 px further: {} Gaussians feel it, by {} at \
                 most. The whole gradient is {} where a Gaussian has the colour of the white it stands on, but up to \
                 {} where it has not: it is pushed about there, without direction.",
                white.moved_by_shapes + random.moved_by_shapes,
                white.gaussians + random.gaussians,
                exact(white.by_shapes.max(random.by_shapes)),
                good.moved_by_shapes,
                good.gaussians,
                significant(good.by_shapes, 2),
                windowed.moved_by_shapes,
                significant(windowed.by_shapes, 2),
                exact(white.in_all),
                significant(random.in_all, 2),
            ),
            numbers: vec![
                Number::new("pull of the shapes under L1", white.by_shapes.max(random.by_shapes), "device units"),
                Number::new("pull of the shapes under L1 + D-SSIM", windowed.by_shapes, "device units"),
                Number::new("pull of the shapes in the good start", good.by_shapes, "device units"),
                Number::new("gradient of white Gaussians", white.in_all, "device units"),
                Number::new("gradient of coloured Gaussians", random.in_all, "device units"),
            ],
        })
    }

    fn flat_claim(&self) -> Claim {
        let (white, random, good) =
            (self.trajectory(Start::ColdWhite), self.trajectory(Start::ColdRandom), self.trajectory(Start::Good));
        let flat = |ratio: f64| (ratio - 1.0).abs() < 0.01;
        Claim {
            name: "loss-is-flat",
            statement: "The loss stays flat and nothing is learnt.",
            section: "Fig. 9 top, A.1",
            circumstances: vec![
                Circumstance::counted(
                    "white: seeds whose last loss is within 1 % of the first",
                    white.by_seed.iter().map(|ending| flat(ending.loss_ratio)),
                ),
                Circumstance::counted(
                    "coloured: seeds whose last loss is within 1 % of that at a fifth of the steps",
                    random.by_seed.iter().map(|ending| flat(ending.late_ratio)),
                ),
                Circumstance::counted(
                    format!("coloured: seeds that learn nothing, and end below {NOTHING_DB} dB"),
                    random.by_seed.iter().map(|ending| ending.psnr < NOTHING_DB),
                ),
            ],
            measured: format!(
                "White: the last loss is {:.4} of the first. Coloured: they fade into the white first; from a fifth of the \
                 steps on the \
                 loss changes by {:+.2} %. Both end at {:.2} and {:.2} dB, where a white image is, and the good start at {:.1} dB.",
                white.loss_ratio,
                100.0 * (random.late_ratio - 1.0),
                white.psnr,
                random.psnr,
                good.psnr
            ),
            numbers: vec![
                Number::new("last loss over the first, white", white.loss_ratio, ""),
                Number::new("last loss over that at a fifth of the steps, coloured", random.late_ratio, ""),
                Number::new("PSNR of the cold start", random.psnr, "dB"),
                Number::new("PSNR of the good start", good.psnr, "dB"),
            ],
        }
    }

    fn variance_claim(&self) -> Option<Claim> {
        let pulled = |what: &str, pull: &Pull| Circumstance {
            what: format!("Gaussians of {what} whose gradient the shapes change before the first step"),
            held: pull.moved_by_shapes,
            of: pull.gaussians,
        };
        let border = pulled("σ 15 px on the border", self.pull(Start::LargeVariance, Loss::L1)?);
        let anywhere = pulled("σ 15 px anywhere, the paper's start,", self.pull(Start::Good, Loss::L1)?);
        let (large, good) = (self.trajectory(Start::LargeVariance), self.trajectory(Start::Good));
        let good_steps = good.steps_to_milestone.unwrap_or(f64::NAN);
        Some(Claim {
            name: "large-variances-cure",
            statement: "Large initial variances cure it, as every Gaussian then reaches the shapes.",
            section: "§3.4.1",
            circumstances: vec![
                anywhere,
                border,
                Circumstance::counted(
                    format!("seeds that reach the loss of the good start's step {MILESTONE} from the border"),
                    large.by_seed.iter().map(|ending| ending.steps_to_milestone.is_some()),
                ),
                Circumstance::counted(
                    format!("seeds that end sharp from the border, at {SHARP_DB} dB or more"),
                    large.by_seed.iter().map(|ending| ending.psnr >= SHARP_DB),
                ),
            ],
            measured: format!(
                "From the same border with σ {LARGE_SCALE_PX} px, the loss that the good start has at step {MILESTONE} is \
                 reached {}; \
                 it ends at {:.1} dB.",
                when(large.steps_to_milestone),
                large.psnr
            ),
            numbers: vec![
                Number::new(
                    "steps to the milestone, large variance",
                    large.steps_to_milestone.unwrap_or(f64::NAN),
                    "steps",
                ),
                Number::new("steps to the milestone, good start", good_steps, "steps"),
                Number::new("PSNR at the end", large.psnr, "dB"),
            ],
        })
    }

    fn mechanism_claim(&self) -> Claim {
        let (forced, residual) = (self.trajectory(Start::ColdForced), self.trajectory(Start::ColdResidual));
        let stuck = |what: &str, start| {
            let ends = self.trajectory(start).by_seed.iter().map(|ending| ending.psnr < NOTHING_DB);
            Circumstance::counted(format!("seeds that end below {NOTHING_DB} dB {what}"), ends)
        };
        Claim {
            name: "no-way-to-explore",
            statement: "The method has no mechanism that brings geometry into empty space without a gradient to begin with.",
            section: "§5.1, A.1",
            circumstances: vec![
                stuck("under the paper's growth", Start::ColdRandom),
                stuck("where growth is forced even without a gradient", Start::ColdForced),
            ],
            measured: format!(
                "So the paper's method fares: even if growth is forced where gradients are zero, {:.0} Gaussians end at {:.2} dB. Growth by \
                 residual, this project's cure, which needs no gradient and is not part of that method, reaches from the same cold start \
                 the loss of the good start's step {MILESTONE} {}, and ends at {:.1} dB.",
                forced.count,
                forced.psnr,
                when(residual.steps_to_milestone),
                residual.psnr
            ),
            numbers: vec![
                Number::new("PSNR of forced growth", forced.psnr, "dB"),
                Number::new(
                    "steps to the milestone, seeding by residual",
                    residual.steps_to_milestone.unwrap_or(f64::NAN),
                    "steps",
                ),
                Number::new("PSNR of seeding by residual", residual.psnr, "dB"),
            ],
        }
    }

    fn trajectories_table(&self) -> Table {
        let row = |trajectory: &Trajectory| {
            vec![
                trajectory.start.name().into(),
                trajectory.steps_to_milestone.map_or("never".into(), |steps| Cell::Fixed(steps, 0)),
                Cell::Fixed(trajectory.count, 0),
                Cell::Fixed(trajectory.psnr, 2),
                Cell::Significant(trajectory.loss_ratio, 3),
            ]
        };
        Table {
            name: "starts",
            title: format!("Steps until the loss is that of the good start at step {MILESTONE}"),
            columns: vec!["start", "steps", "Gaussians at the end", "PSNR, dB", "last loss / first"],
            rows: self.trajectories.iter().map(row).collect(),
        }
    }

    fn pulls_table(&self) -> Table {
        let row = |pull: &Pull| {
            let loss = if pull.loss == Loss::L1 { "L1" } else { "L1 + D-SSIM" };
            vec![
                pull.start.name().into(),
                loss.into(),
                pull.gaussians.into(),
                pull.moved_by_shapes.into(),
                Cell::Significant(pull.by_shapes, 2),
                Cell::Significant(pull.in_all, 2),
            ]
        };
        Table {
            name: "pulls",
            title: "Positional gradients before the first step, normalised device units".to_owned(),
            columns: vec![
                "start",
                "loss",
                "Gaussians",
                "moved by the shapes",
                "largest pull of the shapes",
                "largest gradient",
            ],
            rows: self.pulls.iter().map(row).collect(),
        }
    }
}

/// A number as text, "exactly 0" if it is.
fn exact(value: f64) -> String {
    if value == 0.0 { "exactly 0".to_owned() } else { format!("{} at most", significant(value, 2)) }
}

fn when(steps: Option<f64>) -> String {
    steps.map_or_else(|| "never".to_owned(), |steps| format!("at step {steps:.0}"))
}
