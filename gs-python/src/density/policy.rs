//! Policies of density control that are written in Python.

use std::sync::PoisonError;

use gs_core::{EditPlan, Error, effects::Statistics};
use gs_density::{Actions, DensityPolicy, Needs, Observation, Policy, Rng};
use pyo3::{exceptions::PyTypeError, prelude::*, types::PyAny};
use rand::Rng as _;

use super::{
    observation::{Observation as Seen, SeenScene},
    plan::{Plan, PythonScene},
};
use crate::convert::{
    errors::{self, IntoPython, Raised},
    settings,
};

/// A policy in Python: an object with a method `plan(observation, rng)`.
#[derive(Debug)]
pub(crate) struct PythonPolicy {
    object: Py<PyAny>,
    actions: Actions,
    needs: Needs,
    raised: Raised,
}

/// A policy as an argument: the name of one of the engine's, or an object.
pub(crate) enum PolicyArgument<'py> {
    Named(Policy),
    InPython(Bound<'py, PyAny>),
}

impl<'py> PolicyArgument<'py> {
    pub(crate) fn of(policy: &Bound<'py, PyAny>) -> PyResult<Self> {
        if let Ok(name) = policy.extract::<String>() {
            return Policy::from_name(&name).map(Self::Named).map_err(IntoPython::into_python);
        }
        if policy.hasattr("plan")? && policy.getattr("plan")?.is_callable() {
            return Ok(Self::InPython(policy.clone()));
        }
        Err(errors::wrong_type("policy", "a name or an object with a method plan(observation, rng)", policy))
    }

    /// The policy of the engine whose actions and first Gaussians a policy in Python starts from.
    pub(crate) fn named(&self) -> PyResult<Policy> {
        match self {
            Self::Named(policy) => Ok(policy.clone()),
            Self::InPython(_) => Policy::from_name("absolute").map_err(IntoPython::into_python),
        }
    }
}

impl PythonPolicy {
    /// The policy of an object, which changes `actions` by its attribute of this name.
    pub(crate) fn new(object: &Bound<'_, PyAny>, actions: Actions, raised: Raised) -> PyResult<Self> {
        let attribute = |name: &str| object.getattr_opt(name);
        let actions = match attribute("actions")? {
            Some(over) => settings::with("policy.actions", actions, Some(&over))?,
            None => actions,
        };
        actions.validate().map_err(IntoPython::into_python)?;
        let statistics = match attribute("statistics")? {
            Some(name) => {
                let name: String = name.extract().map_err(|_| {
                    let message = format!("policy.statistics: expected a name such as 'mean-gradient', not {name}");
                    PyTypeError::new_err(message)
                })?;
                settings::named("policy.statistics", &name)?
            }
            None => Statistics::MeanGradient,
        };
        let residual = attribute("needs_residual")?.is_some_and(|needs| needs.is_truthy().unwrap_or(false));
        let needs = Needs { statistics, residual, ..Needs::default() };
        Ok(Self { object: object.clone().unbind(), actions, needs, raised })
    }
}

impl<S: PythonScene + SeenScene> DensityPolicy<S> for PythonPolicy {
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        let planned = Python::attach(|py| {
            let seen = Bound::new(py, Seen::of(py, observation)?)?;
            // Those of the plan's own edits are drawn as if it had drawn none.
            let numbers = py.import("numpy.random")?.call_method1("default_rng", (rng.clone().next_u64(),))?;
            let plan = self.object.bind(py).call_method1("plan", (seen, numbers))?;
            let plan =
                plan.cast::<Plan>().map_err(|_| errors::wrong_type("plan(observation, rng)", "a Plan", &plan))?;
            plan.get().edits(py, observation, &self.actions, rng)
        });
        planned.map_err(|error| {
            let message = format!("the policy failed: {error}");
            *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            Error::State(message)
        })
    }

    fn needs(&self) -> Needs {
        self.needs
    }
}
