//! How many threads work on the host, and why so many.

use std::{env, num::NonZero, thread::available_parallelism};

use crate::{failure::Failure, values::whole};

/// The variable by which programs that use rayon are told how many threads to start; 0 leaves it to them.
const VARIABLE: &str = "RAYON_NUM_THREADS";

/// Threads on the host.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Threads {
    pub(super) count: usize,
    pub(super) why: &'static str,
}

impl Threads {
    /// As many as the flag says, or else the environment; one a core where neither does.
    ///
    /// # Errors
    /// Bad usage where the environment says what cannot be.
    pub(super) fn of(flag: Option<u16>) -> Result<Self, Failure> {
        Self::chosen(flag, env::var(VARIABLE).ok().as_deref())
    }

    fn chosen(flag: Option<u16>, variable: Option<&str>) -> Result<Self, Failure> {
        if let Some(count) = flag {
            return Ok(Self { count: count.into(), why: "threads as asked" });
        }
        let text = variable.unwrap_or_default();
        match if text.is_empty() { Ok(0) } else { whole::<u16>(0..=1024)(text) } {
            Ok(0) => Ok(Self { count: available_parallelism().map_or(1, NonZero::get), why: "one thread a core" }),
            Ok(count) => Ok(Self { count: count.into(), why: "threads as RAYON_NUM_THREADS says" }),
            Err(why) => {
                Err(Failure::usage(format_args!("{VARIABLE} is `{text}`, but {why}"))
                    .mend("unset it, or give --threads"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_flag_counts_before_the_environment_and_that_before_the_cores() {
        let count = |flag, variable| Threads::chosen(flag, variable).map(|threads| threads.count);
        let cores = available_parallelism().map_or(1, NonZero::get);
        assert_eq!(count(Some(3), Some("5")), Ok(3));
        assert_eq!(count(None, Some("5")), Ok(5));
        for open in [None, Some(""), Some("0")] {
            assert_eq!(count(None, open), Ok(cores), "{open:?}");
        }
        for wrong in ["-1", "many", "100000"] {
            let line = count(None, Some(wrong)).unwrap_err().line().unwrap();
            assert!(line.starts_with(&format!("error: RAYON_NUM_THREADS is `{wrong}`, but must be ")), "{line}");
        }
    }
}
