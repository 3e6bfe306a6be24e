//! How commands read data sets: the flags that all of them have.

use std::{fmt, num::NonZeroU32, path::Path, str::FromStr};

use clap::Args;
use gs_io::dataset::{Dataset, DatasetSettings, Remark, read_dataset};

use crate::{failure::Failure, output::printable};

/// How the images of a data set are read, whatever for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Args)]
#[command(next_help_heading = "Images of data sets")]
pub(crate) struct ReadingArgs {
    /// Scale images down whose longer side has more pixels; none leaves them as they are
    #[arg(long, value_name = "PX", default_value_t)]
    pub(crate) max_size: MaxSize,
    /// Read files outside the data set's folder, too, where it names them; links inside it are always followed
    #[arg(long)]
    pub(crate) allow_outside: bool,
}

impl ReadingArgs {
    /// As the library has it.
    pub(crate) fn settings(&self) -> DatasetSettings {
        DatasetSettings { max_side: self.max_size.0, allow_outside: self.allow_outside, ..DatasetSettings::default() }
    }

    /// Reads a data set of which only cameras and points are of interest.
    ///
    /// # Errors
    /// Where it is none, or a broken one.
    pub(crate) fn read(&self, path: &Path) -> Result<Dataset, Failure> {
        Ok(read_dataset(path, &self.settings())?)
    }

    /// The flags that say the same, where they are not the default; each after a blank.
    pub(crate) fn flags(&self) -> String {
        let Self { max_size, allow_outside } = self;
        let size = if *max_size == MaxSize::default() { String::new() } else { format!(" --max-size {max_size}") };
        size + if *allow_outside { " --allow-outside" } else { "" }
    }
}

/// What is to be said of a data set, with the flag that changes it; one line, whatever the data set's names are.
pub(crate) fn remark_text(remark: &Remark) -> String {
    let flag = if matches!(remark, Remark::Reduced { .. }) { "; --max-size none reads all pixels" } else { "" };
    printable(&remark.to_string()).into_owned() + flag
}

/// The most pixels of an image's longer side, a number or none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
                let pixels = text.parse().map_err(|_| "write a number of pixels such as 1600, or none".to_owned())?;
                Ok(Self(NonZeroU32::new(pixels)))
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
        assert_eq!(("800".parse(), "none".parse(), "0".parse()), (size(800), size(0), size(0)));
        for bad in ["", "-1", "1600px", "1e3", "full"] {
            assert!(bad.parse::<MaxSize>().is_err(), "{bad}");
        }
    }

    #[test]
    fn only_what_is_not_the_default_is_told() {
        let usual = ReadingArgs { max_size: MaxSize::default(), allow_outside: false };
        assert_eq!(usual.flags(), "");
        assert_eq!(
            ReadingArgs { max_size: MaxSize(None), allow_outside: true }.flags(),
            " --max-size none --allow-outside"
        );
        assert_eq!(ReadingArgs { max_size: MaxSize(NonZeroU32::new(64)), ..usual }.flags(), " --max-size 64");
    }
}
