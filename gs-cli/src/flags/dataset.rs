//! The flags of commands that read data sets.

use std::{fmt, num::NonZeroU32, path::Path, str::FromStr};

use clap::Args;
use gs_io::{
    File3d,
    dataset::{AlphaMeaning, Dataset, DatasetSettings, Remark, read_dataset},
};
use serde::{Deserialize, Serialize};

use super::values::{by_name, whole};
use crate::{failure::Failure, terminal::output::printable};

/// How any data set is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Args, Serialize, Deserialize)]
#[command(next_help_heading = "Data sets")]
#[serde(rename_all = "kebab-case")]
pub(crate) struct ReadingArgs {
    /// Scale down images whose longer side has more pixels; none keeps all pixels
    #[arg(long, value_name = "PX", default_value_t)]
    pub(crate) max_size: MaxSize,
    /// Also read files outside the data set's folder if it names them; links inside it are always
    /// followed
    #[arg(long)]
    pub(crate) allow_outside: bool,
}

impl ReadingArgs {
    /// The settings of the library.
    pub(crate) fn settings(&self) -> DatasetSettings {
        DatasetSettings::default().with(|s| {
            s.max_side = self.max_size.0;
            s.allow_outside = self.allow_outside;
        })
    }

    /// Reads the data set that a scene is shown with, in the frame of the scene.
    pub(crate) fn read_for(&self, scene: &File3d, path: &Path) -> Result<Dataset, Failure> {
        Ok(read_dataset(path, &self.settings().with(|s| s.frame = Some(scene.trained_with.frame)))?)
    }

    /// The flags that differ from the defaults, each after a space.
    pub(crate) fn flags(&self) -> String {
        let Self { max_size, allow_outside } = self;
        let size = if *max_size == MaxSize::default() { String::new() } else { format!(" --max-size {max_size}") };
        size + if *allow_outside { " --allow-outside" } else { "" }
    }
}

/// A remark of the reader as one line, with the flag that changes its subject.
pub(crate) fn remark_text(remark: &Remark) -> String {
    let flag = match remark {
        Remark::Reduced { .. } => "; --max-size none reads all pixels",
        Remark::Frame { .. } => "; gs convert --frame world takes the scene back",
        _ => "",
    };
    printable(&remark.to_string()).into_owned() + flag
}

/// How a data set is read to train or to evaluate with its images.
#[derive(Debug, Clone, Args, Serialize, Deserialize)]
#[command(next_help_heading = "Data sets")]
#[serde(rename_all = "kebab-case")]
pub(crate) struct DatasetArgs {
    /// Hold out every N-th view by name for tests, whatever the data set says; 0 holds out none
    /// [default: what the data set says, or else 8]
    #[arg(long, value_name = "N", value_parser = whole::<u32>(0..))]
    pub(crate) holdout: Option<u32>,
    /// The folder of the data set to take images from, such as images_4 [default: the first that
    /// there is]
    #[arg(long, value_name = "FOLDER")]
    pub(crate) images: Option<String>,
    /// What the alpha channel of the images means
    #[arg(long, value_parser = by_name::<AlphaMeaning>(), default_value_t)]
    pub(crate) alpha: AlphaMeaning,
    #[command(flatten)]
    pub(crate) reading: ReadingArgs,
}

impl DatasetArgs {
    /// Reads a data set to train with, in a frame that suits it.
    pub(crate) fn read(&self, path: &Path) -> Result<Dataset, gs_io::Error> {
        read_dataset(path, &self.settings())
    }

    /// Reads the data set that a scene is evaluated with, in the frame of the scene.
    pub(crate) fn read_for(&self, scene: &File3d, path: &Path) -> Result<Dataset, Failure> {
        Ok(read_dataset(path, &self.settings().with(|s| s.frame = Some(scene.trained_with.frame)))?)
    }

    /// The settings of the library.
    pub(crate) fn settings(&self) -> DatasetSettings {
        self.reading.settings().with(|s| {
            s.image_folder = self.images.clone();
            if let Some(holdout) = self.holdout {
                s.test_every = NonZeroU32::new(holdout);
                s.replace_split = true;
            }
            s.alpha = self.alpha;
        })
    }
}

/// The most pixels of an image's longer side, a number or none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct MaxSize(pub(crate) Option<NonZeroU32>);

impl Default for MaxSize {
    /// 1600 px, to which 3DGS scales wider images.
    fn default() -> Self {
        Self(NonZeroU32::new(1600))
    }
}

impl FromStr for MaxSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "none" => Ok(Self(None)),
            _ => {
                let pixels = text.parse().map_err(|_| "must be at least 1 px, such as 1600, or none".to_owned())?;
                Ok(Self(Some(pixels)))
            }
        }
    }
}

impl fmt::Display for MaxSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            None => f.write_str("none"),
            Some(pixels) => pixels.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_numbers_or_none() {
        let size = |pixels| Ok(MaxSize(NonZeroU32::new(pixels)));
        assert_eq!(("800".parse(), "none".parse()), (size(800), size(0)));
        for bad in ["", "0", "-1", "1600px", "1e3", "full"] {
            assert!(bad.parse::<MaxSize>().is_err(), "{bad}");
        }
    }

    #[test]
    fn defaults_need_no_flags() {
        let usual = ReadingArgs { max_size: MaxSize::default(), allow_outside: false };
        assert_eq!(usual.flags(), "");
        assert_eq!(
            ReadingArgs { max_size: MaxSize(None), allow_outside: true }.flags(),
            " --max-size none --allow-outside"
        );
        assert_eq!(ReadingArgs { max_size: MaxSize(NonZeroU32::new(64)), ..usual }.flags(), " --max-size 64");
    }
}
