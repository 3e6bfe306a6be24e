//! Cases: edits, held against a plain reading of the plan, row by row of the saved state.

use gs_core::{
    Adam, Binning, Chart, CloudState, EditPlan, Error, Loss, PlanarGaussian, PlanarScene, Rasterizer, Scene, TrainStep,
    edit::{AfterEdit, Birth, Change, Moments, Origin, Place, PruneCause, Removal},
    effects::{Blend, Statistics},
    scene::logit,
};

use crate::{
    failure::Failure,
    scenes::{Draw, Kind},
};

/// All that a state holds about one Gaussian; the shape is log-scales and rotation, or a frame, padded with 0.
#[derive(Debug, Clone, PartialEq)]
struct Row {
    mean: [f32; 2],
    shape: [f32; 4],
    color: [f32; 3],
    opacity_logit: Option<f32>,
    moment1: [f32; 9],
    moment2: [f32; 9],
    steps: u32,
    gradient_sum: f32,
    visible: u32,
}

fn rows(state: &CloudState) -> Result<Vec<Row>, Failure> {
    let means = state.rows::<2>("mean")?;
    let shapes: Vec<[f32; 4]> = match state.chart {
        Chart::LocalFrame => state.rows::<4>("frame")?,
        Chart::ScaleRotation => {
            let pairs = state.rows::<2>("log_scale")?.into_iter().zip(state.rows::<1>("rotation")?);
            pairs.map(|([a, b], [angle])| [a, b, angle, 0.0]).collect()
        }
    };
    let colors = state.rows::<3>("color")?;
    let logits = if state.contains("opacity_logit") { Some(state.rows::<1>("opacity_logit")?) } else { None };
    let (first, second) = (state.rows::<9>("moment1")?, state.rows::<9>("moment2")?);
    let (steps, visible) = (state.integers("steps")?, state.integers("visible")?);
    let sums = state.rows::<1>("gradient_sum")?;
    let lengths = [shapes.len(), colors.len(), first.len(), second.len(), steps.len(), visible.len(), sums.len()];
    let logits_match = logits.as_ref().is_none_or(|l| l.len() == means.len());
    Failure::unless(logits_match && lengths.iter().all(|&n| n == means.len()), || {
        format!("the state's tensors are of {} means and {lengths:?} of the rest", means.len())
    })?;
    Ok((0..means.len())
        .map(|i| Row {
            mean: means[i],
            shape: shapes[i],
            color: colors[i],
            opacity_logit: logits.as_ref().map(|l| l[i][0]),
            moment1: first[i],
            moment2: second[i],
            steps: steps[i],
            gradient_sum: sums[i][0],
            visible: visible[i],
        })
        .collect())
}

/// A row with the parameters of `g`, and nothing learned.
fn fresh(g: &PlanarGaussian, chart: Chart, has_opacity: bool) -> Row {
    Row {
        mean: g.mean.to_array(),
        shape: match chart {
            Chart::ScaleRotation => [g.log_scale.x, g.log_scale.y, g.rotation, 0.0],
            Chart::LocalFrame => g.frame().to_cols_array(),
        },
        color: g.color.to_array(),
        opacity_logit: has_opacity.then_some(g.opacity_logit),
        moment1: [0.0; 9],
        moment2: [0.0; 9],
        steps: 0,
        gradient_sum: 0.0,
        visible: 0,
    }
}

fn with_moments_of(row: Row, parent: &Row) -> Row {
    Row { moment1: parent.moment1, moment2: parent.moment2, steps: parent.steps, ..row }
}

/// A cloud that has been trained for a few steps, so that all its rows differ.
fn trained<R: Rasterizer<PlanarScene>>(rasterizer: &R, blend: Blend, chart: Chart) -> Result<R::Cloud, Failure> {
    let mut draw = Draw::new(Kind::Overlapping, blend, 9, (24, 20), 1800);
    draw.settings.effects.statistics = Statistics::MeanGradient;
    let target = rasterizer.upload_target(&draw.target()?)?;
    let rates = Adam::default().at(0.0);
    let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let mut cloud = rasterizer.upload(&draw.scene, chart)?;
    for _ in 0..3 {
        rasterizer.train_step(&mut cloud, &draw.view, &target, &step)?;
    }
    for row in rows(&rasterizer.save(&cloud)?)? {
        let learned = row.moment1[0] != 0.0 && row.moment2[0] != 0.0 && row.steps == 3 && row.gradient_sum > 0.0;
        Failure::unless(learned, || format!("a Gaussian has learned nothing in three steps: {row:?}"))?;
    }
    Ok(cloud)
}

/// A plan that removes, changes and adds in every way there is.
fn plan(newcomers: &PlanarScene, statistics: AfterEdit) -> EditPlan<PlanarGaussian> {
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
            birth(6, Some(1), Moments::Fresh, Place::BehindParent),
        ],
        opacity_ceiling: None,
        statistics,
    }
}

