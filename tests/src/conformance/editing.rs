//! Cases of edits, compared with a simple interpretation of the plan, row by row of the saved
//! tensors.

use pollster::FutureExt as _;
use std::collections::BTreeMap;

use gs_core::{
    Binning, EditPlan, Error, Loss, Optimizer, Parameterization, SplatsState, TensorData, TrainStep,
    edit::{AfterEdit, Birth, Change, Moments, Origin, Place, PruneCause, Removal},
    effects::{Blend, Statistics},
    logit,
};

use super::parameterizations;
use crate::{failure::Failure, oracle::OracleScene, subject::Subject};

/// The state of one Gaussian: the numbers of each tensor, integers by their bits.
type Row = BTreeMap<String, Vec<f32>>;

const MOMENTS: [&str; 3] = ["moment1", "moment2", "steps"];
const STEPS: [&str; 1] = ["steps"];
const STATISTICS: [&str; 2] = ["gradient_sum", "visible"];

fn rows(state: &SplatsState) -> Result<Vec<Row>, Failure> {
    let count = state.integers("steps")?.len();
    let mut rows = vec![Row::new(); count];
    for (name, tensor) in &state.tensors {
        let numbers: Vec<f32> = match &tensor.data {
            TensorData::F32(values) => values.clone(),
            TensorData::U32(values) => values.iter().map(|&v| f32::from_bits(v)).collect(),
        };
        let width = numbers.len() / count.max(1);
        let whole = numbers.len() == width * count && width > 0;
        Failure::unless(whole, || format!("`{name}` has {} numbers for {count} Gaussians", numbers.len()))?;
        for (row, numbers) in rows.iter_mut().zip(numbers.chunks_exact(width)) {
            row.insert(name.clone(), numbers.to_vec());
        }
    }
    Ok(rows)
}

/// A row with some of its tensors taken from another.
fn with(row: &Row, names: &[&str], from: &Row) -> Row {
    let mut row = row.clone();
    for name in names {
        row.insert((*name).to_owned(), from[*name].clone());
    }
    row
}

/// A new row that inherits moments. A covariance factor becomes the one nearest to the parent's, in
/// whose coordinates the moments are.
fn heir<S: Subject>(new: &Row, parent: &Row) -> Row {
    let mut row = with(new, &MOMENTS, parent);
    if let Some(factor) = row.get_mut("factor") {
        *factor = S::aligned(factor, &parent["factor"]);
    }
    row
}

/// A row with some of its tensors zero.
fn without(row: &Row, names: &[&str]) -> Row {
    let mut row = row.clone();
    for name in names {
        row.entry((*name).to_owned()).and_modify(|values| values.fill(0.0));
    }
    row
}

/// Splats after a few training steps, so that all rows differ.
fn trained<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    blend: Blend,
    parameterization: Parameterization,
) -> Result<R::Splats, Failure> {
    let mut draw = S::overlapping(blend, 9, (24, 20), 1803);
    draw.settings.effects.statistics = Statistics::MeanGradient;
    let target = rasterizer.upload_target(&draw.target()?)?;
    let rates = S::adam().at(0.0);
    let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let mut splats = rasterizer.upload(&draw.scene, parameterization)?;
    for _ in 0..3 {
        rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on()?;
    }
    for row in rows(&rasterizer.save(&splats).block_on()?)? {
        let [first, second, sum] = ["moment1", "moment2", "gradient_sum"].map(|name| row[name][0]);
        let has_moments = first != 0.0 && second != 0.0 && row["steps"][0].to_bits() == 3 && sum > 0.0;
        Failure::unless(has_moments, || format!("a Gaussian has no moments after three steps: {row:?}"))?;
    }
    Ok(splats)
}

