//! The findings of the instability experiment.

use super::{guard::NEEDLE_PX, small_fits::SMALL_GAUSSIANS, *};

impl InstabilityMeasured {
    pub(super) fn findings(&self) -> Findings {
        let error = |label, value: fn(&Determinant) -> f64| {
            let determinants = self.precision.determinants.iter().rev();
            Series::line(label, determinants.map(|d| (d.short_px, value(d).max(1e-9))).collect())
        };
        let scales = self.free.iter().filter(|free| free.guard == Guard::Off);
        let scales = scales.filter_map(|free| {
            let trajectory = free.trajectories.first()?;
            Some(Series::line(format!("step of {} px", free.scale_rate_px?), trajectory.scales.clone()))
        });
        let side = SyntheticTarget::THIN_LINES_24_PX.image().width();
        Findings {
            method: format!(
                "First one scale of a needle of {NEEDLE_PX} px goes to 1e-12 px, at {} angles, and loss and gradients \
                 are examined. Then {SMALL_GAUSSIANS} Gaussians are fitted to thin lines on {side}×{side} \
                 px (L1, 800 steps, {} seeds), where an optimizer may drive a scale to zero by itself. Without guards and with the \
                 paper's, this is computed in 32 bits as the formulas are written down (Σ multiplied out, inverted by a·c − \
                 b², Adam on the scales themselves), by a dense solver that only this experiment uses; with this \
                 project's guards, by the product.",
                self.drive(Guard::Off).angles,
                self.trajectories(Guard::Project).count(),
            ),
            claims: vec![self.nan_claim(), self.clamp_claim()],
            charts: vec![
                Figure {
                    name: "determinant".to_owned(),
                    title: "Relative error of the determinant in 32 bits, σ₁ = 10 px".to_owned(),
                    x: Axis::logarithmic("σ₂, px"),
                    y: Axis::logarithmic("relative error, worst of 32 angles"),
                    marks: Marks::lines(vec![
                        error("a·c − b² of Σ", |d| d.of_covariance),
                        error("of the covariance factor, squared", |d| d.of_factor),
                    ]),
                },
                Figure {
                    name: "smallest-scale".to_owned(),
                    title: "The smallest scale of a fit without guards, by Adam's step".to_owned(),
                    x: Axis::linear("step"),
                    y: Axis::logarithmic("smallest |σ|, px"),
                    marks: Marks::lines(scales.collect()),
                },
            ],
            tables: vec![self.drives_table(), self.free_table()],
            pictures: Vec::new(),
        }
    }

    /// The small fits with a guard, of all step sizes.
    fn trajectories(&self, guard: Guard) -> impl Iterator<Item = &Trajectory> {
        self.free.iter().filter(move |free| free.guard == guard).flat_map(|free| &free.trajectories)
    }

    fn nan_claim(&self) -> Claim {
        let drive = self.drive(Guard::Off);
        let (fits, diverged) = self.free_fits(Guard::Off);
        let from = drive.from_px.unwrap_or(0.0);
        // Fits that reached the scale at which the needle's gradients stop being finite, or
        // diverged before.
        let driven: Vec<&Trajectory> = self
            .trajectories(Guard::Off)
            .filter(|trajectory| trajectory.diverged || trajectory.smallest_scale_px <= from)
            .collect();
        let smallest =
            self.trajectories(Guard::Off).map(|trajectory| trajectory.smallest_scale_px).fold(f64::INFINITY, f64::min);
        Claim {
            name: "singular-covariances-give-nan".to_owned(),
            statement:
                "When the optimizer drives a scale to near zero, the covariance becomes singular and the loss NaN."
                    .to_owned(),
            section: "§3.4.2".to_owned(),
            circumstances: vec![
                Circumstance::once(
                    "in 32 bits the determinant of Σ stops being positive at a scale above zero",
                    self.precision.singular_below_px > 0.0,
                ),
                Circumstance {
                    what: "angles at which a scale driven by hand ends in a loss or gradient that is not finite"
                        .to_owned(),
                    held: drive.not_finite,
                    of: drive.angles,
                },
                Circumstance::counted(
                    "fits in which the optimizer drives a scale there that diverge",
                    driven.iter().map(|trajectory| trajectory.diverged),
                ),
            ],
            measured: format!(
                "Without guards a·c − b² is wrong by a tenth below {} px and not positive, at some angle, below {} px; loss or gradients \
                 stop being finite from σ = {} px downwards, at {} of {} angles. Of {fits} fits without guards, {} drive a scale down \
                 there by themselves, and {diverged} of these diverge. The smallest scale met is {} px.",
                significant(self.precision.wrong_below_px, 2),
                significant(self.precision.singular_below_px, 2),
                significant(from, 2),
                drive.not_finite,
                drive.angles,
                driven.len(),
                significant(smallest, 2)
            ),
            numbers: vec![
                Number::new("scale at which it first is not finite", from, "px"),
                Number::new("determinant wrong by a tenth below", self.precision.wrong_below_px, "px"),
                Number::new("determinant not positive below", self.precision.singular_below_px, "px"),
                Number::new("fits without guards that drive a scale there", driven.len() as f64, ""),
                Number::new("fits without guards that diverge", diverged as f64, ""),
                Number::new("fits without guards", fits as f64, ""),
            ],
        }
    }

