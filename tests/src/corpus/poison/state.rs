//! Poison in a cloud: in each number that a backend keeps of a Gaussian, parameters, moments and statistics. A training run or a checkpoint may
//! bring any value there, however carefully scenes are checked.

use std::fmt;

use gs_core::{
    Binning, Chart, CloudState, Error, Image, Rasterizer, TrainStep, Wait, state::TensorData, statistics::Culled,
};

use super::{VALUES, inputs::Inputs};
use crate::{
    failure::Failure,
    oracle::{Oracle, OracleScene, OracleView},
    subject::Subject,
    tolerance::compare_images,
};

/// The Gaussian that is poisoned.
const VICTIM: usize = 1;

/// Training steps after a poisoning.
const STEPS: usize = 3;

/// A column of a tensor of a cloud's state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct StateSlot {
    tensor: String,
    column: usize,
    /// The entry of a row of parameters that it is.
    parameter: Option<usize>,
}

impl fmt::Display for StateSlot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.tensor, self.column)
    }
}

/// The tensors of parameters, in their order in a row of the oracle's.
const PARAMETERS: [&str; 6] = ["mean", "log_scale", "rotation", "opacity_logit", "color", "sh"];

/// What all runs with the same inputs share.
pub(super) struct Clean<S: Subject, R: Rasterizer<S>> {
    pub(super) state: CloudState,
    target: R::Target,
    /// What becomes of the scene without the victim.
    image: Image,
    stepped: S,
}

impl<S: Subject, R: Rasterizer<S>> Clean<S, R> {
    pub(super) fn new(rasterizer: &R, inputs: &Inputs<S>) -> Result<Self, Failure> {
        let state = rasterizer.save(&rasterizer.upload(&inputs.scene, Chart::ScaleRotation)?)?;
        let target = rasterizer.upload_target(&inputs.target)?;
        let others = inputs.scene.picked((0..inputs.scene.len()).filter(|&i| i != VICTIM));
        let cloud = rasterizer.upload(&others, Chart::ScaleRotation)?;
        let (image, _) = seen(rasterizer, inputs, &cloud)?;
        let Trained { stepped, .. } = Trained::of(rasterizer, inputs, cloud, &target, 1)?;
        Ok(Self { state, target, image, stepped })
    }
}

/// All numbers that are kept of one Gaussian.
pub(super) fn slots(state: &CloudState) -> Result<Vec<StateSlot>, Failure> {
    let columns = |name: &str| state.matrix(name).map_or(0, |(columns, _)| columns);
    let mut slots = Vec::new();
    let mut parameter = 0;
    for tensor in PARAMETERS {
        for column in 0..columns(tensor) {
            slots.push(StateSlot { tensor: tensor.to_owned(), column, parameter: Some(parameter + column) });
        }
        // A row of the oracle's has an opacity even where none is stored.
        parameter += if tensor == "opacity_logit" { 1 } else { columns(tensor) };
    }
    for tensor in state.tensors.keys().filter(|name| !PARAMETERS.contains(&name.as_str())) {
        let floats = matches!(state.tensors[tensor].data, TensorData::F32(_));
        let columns = if floats { columns(tensor).max(1) } else { 0 };
        slots.extend((0..columns).map(|column| StateSlot { tensor: tensor.clone(), column, parameter: None }));
    }
    Failure::unless(slots.len() > 20, || format!("a state of {} numbers a Gaussian", slots.len()))?;
    Ok(slots)
}

