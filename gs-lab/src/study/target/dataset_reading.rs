//! How a study reads its data sets.

use std::{num::NonZeroU32, path::Path};

use gs_io::{
    WorldFrame,
    dataset::{AlphaMeaning, Dataset, DatasetSettings, Split, View, read_dataset},
};
use gs_train::{SettingsFile, parse_settings, settings_to_toml};
use serde::{Deserialize, Serialize};

gs_core::impl_with!(DatasetReading);

impl SettingsFile for DatasetReading {
    fn from_toml(text: &str, file: &Path) -> Result<Self, gs_train::Error> {
        parse_settings(text, file)
    }

    fn to_toml(&self) -> Result<String, gs_train::Error> {
        settings_to_toml(self)
    }
}

/// How the data sets of a study are read: the flags of `gs train` by the same names, and how many
/// views are used.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct DatasetReading {
    /// Images with a longer side are scaled down to this many pixels; 0 keeps all. Default 1600.
    pub max_size: u32,
    /// Every n-th view by name is held out, unless the data set says which; 0 holds out none.
    /// Default 8.
    pub holdout: u32,
    /// The folder of the data set with the images, such as `images_4`. By default the first that
    /// there is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub images: Option<String>,
    /// What the alpha channel of the images means. Default opacity.
    pub alpha: AlphaMeaning,
    /// Largest number of training views, evenly spread over those that there are. By default all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub views: Option<NonZeroU32>,
    /// Largest number of held-out views, evenly spread likewise. By default all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub test_views: Option<NonZeroU32>,
}

impl Default for DatasetReading {
    fn default() -> Self {
        Self { max_size: 1600, holdout: 8, images: None, alpha: AlphaMeaning::Opacity, views: None, test_views: None }
    }
}

impl DatasetReading {
    /// Reads a data set into a frame, such as that of a scene, or into one that suits it; leaves out the
    /// views that are not used. Pixels are read when they are needed.
    ///
    /// # Errors
    /// Those of [`read_dataset`].
    pub fn read(&self, frame: Option<WorldFrame>, path: &Path) -> Result<Dataset, gs_io::Error> {
        let mut dataset = read_dataset(path, &self.settings().with(|s| s.frame = frame))?;
        self.thin(&mut dataset);
        Ok(dataset)
    }

    /// The settings of the reader.
    fn settings(&self) -> DatasetSettings {
        DatasetSettings::default().with(|s| {
            s.image_folder = self.images.clone();
            s.test_every = NonZeroU32::new(self.holdout);
            s.alpha = self.alpha;
            s.max_side = NonZeroU32::new(self.max_size);
        })
    }

    /// Leaves out the views that are too many, and those for validation, which nothing uses.
    fn thin(&self, dataset: &mut Dataset) {
        let mut kept = Vec::with_capacity(dataset.views.len());
        for (split, most) in [(Split::Train, self.views), (Split::Test, self.test_views)] {
            let views: Vec<View> = dataset.views_of(split).cloned().collect();
            let count = most.map_or(views.len(), |most| views.len().min(most.get() as usize));
            kept.extend((0..count).map(|index| views[index * views.len() / count].clone()));
        }
        kept.sort_by(|a, b| a.name.cmp(&b.name));
        dataset.views = kept;
    }

    /// Whether nothing differs from the default.
    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}
