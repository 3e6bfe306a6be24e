//! The findings of the set-up.

use super::*;

impl SetUpMeasured {
    pub(crate) fn findings(&self) -> Findings {
        let settings = paper_settings(self.extent, 0);
        Findings {
            method: format!(
                "A soft red disc and a hard blue square on white, 128×128 px; 20 random Gaussians of σ 15 px, blended front \
                 to back; \
                 {} steps of Adam on L1 + D-SSIM; a round of growth every 100 steps. {} seeds. The paper does not say how 20 \
                 become 600; here, Gaussians in the top 10 % or above the absolute threshold grow.",
                settings.iterations,
                self.grown.counts.len()
            ),
            claims: vec![self.result_claim(), self.pace_claim(), self.spikes_claim(), self.necessity_claim()],
            charts: curve_charts(&self.curves).into(),
            tables: vec![self.ways_table()],
            pictures: self.pictures.clone(),
        }
    }

    fn result_claim(&self) -> Claim {
        let (count, psnr) = (self.grown.mean_count(), self.grown.mean_psnr());
        let reached = mean(self.steps_to_budget.iter().map(|&step| f64::from(step)));
        let budget = paper_settings(self.extent, 0).gaussians;
        Claim {
            name: "converges",
            statement: "The solver turns 20 large blobs into a dense reconstruction of both shapes with 600 Gaussians.",
            section: "§3.3, Figs. 7, 8",
            circumstances: vec![
                Circumstance::counted("seeds that reach 600 Gaussians", self.grown.counts.iter().map(|&n| n >= budget)),
                Circumstance::counted(
                    format!("seeds that end sharp, at {SHARP_DB} dB or more"),
                    self.grown.psnr.iter().map(|&psnr| psnr >= SHARP_DB),
                ),
            ],
            measured: format!(
                "{count:.0} Gaussians, reached on average at step {reached:.0}, and {psnr:.1} dB at the end."
            ),
            numbers: vec![
                Number::new("Gaussians", count, ""),
                Number::new("step at which they are reached", reached, ""),
                Number::new("PSNR", psnr, "dB"),
            ],
        }
    }

    fn pace_claim(&self) -> Claim {
        let (rounds, forced) = (self.rounds_of_forced_growth(), self.forced.mean_count());
        let budget = paper_settings(self.extent, 0).gaussians;
        Claim {
            name: "forced-growth-makes-600",
            statement: "Forcing the top 10 % to grow every 100 steps, whatever the threshold, is what leads from 20 to 600.",
            section: "§3.2, §3.4.3, Fig. 8",
            circumstances: vec![Circumstance::counted(
                "seeds in which the top 10 % alone reach 600 Gaussians",
                self.forced.counts.iter().map(|&count| count >= budget),
            )],
            measured: format!(
                "The top 10 % alone make {forced:.0} Gaussians of 20 in {rounds} rounds ({:.1} dB). Together with the absolute threshold, \
                 which most exceed while the picture is blurred, they make {:.0}.",
                self.forced.mean_psnr(),
                self.grown.mean_count()
            ),
            numbers: vec![
                Number::new("Gaussians by the top 10 % alone", forced, ""),
                Number::new("PSNR by the top 10 % alone", self.forced.mean_psnr(), "dB"),
                Number::new("lowest PSNR by the top 10 % alone", self.forced.range().0, "dB"),
                Number::new("highest PSNR by the top 10 % alone", self.forced.range().1, "dB"),
                Number::new("Gaussians with the threshold", self.grown.mean_count(), ""),
            ],
        }
    }

    fn rounds_of_forced_growth(&self) -> u32 {
        let settings = forced_growth_settings(self.extent, 0);
        settings.rounds.last(settings.iterations) / settings.rounds.every
    }

