//! Comparison of states bit by bit.

use std::collections::BTreeMap;

use gs_core::{SplatsState, TensorData};

/// All numbers of a state as bits, by tensor name. 0 and −0 differ, and NaN equals itself.
#[must_use]
pub fn bits(state: &SplatsState) -> BTreeMap<&str, Vec<u32>> {
    let of = |data: &TensorData| match data {
        TensorData::F32(values) => values.iter().map(|v| v.to_bits()).collect(),
        TensorData::U32(values) => values.clone(),
    };
    state.tensors.iter().map(|(name, tensor)| (name.as_str(), of(&tensor.data))).collect()
}