/// Puts all values into one slot; how many runs that were.
pub(super) fn poison<S: Subject, R: Rasterizer<S>>(
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

fn with(state: &CloudState, slot: &StateSlot, value: f32) -> CloudState {
    let mut state = state.clone();
    if let Some(tensor) = state.tensors.get_mut(&slot.tensor) {
        let columns: usize = tensor.shape.iter().skip(1).product();
        if let TensorData::F32(values) = &mut tensor.data {
            values[VICTIM * columns + slot.column] = value;
        }
    }
    state
}

/// What a cloud shows, and what that leaves out.
fn seen<S: Subject, R: Rasterizer<S>>(
    rasterizer: &R,
    inputs: &Inputs<S>,
    cloud: &R::Cloud,
) -> Result<(Image, Culled), Failure> {
    let frame = rasterizer.forward(cloud, &inputs.view, &inputs.settings)?;
    Ok((rasterizer.image(&frame)?, rasterizer.culled(&frame)?))
}

/// What becomes of a cloud in training.
struct Trained<S> {
    /// After the first step.
    stepped: S,
    losses: Vec<f32>,
    /// After the last.
    scene: S,
}

impl<S: Subject> Trained<S> {
    fn of<R: Rasterizer<S>>(
        rasterizer: &R,
        inputs: &Inputs<S>,
        mut cloud: R::Cloud,
        target: &R::Target,
        steps: usize,
    ) -> Result<Self, Failure> {
        let step =
            TrainStep { settings: &inputs.settings, loss: inputs.loss, rates: &inputs.rates, binning: Binning::Fresh };
        let mut losses = Vec::new();
        rasterizer.train_step(&mut cloud, &inputs.view, target, &step)?;
        let stepped = rasterizer.download(&cloud)?;
        for _ in 1..steps {
            rasterizer.train_step(&mut cloud, &inputs.view, target, &step)?;
        }
        rasterizer.losses(&mut cloud, Wait::All, &mut losses)?;
        let scene = rasterizer.download(&cloud)?;
        Ok(Self { stepped, losses, scene })
    }
}

fn one<S: Subject, R: Rasterizer<S>>(
    rasterizer: &R,
    inputs: &Inputs<S>,
    clean: &Clean<S, R>,
    slot: &StateSlot,
    value: f32,
) -> Result<(), Failure> {
    let cloud = match rasterizer.restore(&with(&clean.state, slot, value)) {
        Err(Error::State(_) | Error::NotFinite { .. }) if !value.is_finite() => return Ok(()),
        cloud => cloud?,
    };
    let mut rows = inputs.scene.rows();
    let oracle = Oracle::new(inputs.view, inputs.settings)?;
    // What is kept besides parameters has no part in pictures.
    let footprint = match slot.parameter {
        None => oracle.footprint(&rows.gaussians[VICTIM]),
        Some(parameter) => {
            accepts_what_is_valid(rasterizer, &cloud)?;
            rows.gaussians[VICTIM][parameter] = f64::from(value);
            shown(&oracle, &rows, &seen(rasterizer, inputs, &cloud)?, &clean.image)?
        }
    };

    // A Gaussian that shares no pixel with the victim takes the very step that it would have taken without it.
    let trained = Trained::of(rasterizer, inputs, cloud, &clean.target, STEPS)?;
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

    // Sums that a colour of 10³⁰ makes overflow are what they are; but where the losses are finite, so are the others.
    let Trained { losses, scene, .. } = &trained;
    Failure::unless(!losses.iter().any(|loss| loss.is_nan()), || format!("losses {losses:?}"))?;
    if losses.iter().all(|loss| loss.is_finite()) {
        let others = scene.picked((0..inputs.scene.len()).filter(|&i| i != VICTIM));
        others.validate().map_err(|error| Failure::from(error).at(format!("the others after {STEPS} steps")))?;
    }
    Ok(())
}

/// A scene that holds the value is accepted, and comes back to the bit, or refused with an error that says where it is.
fn accepts_what_is_valid<S: Subject, R: Rasterizer<S>>(rasterizer: &R, cloud: &R::Cloud) -> Result<(), Failure> {
    let scene = rasterizer.download(cloud)?;
    match (scene.validate(), rasterizer.upload(&scene, Chart::ScaleRotation)) {
        (Err(_), Err(Error::NotFinite { index: VICTIM, .. })) => Ok(()),
        (Ok(()), Ok(uploaded)) => {
            let back = rasterizer.download(&uploaded)?;
            Failure::unless(back == scene, || "a scene does not come back as it was".to_owned())
        }
        (valid, accepted) => {
            let accepted = accepted.map(|_| ());
            Err(Failure::Broken(format!("a scene that is {valid:?} is met with {accepted:?}")))
        }
    }
}

/// Whether as many are left out for the same causes. A scale of ln 0 is no size as much as it is no number; and a backend may list a Gaussian
/// that only its bounds let touch a pixel.
pub(super) fn same_causes(found: Culled, expected: Culled) -> bool {
    let invalid = |culled: Culled| culled.not_finite + culled.degenerate;
    found.near == expected.near
        && found.transparent == expected.transparent
        && invalid(found) == invalid(expected)
        && found.outside <= expected.outside
}

/// Holds the picture of a poisoned scene against the oracle's, and off the poisoned Gaussian's footprint, to the bit, against the one without it;
/// the footprint.
fn shown<V: OracleView>(
    oracle: &Oracle<V>,
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
