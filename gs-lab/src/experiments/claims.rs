//! The paper's claims in the quick form of the experiments, each with its verdict and the numbers
//! behind it.
//!
//! A test runs an experiment once and checks each of its claims in a function of its own. A claim
//! without such a function fails the test.

use super::{
    Cell, ClaimVerdict, ExperimentSize, Findings, Laboratory, Watch,
    cold_start::{self, ColdStartMeasured, Start},
    edges::{self, EdgesMeasured, Zone},
    instability::{self, Guard, InstabilityMeasured},
    lazy_convergence::{self, Case, Criterion, LazyMeasured, Variation},
    popping::{self, PoppingMeasured},
    set_up::{self, SetUpMeasured},
};
use crate::price::popping::VISIBLE_LEVELS;
use gs_core::Loss;
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_train::PAPER_SIDE_PX;

fn cpu() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default()).unwrap()
}

/// Name of a claim, its verdict in the quick form, and the check of its numbers.
type Check<M> = (&'static str, ClaimVerdict, fn(&M));

/// Checks the verdicts and numbers of all claims of an experiment, and that tables and charts are
/// complete.
fn check_claims<M>(measured: &M, findings: &Findings, checks: &[Check<M>]) {
    let made: Vec<&str> = findings.claims.iter().map(|claim| claim.name).collect();
    let checked: Vec<&str> = checks.iter().map(|check| check.0).collect();
    assert_eq!(made, checked, "every claim is looked at");
    for (claim, (_, verdict, check)) in findings.claims.iter().zip(checks) {
        check(measured);
        assert_eq!(claim.verdict(), *verdict, "{claim:?}");
        assert!(
            !claim.circumstances.is_empty() && claim.circumstances.iter().all(|c| c.held <= c.of && c.of > 0),
            "{claim:?}"
        );
        assert!(claim.measured.contains(|c: char| c.is_ascii_digit()) && !claim.measured.contains("NaN"), "{claim:?}");
        assert!(!claim.numbers.is_empty() && claim.numbers.iter().all(|number| number.value.is_finite()), "{claim:?}");
    }
    for table in &findings.tables {
        assert!(table.rows.iter().all(|row| row.len() == table.columns.len()), "{}", table.title);
        assert!(!table.rows.iter().flatten().any(|cell| matches!(cell, Cell::Fixed(v, _) if v.is_nan())), "{table:?}");
    }
    for chart in &findings.charts {
        assert!(chart.lines().iter().all(|series| !series.points.is_empty()), "{}", chart.title);
    }
}

/// Counts the fits.
#[derive(Default)]
struct Counter(u32);

impl Watch for Counter {
    fn on_fit(&mut self, label: &str) {
        assert!(!label.is_empty());
        self.0 += 1;
    }
}

mod set_up_and_result {
    use super::*;

    #[test]
    fn claims() {
        let mut counter = Counter::default();
        let measured = set_up::measure(&mut Laboratory::new(&cpu(), ExperimentSize::Quick, &mut counter)).unwrap();
        assert_eq!(counter.0, 22);
        check_claims(
            &measured,
            &measured.findings(),
            &[
                ("converges", ClaimVerdict::Confirmed, converges),
                ("forced-growth-makes-600", ClaimVerdict::Refuted, forced_growth_makes_600),
                ("spikes-bring-drops", ClaimVerdict::Confirmed, spikes_bring_drops),
                ("growth-is-essential", ClaimVerdict::Partly, growth_is_essential),
            ],
        );
    }

    fn converges(m: &SetUpMeasured) {
        assert!(m.grown.counts.iter().all(|&count| count == 600), "{:?}", m.grown);
        assert!(m.grown.mean_psnr() > 50.0, "{:?}", m.grown);
        assert!(m.steps_to_budget.iter().all(|step| (500..=900).contains(step)), "{:?}", m.steps_to_budget);
    }

    /// 20 Gaussians grow by a tenth, rounded up, in each of 9 rounds: 22, 25, 28, 31, 35, 39, 43,
    /// 48, 53.
    fn forced_growth_makes_600(m: &SetUpMeasured) {
        assert_eq!(m.forced.counts, [53; 6]);
    }

    fn spikes_bring_drops(m: &SetUpMeasured) {
        // Each seed counts once, however many rounds its fits have.
        assert!(m.change.pairs == 6 && m.rounds.len() >= 70, "{:?}", m.change);
        assert!(m.change.interval.unwrap().high < -0.5 && m.change.negative == 6, "{:?}", m.change);
        assert!(m.net_beyond_control.interval.unwrap().high < -0.05, "{:?}", m.net_beyond_control);
        // The edit itself increases the loss.
        assert!(m.rounds.iter().filter(|round| round.jump > 0.0).count() * 10 > m.rounds.len() * 9);
    }

    fn growth_is_essential(m: &SetUpMeasured) {
        let [grown, twenty, small] = [&m.grown, &m.twenty, &m.many_small].map(|way| way.mean_psnr());
        assert!(twenty < 24.0 && small > twenty + 20.0 && grown > small, "{grown} {twenty} {small}");
        assert!(
            m.start_against_growth.pairs == 2 && m.start_against_growth.mean < -3.0,
            "{:?}",
            m.start_against_growth
        );
    }
}

mod cold_starts {
    use super::*;

    #[test]
    fn claims() {
        let measured = cold_start::measure(&mut Laboratory::new(&cpu(), ExperimentSize::Quick, &mut ())).unwrap();
        check_claims(
            &measured,
            &measured.findings(),
            &[
                ("gradient-is-zero", ClaimVerdict::Partly, gradient_is_zero),
                ("loss-is-flat", ClaimVerdict::Confirmed, loss_is_flat),
                ("large-variances-cure", ClaimVerdict::Partly, large_variances_cure),
                ("no-way-to-explore", ClaimVerdict::Confirmed, no_way_to_explore),
            ],
        );
    }

    fn gradient_is_zero(m: &ColdStartMeasured) {
        for start in [Start::ColdWhite, Start::ColdRandom] {
            let pull = m.pull(start, Loss::L1).unwrap();
            assert_eq!((pull.gaussians, pull.moved_by_shapes, pull.by_shapes), (20, 0, 0.0), "{pull:?}");
            assert!(m.pull(start, Loss::PAPER).unwrap().by_shapes < 1e-4);
        }
        // Control: where Gaussians overlap the shapes, all of them are pulled.
        let good = m.pull(Start::Good, Loss::L1).unwrap();
        assert!(good.moved_by_shapes == 20 && good.by_shapes > 0.01, "{good:?}");
        // Coloured Gaussians have gradients because they differ from the white below them.
        assert!(m.pull(Start::ColdRandom, Loss::L1).unwrap().in_all > 1e-4);
    }

    fn loss_is_flat(m: &ColdStartMeasured) {
        assert!((m.trajectory(Start::ColdWhite).loss_ratio - 1.0).abs() < 1e-4);
        assert!((m.trajectory(Start::ColdRandom).late_ratio - 1.0).abs() < 1e-3);
        assert!(m.trajectory(Start::ColdRandom).psnr < 10.5 && m.trajectory(Start::Good).psnr > 50.0);
    }

    fn large_variances_cure(m: &ColdStartMeasured) {
        assert_eq!(m.trajectory(Start::Good).steps_to_milestone, Some(500.0));
        // In the paper's start all Gaussians are pulled; on the border, some of the same size reach
        // no shape.
        let pulled = |start| m.pull(start, Loss::L1).unwrap().moved_by_shapes;
        assert!(pulled(Start::Good) == 20 && (10..20).contains(&pulled(Start::LargeVariance)));
        assert!(m.trajectory(Start::LargeVariance).steps_to_milestone.is_some_and(|steps| steps < 1000.0));
    }

    fn no_way_to_explore(m: &ColdStartMeasured) {
        let forced = m.trajectory(Start::ColdForced);
        assert!(forced.steps_to_milestone.is_none() && forced.count > 40.0 && forced.psnr < 10.5, "{forced:?}");
        let seeded = m.trajectory(Start::ColdResidual);
        assert!(seeded.steps_to_milestone.is_some_and(|steps| steps < 400.0) && seeded.psnr > 50.0, "{seeded:?}");
    }
}

mod lazy {
    use super::*;

    #[test]
    fn claims() {
        let measured = lazy_convergence::measure(&mut Laboratory::new(&cpu(), ExperimentSize::Quick, &mut ())).unwrap();
        check_claims(
            &measured,
            &measured.findings(),
            &[
                ("absolute-threshold-stagnates", ClaimVerdict::Partly, absolute_threshold_stagnates),
                ("forced-growth-does-not", ClaimVerdict::Partly, forced_growth_does_not),
                ("no-universal-threshold", ClaimVerdict::Partly, no_universal_threshold),
                ("relative-criteria-generalise", ClaimVerdict::Partly, relative_criteria_generalise),
            ],
        );
    }

    fn absolute_threshold_stagnates(m: &LazyMeasured) {
        let (pixel, device) = (m.growth(Criterion::AbsolutePixel), m.growth(Criterion::AbsoluteDevice));
        assert!((22.0..40.0).contains(&pixel.mean_count()) && pixel.last_growth <= 400.0, "{pixel:?}");
        assert!(pixel.mean_psnr() < 26.0 && device.mean_psnr() > 50.0);
        assert_eq!(device.counts, [600; 2]);
    }

    /// The count follows from the policy; the PSNR does not.
    fn forced_growth_does_not(m: &LazyMeasured) {
        let (forced, pixel) = (m.growth(Criterion::Forced), m.growth(Criterion::AbsolutePixel));
        assert_eq!(forced.counts, [53; 2]);
        assert!(forced.psnr.iter().zip(&pixel.psnr).all(|(forced, pixel)| forced > pixel), "{forced:?} {pixel:?}");
    }

    fn no_universal_threshold(m: &LazyMeasured) {
        let paper = &m.cases[0];
        assert_eq!((paper.variation, paper.target.side_px), (Variation::None, PAPER_SIDE_PX));
        assert!(paper.outcomes.iter().all(|outcome| outcome.count_transferred == m.trial.budget), "{paper:?}");
        let moves = |variation| {
            let mut cases = m.cases.iter().filter(|case| case.variation == variation);
            cases.all(|case| case.moves_against(paper))
        };
        assert!(moves(Variation::Contrast) && !moves(Variation::Stripes), "{:?}", m.cases);
    }

    fn relative_criteria_generalise(m: &LazyMeasured) {
        let reached = |case: &Case| case.outcomes.iter().all(|outcome| outcome.count_hybrid == m.trial.budget);
        assert!(m.cases.len() >= 3 && m.cases.iter().all(reached), "{:?}", m.cases);
        // With the paper's 10 % the rounds are too few for the budget.
        assert!(m.cases.iter().flat_map(|case| &case.outcomes).all(|outcome| outcome.count_forced < m.trial.budget));
    }
}

mod instabilities {
    use super::*;

    #[test]
    fn claims() {
        let measured = instability::measure(&mut Laboratory::new(&cpu(), ExperimentSize::Quick, &mut ())).unwrap();
        check_claims(
            &measured,
            &measured.findings(),
            &[
                ("singular-covariances-give-nan", ClaimVerdict::Partly, singular_covariances_give_nan),
                ("clamp-and-epsilon-cure", ClaimVerdict::Confirmed, clamp_and_epsilon_cure),
                ("price-of-the-clamp", ClaimVerdict::Confirmed, price_of_the_clamp),
            ],
        );
    }

    fn singular_covariances_give_nan(m: &InstabilityMeasured) {
        let off = m.drive(Guard::Off);
        assert!(off.not_finite * 2 > off.angles, "{off:?}");
        assert!(off.from_px.is_some_and(|from| (1e-4..1e-2).contains(&from)), "{off:?}");
        assert!(m.precision.wrong_below_px > off.from_px.unwrap(), "wrong before it is NaN");
        let (fits, diverged) = m.free_fits(Guard::Off);
        assert!(fits == 10 && (1..fits).contains(&diverged), "some diverge, and not all: {diverged} of {fits}");
    }

    fn clamp_and_epsilon_cure(m: &InstabilityMeasured) {
        for guard in [Guard::Paper, Guard::Project] {
            assert_eq!((m.drive(guard).not_finite, m.free_fits(guard).1), (0, 0), "{guard:?}");
        }
        assert!(m.drive(Guard::Epsilon).not_finite > 0, "it is not the ε that cures");
        assert!(m.drive(Guard::Project).left_out_px.is_some_and(|scale| scale < 1e-3));
        // The scales are checked at every step: they stay above the minimum and come close to it.
        let project = m.free.iter().find(|free| free.guard == Guard::Project).unwrap();
        assert!(
            project.trajectories.iter().all(|trajectory| trajectory.scales.len() == 201),
            "800 steps, every fourth, and the end"
        );
        assert!((0.25..0.5).contains(&project.smallest_scale_px()), "{}", project.smallest_scale_px());
    }

    fn price_of_the_clamp(m: &InstabilityMeasured) {
        // One seed is too few for the thin lines: a fit may end while it recovers from a round.
        assert!(m.price_of_clamp("circle and square").mean < -5.0, "{:?}", m.floors);
        assert!(m.floors.iter().all(|floor| floor.diverged() == 0));
    }
}

mod edges_and_blobs {
    use super::*;

    #[test]
    fn claims() {
        let measured = edges::measure(&mut Laboratory::new(&cpu(), ExperimentSize::Quick, &mut ())).unwrap();
        let findings = measured.findings();
        // A rounding may reverse the order for one of the two seeds, but not on average.
        let fewer = findings.claims[1].verdict();
        assert!(matches!(fewer, ClaimVerdict::Confirmed | ClaimVerdict::Partly), "{fewer:?}");
        check_claims(
            &measured,
            &findings,
            &[
                ("edges-are-dense-and-stretched", ClaimVerdict::Confirmed, edges_are_dense_and_stretched),
                ("the-disc-needs-fewer", fewer, the_disc_needs_fewer),
            ],
        );
    }

    fn edges_are_dense_and_stretched(m: &EdgesMeasured) {
        let (square, disc) = (m.population(Zone::SquareEdge), m.population(Zone::DiscEdge));
        // A single fit is chaotic: rounding the target changes these numbers by a fifth.
        let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
        assert!(mean(&square.per_100_px2) > 1.3 * mean(&disc.per_100_px2), "{square:?} {disc:?}");
        assert!(mean(&square.anisotropy) > 1.5 * mean(&disc.anisotropy), "{square:?} {disc:?}");
        assert!(mean(&square.size_px) < mean(&disc.size_px), "{square:?} {disc:?}");
        assert!(square.off_edge_degrees < 10.0, "along the edge: {square:?}");
    }

    fn the_disc_needs_fewer(m: &EdgesMeasured) {
        let count = |zones: [Zone; 2]| zones.map(|zone| m.population(zone).count).iter().sum::<f64>();
        let (disc, square) = (count([Zone::DiscEdge, Zone::DiscInside]), count([Zone::SquareEdge, Zone::SquareInside]));
        assert!(disc < square && disc + square > 450.0, "{disc} {square}");
    }
}

mod popping_of_colours {
    use crate::price::popping::{PoppingComparison, SlowOrbit, compare, discs, discs_flight};
    use glam::Vec3;
    use gs_core::{Blend, RenderSettings, Scene, Scene3d, effects::Antialias};

    use super::*;

    #[test]
    fn claims() {
        let measured = popping::measure(&mut Laboratory::new(&cpu(), ExperimentSize::Quick, &mut ())).unwrap();
        check_claims(
            &measured,
            &measured.findings(),
            &[
                ("colours-pop", ClaimVerdict::Partly, colours_pop),
                ("negligible-at-pixel-size", ClaimVerdict::Confirmed, negligible_at_pixel_size),
            ],
        );
    }

    fn colours_pop(m: &PoppingMeasured) {
        // With the global sort the discs jump at once by more than a third of the range; with the
        // per-pixel sort not at all.
        let [tile, pixel] = m.discs.finest().orders.each_ref().map(|popping| popping.highest);
        assert!(tile > 85.0 && pixel < 0.5, "{tile} {pixel}");
        // A third of the pixels jumps once, whatever the step.
        let left = m.discs.left_by_half_a_step()[0];
        assert!((0.98..1.02).contains(&left), "{left}");
        let largest = m.ball[0].comparison.finest();
        assert!(largest.tile().highest > VISIBLE_LEVELS && largest.pixel().highest < VISIBLE_LEVELS, "{largest:?}");
        assert!(largest.tile().squares() > 2.0 * largest.pixel().squares(), "{largest:?}");
        assert!(m.grid_trace < 0.1, "{}", m.grid_trace);
    }

    fn negligible_at_pixel_size(m: &PoppingMeasured) {
        let squares: Vec<f64> = m.ball.iter().map(|of| of.comparison.finest().tile().squares()).collect();
        assert!(squares[0] > 3.0 * squares[3], "{squares:?}");
        assert!(m.ball.windows(2).all(|pair| pair[1].gaussians > 3 * pair[0].gaussians));
    }

    fn flown(scene: &Scene3d, step_degrees: f32) -> PoppingComparison {
        let (flight, first) = discs_flight(96, 16, step_degrees);
        let mut render = RenderSettings::blended(Blend::Over);
        render.effects.antialias = Antialias::Dilate;
        // A high α cut would leave visible rims.
        render.accuracy.alpha_cut = 1e-6;
        compare(cpu().for_3d(), scene, &flight, &first, &render).unwrap()
    }

    /// A single disc has no order: half the step leaves a quarter of the motion, with either order.
    /// With two discs, a jump remains.
    #[test]
    fn motion_goes_with_the_step_and_a_jump_stays() {
        let one: Scene3d = {
            let mut scene = Scene3d::default();
            // Off the axis, so that it moves across the picture.
            let gaussian = discs().gaussian(0);
            scene.push(gs_core::Gaussian3d { mean: Vec3::new(0.3, 0.0, -1.0), ..gaussian });
            scene
        };
        let moved = flown(&one, 0.5);
        let [tile, pixel] = moved.finest().orders.each_ref().map(|popping| popping.highest);
        assert!(tile > 0.05 && (tile - pixel).abs() < 1e-3 * tile, "{tile} {pixel}");
        for steps in moved.steps.windows(2) {
            let left = steps[0].tile().highest / steps[1].tile().highest;
            assert!((0.2..0.3).contains(&left), "{left}");
            // Squares per degree fall to an eighth.
            let left = steps[0].tile().squares() / steps[1].tile().squares();
            assert!((0.08..0.17).contains(&left), "{left}");
        }
        let jumped = flown(&discs(), 0.05);
        for steps in jumped.steps.windows(2) {
            let left = steps[0].tile().highest / steps[1].tile().highest;
            assert!((0.98..1.02).contains(&left), "{left}");
        }
        // The camera turns by 15 steps, during which each pixel jumps once.
        let turned = 15.0 * 0.05;
        let share = jumped.finest().tile().times() * turned;
        assert!((0.1..0.5).contains(&share), "{share}");
        assert_eq!(jumped.finest().pixel().times(), 0.0);
        let middle = jumped.moment.pixel;
        assert!(middle.0.abs_diff(48) < 16 && middle.1.abs_diff(48) < 16, "{middle:?}");
    }

    #[test]
    fn a_flight_that_is_not_possible_is_refused() {
        let (flight, first) = discs_flight(16, 9, 1.0);
        assert_eq!(flight.stretches(&first).unwrap()[0].len(), 9);
        for bad in [
            SlowOrbit { frames: 8, ..flight },
            SlowOrbit { frames: 1_000_000, ..flight },
            SlowOrbit { step_degrees: 0.0, ..flight },
            SlowOrbit { step_degrees: f32::NAN, ..flight },
            SlowOrbit { orbit: gs_core::view::Orbit { frames: 0, ..flight.orbit }, ..flight },
        ] {
            assert!(bad.stretches(&first).is_err(), "{bad:?}");
        }
    }
}
