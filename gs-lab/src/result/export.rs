//! The tables of a study as CSV files. Times are in files of their own, so that all other
//! files are the same byte for byte however a study was run: side by side, interrupted, or on more
//! threads.

use super::{
    claim::claims_csv,
    comparison::{Difference, Pair},
    contrast::Judged,
    factorial::{Effect, EffectOf},
    remark::ResultRemark,
    tables::{Results, RunQuality, Spread},
};
use crate::{
    error::Error,
    run::{CLAIMS, Finished, RunOutcome, StudyFolder, VIEWS},
    study::{Matching, Run},
};

/// Writes the tables: `runs.csv`, `quality.csv` and `differences.csv`. Tables that depend on measured time are
/// `times.csv` and `differences-at-time.csv`. A study of scenes also has `views.csv`, one with claims `claims.csv`,
/// one with factors `effects.csv` and `effects-at-time.csv`.
///
/// # Errors
/// [`Error::Io`].
pub(crate) fn write_tables(results: &Results<'_>, folder: &StudyFolder) -> Result<(), Error> {
    let Results { plan, .. } = results;
    let regular = [Matching::Count, Matching::Iterations];
    let output = folder.lock_results()?;
    output.write("runs.csv", runs_csv(results))?;
    if plan.study.is_of_scenes() {
        output.write(VIEWS, views_csv(results))?;
    }
    if !plan.study.factors.is_empty() {
        output.write("effects.csv", effects_csv(&results.effects(&regular)))?;
        output.write("effects-at-time.csv", effects_csv(&results.effects(&[Matching::Time])))?;
    }
    if !plan.study.claims.is_empty() {
        output.write(CLAIMS, claims_csv([(plan.study.name.as_str(), results.claims().as_slice())]))?;
    }
    output.write("quality.csv", quality_csv(&results.qualities()))?;
    output.write("differences.csv", differences_csv(&results.differences(&regular)))?;
    output.write("differences-at-time.csv", differences_csv(&results.differences(&[Matching::Time])))?;
    Ok(output.write("times.csv", times_csv(results))?)
}

fn runs_csv(results: &Results<'_>) -> String {
    let plan = results.plan;
    let target = if plan.study.is_of_scenes() { "data_set" } else { "image" };
    let header = format!(
        "row,arm,{target},budget,seed,address,status,gaussians,bytes,iterations,psnr,ssim,ms_ssim,l1,scene,error"
    );
    let lines = results.rows().map(|(run, record)| {
        let (status, end, error) = match record.map(|record| &record.outcome) {
            Some(RunOutcome::Finished(end)) => ("finished", Some(end), ""),
            Some(RunOutcome::Failed { error }) => ("failed", None, error.as_str()),
            None => ("missing", None, ""),
        };
        let cells = [
            run.row.to_string(),
            plan.arm(run).name.clone(),
            plan.target(run).name.clone(),
            run.budget.to_string(),
            run.seed.to_string(),
            run.address.clone(),
            status.to_owned(),
            whole(end.map(|end| end.gaussians)),
            whole(end.map(|end| end.bytes)),
            whole(end.map(|end| end.iterations)),
            number(end.map(|end| end.psnr), 6),
            number(end.map(|end| end.ssim), 8),
            number(end.and_then(|end| end.ms_ssim), 8),
            number(end.map(|end| end.l1), 8),
            end.map(|end| end.scene.clone()).unwrap_or_default(),
            error.to_owned(),
        ];
        csv_row(cells)
    });
    table(&header, lines)
}

fn views_csv(results: &Results<'_>) -> String {
    let ends = results.rows().filter_map(|(run, record)| Some((run, record?.outcome.finished()?)));
    let lines = ends.flat_map(|(run, end)| {
        end.views.iter().map(|view| {
            let cells = [
                run.row.to_string(),
                view.name.clone(),
                number(Some(view.psnr), 6),
                number(Some(view.ssim), 8),
                number(view.ms_ssim, 8),
                number(Some(view.l1), 8),
            ];
            csv_row(cells)
        })
    });
    table("row,view,psnr,ssim,ms_ssim,l1", lines)
}