/// A plan with every kind of removal, change and addition.
fn plan<S: Subject>(newcomers: &S, statistics: AfterEdit) -> EditPlan<S::Gaussian> {
    let birth = |k, parent, moments, place| Birth {
        gaussian: newcomers.gaussian(k),
        parent,
        moments,
        origin: Origin::Split,
        place,
    };
    EditPlan {
        removed: [7, 2].map(|index| Removal { index, cause: PruneCause::Unimportant }).to_vec(),
        changed: vec![
            Change { index: 5, gaussian: newcomers.gaussian(0), moments: Moments::Inherit },
            Change { index: 0, gaussian: newcomers.gaussian(1), moments: Moments::Fresh },
        ],
        added: vec![
            birth(2, Some(7), Moments::Inherit, Place::BehindParent),
            birth(3, Some(4), Moments::Fresh, Place::First),
            birth(4, None, Moments::Fresh, Place::BehindParent), // Without a parent: last.
            birth(5, Some(1), Moments::Inherit, Place::Last),
            birth(6, Some(1), Moments::Zeroed, Place::BehindParent),
        ],
        opacity_ceiling: None,
        statistics,
        fixed: 0,
    }
}

/// Parameters, moments, step counts and statistics follow their Gaussians through an edit. A
/// ceiling lowers opacities and sets their moments to 0.
pub(crate) fn edits_carry_everything_along<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    for parameterization in parameterizations::<S, R>(rasterizer)? {
        for blend in [Blend::Sum, Blend::Over] {
            for statistics in [AfterEdit::Keep, AfterEdit::Restart] {
                let mut splats = trained::<S, R>(rasterizer, blend, parameterization)?;
                let before = rows(&rasterizer.save(&splats).block_on()?)?;
                let newcomers = S::typical(blend, 7, (24, 20), 1807).scene;
                // Fresh splats have no moments.
                let new = rows(&rasterizer.save(&rasterizer.upload(&newcomers, parameterization)?).block_on()?)?;
                for name in MOMENTS.iter().chain(&STATISTICS) {
                    let zero = new.iter().all(|row| row[*name].iter().all(|&v| v == 0.0));
                    Failure::unless(zero, || format!("`{name}` of fresh splats is not zero"))?;
                }
                rasterizer.edit(&mut splats, &plan(&newcomers, statistics)).block_on()?;
                let mut expected = vec![
                    with(&new[3], &STATISTICS, &before[4]),
                    with(&new[1], &STATISTICS, &before[0]),
                    before[1].clone(),
                    with(&with(&new[6], &STEPS, &before[1]), &STATISTICS, &before[1]),
                    before[3].clone(),
                    before[4].clone(),
                    with(&heir::<S>(&new[0], &before[5]), &STATISTICS, &before[5]),
                    before[6].clone(),
                    with(&heir::<S>(&new[2], &before[7]), &STATISTICS, &before[7]),
                    before[8].clone(),
                    new[4].clone(),
                    with(&heir::<S>(&new[5], &before[1]), &STATISTICS, &before[1]),
                ];
                if statistics == AfterEdit::Restart {
                    expected = expected.iter().map(|row| without(row, &STATISTICS)).collect();
                }
                let place = format!("{parameterization:?}, {blend:?}, {statistics:?}");
                compare(&expected, &rows(&rasterizer.save(&splats).block_on()?)?, &place)?;
                let count = rasterizer.len(&splats);
                Failure::unless(count == 12, || format!("{place}: {count} Gaussians"))?;

                if blend == Blend::Over {
                    // Some opacities are below the ceiling, and some above.
                    let ceiling = 0.4;
                    let plan = EditPlan { opacity_ceiling: Some(ceiling), statistics, ..EditPlan::default() };
                    let above = expected.iter().filter(|row| row["opacity_logit"][0] > logit(ceiling)).count();
                    Failure::unless((1..12).contains(&above), || {
                        format!("{above} of 12 opacities are above the ceiling")
                    })?;
                    rasterizer.edit(&mut splats, &plan).block_on()?;
                    for row in &mut expected {
                        row.entry("opacity_logit".to_owned())
                            .and_modify(|value| value[0] = value[0].min(logit(ceiling)));
                        for name in ["moment1", "moment2"] {
                            row.entry(name.to_owned()).and_modify(|values| values[S::OPACITY_MOMENT] = 0.0);
                        }
                    }
                    compare(&expected, &rows(&rasterizer.save(&splats).block_on()?)?, &format!("{place}, ceiling"))?;
                }
            }
        }
    }
    Ok(())
}

