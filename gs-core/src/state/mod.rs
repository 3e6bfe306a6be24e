//! The whole state of splats as named tensors, for checkpoints and for exchange between backends.

mod saved;
mod scene;

use std::collections::BTreeMap;

use crate::{adam::Parameterization, error::Error, scene::check_len};

pub use saved::{SavedState, SavedTensor, TensorType};

/// Values of a tensor, row-major.
#[derive(Debug, Clone, PartialEq)]
pub enum TensorData {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// 32-bit unsigned integers.
    U32(Vec<u32>),
}

/// Shape and values of a tensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    /// Shape; the product is the length of `data`.
    pub shape: Vec<usize>,
    /// Values.
    pub data: TensorData,
}

/// Parameters, Adam moments, step counts and statistics of splats, bit for bit as the backend holds
/// them.
///
/// Names and shapes are part of the contract between backends. For 2D splats: `mean [N,2]`,
/// `factor [N,4]` (columns of L, in [`Parameterization::CovarianceFactor`]) or `log_scale [N,2]`
/// and `rotation [N]`; `color [N,3]`, `opacity_logit [N]` (absent where all are opaque); `moment1`,
/// `moment2 [N,9]` in the order mean 2, shape 3, colour 3, opacity 1; `steps [N]` (u32);
/// `gradient_sum [N]` (of the statistic that is collected), `visible [N]` (u32).
///
/// For 3D splats, with K = (d + 1)² coefficients: `mean [N,3]`, `log_scale [N,3]`, `rotation [N,4]`
/// (w, x, y, z), `opacity_logit [N]`, `sh [N,3K]` (coefficient by coefficient, each R, G, B);
/// `moment1`, `moment2 [N,11+3K]` in the order mean 3, log-scale 3, rotation 4, opacity 1, SH 3K;
/// `steps`, `gradient_sum` and `visible` as above. Moments that a backend holds in 16 bits
/// ([`MomentFormat`](crate::adam::MomentFormat)) are numbers of 32 bits here, which hold them
/// exactly.
#[derive(Debug, Clone, PartialEq)]
pub struct SplatsState {
    /// Coordinates in which the optimizer moves; they decide how the shape is held.
    pub parameterization: Parameterization,
    /// Tensors by name.
    pub tensors: BTreeMap<String, Tensor>,
}

impl SplatsState {
    /// A state without tensors.
    pub fn new(parameterization: Parameterization) -> Self {
        Self { parameterization, tensors: BTreeMap::new() }
    }

    /// Adds `[N, COLUMNS]` floats.
    pub fn insert<const COLUMNS: usize>(&mut self, name: &str, rows: impl IntoIterator<Item = [f32; COLUMNS]>) {
        let data: Vec<f32> = rows.into_iter().flatten().collect();
        let shape = vec![data.len() / COLUMNS, COLUMNS];
        self.tensors.insert(name.to_owned(), Tensor { shape, data: TensorData::F32(data) });
    }

    /// Adds `[N, columns]` floats, row-major.
    ///
    /// # Panics
    /// Where `values` are not whole rows.
    pub fn insert_matrix(&mut self, name: &str, columns: usize, values: Vec<f32>) {
        assert!(columns > 0 && values.len().is_multiple_of(columns), "{} values in rows of {columns}", values.len());
        let shape = vec![values.len() / columns, columns];
        self.tensors.insert(name.to_owned(), Tensor { shape, data: TensorData::F32(values) });
    }

    /// Adds `[N]` integers.
    pub fn insert_u32(&mut self, name: &str, values: Vec<u32>) {
        self.tensors.insert(name.to_owned(), Tensor { shape: vec![values.len()], data: TensorData::U32(values) });
    }

    /// The rows of `[N, COLUMNS]` floats.
    ///
    /// # Errors
    /// [`Error::State`] where the tensor is missing, of another shape or of another type.
    pub fn rows<const COLUMNS: usize>(&self, name: &str) -> Result<Vec<[f32; COLUMNS]>, Error> {
        match self.get(name)? {
            Tensor { shape, data: TensorData::F32(data) } if shape.last() == Some(&COLUMNS) || COLUMNS == 1 => {
                let (rows, rest) = data.as_chunks::<COLUMNS>();
                if rest.is_empty() {
                    return Ok(rows.to_vec());
                }
                Err(Error::State(format!("tensor `{name}` has {} values, not rows of {COLUMNS}", data.len())))
            }
            other => {
                Err(Error::State(format!("tensor `{name}` is {:?}, not floats in rows of {COLUMNS}", other.shape)))
            }
        }
    }

    /// The columns of an `[N, columns]` tensor of floats, and its numbers, row-major.
    ///
    /// # Errors
    /// [`Error::State`] where the tensor is missing, not of two dimensions, of another length than
    /// its shape says, or of another type.
    pub fn matrix(&self, name: &str) -> Result<(usize, &[f32]), Error> {
        match self.get(name)? {
            Tensor { shape, data: TensorData::F32(data) } => match shape[..] {
                [rows, columns] if columns > 0 && rows.checked_mul(columns) == Some(data.len()) => Ok((columns, data)),
                _ => Err(Error::State(format!("tensor `{name}` has {} values in a shape of {shape:?}", data.len()))),
            },
            _ => Err(Error::State(format!("tensor `{name}` holds integers, not floats"))),
        }
    }

    /// The numbers of a tensor of floats of this shape, rows and columns; row-major.
    ///
    /// # Errors
    /// Those of [`Self::matrix`]; [`Error::State`] and [`Error::Length`] where the shape is another.
    pub fn matrix_of(&self, name: &'static str, [rows, columns]: [usize; 2]) -> Result<&[f32], Error> {
        let (found, numbers) = self.matrix(name)?;
        if found != columns {
            return Err(Error::State(format!("tensor `{name}` has {found} columns, not {columns}")));
        }
        check_len(name, rows, numbers.len() / found)?;
        Ok(numbers)
    }

    /// `[N]` integers.
    ///
    /// # Errors
    /// [`Error::State`] where the tensor is missing or of another type.
    pub fn integers(&self, name: &str) -> Result<Vec<u32>, Error> {
        match &self.get(name)?.data {
            TensorData::U32(values) => Ok(values.clone()),
            TensorData::F32(_) => Err(Error::State(format!("tensor `{name}` holds floats, not integers"))),
        }
    }

    /// Whether there is a tensor of this name.
    pub fn contains(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    fn get(&self, name: &str) -> Result<&Tensor, Error> {
        self.tensors.get(name).ok_or_else(|| Error::State(format!("tensor `{name}` is missing")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_and_misuse_is_an_error() {
        let mut state = SplatsState::new(Parameterization::ScaleRotation);
        state.insert("mean", [[1.0, 2.0], [3.0, 4.0]]);
        state.insert_u32("steps", vec![7]);
        assert_eq!(state.rows::<2>("mean").unwrap(), [[1.0, 2.0], [3.0, 4.0]]);
        assert!(state.rows::<3>("mean").is_err());
        assert!(state.rows::<2>("absent").is_err());
        assert!(state.integers("mean").is_err());
        assert_eq!(state.integers("steps").unwrap(), [7]);
        state.insert_matrix("sh", 3, vec![1.0; 6]);
        assert_eq!(state.matrix("sh").unwrap(), (3, &[1.0; 6][..]));
        assert!(state.matrix("steps").is_err());
        state.tensors.get_mut("sh").unwrap().shape = vec![4, 3];
        assert!(state.matrix("sh").is_err());
    }
}