fn quality_csv(rows: &[RunQuality]) -> String {
    let header = "arm,budget,finished,failed,missing,images,gaussians,gaussians_sd,bytes,psnr,psnr_sd,ssim,ssim_sd,ms_ssim,ms_ssim_sd";
    let lines = rows.iter().map(|q| {
        let spread = |spread: Option<Spread>, digits: usize| {
            let over_seeds = spread.and_then(|spread| spread.over_seeds);
            [number(spread.map(|spread| spread.mean), digits), number(over_seeds, digits)]
        };
        let counts = [q.finished, q.failed, q.missing, q.images].map(|count| count.to_string());
        let cells = [q.arm.clone(), q.budget.to_string()].into_iter().chain(counts).chain(spread(q.gaussians, 1));
        let cells = cells.chain([number(q.bytes.map(|bytes| bytes.mean), 0)]).chain(spread(q.psnr, 4));
        csv_row(cells.chain(spread(q.ssim, 6)).chain(spread(q.ms_ssim, 6)))
    });
    table(header, lines)
}

fn differences_csv(rows: &[Difference]) -> String {
    let header = "match,metric,budget,arm,against,paired,pairs,mean,low,high,verdict,remarks";
    let lines = rows.iter().map(|d| {
        let Pair { budget, arm, against } = &d.of;
        let head = [d.matching.name(), d.metric.name(), &budget.to_string(), arm, against].map(str::to_owned);
        csv_row(head.into_iter().chain(judged_cells(d)))
    });
    table(header, lines)
}

fn effects_csv(rows: &[Effect]) -> String {
    let header =
        "match,metric,effect,factor,level,against,factor2,level2,against2,paired,pairs,mean,low,high,verdict,remarks";
    let lines = rows.iter().map(|e| {
        let (kind, factors) = match &e.of {
            EffectOf::Main { factor, level, against } => {
                ("main", [[factor, level, against], [const { &String::new() }; 3]])
            }
            EffectOf::Interaction { factors, levels, against } => {
                ("interaction", [0, 1].map(|i| [&factors[i], &levels[i], &against[i]]))
            }
        };
        let head = [e.matching.name(), e.metric.name(), kind].map(str::to_owned);
        csv_row(head.into_iter().chain(factors.into_iter().flatten().cloned()).chain(judged_cells(e)))
    });
    table(header, lines)
}

/// The cells of a contrast after those that say what it is of.
fn judged_cells<Of>(judged: &Judged<Of>) -> [String; 7] {
    let Judged { pairing, pairs, mean, interval, verdict, remarks, .. } = judged;
    [
        pairing.words().to_owned(),
        pairs.to_string(),
        number(*mean, 6),
        number(interval.map(|interval| interval.low), 6),
        number(interval.map(|interval| interval.high), 6),
        verdict.words().to_owned(),
        remarks.iter().map(ResultRemark::to_string).collect::<Vec<_>>().join("; "),
    ]
}

fn times_csv(results: &Results<'_>) -> String {
    let ends = results.rows().filter_map(|(run, record)| Some((run, record?.outcome.finished()?)));
    let line = |(run, end): (&Run, &Finished)| {
        let seconds = number(Some(end.seconds), 6);
        csv_row([run.row.to_string(), seconds, end.backend.clone(), end.side_by_side.to_string()])
    };
    table("row,seconds,backend,side_by_side", ends.map(line))
}

fn table(header: &str, lines: impl Iterator<Item = String>) -> String {
    std::iter::once(format!("{header}\n")).chain(lines).collect()
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(String::new, |value| format!("{value:.digits$}"))
}

fn whole(value: Option<impl ToString>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

/// A line of CSV, with cells quoted where necessary (RFC 4180).
pub(crate) fn csv_row<T: AsRef<str>>(cells: impl IntoIterator<Item = T>) -> String {
    cells.into_iter().map(|cell| quoted(cell.as_ref())).collect::<Vec<_>>().join(",") + "\n"
}

fn quoted(cell: &str) -> String {
    match cell.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", cell.replace('"', "\"\"")),
        false => cell.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_hold_anything() {
        assert_eq!(quoted("a b"), "a b");
        assert_eq!(quoted("a, \"b\""), "\"a, \"\"b\"\"\"");
        assert_eq!((number(None, 2), number(Some(1.0 / 3.0), 2)), (String::new(), "0.33".to_owned()));
    }
}