/// A Gaussian that is replaced by itself and inherits its moments trains on as without the edit, in
/// every parameterization.
pub(crate) fn changes_that_inherit_go_on<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    let draw = S::overlapping(Blend::Over, 9, (24, 20), 1811);
    let target = rasterizer.upload_target(&draw.target()?)?;
    let rates = S::adam().at(0.0);
    let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    for parameterization in parameterizations::<S, R>(rasterizer)? {
        let mut after = Vec::new();
        let mut before = draw.scene.emptied();
        for edited in [false, true] {
            let mut splats = rasterizer.upload(&draw.scene, parameterization)?;
            (0..20).try_for_each(|_| rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on())?;
            before = rasterizer.download(&splats).block_on()?;
            if edited {
                let change =
                    |i: usize| Change { index: i as u32, gaussian: before.gaussian(i), moments: Moments::Inherit };
                let changed = (0..before.len()).map(change).collect();
                rasterizer.edit(&mut splats, &EditPlan { changed, ..EditPlan::default() }).block_on()?;
            }
            (0..5).try_for_each(|_| rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on())?;
            after.push(rasterizer.download(&splats).block_on()?.rows());
        }
        let means = |rows: &OracleScene| -> Vec<f64> {
            rows.gaussians.iter().flat_map(|row| row[..S::DIMENSIONS].to_vec()).collect()
        };
        let apart = |a: &OracleScene, b: &OracleScene| {
            means(a).iter().zip(means(b)).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
        };
        let (moved, off) = (apart(&after[0], &before.rows()), apart(&after[0], &after[1]));
        Failure::unless(moved > 0.0 && off <= ASTRAY * moved, || {
            format!("{parameterization:?}: means move by {moved:e}, but replaced Gaussians deviate by {off:e}")
        })?;
    }
    Ok(())
}

/// Largest deviation as a share of the movement.
const ASTRAY: f64 = 0.02;

fn compare(expected: &[Row], found: &[Row], place: &str) -> Result<(), Failure> {
    Failure::unless(expected.len() == found.len(), || {
        format!("{place}: {} Gaussians instead of {}", found.len(), expected.len())
    })?;
    for (i, (expected, found)) in expected.iter().zip(found).enumerate() {
        let names = |row: &Row| row.keys().cloned().collect::<Vec<_>>();
        Failure::unless(names(expected) == names(found), || {
            format!("{place}: tensors {:?} instead of {:?}", names(found), names(expected))
        })?;
        for (name, a) in expected {
            let b = &found[name];
            // New parameters may be rounded once more. All else has the same bits.
            let is_moved = MOMENTS.iter().chain(&STATISTICS).any(|n| n == name);
            let same = |a: f32, b: f32| match is_moved {
                true => a.to_bits() == b.to_bits() || (a == 0.0 && b == 0.0),
                false => a == b || (a - b).abs() <= 1e-5 * a.abs().max(1.0),
            };
            Failure::unless(a.len() == b.len() && a.iter().zip(b).all(|(&a, &b)| same(a, b)), || {
                format!("{place}: `{name}` of Gaussian {i} should be {a:?}, but is {b:?}")
            })?;
        }
    }
    Ok(())
}

/// A contradictory plan is refused as [`Error::Plan`], and the splats do not change.
pub(crate) fn refused_edits_change_nothing<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    let newcomers = S::typical(Blend::Over, 7, (24, 20), 1807).scene;
    let good = plan(&newcomers, AfterEdit::Restart);
    let gone = |index| Removal { index, cause: PruneCause::Transparent };
    let mut wrong = vec![good; 5];
    wrong[0].removed.push(gone(9)); // There are 9: 0 to 8.
    wrong[1].removed.push(gone(2)); // Removed twice.
    wrong[2].removed.push(gone(5)); // Changed and removed.
    wrong[3].added[1].parent = Some(12);
    let twice = wrong[4].changed[0].clone();
    wrong[4].changed.push(twice);
    let mut splats = trained::<S, R>(rasterizer, Blend::Over, Parameterization::ScaleRotation)?;
    let before = rasterizer.save(&splats).block_on()?;
    for (i, plan) in wrong.iter().enumerate() {
        let refused = matches!(rasterizer.edit(&mut splats, plan).block_on(), Err(Error::Plan(_)));
        Failure::unless(refused, || format!("contradictory plan {i} is not refused as such"))?;
        let same = rasterizer.save(&splats).block_on()? == before;
        Failure::unless(same, || format!("contradictory plan {i} is refused, but changed the splats"))?;
    }
    Ok(())
}
