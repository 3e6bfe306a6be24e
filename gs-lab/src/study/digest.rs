//! Digests of contents: the first 128 bits of SHA-256, in hexadecimal.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    fs,
    path::{Path, PathBuf},
};

use gs_core::{Image, SavedState, Scene2d, Scene3d, TensorType};
use gs_io::{
    Checkpoint,
    dataset::{Dataset, View},
};
use hmac_sha256::Hash;

use crate::error::Error;

/// Values of a tensor that are copied at once.
const CHUNK: usize = 1 << 16;

/// Hexadecimal digits of a digest.
pub(crate) const DIGITS: usize = 32;

/// The digest of several texts, which depends on where one ends and the next begins.
pub(crate) fn of_texts<'a>(texts: impl IntoIterator<Item = &'a str>) -> String {
    let mut hash = Hash::new();
    for text in texts {
        hash.update((text.len() as u64).to_le_bytes());
        hash.update(text);
    }
    digits(hash)
}

/// The digest of an image: its size and the bit patterns of its values.
pub(crate) fn of_image(image: &Image) -> String {
    let mut hash = Hash::new();
    hash.update([image.width(), image.height()].map(u32::to_le_bytes).as_flattened());
    hash_floats(&mut hash, image.pixels().as_flattened().iter().copied());
    digits(hash)
}

/// The digest of a data set: its views, the content of their files, and its points. It does not
/// depend on where the data set is.
///
/// # Errors
/// [`Error::Path`] where a file cannot be read.
pub(crate) fn of_dataset(dataset: &Dataset) -> Result<String, Error> {
    let mut hash = Hash::new();
    let mut add = |text: &str| {
        hash.update((text.len() as u64).to_le_bytes());
        hash.update(text);
    };
    // The faces of a 360° image share a file.
    let mut files: BTreeMap<&PathBuf, String> = BTreeMap::new();
    add(dataset.kind.name());
    for view in &dataset.views {
        let View { name, camera, full, source, orientation, alpha, split, depth, .. } = view;
        let unit = depth.as_ref().map(|depth| depth.unit);
        add(name);
        add(&format!("{camera:?} {full:?} {source:?} {orientation:?} {alpha:?} {split:?} {unit:?}"));
        for path in [Some(&view.image), view.mask.as_ref(), depth.as_ref().map(|depth| &depth.path)] {
            add(match path {
                None => "none",
                Some(path) => match files.entry(path) {
                    Entry::Occupied(entry) => entry.into_mut(),
                    Entry::Vacant(entry) => entry.insert(of_file(path)?),
                },
            });
        }
    }
    hash_floats(&mut hash, dataset.points.iter().flat_map(|p| p.position.to_array().into_iter().chain(p.color)));
    Ok(digits(hash))
}

fn of_file(path: &Path) -> Result<String, Error> {
    let bytes = fs::read(path).map_err(|source| Error::Path { path: path.to_owned(), source })?;
    let mut hash = Hash::new();
    hash.update(bytes);
    Ok(digits(hash))
}

/// The digest of a 3D scene. Two scenes have the same digest only if they are bit-identical.
pub(crate) fn of_scene_3d(scene: &Scene3d) -> String {
    let mut hash = Hash::new();
    hash.update((scene.means.len() as u64).to_le_bytes());
    hash.update([scene.sh_degree]);
    hash_floats(&mut hash, scene.means.iter().flat_map(|v| v.to_array()));
    hash_floats(&mut hash, scene.log_scales.iter().flat_map(|v| v.to_array()));
    hash_floats(&mut hash, scene.rotations.iter().flatten().copied());
    hash_floats(&mut hash, scene.opacity_logits.iter().copied());
    hash_floats(&mut hash, scene.sh.iter().flat_map(|v| v.to_array()));
    digits(hash)
}

/// The digest of a scene. Two scenes have the same digest only if they are bit-identical.
pub(crate) fn of_scene(scene: &Scene2d) -> String {
    let mut hash = Hash::new();
    hash.update((scene.means.len() as u64).to_le_bytes());
    hash.update((scene.opacity_logits.len() as u64).to_le_bytes());
    hash_floats(&mut hash, scene.means.iter().flat_map(|v| v.to_array()));
    hash_floats(&mut hash, scene.log_scales.iter().flat_map(|v| v.to_array()));
    hash_floats(&mut hash, scene.rotations.iter().copied());
    hash_floats(&mut hash, scene.opacity_logits.iter().copied());
    hash_floats(&mut hash, scene.colors.iter().flat_map(|v| v.to_array()));
    digits(hash)
}

/// The digest of a run's checkpoint: the run's address, all metadata, and the bits of all tensors.
pub(crate) fn of_checkpoint<'a, S>(address: &str, checkpoint: &'a Checkpoint<S>) -> String
where
    &'a S: Into<SavedState<'a>>,
{
    let metadata = &checkpoint.metadata;
    let SavedState { parameterization, mut tensors } = (&checkpoint.state).into();
    let mut hash = Hash::new();
    let mut add = |text: &str| {
        hash.update((text.len() as u64).to_le_bytes());
        hash.update(text);
    };
    add(address);
    add(&format!("{parameterization:?} {}", metadata.len()));
    metadata.iter().flat_map(|(key, value)| [key, value]).for_each(|text| add(text));
    tensors.sort_by(|left, right| left.name.cmp(&right.name));
    for tensor in &tensors {
        let kind = match tensor.numbers {
            TensorType::F32 => "f32",
            TensorType::U32 => "u32",
        };
        hash.update(of_texts([&tensor.name, kind, &format!("{:?}", tensor.shape)]));
        tensor.pass(&mut |bits| bits.chunks(CHUNK).for_each(|chunk| hash_words(&mut hash, chunk)));
    }
    digits(hash)
}

fn hash_words(hash: &mut Hash, words: &[u32]) {
    let bytes: Vec<[u8; 4]> = words.iter().map(|word| word.to_le_bytes()).collect();
    hash.update(bytes.as_flattened());
}

fn hash_floats(hash: &mut Hash, values: impl Iterator<Item = f32>) {
    let bytes: Vec<[u8; 4]> = values.map(f32::to_le_bytes).collect();
    hash.update(bytes.as_flattened());
}

fn digits(hash: Hash) -> String {
    let mut digits: String = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    digits.truncate(DIGITS);
    digits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contents_that_differ_in_a_bit_have_other_digests() {
        let grey = Image::filled(4, 3, [0.5; 3]).unwrap();
        let mut other = grey.clone();
        other.pixels_mut()[11][2] = f32::from_bits(0.5f32.to_bits() + 1);
        assert_ne!(of_image(&grey), of_image(&other));
        assert_ne!(of_image(&grey), of_image(&Image::filled(3, 4, [0.5; 3]).unwrap()));
        assert_ne!(of_texts(["ab", "c"]), of_texts(["a", "bc"]));
        assert_eq!(of_texts(["a"]).len(), DIGITS);
    }
}
