//! `gs info`: the content of a scene, a checkpoint or a data set, or the GPUs of the machine.

mod adapters;
mod dataset;
mod measure;
mod scene;

use std::{collections::BTreeMap, fmt::Write, path::PathBuf};

use clap::Args;
use gs_core::counted;
use gs_io::{
    AnyScene, Values,
    dataset::{may_be_dataset, read_dataset},
    readable_in,
};
use gs_lab::report::significant;

use self::measure::Measure;
use crate::{failure::Failure, files, flags::dataset::DatasetArgs, terminal::output::printable};

/// The flags of `gs info`.
#[derive(Debug, Clone, Args)]
pub(crate) struct InfoArgs {
    /// A scene file, a checkpoint, the output folder of gs fit or gs train, or a data set of posed
    /// images
    #[arg(required_unless_present = "adapters")]
    file: Option<PathBuf>,
    /// List the GPUs and software drivers of this machine, and the choice of --backend auto
    #[arg(long, conflicts_with = "file")]
    adapters: bool,
    /// Measure in a 3D scene: the distance of two points X,Y,Z,X,Y,Z, or the area of a polygon
    /// polygon:X,Z,X,Z,X,Z as seen from above and the heights of the scene in it
    #[arg(long, value_name = "PLACES", allow_hyphen_values = true)]
    measure: Option<Measure>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    images: DatasetArgs,
}

/// Prints the content of a file, or lists the adapters.
pub(crate) fn run(args: &InfoArgs) -> Result<(), Failure> {
    // The command line has either the file or --adapters.
    let Some(file) = &args.file else {
        return adapters::run(args.json);
    };
    if may_be_dataset(file) {
        match read_dataset(file, &args.images.settings()) {
            Err(gs_io::Error::NotADataset { .. }) if readable_in(file).is_some() => {}
            dataset => return dataset::print(&dataset?, args.json),
        }
    }
    let read = files::scene::read(file, Values::Checked)?;
    match (&read.scene, &args.measure) {
        (AnyScene::ThreeD(file), Some(measure)) => measure.print(file, args.json),
        (AnyScene::TwoD(_), Some(_)) => {
            Err(Failure::usage("is a 2D scene, and --measure measures 3D scenes").at(file.display()))
        }
        (_, None) => scene::print(read, args.json),
    }
}

/// A line for each fact, and those of a checkpoint's metadata.
fn rows_text(rows: &[(&str, String)], metadata: &BTreeMap<String, String>) -> String {
    let lines: String = rows.iter().map(|(name, value)| format!("{name:<20}{}\n", printable(value))).collect();
    (lines + &metadata_text(metadata)).trim_end().to_owned()
}

/// A value of a parameter, to five significant digits.
fn number(value: f32) -> String {
    significant(value.into(), 5)
}

/// The metadata of a checkpoint, a line for each entry.
fn metadata_text(metadata: &BTreeMap<String, String>) -> String {
    let mut text = String::new();
    for (name, value) in metadata {
        let name = printable(name);
        if name == "metrics" {
            let _ = writeln!(text, "{name:<20}{}", counted(value.matches("[[row]]").count(), "row"));
            continue;
        }
        for (i, line) in value.lines().enumerate() {
            let _ = writeln!(text, "{:<20}{}", if i == 0 { name.as_ref() } else { "" }, printable(line));
        }
    }
    text
}
