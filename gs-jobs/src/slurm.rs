//! What the variables of Slurm say about the task that this process is.

use super::work::Shard;

/// The part of jobs for this task of an array; `None` outside of arrays.
pub fn shard() -> Option<Shard> {
    shard_of(variable)
}

/// The job and the task, as squeue shows them; `None` outside of Slurm.
pub fn task() -> Option<String> {
    task_of(variable)
}

/// A variable of the environment.
fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok()
}

fn shard_of(variable: impl Fn(&str) -> Option<String>) -> Option<Shard> {
    let number = |name: &str| variable(name)?.parse::<u32>().ok();
    let (task, count) = (number("SLURM_ARRAY_TASK_ID")?, number("SLURM_ARRAY_TASK_COUNT")?);
    let first = number("SLURM_ARRAY_TASK_MIN").unwrap_or(0);
    let step = number("SLURM_ARRAY_TASK_STEP").unwrap_or(1).max(1);
    // Tasks with irregular numbers may share a part: what no task begins with is done last.
    let index = (task.checked_sub(first)? / step).checked_rem(count)?;
    Some(Shard { index, count })
}

fn task_of(variable: impl Fn(&str) -> Option<String>) -> Option<String> {
    match (variable("SLURM_ARRAY_JOB_ID"), variable("SLURM_ARRAY_TASK_ID")) {
        (Some(job), Some(task)) => Some(format!("{job}_{task}")),
        _ => variable("SLURM_JOB_ID"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn environment<'a>(variables: &'a [(&str, &str)]) -> impl Fn(&str) -> Option<String> + 'a {
        |name| Some(variables.iter().find(|(known, _)| *known == name)?.1.to_owned())
    }

    #[test]
    fn tasks_of_an_array_begin_with_different_parts() {
        let part =
            |variables: &[(&str, &str)]| shard_of(environment(variables)).map(|Shard { index, count }| (index, count));
        let task = |id, count, first, step| {
            part(&[
                ("SLURM_ARRAY_TASK_ID", id),
                ("SLURM_ARRAY_TASK_COUNT", count),
                ("SLURM_ARRAY_TASK_MIN", first),
                ("SLURM_ARRAY_TASK_STEP", step),
            ])
        };
        assert_eq!(["0", "3"].map(|id| task(id, "4", "0", "1")), [Some((0, 4)), Some((3, 4))]);
        assert_eq!(["11", "14"].map(|id| task(id, "4", "11", "1")), [Some((0, 4)), Some((3, 4))]);
        assert_eq!(["1", "5", "9"].map(|id| task(id, "3", "1", "4")), [Some((0, 3)), Some((1, 3)), Some((2, 3))]);
        assert_eq!(task("40", "3", "1", "1"), Some((0, 3)), "one of 1,7,40");
        assert_eq!(part(&[("SLURM_JOB_ID", "7")]), None);
        assert_eq!(task("0", "0", "0", "1"), None);
    }

    #[test]
    fn a_task_is_named_as_squeue_names_it() {
        let array = [("SLURM_JOB_ID", "9"), ("SLURM_ARRAY_JOB_ID", "7"), ("SLURM_ARRAY_TASK_ID", "2")];
        assert_eq!(task_of(environment(&array)).as_deref(), Some("7_2"));
        assert_eq!(task_of(environment(&array[..1])).as_deref(), Some("9"));
        assert_eq!(task_of(environment(&[])), None);
    }
}