/// Parameters, moments, step counts and statistics follow their Gaussians through removals, changes and births, which stand where the
/// plan puts them; a ceiling lowers opacities and makes their moments 0.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn edits_carry_everything_along<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<(), Failure> {
    for chart in [Chart::ScaleRotation, Chart::LocalFrame] {
        for blend in [Blend::Sum, Blend::Over] {
            for statistics in [AfterEdit::Keep, AfterEdit::Restart] {
                let mut cloud = trained(rasterizer, blend, chart)?;
                let before = rows(&rasterizer.save(&cloud)?)?;
                let newcomers = Draw::new(Kind::Typical, blend, 7, (24, 20), 1801).scene;
                let has_opacity = newcomers.has_opacity();
                rasterizer.edit(&mut cloud, &plan(&newcomers, statistics))?;
                let new = |k: usize| fresh(&newcomers.gaussian(k), chart, has_opacity);
                let with_statistics_of = |row: Row, i: usize| Row {
                    gradient_sum: before[i].gradient_sum,
                    visible: before[i].visible,
                    ..row
                };
                let mut expected = vec![
                    with_statistics_of(new(3), 4),
                    with_statistics_of(new(1), 0),
                    before[1].clone(),
                    with_statistics_of(new(6), 1),
                    before[3].clone(),
                    before[4].clone(),
                    with_statistics_of(with_moments_of(new(0), &before[5]), 5),
                    before[6].clone(),
                    with_statistics_of(with_moments_of(new(2), &before[7]), 7),
                    before[8].clone(),
                    new(4),
                    with_statistics_of(with_moments_of(new(5), &before[1]), 1),
                ];
                if statistics == AfterEdit::Restart {
                    expected.iter_mut().for_each(|row| (row.gradient_sum, row.visible) = (0.0, 0));
                }
                let place = format!("{chart:?}, {blend:?}, {statistics:?}");
                compare(&expected, &rows(&rasterizer.save(&cloud)?)?, &place)?;
                let count = rasterizer.len(&cloud);
                Failure::unless(count == 12, || format!("{place}: {count} Gaussians"))?;

                if blend == Blend::Over {
                    // A ceiling that some opacities are below and some above.
                    let ceiling = 0.4;
                    let plan = EditPlan { opacity_ceiling: Some(ceiling), statistics, ..EditPlan::default() };
                    let above = expected.iter().filter(|row| row.opacity_logit > Some(logit(ceiling))).count();
                    Failure::unless((1..10).contains(&above), || {
                        format!("{above} of 10 opacities are above the ceiling")
                    })?;
                    rasterizer.edit(&mut cloud, &plan)?;
                    for row in &mut expected {
                        row.opacity_logit = row.opacity_logit.map(|value| value.min(logit(ceiling)));
                        (row.moment1[8], row.moment2[8]) = (0.0, 0.0);
                    }
                    compare(&expected, &rows(&rasterizer.save(&cloud)?)?, &format!("{place}, ceiling"))?;
                }
            }
        }
    }
    Ok(())
}

fn compare(expected: &[Row], found: &[Row], place: &str) -> Result<(), Failure> {
    Failure::unless(expected.len() == found.len(), || {
        format!("{place}: {} Gaussians instead of {}", found.len(), expected.len())
    })?;
    for (i, (a, b)) in expected.iter().zip(found).enumerate() {
        // Parameters that are set may be rounded once more; all else is moved, bit for bit.
        let near =
            |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| a == b || (a - b).abs() <= 1e-5 * a.abs().max(1.0));
        let logits = [a, b].map(|row| row.opacity_logit.unwrap_or(f32::INFINITY));
        let parameters = near(&a.mean, &b.mean)
            && near(&a.shape, &b.shape)
            && near(&a.color, &b.color)
            && near(&logits[..1], &logits[1..]);
        let Row { mean, shape, color, opacity_logit, .. } = a.clone();
        let rest = Row { mean, shape, color, opacity_logit, ..b.clone() } == *a;
        Failure::unless(parameters && rest, || format!("{place}: Gaussian {i} should be {a:?}, but is {b:?}"))?;
    }
    Ok(())
}

/// A plan that contradicts itself or the cloud is refused as [`Error::Plan`], and the cloud is as before.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn refused_edits_change_nothing<R: Rasterizer<PlanarScene>>(rasterizer: &R) -> Result<(), Failure> {
    let newcomers = Draw::new(Kind::Typical, Blend::Over, 7, (24, 20), 1801).scene;
    let good = plan(&newcomers, AfterEdit::Restart);
    let gone = |index| Removal { index, cause: PruneCause::Transparent };
    let mut wrong = vec![good; 5];
    wrong[0].removed.push(gone(9)); // There are 9: 0 to 8.
    wrong[1].removed.push(gone(2)); // Removed twice.
    wrong[2].removed.push(gone(5)); // Changed and removed.
    wrong[3].added[1].parent = Some(12);
    let twice = wrong[4].changed[0].clone();
    wrong[4].changed.push(twice);
    let mut cloud = trained(rasterizer, Blend::Over, Chart::ScaleRotation)?;
    let before = rasterizer.save(&cloud)?;
    for (i, plan) in wrong.iter().enumerate() {
        let refused = matches!(rasterizer.edit(&mut cloud, plan), Err(Error::Plan(_)));
        Failure::unless(refused, || format!("contradictory plan {i} is not refused as such"))?;
        let same = rasterizer.save(&cloud)? == before;
        Failure::unless(same, || format!("contradictory plan {i} is refused, but changed the cloud"))?;
    }
    Ok(())
}
