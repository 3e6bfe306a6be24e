//! `Plan`: the edits that a policy written in Python wants.

use std::collections::HashSet;

use gs_core::{
    EditPlan, Scene as _,
    edit::{Birth, Change, Moments, Place, PruneCause, Removal},
};
use gs_density::{Actions, DensityScene, Observation, Rng, Round, SizeThreshold};
use pyo3::{
    prelude::*,
    types::{PyAny, PyTuple},
};

use crate::{
    convert::{
        arrays,
        errors::{self, IntoPython},
    },
    scene::{scene2d::Scene2d, scene3d::Scene3d},
};

#[doc = doc!("Plan")]
#[pyclass(frozen, module = "gaussian_splats")]
#[derive(Debug)]
pub(crate) struct Plan {
    grow: Option<Py<PyAny>>,
    clone: Option<Py<PyAny>>,
    split: Option<Py<PyAny>>,
    prune: Option<Py<PyAny>>,
    relocate: Option<(Py<PyAny>, Py<PyAny>)>,
    add: Option<Py<PyAny>>,
    opacity_ceiling: Option<f32>,
}

#[pymethods]
impl Plan {
    #[new]
    #[pyo3(signature = (grow = None, *, clone = None, split = None, prune = None, relocate = None, add = None, opacity_ceiling = None))]
    fn new(
        grow: Option<Py<PyAny>>,
        clone: Option<Py<PyAny>>,
        split: Option<Py<PyAny>>,
        prune: Option<Py<PyAny>>,
        relocate: Option<&Bound<'_, PyTuple>>,
        add: Option<Py<PyAny>>,
        opacity_ceiling: Option<f32>,
    ) -> PyResult<Self> {
        let relocate = match relocate.map(|pair| pair.extract::<(Py<PyAny>, Py<PyAny>)>()) {
            None => None,
            Some(Ok(pair)) => Some(pair),
            Some(Err(_)) => return Err(errors::value("relocate", "expected two arrays: (moved, onto)")),
        };
        if opacity_ceiling.is_some_and(|ceiling| !(ceiling > 0.0 && ceiling <= 1.0)) {
            return Err(errors::value("opacity_ceiling", "must be above 0 and at most 1"));
        }
        Ok(Self { grow, clone, split, prune, relocate, add, opacity_ceiling })
    }
}

