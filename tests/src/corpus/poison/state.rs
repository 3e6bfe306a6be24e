//! Hostile values in each number of splats: parameters, moments and statistics. A training run or a
//! checkpoint may bring any value there, however carefully scenes are checked.

use pollster::FutureExt as _;
use std::fmt;

use gs_core::{Culled, Error, Image, Optimizer, Parameterization, SplatsState, TensorData, Wait};

use super::{
    super::run::rows_of,
    VALUES,
    inputs::{Breadth, Inputs},
};
use crate::{
    failure::Failure,
    oracle::{Oracle, OracleScene},
    subject::Subject,
    tolerance::compare_images,
};

/// Index of the tested Gaussian.
const VICTIM: usize = 1;

/// Number of training steps after a value is set.
const STEPS: usize = 3;

/// A column of a tensor of a saved state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct StateSlot {
    tensor: String,
    column: usize,
    kept: Kept,
}

/// The meaning of a number in a saved state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kept {
    /// An entry of a row of the oracle's parameters.
    Parameter(usize),
    /// An entry of the covariance factor.
    Factor(usize),
    /// No parameter: images do not depend on it.
    Beside,
}

impl fmt::Display for StateSlot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.tensor, self.column)
    }
}

/// The common part of all runs with the same inputs in the same parameterization.
pub(super) struct Clean<S: Subject, R: Optimizer<S>> {
    state: SplatsState,
    target: R::Target,
    /// The Gaussians in the oracle's form.
    rows: OracleScene,
    /// The training of the scene without the tested Gaussian.
    image: Image,
    stepped: S,
}

impl<S: Subject, R: Optimizer<S>> Clean<S, R> {
    pub(super) fn new(rasterizer: &R, inputs: &Inputs<S>, parameterization: Parameterization) -> Result<Self, Failure> {
        let splats = rasterizer.upload(&inputs.scene, parameterization)?;
        let (state, rows) =
            (rasterizer.save(&splats).block_on()?, rows_of(rasterizer, &inputs.scene, &splats, parameterization)?);
        let target = rasterizer.upload_target(&inputs.target)?;
        let others = inputs.scene.picked((0..inputs.scene.len()).filter(|&i| i != VICTIM));
        let splats = rasterizer.upload(&others, parameterization)?;
        let (image, _) = seen(rasterizer, inputs, &splats)?;
        let Trained { stepped, .. } = Trained::of(rasterizer, inputs, splats, &target, 1)?;
        Ok(Self { state, target, rows, image, stepped })
    }

    /// The Gaussians in the oracle's form, with a value in a slot.
    fn rows_with(&self, inputs: &Inputs<S>, slot: &StateSlot, value: f32) -> Result<OracleScene, Failure> {
        let mut rows = self.rows.clone();
        match slot.kept {
            Kept::Parameter(entry) => rows.gaussians[VICTIM][entry] = f64::from(value),
            Kept::Factor(_) => {
                rows = inputs.scene.rows_of_factors(with(&self.state, slot, value).matrix(FACTOR)?.1);
            }
            Kept::Beside => {}
        }
        Ok(rows)
    }
}

/// The tensor of factors.
const FACTOR: &str = "factor";

/// The meaning of the columns of a tensor.
fn kept_in<S: Subject>(tensor: &str) -> impl Fn(usize) -> Kept {
    let opacity = (0..).find(|&i| S::parameter_name(i) == "opacity logit").unwrap_or_default();
    let first = match tensor {
        "mean" => Some(0),
        "log_scale" => Some(S::DIMENSIONS),
        "rotation" => Some(2 * S::DIMENSIONS),
        "opacity_logit" => Some(opacity),
        // The oracle's rows have opacities even if none are stored.
        "color" | "sh" => Some(opacity + 1),
        _ => None,
    };
    let is_factor = tensor == FACTOR;
    move |column| match first {
        Some(first) => Kept::Parameter(first + column),
        None if is_factor => Kept::Factor(column),
        None => Kept::Beside,
    }
}

