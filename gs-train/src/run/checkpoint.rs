//! Metadata of a checkpoint: settings, step, time, counts and the target images.

use std::{collections::BTreeMap, fmt::Display, path::Path, str::FromStr};

use gs_core::{Effects, Image, edit::EditCounts, effects::Statistics};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::{
    recovery::FreshStart,
    task::{RunSettings, Trainable},
};
use crate::error::Error;

/// The state of a [`Trainer`](crate::Trainer) that is not in its splats.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Record<C> {
    pub(crate) settings: C,
    /// Steps done.
    pub(crate) step: u32,
    pub(crate) seconds: f64,
    pub(crate) edits: EditCounts,
    /// Restarts of the run.
    pub(crate) fresh_starts: Vec<FreshStart>,
    /// Identifies the target images, such as the [`fingerprint`] of a target.
    pub(crate) images: String,
}

impl<C> Record<C> {
    /// The record of a run before its first step.
    pub(crate) fn beginning(settings: C, images: String) -> Self {
        Self { settings, step: 0, seconds: 0.0, edits: EditCounts::default(), fresh_starts: Vec::new(), images }
    }

    /// Effects that the scene has been trained with: those of the last step, or of the first one
    /// before any step.
    pub(crate) fn effects<S: Trainable<Settings = C>>(&self) -> Effects
    where
        C: RunSettings<S>,
    {
        let effects = self.settings.effects_after(self.step.saturating_sub(1));
        Effects { statistics: Statistics::None, ..effects }
    }

    pub(crate) fn to_metadata<S: Trainable<Settings = C>>(&self) -> Result<BTreeMap<String, String>, Error>
    where
        C: RunSettings<S>,
    {
        Ok([
            ("format", C::FORMAT.to_owned()),
            ("settings", self.settings.to_toml()?),
            ("step", self.step.to_string()),
            ("seconds", format!("{:?}", self.seconds)),
            ("edits", to_table("edits", &self.edits)?),
            ("health", to_table("health", &Health { fresh_starts: self.fresh_starts.clone() })?),
            ("target", self.images.clone()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into())
    }

    pub(crate) fn from_metadata<S: Trainable<Settings = C>>(metadata: &BTreeMap<String, String>) -> Result<Self, Error>
    where
        C: RunSettings<S>,
    {
        let format = value(metadata, "format")?;
        if format != C::FORMAT {
            return Err(Error::Checkpoint(format!("its format is `{format}`, not `{}`", C::FORMAT)));
        }
        let settings = C::from_toml(value(metadata, "settings")?, Path::new("")).map_err(|error| match error {
            Error::Settings { problem, .. } => Error::Checkpoint(format!("its `settings`: {problem}")),
            error => error,
        })?;
        settings.validate()?;
        let health: Health = table(metadata, "health")?;
        let record = Self {
            settings,
            step: step_of(metadata)?,
            seconds: parsed(metadata, "seconds")?,
            edits: table(metadata, "edits")?,
            fresh_starts: health.fresh_starts,
            images: value(metadata, "target")?.to_owned(),
        };
        if let Some(start) = record.fresh_starts.iter().find(|start| start.step > record.step) {
            return Err(Error::Checkpoint(format!("it restarted at step {}, after its own step", start.step)));
        }
        let iterations = record.settings.of_loop().iterations;
        if record.step > iterations {
            return Err(Error::Checkpoint(format!("it is at step {} of {iterations}", record.step)));
        }
        if !(record.seconds >= 0.0 && record.seconds.is_finite()) {
            return Err(Error::Checkpoint(format!("its time is {} s", record.seconds)));
        }
        Ok(record)
    }
}

/// Restarts of a run, as a table of its own.
#[derive(Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
struct Health {
    fresh_starts: Vec<FreshStart>,
}

/// Steps done in a checkpoint with this metadata, of any kind of training.
pub(crate) fn step_of(metadata: &BTreeMap<String, String>) -> Result<u32, Error> {
    parsed(metadata, "step")
}

fn value<'a>(metadata: &'a BTreeMap<String, String>, key: &str) -> Result<&'a str, Error> {
    let missing = || Error::Checkpoint(format!("its metadata lack `{key}`"));
    metadata.get(key).map(String::as_str).ok_or_else(missing)
}

fn parsed<T: FromStr<Err: Display>>(metadata: &BTreeMap<String, String>, key: &str) -> Result<T, Error> {
    let text = value(metadata, key)?;
    text.parse().map_err(|e| Error::Checkpoint(format!("its `{key}` is `{text}`: {e}")))
}

