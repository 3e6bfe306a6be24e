//! The mean of a scene over the last steps of a run.
//!
//! Steps of constant length jump around a minimum. The mean of several scenes of such a run is
//! nearer to it, and fits unseen views better than the last scene. *Source:* stochastic weight
//! averaging (Izmailov et al. 2018, arXiv 1803.05407).

use gs_core::{Optimizer, SavedState, SavedTensor, SplatsState, Tensor, TensorData, TensorType};

use super::Trainer;
use crate::{
    error::Error,
    run::task::{RunSettings, Trainable},
};

/// Most scenes that a mean is taken of.
const SCENES: u32 = 32;

/// Names of the tensors in a checkpoint: the number of scenes, and a sum for each array of the
/// scene.
const COUNT: &str = "average.scenes";
const SUM: &str = "average.sum";

/// The sum of each parameter over several scenes that have the same Gaussians.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Average {
    scenes: u32,
    /// One for each array of the scene; empty before the first scene.
    sums: Vec<Vec<f32>>,
}

/// Whether the scene after `step` of `iterations` steps is a part of the mean over this share of
/// the run.
fn is_due(share: f32, step: u32, iterations: u32) -> bool {
    let last = (f64::from(iterations) * f64::from(share)) as u32;
    let left = iterations - step;
    left < last && left.is_multiple_of(last.div_ceil(SCENES))
}

impl Average {
    /// Adds a scene with these parameters.
    fn add(&mut self, arrays: Vec<&mut [f32]>) {
        self.scenes += 1;
        self.sums.resize_with(arrays.len(), Vec::new);
        for (sum, array) in self.sums.iter_mut().zip(arrays) {
            if sum.is_empty() {
                sum.extend_from_slice(array);
            } else {
                sum.iter_mut().zip(array).for_each(|(sum, number)| *sum += *number);
            }
        }
    }

    /// Gives one of the scenes, with these parameters, the mean of all.
    fn assign_to(&self, arrays: Vec<&mut [f32]>) {
        for (array, sum) in arrays.into_iter().zip(&self.sums) {
            array.iter_mut().zip(sum).for_each(|(number, sum)| *number = *sum / self.scenes as f32);
        }
    }

    /// Adds the sums to the state of a checkpoint.
    pub(super) fn save<'s>(&'s self, state: &mut SavedState<'s>) {
        state.tensors.extend(self.tensors());
    }

    /// The tensors for a checkpoint; none before the first scene.
    fn tensors(&self) -> impl Iterator<Item = SavedTensor<'_>> {
        let sums = self.sums.iter().enumerate().map(|(index, sum)| {
            let pass = move |to: &mut dyn FnMut(&[u32])| to(bytemuck::cast_slice(sum));
            SavedTensor::new(format!("{SUM}{index}"), vec![sum.len()], TensorType::F32, pass)
        });
        let count = SavedTensor::new(COUNT, vec![1], TensorType::U32, |to| to(&[self.scenes]));
        sums.chain((self.scenes > 0).then_some(count))
    }

    /// The sums in a checkpoint of this state, of a run whose first `fixed` Gaussians do not move.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where they do not fit the Gaussians of the state.
    pub(crate) fn of_state<S: Trainable>(
        state: &SplatsState,
        fixed: u32,
        scene: impl Fn(&SplatsState) -> Result<S, gs_core::Error>,
    ) -> Result<Self, Error> {
        let Some(count) = state.tensors.get(COUNT) else { return Ok(Self::default()) };
        let mut scene = scene(state)?;
        let wrong = || Error::Checkpoint("its average does not fit its Gaussians".to_owned());
        let TensorData::U32(count) = &count.data else { return Err(wrong()) };
        let sum = |(index, array): (usize, &mut [f32])| match state.tensors.get(&format!("{SUM}{index}")) {
            Some(Tensor { data: TensorData::F32(sum), .. }) if sum.len() == array.len() => Some(sum.clone()),
            _ => None,
        };
        let sums: Option<Vec<_>> = moving(&mut scene, fixed).into_iter().enumerate().map(sum).collect();
        match (&count[..], sums) {
            (&[scenes], Some(sums)) if (1..=SCENES).contains(&scenes) => Ok(Self { scenes, sums }),
            _ => Err(wrong()),
        }
    }
}