/// The numbers of one Gaussian: all, or those on which images depend.
pub(super) fn slots<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    inputs: &Inputs<S>,
    parameterization: Parameterization,
) -> Result<Vec<StateSlot>, Failure> {
    let state = rasterizer.save(&rasterizer.upload(&inputs.scene, parameterization)?).block_on()?;
    let mut slots = Vec::new();
    for (name, tensor) in &state.tensors {
        if matches!(tensor.data, TensorData::F32(_)) {
            let (columns, kept) = (tensor.shape.iter().skip(1).product(), kept_in::<S>(name));
            slots.extend((0..columns).map(|column| StateSlot { tensor: name.clone(), column, kept: kept(column) }));
        }
    }
    Failure::unless(slots.len() > 20, || format!("a state of {} numbers a Gaussian", slots.len()))?;
    slots.retain(|slot| inputs.breadth == Breadth::Whole || slot.kept != Kept::Beside);
    Ok(slots)
}

/// Tests all values in one slot. Returns the number of runs.
pub(super) fn poison<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    inputs: &Inputs<S>,
    clean: &Clean<S, R>,
    slot: &StateSlot,
) -> Result<usize, Failure> {
    for value in VALUES {
        one(rasterizer, inputs, clean, slot, value).map_err(|failure| failure.at(format!("{value:e}")))?;
    }
    Ok(VALUES.len())
}

fn with(state: &SplatsState, slot: &StateSlot, value: f32) -> SplatsState {
    let mut state = state.clone();
    if let Some(tensor) = state.tensors.get_mut(&slot.tensor) {
        let columns: usize = tensor.shape.iter().skip(1).product();
        if let TensorData::F32(values) = &mut tensor.data {
            values[VICTIM * columns + slot.column] = value;
        }
    }
    state
}

/// The image and the culled Gaussians.
fn seen<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    inputs: &Inputs<S>,
    splats: &R::Splats,
) -> Result<(Image, Culled), Failure> {
    let pass = rasterizer.forward(splats, &inputs.view, &inputs.settings).block_on()?;
    Ok((rasterizer.image(&pass).block_on()?, rasterizer.culled(&pass)))
}

/// The states during training.
struct Trained<S> {
    /// The scene after the first step.
    stepped: S,
    losses: Vec<f32>,
    /// The scene after the last step.
    scene: S,
}

impl<S: Subject> Trained<S> {
    fn of<R: Optimizer<S>>(
        rasterizer: &R,
        inputs: &Inputs<S>,
        mut splats: R::Splats,
        target: &R::Target,
        steps: usize,
    ) -> Result<Self, Failure> {
        let (step, mut losses) = (inputs.step(), Vec::new());
        rasterizer.train_step(&mut splats, &inputs.view, target, &step).block_on()?;
        let stepped = rasterizer.download(&splats).block_on()?;
        for _ in 1..steps {
            rasterizer.train_step(&mut splats, &inputs.view, target, &step).block_on()?;
        }
        rasterizer.losses(&mut splats, Wait::All, &mut losses).block_on()?;
        let scene = rasterizer.download(&splats).block_on()?;
        Ok(Self { stepped, losses, scene })
    }
}