    fn clamp_claim(&self) -> Claim {
        let [epsilon, paper, project] = [Guard::Epsilon, Guard::Paper, Guard::Project].map(|guard| self.drive(guard));
        let (fits, diverged) = self.free_fits(Guard::Paper);
        let (epsilon_fits, epsilon_diverged) = self.free_fits(Guard::Epsilon);
        let (project_fits, project_diverged) = self.free_fits(Guard::Project);
        let smallest = self
            .trajectories(Guard::Project)
            .map(|trajectory| trajectory.smallest_scale_px)
            .fold(f64::INFINITY, f64::min);
        // Both have the same seeds and step sizes in the same order.
        let pairs = self.trajectories(Guard::Off).zip(self.trajectories(Guard::Paper));
        let cured = pairs.filter(|(off, _)| off.diverged).map(|(_, paper)| !paper.diverged);
        Claim {
            name: "clamp-and-epsilon-cure".to_owned(),
            statement: "A hard minimum scale of 1.0 and an ε in the determinant cure it.".to_owned(),
            section: "§3.4.2".to_owned(),
            circumstances: vec![
                Circumstance {
                    what: "angles at which a scale driven by hand stays finite with both".to_owned(),
                    held: paper.angles - paper.not_finite,
                    of: paper.angles,
                },
                Circumstance::counted("fits that diverge without guards and live with both", cured),
                Circumstance { what: "fits with both that live".to_owned(), held: fits - diverged, of: fits },
            ],
            measured: format!(
                "With both, everything is finite at {} of {} angles, and {diverged} of {fits} fits diverge. With ε alone, {} of {} angles \
                 and {epsilon_diverged} of {epsilon_fits} fits do not stay finite. With this project's guards, {} of {} angles stay finite and \
                 {project_diverged} of {project_fits} fits diverge; they let a scale shrink to 0.25 px in training (the \
                 smallest met at any step is {} px) and leave a Gaussian of {NEEDLE_PX} px out whose other scale is below {} px.",
                paper.angles - paper.not_finite,
                paper.angles,
                epsilon.not_finite,
                epsilon.angles,
                project.angles - project.not_finite,
                project.angles,
                significant(smallest, 2),
                significant(project.left_out_px.unwrap_or(0.0), 2)
            ),
            numbers: vec![
                Number::new("angles that are not finite with clamp and ε", paper.not_finite as f64, ""),
                Number::new("angles that are not finite with ε alone", epsilon.not_finite as f64, ""),
                Number::new("angles that are not finite with this project's guards", project.not_finite as f64, ""),
                Number::new("fits that diverge with clamp and ε", diverged as f64, ""),
                Number::new("fits that diverge with ε alone", epsilon_diverged as f64, ""),
                Number::new("fits that diverge with this project's guards", project_diverged as f64, ""),
            ],
        }
    }

    fn drives_table(&self) -> Table {
        let row = |drive: &Drive| {
            let scale = |scale: Option<f64>| Cell::from(scale.map(|scale| Cell::Significant(scale, 2)));
            vec![
                drive.guard.name().into(),
                drive.angles.into(),
                drive.not_finite.into(),
                scale(drive.from_px),
                scale(drive.left_out_px),
            ]
        };
        let columns = ["guard", "angles", "not finite at", "from σ, px", "left out from σ, px"];
        Table::new("driven", "A scale that is driven to zero", &columns, self.drives.iter().map(row).collect())
    }

    fn free_table(&self) -> Table {
        let row = |free: &Free| {
            vec![
                free.guard.name().into(),
                free.scale_rate_px.map_or("2 % (logarithm)".into(), |rate| format!("{rate} px").into()),
                free.fits().into(),
                free.diverged().into(),
                Cell::Significant(free.smallest_scale_px(), 2),
                free.psnr().map(|psnr| Cell::Fixed(psnr, 2)).into(),
            ]
        };
        let columns = ["guard", "Adam's step of σ", "fits", "diverged", "smallest |σ|, px", "PSNR, dB"];
        Table::new("free", "Small fits to thin lines", &columns, self.free.iter().map(row).collect())
    }
}
