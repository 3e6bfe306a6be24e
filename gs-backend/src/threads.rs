//! How many threads compute on the host, and why so many.

use std::{env, num::NonZero, thread::available_parallelism};

use gs_core::Error;

/// The environment variable from which programs that use rayon read their number of threads. 0
/// means one per core.
const VARIABLE: &str = "RAYON_NUM_THREADS";

/// The most threads that a program may have.
const MOST: usize = 1024;

/// Returns the number of host threads of a backend for which `asked` threads were requested, or no
/// number in particular.
///
/// # Errors
/// [`Error::Setting`] for less than 1 or more than 1024 threads, and where the environment variable is
/// not a possible number.
pub fn host_threads(asked: Option<usize>) -> Result<usize, Error> {
    Threads::choose(asked).map(|threads| threads.count)
}

/// Threads on the host.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Threads {
    pub(crate) count: usize,
    pub(crate) why: &'static str,
}

impl Threads {
    /// Chooses the number of threads: the requested one, otherwise that of the environment
    /// variable, otherwise one per core.
    ///
    /// # Errors
    /// [`Error::Setting`] where the request or the environment variable is not a possible number.
    pub(crate) fn choose(asked: Option<usize>) -> Result<Self, Error> {
        Self::from_variable(asked, env::var(VARIABLE).ok().as_deref())
    }

    fn from_variable(asked: Option<usize>, variable: Option<&str>) -> Result<Self, Error> {
        if let Some(count) = asked {
            Error::within("threads", count, 1..=MOST, "1 to 1024")?;
            return Ok(Self { count, why: "threads as requested" });
        }
        let text = variable.unwrap_or_default();
        match if text.is_empty() { Ok(0) } else { text.trim().parse() } {
            Ok(0) => Ok(Self { count: available_parallelism().map_or(1, NonZero::get), why: "one thread a core" }),
            Ok(count) if count <= MOST => Ok(Self { count, why: "threads as RAYON_NUM_THREADS says" }),
            _ => Err(Error::setting(VARIABLE, format_args!("`{text}`"), "a whole number from 0 to 1024")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_overrides_the_environment_and_that_the_cores() {
        let count = |asked, variable| Threads::from_variable(asked, variable).map(|threads| threads.count);
        let cores = available_parallelism().map_or(1, NonZero::get);
        assert_eq!(count(Some(3), Some("5")), Ok(3));
        assert_eq!(count(None, Some("5")), Ok(5));
        for open in [None, Some(""), Some("0")] {
            assert_eq!(count(None, open), Ok(cores), "{open:?}");
        }
        for wrong in [0, 1025, usize::MAX] {
            let message = count(Some(wrong), None).unwrap_err().to_string();
            assert_eq!(message, format!("threads is {wrong}, but must be 1 to 1024"));
        }
        for wrong in ["-1", "many", "100000"] {
            let message = count(None, Some(wrong)).unwrap_err().to_string();
            assert!(message.starts_with(&format!("RAYON_NUM_THREADS is `{wrong}`, but must be ")), "{message}");
        }
    }
}