fn one<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    inputs: &Inputs<S>,
    clean: &Clean<S, R>,
    slot: &StateSlot,
    value: f32,
) -> Result<(), Failure> {
    let splats = match rasterizer.restore(&with(&clean.state, slot, value)) {
        Err(Error::State(_) | Error::NotFinite { .. }) if !value.is_finite() => return Ok(()),
        splats => splats?,
    };
    let rows = clean.rows_with(inputs, slot, value)?;
    let oracle = Oracle::new(inputs.view, inputs.settings)?;
    let footprint = if slot.kept == Kept::Beside {
        oracle.footprint(&rows.gaussians[VICTIM])
    } else {
        if inputs.breadth == Breadth::Whole {
            accepts_what_is_valid(rasterizer, &splats)?;
        }
        shown(&oracle, &rows, &seen(rasterizer, inputs, &splats)?, &clean.image)?
    };

    // Gaussians that share no pixel with the tested one move as they do without it.
    let trained = Trained::of(rasterizer, inputs, splats, &clean.target, STEPS)?;
    let mut apart = 0;
    for (i, other) in (0..inputs.scene.len()).filter(|&i| i != VICTIM).enumerate() {
        let own = oracle.footprint(&rows.gaussians[other]);
        if own.iter().zip(&footprint).any(|(a, b)| *a && *b) {
            continue;
        }
        apart += 1;
        let same = trained.stepped.gaussian(other) == clean.stepped.gaussian(i);
        Failure::unless(same, || format!("Gaussian {other} took another step, which shares no pixel with it"))?;
    }
    Failure::unless(apart > 0 || footprint.iter().any(|&touched| touched), || "nothing was compared".to_owned())?;

    // Sums with a colour of 10³⁰ may overflow. But if the losses are finite, the other Gaussians
    // are, too.
    let Trained { losses, scene, .. } = &trained;
    Failure::unless(!losses.iter().any(|loss| loss.is_nan()), || format!("losses {losses:?}"))?;
    if losses.iter().all(|loss| loss.is_finite()) {
        let others = scene.picked((0..inputs.scene.len()).filter(|&i| i != VICTIM));
        others.validate().map_err(|error| Failure::from(error).at(format!("the others after {STEPS} steps")))?;
    }
    Ok(())
}

/// Checks that a scene with the value is uploaded with the same bits, or refused with an error that
/// says where it is.
fn accepts_what_is_valid<S: Subject, R: Optimizer<S>>(rasterizer: &R, splats: &R::Splats) -> Result<(), Failure> {
    let scene = rasterizer.download(splats).block_on()?;
    match (scene.validate(), rasterizer.upload(&scene, Parameterization::ScaleRotation)) {
        (Err(_), Err(Error::NotFinite { index: VICTIM, .. })) => Ok(()),
        (Ok(()), Ok(uploaded)) => {
            let back = rasterizer.download(&uploaded).block_on()?;
            Failure::unless(back == scene, || "a scene does not come back as it was".to_owned())
        }
        (valid, accepted) => {
            let accepted = accepted.map(|_| ());
            Err(Failure::Broken(format!("a scene that is {valid:?} is met with {accepted:?}")))
        }
    }
}

/// Whether the counts by cause are equal. A scale of ln 0 counts as degenerate or as not finite,
/// and a backend may list a Gaussian that only touches a pixel by its bounds.
pub(super) fn same_causes(found: Culled, expected: Culled) -> bool {
    let invalid = |culled: Culled| culled.not_finite + culled.degenerate;
    found.near == expected.near
        && found.transparent == expected.transparent
        && invalid(found) == invalid(expected)
        && found.outside <= expected.outside
}

/// Compares the image with the oracle's and, outside the tested Gaussian's footprint, bit by bit
/// with the image without it. Returns the footprint.
fn shown(
    oracle: &Oracle,
    rows: &OracleScene,
    (found, culled): &(Image, Culled),
    without: &Image,
) -> Result<Vec<bool>, Failure> {
    let expected = oracle.render(rows);
    Failure::unless(same_causes(*culled, expected.culled), || {
        format!("left out {culled:?}, the oracle {:?}", expected.culled)
    })?;
    let footprint = oracle.footprint(&rows.gaussians[VICTIM]);
    for (p, touched) in footprint.iter().enumerate() {
        let (seen, alone) = (found.pixels()[p], without.pixels()[p]);
        let finite = seen.iter().all(|v| v.is_finite());
        Failure::unless(finite, || format!("pixel {p} is {seen:?}"))?;
        let same = *touched || seen.map(f32::to_bits) == alone.map(f32::to_bits);
        Failure::unless(same, || format!("pixel {p}, which it does not touch, is {seen:?}, without it {alone:?}"))?;
    }
    compare_images(&expected, found)?;
    Ok(footprint)
}