    fn spikes_claim(&self) -> Claim {
        let (change, net) = (self.change, self.net_beyond_control);
        let average = |value: fn(&GrowthRound) -> f64| mean(self.rounds.iter().map(value));
        let (before, after) = (average(|r| r.slope_before), average(|r| r.slope_after));
        let jump = median(self.rounds.iter().map(|r| r.jump.exp()));
        Claim {
            name: "spikes-bring-drops",
            statement: "Spikes in the count go with rapid drops of the loss.",
            section: "§3.3, Fig. 8",
            circumstances: vec![
                Circumstance::once(
                    "the loss falls faster after a round than before it (95 % interval over seeds)",
                    change.is_negative(),
                ),
                Circumstance::once(
                    "100 steps later it stands lower than without growth (95 % interval over seeds)",
                    net.is_negative(),
                ),
            ],
            measured: format!(
                "Over the {} rounds that grew in the fits of {} seeds, ln loss falls by {:.2} per 100 steps in the 50 steps before a round \
                 and by {:.2} in those after. Averaged by seed the change is {:+.2} ({}), and a steeper fall in \
                 {} of {} seeds. The edit itself multiplies the loss by {jump:.1} (median), which a drop first has to make \
                 up for. 100 steps later, ln loss stands {:+.2} ({}) against where it went without growth, lower in {} of {} \
                 seeds.",
                self.rounds.len(),
                change.pairs,
                -before,
                -after,
                change.mean,
                change.interval_in_words(Sense::Forward, 2),
                change.negative,
                change.pairs,
                net.mean,
                net.interval_in_words(Sense::Forward, 2),
                net.negative,
                net.pairs,
            ),
            numbers: [
                vec![Number::new("change of slope at a round", change.mean, "ln loss per 100 steps")],
                interval_numbers(&change, "ln loss per 100 steps"),
                vec![
                    Number::new("loss after the edit over that before it, median", jump, ""),
                    Number::new("net change after 100 steps, against no growth", net.mean, "ln loss"),
                ],
                interval_numbers(&net, "ln loss"),
            ]
            .concat(),
        }
    }

    fn necessity_claim(&self) -> Claim {
        let [grown, twenty, small, large] =
            [&self.grown, &self.twenty, &self.many_small, &self.many_large].map(Way::mean_psnr);
        let start = self.start_against_growth;
        let better_start =
            self.many_small.psnr.iter().zip(&self.many_large.psnr).map(|(small, large)| small.max(*large));
        Claim {
            name: "growth-is-essential",
            statement: "Adding Gaussians is essential for leaving local minima.",
            section: "§3.3",
            circumstances: vec![
                Circumstance::counted(
                    format!("seeds in which 20 that stay 20 end blurred, below {SHARP_DB} dB, and growth does not"),
                    self.twenty
                        .psnr
                        .iter()
                        .zip(&self.grown.psnr)
                        .map(|(twenty, grown)| *twenty < SHARP_DB && *grown >= SHARP_DB),
                ),
                Circumstance::counted(
                    "seeds in which 600 from the start, of which none is added, end blurred too",
                    better_start.map(|psnr| psnr < SHARP_DB),
                ),
            ],
            measured: format!(
                "After as many steps, growth reaches {grown:.1} dB; 20 that stay 20 reach {twenty:.1} dB; 600 from the start reach {small:.1} dB \
                 if together they cover as much as the 20, and {large:.1} dB if each is as large. Growth ends {:+.1} dB above the better of \
                 these two starts with the same seed (seeds: {}).",
                -start.mean,
                start.interval_in_words(Sense::Reversed, 1)
            ),
            numbers: vec![
                Number::new("with growth", grown, "dB"),
                Number::new("20, no growth", twenty, "dB"),
                Number::new("600 small ones, no growth", small, "dB"),
                Number::new("600 large ones, no growth", large, "dB"),
                Number::new("growth above the better start of the same seed", -start.mean, "dB"),
            ],
        }
    }

    fn ways_table(&self) -> Table {
        let row = |way: &Way| {
            let (low, high) = way.range();
            vec![
                way.label.clone().into(),
                way.psnr.len().into(),
                Cell::Fixed(way.mean_count(), 0),
                Cell::Fixed(way.mean_psnr(), 2),
                Cell::Fixed(low, 2),
                Cell::Fixed(high, 2),
                Cell::Significant(mean(way.loss.iter().copied()), 3),
            ]
        };
        let ways = [&self.grown, &self.forced, &self.twenty, &self.many_small, &self.many_large];
        Table {
            name: "ways",
            title: "What the same number of steps reaches".to_owned(),
            columns: vec!["way", "seeds", "Gaussians", "PSNR, dB", "lowest", "highest", "last loss"],
            rows: ways.map(row).to_vec(),
        }
    }
}

/// The ends of an interval, if there is one.
fn interval_numbers(paired: &Paired, unit: &'static str) -> Vec<Number> {
    let ends = paired.interval.map(|interval| [("from", interval.low), ("to", interval.high)]);
    let number = |(end, value)| Number::new(format!("its 95 % interval over seeds, {end}"), value, unit);
    ends.into_iter().flatten().map(number).collect()
}