/// The value of a key whose text is a table in TOML.
///
/// # Errors
/// [`Error::Checkpoint`] where it is missing or no such table.
pub(crate) fn table<T: DeserializeOwned>(metadata: &BTreeMap<String, String>, key: &str) -> Result<T, Error> {
    toml::from_str(value(metadata, key)?).map_err(|e| Error::Checkpoint(format!("its `{key}`: {}", e.message())))
}

/// The text that [`table`] reads.
///
/// # Errors
/// [`Error::Checkpoint`] where TOML has no form for it.
pub(crate) fn to_table(key: &str, table: &impl Serialize) -> Result<String, Error> {
    toml::to_string(table).map_err(|e| Error::Checkpoint(format!("its `{key}` cannot be written: {e}")))
}

/// Size and hash of an image as text. Images that differ have different ones, except for a chance
/// of 2⁻⁶⁴.
pub(crate) fn fingerprint(image: &Image) -> String {
    let hash = digest(image.pixels().as_flattened().iter().flat_map(|value| value.to_le_bytes()));
    format!("{}x{} px, {hash:016x}", image.width(), image.height())
}

/// A hash of bytes. *Source:* FNV-1a, 64 bits.
pub(crate) fn digest(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes
        .into_iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use gs_core::Scene2d;
    use gs_density::{Grow, Policy, Signal};

    use super::*;
    use crate::fit::FitSettings;

    fn record() -> Record<FitSettings> {
        Record {
            settings: FitSettings::paper(),
            step: 300,
            seconds: 0.1 + 0.2,
            edits: EditCounts { seeded: 7, pruned_unimportant: 2, ..EditCounts::default() },
            fresh_starts: vec![FreshStart { step: 200, loss: 0.1 + 0.2, first: 0.1 }],
            images: "1x1 px, 0".to_owned(),
        }
    }

    #[test]
    fn a_record_comes_back_from_its_metadata() {
        assert_eq!(Record::from_metadata::<Scene2d>(&record().to_metadata::<Scene2d>().unwrap()).unwrap(), record());
    }

    #[test]
    fn damaged_metadata_are_an_error() {
        let good = record().to_metadata::<Scene2d>().unwrap();
        for (key, bad) in [
            ("format", "fit-4d-1"),
            ("settings", "="),
            ("settings", "gaussians = 0"),
            ("step", "-1"),
            ("step", "2501"),
            ("seconds", "NaN"),
            ("edits", "cloned = -1"),
            ("health", "fresh-starts = [{ step = 301, loss = 1.0, first = 0.5 }]"),
        ] {
            let mut metadata = good.clone();
            metadata.insert(key.to_owned(), bad.to_owned());
            assert!(Record::from_metadata::<Scene2d>(&metadata).is_err(), "{key} = {bad}");
            metadata.remove(key);
            assert!(Record::from_metadata::<Scene2d>(&metadata).is_err(), "no {key}");
        }
    }

    #[test]
    fn every_float_comes_back_bit_for_bit() {
        let mut record = record();
        for odd in [1, 12_345, 0x0012_3457].map(|ulps| f32::from_bits(0.1f32.to_bits() + ulps)) {
            for threshold in [odd, f32::INFINITY] {
                record.settings.adam.mean.learning_rate = odd;
                record.settings.policy =
                    Policy::Grow(Grow::absolute(Signal::MeanGradient).with(|s| s.threshold = threshold));
                record.seconds = f64::from(odd) / 3.0;
                let metadata = record.to_metadata::<Scene2d>().unwrap();
                assert_eq!(Record::from_metadata::<Scene2d>(&metadata).unwrap(), record, "{metadata:?}");
            }
        }
    }

    #[test]
    fn a_fingerprint_distinguishes_images() {
        let grey = Image::filled(4, 3, [0.5; 3]).unwrap();
        let mut other = grey.clone();
        other.pixels_mut()[11][2] = f32::from_bits(0.5f32.to_bits() + 1);
        assert_ne!(fingerprint(&grey), fingerprint(&other));
        assert_ne!(fingerprint(&grey), fingerprint(&Image::filled(3, 4, [0.5; 3]).unwrap()));
        assert_eq!(fingerprint(&grey), fingerprint(&grey.clone()));
        assert!(fingerprint(&grey).starts_with("4x3 px, "), "gs_io::read_scene reads the size");
    }
}
