//! A state whose numbers are passed on row by row instead of being held in memory.

use std::{fmt, rc::Rc};

use super::{SplatsState, Tensor, TensorData};
use crate::adam::Parameterization;

/// The same as a [`SplatsState`], without the memory for it: the numbers are passed from where the
/// backend holds them to where they are written.
#[derive(Debug, Clone)]
pub struct SavedState<'a> {
    /// Coordinates in which the optimizer moves.
    pub parameterization: Parameterization,
    /// The tensors of [`SplatsState`], in any order.
    pub tensors: Vec<SavedTensor<'a>>,
}

/// The type of a tensor's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TensorType {
    /// 32-bit floats.
    F32,
    /// 32-bit unsigned integers.
    U32,
}

/// Passes the bits of numbers to its argument, piece by piece.
type Pass<'a> = dyn Fn(&mut dyn FnMut(&[u32])) + 'a;

/// A tensor of a [`SavedState`].
#[derive(Clone)]
pub struct SavedTensor<'a> {
    /// Name in the state.
    pub name: String,
    /// Shape; the product is the number of numbers.
    pub shape: Vec<usize>,
    /// Type of the numbers.
    pub numbers: TensorType,
    pass: Rc<Pass<'a>>,
}

impl<'a> SavedTensor<'a> {
    /// A tensor whose numbers, row-major, `pass` hands to its argument, piece by piece. Floats are
    /// passed as their bits.
    pub fn new(
        name: impl Into<String>,
        shape: Vec<usize>,
        numbers: TensorType,
        pass: impl Fn(&mut dyn FnMut(&[u32])) + 'a,
    ) -> Self {
        Self { name: name.into(), shape, numbers, pass: Rc::new(pass) }
    }

    /// Passes all numbers to `to`, piece by piece, row-major. Floats are passed as their bits.
    pub fn pass(&self, to: &mut dyn FnMut(&[u32])) {
        (self.pass)(to);
    }

    fn collect(&self) -> Tensor {
        let len = self.shape.iter().product();
        let data = match self.numbers {
            TensorType::F32 => {
                let mut values: Vec<f32> = Vec::with_capacity(len);
                self.pass(&mut |bits| values.extend_from_slice(bytemuck::cast_slice(bits)));
                TensorData::F32(values)
            }
            TensorType::U32 => {
                let mut values = Vec::with_capacity(len);
                self.pass(&mut |bits| values.extend_from_slice(bits));
                TensorData::U32(values)
            }
        };
        Tensor { shape: self.shape.clone(), data }
    }
}

impl fmt::Debug for SavedTensor<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, shape, numbers, .. } = self;
        write!(f, "{name} {shape:?} {numbers:?}")
    }
}

impl SavedState<'_> {
    /// Copies the state into memory of its own.
    pub fn collect(&self) -> SplatsState {
        let mut state = SplatsState::new(self.parameterization);
        let tensors = self.tensors.iter().map(|tensor| (tensor.name.clone(), tensor.collect()));
        state.tensors = tensors.collect();
        state
    }
}

impl Tensor {
    fn type_and_bits(&self) -> (TensorType, &[u32]) {
        match &self.data {
            TensorData::F32(values) => (TensorType::F32, bytemuck::cast_slice(values)),
            TensorData::U32(values) => (TensorType::U32, values),
        }
    }
}

impl<'a> From<&'a SplatsState> for SavedState<'a> {
    fn from(state: &'a SplatsState) -> Self {
        let tensors = state.tensors.iter().map(|(name, tensor)| {
            let (numbers, bits) = tensor.type_and_bits();
            SavedTensor::new(name, tensor.shape.clone(), numbers, move |to| to(bits))
        });
        Self { parameterization: state.parameterization, tensors: tensors.collect() }
    }
}

impl<'a> From<&'a SavedState<'_>> for SavedState<'a> {
    fn from(state: &'a SavedState<'_>) -> Self {
        state.clone()
    }
}

impl From<SplatsState> for SavedState<'static> {
    fn from(state: SplatsState) -> Self {
        let tensors = state.tensors.into_iter().map(|(name, tensor)| {
            let (shape, numbers) = (tensor.shape.clone(), tensor.type_and_bits().0);
            SavedTensor::new(name, shape, numbers, move |to| to(tensor.type_and_bits().1))
        });
        Self { parameterization: state.parameterization, tensors: tensors.collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_comes_back_bit_for_bit() {
        let mut state = SplatsState::new(Parameterization::CovarianceFactor);
        state.insert("mean", [[1.0, -0.0], [f32::INFINITY, 1e-40]]);
        state.insert_u32("steps", vec![u32::MAX, 7]);
        assert_eq!(SavedState::from(&state).collect(), state);
        assert_eq!(SavedState::from(state.clone()).collect(), state);
        let doubled = SavedTensor::new("steps", vec![4], TensorType::U32, |to| {
            to(&[1]);
            to(&[2, 3, 4]);
        });
        let TensorData::U32(values) = doubled.collect().data else { panic!("{doubled:?}") };
        assert_eq!(values, [1, 2, 3, 4]);
    }
}
