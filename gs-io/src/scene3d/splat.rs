//! `.splat`: 32 bytes per Gaussian without a header, as in antimatter15's viewer.
//!
//! | bytes | what |
//! |---|---|
//! | 0–11 | mean, three f32 |
//! | 12–23 | scale (not its logarithm), three f32 |
//! | 24–27 | red, green, blue, opacity: 0 to 255 stand for 0 to 1 |
//! | 28–31 | quaternion w, x, y, z: (byte − 128) / 128 |
//!
//! Little-endian; axes are those of the PLY it was made from. Without a header, only its extension
//! identifies it.

use gs_core::constants::SH_C0;
use gs_core::{Scene, Scene3d};

use super::{
    Encoded3d, File3d, Format3d, TrainedWith,
    conversion_loss::{Clamp, ConversionLoss},
    options::ToWrite,
    source::Source,
    values::{UnitRotations, byte_of_logit, log_of_scale, logit_of_step, scale_of_log},
};
use crate::error::Error;

pub(super) const RECORD_BYTES: usize = 32;

/// Reads a scene of degree 0.
pub(crate) fn read(source: &Source<'_>, format: Format3d) -> Result<File3d, Error> {
    let (records, rest) = source.bytes.as_chunks::<RECORD_BYTES>();
    if !rest.is_empty() {
        let start = source.bytes.len() - rest.len();
        return Err(source.damaged(start, "a record of 32 bytes", format!("{}", rest.len())));
    }
    let mut scene = Scene3d::default();
    for record in records {
        let (numbers, _) = record.as_chunks::<4>();
        let number = |k: usize| f32::from_le_bytes(numbers[k]);
        let share = |k: usize| f32::from(record[k]) / 255.0;
        scene.means.push([number(0), number(1), number(2)].into());
        scene.log_scales.push([number(3), number(4), number(5)].map(log_of_scale).into());
        scene.sh.push([24, 25, 26].map(|k| (share(k) - 0.5) / SH_C0).into());
        scene.opacity_logits.push(logit_of_step(record[27].into(), 255));
        scene.rotations.push([28, 29, 30, 31].map(|k: usize| (f32::from(record[k]) - 128.0) / 128.0));
    }
    Ok(File3d::of(format, scene))
}

/// Encodes a scene.
pub(crate) fn encode(&ToWrite { format, path, scene, options }: &ToWrite<'_>) -> Result<Encoded3d, Error> {
    let rotations = UnitRotations::new(scene, path)?;
    let mut bytes = Vec::with_capacity(scene.len() * RECORD_BYTES);
    let mut clamp = Clamp::new("colours", 0.0, 1.0, 0.5 / 255.0);
    let byte = |share: f32| (share * 255.0).round() as u8;
    for i in 0..scene.len() {
        let numbers = scene.means[i].to_array().into_iter().chain(scene.log_scales[i].to_array().map(scale_of_log));
        bytes.extend(numbers.flat_map(f32::to_le_bytes));
        let color = scene.sh[i * scene.sh_len()].to_array().map(|c| clamp.apply(0.5 + SH_C0 * c));
        bytes.extend(color.map(byte));
        bytes.push(byte_of_logit(scene.opacity_logits[i]));
        // The cast saturates: 1 becomes 255, which is 127/128; readers normalise.
        bytes.extend(rotations.get(i).map(|q| (q * 128.0 + 128.0).round() as u8));
    }
    let mut losses = Vec::from_iter(ConversionLoss::of_degree(scene.sh_degree, 0));
    let rounded = |what| ConversionLoss::Rounded { what, to: "8 bits".to_owned() };
    losses.extend(["colours", "opacities", "the parts of quaternions"].map(rounded));
    losses.extend(clamp.loss());
    losses.extend(options.trained_with.lost(&TrainedWith::default()));
    Ok(Encoded3d::of(format, bytes, losses))
}
