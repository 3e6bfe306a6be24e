//! `gs study report`: tables and report of the runs that have ended so far.

use gs_core::counted;
use gs_lab::{Results, StudyFolder, report::write};

use super::{arguments::ReportArgs, conclude, prepare::held};
use crate::{
    failure::Failure,
    terminal::output::{self, quoted},
};

/// Writes tables and report.
pub(super) fn run(args: &ReportArgs) -> Result<(), Failure> {
    let held = held(&args.study, args.overwrite.overwrite)?;
    let (folder, plan) = (&held.folder, held.plan_as_prepared()?);
    let results = Results::read(&plan, folder)?;
    remove_damaged(&results, folder)?;
    let missing = results.missing().count();
    if missing == plan.runs.len() {
        let hint = format_args!("do runs with gs study work {}", quoted(folder.path()));
        return Err(Failure::failed("no run has ended yet").at(folder.path().display()).hint(hint));
    }
    if missing > 0 {
        let all = counted(plan.runs.len(), "run");
        output::note(format_args!("{missing} of {all} are missing; tables and report are of the others"));
    }
    let command = format!("gs study work {}", quoted(folder.path()));
    write(&results, folder, &command)?;
    conclude(&results, folder)
}

/// Removes damaged records, so that their runs are done again, and returns their number.
pub(super) fn remove_damaged(results: &Results<'_>, folder: &StudyFolder) -> Result<usize, Failure> {
    let rows = folder.remove_damaged(results.missing())?;
    for row in &rows {
        output::note(format_args!(
            "row {row}: its record was damaged (cut short?) and is removed: the run counts as missing"
        ));
    }
    Ok(rows.len())
}