/// The parameters of the Gaussians behind the first `fixed`, an array for each kind.
fn moving<S: Trainable>(scene: &mut S, fixed: u32) -> Vec<&mut [f32]> {
    let count = scene.len().max(1);
    fn behind(array: &mut [f32], fixed: usize, count: usize) -> &mut [f32] {
        let from = array.len() / count * fixed;
        &mut array[from..]
    }
    scene.numbers_mut().into_iter().map(|array| behind(array, fixed as usize, count)).collect()
}

impl<R: Optimizer<S>, S: Trainable> Trainer<'_, R, S> {
    /// Adds the scene to the mean where the settings say so. After the last step, the mean replaces
    /// it.
    pub(super) async fn average(&mut self) -> Result<(), Error> {
        let share = self.record.settings.average_last();
        if !is_due(share, self.record.step, self.iterations()) {
            return Ok(());
        }
        let mut scene = self.rasterizer.download(&self.splats).await?;
        let fixed = self.record.settings.fixed();
        self.average.add(moving(&mut scene, fixed));
        if self.is_finished() {
            std::mem::take(&mut self.average).assign_to(moving(&mut scene, fixed));
            let parameterization = self.record.settings.parameterization();
            // Frees the memory of the last scene first.
            self.splats = self.rasterizer.upload(&S::default(), parameterization)?;
            self.splats = self.rasterizer.upload(&scene, parameterization)?;
        }
        Ok(())
    }

    /// Begins the mean again.
    pub(crate) fn forget_average(&mut self) {
        self.average = Average::default();
    }
}

#[cfg(test)]
mod tests {
    use gs_core::Scene2d;

    use super::*;

    #[test]
    fn at_most_32_scenes_are_averaged_evenly_and_the_last_one_always() {
        let due = |share: f32, iterations: u32| -> Vec<u32> {
            (1..=iterations).filter(|&step| is_due(share, step, iterations)).collect()
        };
        assert!(due(0.0, 100).is_empty());
        assert_eq!(due(0.05, 100), [96, 97, 98, 99, 100]);
        let many = due(0.25, 2_000);
        assert_eq!((many.len(), many[0], many[31]), (32, 1_504, 2_000));
        assert!(many.windows(2).all(|pair| pair[1] - pair[0] == 16));
        assert_eq!(due(1.0, 3), [1, 2, 3]);
        assert!(due(0.1, 5).is_empty());
    }

    #[test]
    fn the_mean_is_that_of_each_number_and_survives_a_checkpoint() {
        let scene = |at: f32| Scene2d {
            means: vec![glam::Vec2::new(at, 2.0 * at)],
            log_scales: vec![glam::Vec2::ZERO],
            rotations: vec![0.5],
            opacity_logits: Vec::new(),
            colors: vec![glam::Vec3::splat(at)],
        };
        let mut average = Average::default();
        assert_eq!(average.tensors().count(), 0);
        [1.0, 2.0].into_iter().for_each(|at| average.add(scene(at).numbers_mut()));
        let mut state = SplatsState::new(gs_core::Parameterization::ScaleRotation);
        let tensors = SavedState { parameterization: state.parameterization, tensors: average.tensors().collect() };
        state.tensors = tensors.collect().tensors;
        let mut read = Average::of_state(&state, 0, |_| Ok(scene(0.0))).unwrap();
        assert_eq!(read, average);
        read.add(scene(6.0).numbers_mut());
        let mut mean = scene(6.0);
        read.assign_to(mean.numbers_mut());
        assert_eq!(mean, scene(3.0));
        let two = Scene2d { rotations: vec![0.0; 2], ..scene(0.0) };
        let found = |state: &SplatsState, scene: &Scene2d| Average::of_state(state, 0, |_| Ok(scene.clone()));
        assert!(matches!(found(&state, &two), Err(Error::Checkpoint(_))));
        state.insert_u32(COUNT, vec![SCENES + 1]);
        assert!(matches!(found(&state, &scene(0.0)), Err(Error::Checkpoint(_))));
        assert_eq!(found(&SplatsState::new(state.parameterization), &scene(0.0)).unwrap(), Average::default());
    }
}