/// A kind of scene that has a class in Python.
pub(crate) trait PythonScene: DensityScene {
    /// The Gaussians of an object of that class.
    fn from_python(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Vec<Self::Gaussian>>;
}

macro_rules! python_scene {
    ($core:ty, $class:ident) => {
        impl PythonScene for $core {
            fn from_python(argument: &str, object: &Bound<'_, PyAny>) -> PyResult<Vec<Self::Gaussian>> {
                let scene =
                    object.cast::<$class>().map_err(|_| errors::wrong_type(argument, stringify!($class), object))?;
                let scene = &scene.get().scene;
                Ok((0..scene.len()).map(|index| scene.gaussian(index)).collect())
            }
        }
    };
}
python_scene!(gs_core::Scene2d, Scene2d);
python_scene!(gs_core::Scene3d, Scene3d);

impl Plan {
    /// The edits of the plan, with those of `actions` ([`Actions`]: pruning and opacity resets).
    ///
    /// # Errors
    /// `TypeError` and `ValueError` that name the argument of the plan: arrays of the wrong kind,
    /// indices of no Gaussian, contradictions, and more Gaussians than the budget.
    pub(crate) fn edits<S: PythonScene>(
        &self,
        py: Python<'_>,
        observation: &Observation<'_, S>,
        actions: &Actions,
        rng: &mut Rng,
    ) -> PyResult<EditPlan<S::Gaussian>> {
        let len = observation.scene.len();
        let list = |argument: &str, of: Option<&Py<PyAny>>| match of {
            Some(of) => arrays::indices(argument, of.bind(py), len),
            None => Ok(Vec::new()),
        };
        let [mut grow, mut clone, mut split, prune] = [
            list("grow", self.grow.as_ref())?,
            list("clone", self.clone.as_ref())?,
            list("split", self.split.as_ref())?,
            list("prune", self.prune.as_ref())?,
        ];
        let (moved, onto) = match &self.relocate {
            Some((moved, onto)) => (list("relocate[0]", Some(moved))?, list("relocate[1]", Some(onto))?),
            None => Default::default(),
        };
        if moved.len() != onto.len() {
            let problem = format!("expected two arrays of one length, not {} and {}", moved.len(), onto.len());
            return Err(errors::value("relocate", problem));
        }
        once_each(
            len,
            [("grow", &grow), ("clone", &clone), ("split", &split), ("prune", &prune), ("relocate[0]", &moved)],
        )?;
        apart(&onto, [("prune", &prune), ("relocate[0]", &moved)])?;

        let round = Round::open(actions, observation).map_err(IntoPython::into_python)?;
        // What the actions prune does not grow.
        let mut is_left = vec![false; len];
        round.survivors().for_each(|index| is_left[index as usize] = true);
        for list in [&mut grow, &mut clone, &mut split] {
            list.retain(|&index| is_left[index as usize]);
        }
        let added = match &self.add {
            Some(add) => S::from_python("add", add.bind(py))?,
            None => Vec::new(),
        };
        let fixed = clone.len() + split.len() + added.len();
        let gone = prune.iter().filter(|&&index| is_left[index as usize]).count();
        let room = round.room() + gone;
        if fixed > room {
            let problem = format!(
                "the plan adds {fixed} Gaussians, but the budget of {} has room for {room}",
                observation.budget
            );
            return Err(errors::value("plan", problem));
        }
        grow.truncate(if actions.grows(observation.progress) { room - fixed } else { 0 });

        let densify = &actions.densify;
        let always = densify.with(|densify| densify.split_above = SizeThreshold::ExtentFraction(0.0));
        let never = densify.with(|densify| densify.split_above = SizeThreshold::ExtentFraction(f32::INFINITY));
        // Random numbers are drawn in the order of the parents, as in the engine's own policies.
        let kinds = [(grow, densify), (split, &always), (clone, &never)];
        let named = kinds.iter().flat_map(|(list, densify)| list.iter().map(move |&index| (index, *densify)));
        let mut parents: Vec<_> = named.collect();
        parents.sort_unstable_by_key(|&(index, _)| index);
        let mut plan = round.grow(&[], rng);
        for (index, densify) in parents {
            let (change, birth) = densify.grow(index, observation, rng);
            plan.changed.extend(change);
            plan.added.push(birth);
        }
        for (moved, onto) in moved.into_iter().zip(onto) {
            if !(is_left[moved as usize] && is_left[onto as usize]) {
                continue;
            }
            let gaussian = observation.scene.gaussian(onto as usize);
            plan.changed.push(Change { index: moved, gaussian, moments: Moments::Fresh });
        }
        plan.changed.sort_by_key(|change| change.index);
        let seeds = added.into_iter().map(|gaussian| Birth { place: Place::Last, ..Birth::seed(gaussian) });
        plan.added.extend(seeds);
        let pruned = prune.into_iter().filter(|&index| is_left[index as usize]);
        plan.removed.extend(pruned.map(|index| Removal { index, cause: PruneCause::Unimportant }));
        plan.removed.sort_unstable_by_key(|removal| removal.index);
        plan.opacity_ceiling = self.opacity_ceiling.or(plan.opacity_ceiling);
        Ok(plan)
    }
}

/// Checks that no Gaussian which others become a copy of goes away or becomes another itself.
fn apart(onto: &[u32], lists: [(&str, &[u32]); 2]) -> PyResult<()> {
    for (argument, list) in lists {
        let gone: HashSet<u32> = list.iter().copied().collect();
        if let Some(index) = onto.iter().find(|index| gone.contains(index)) {
            return Err(errors::value("relocate[1]", format!("Gaussian {index} is named here and in {argument}")));
        }
    }
    Ok(())
}

/// Checks that no Gaussian is named twice.
fn once_each(len: usize, lists: [(&str, &[u32]); 5]) -> PyResult<()> {
    let mut named: Vec<Option<usize>> = vec![None; len];
    for (which, (argument, list)) in lists.into_iter().enumerate() {
        for &index in list {
            if let Some(other) = named[index as usize].replace(which) {
                let also = if other == which { "twice".to_owned() } else { format!("and in {}", lists[other].0) };
                return Err(errors::value(argument, format!("Gaussian {index} is named here {also}")));
            }
        }
    }
    Ok(())
}
