//! How long each phase of a run takes.

use std::{
    sync::{Mutex, MutexGuard, PoisonError},
    time::Instant,
};

use serde::{Serialize, Serializer, ser::SerializeMap as _};

/// The phases of a run, one after the other from the start of the program, or of the work on one of
/// several images.
#[derive(Debug)]
pub(crate) struct Phases {
    started: Instant,
    ended: Mutex<Vec<(&'static str, Instant)>>,
}

impl Phases {
    /// The first phase begins now.
    pub(crate) fn begin() -> Self {
        Self { started: Instant::now(), ended: Mutex::new(Vec::new()) }
    }

    /// When the first phase began.
    pub(crate) fn started(&self) -> Instant {
        self.started
    }

    /// Says that a phase ends now, and the next one begins.
    pub(crate) fn end(&self, name: &'static str) {
        self.ended().push((name, Instant::now()));
    }

    fn ended(&self) -> MutexGuard<'_, Vec<(&'static str, Instant)>> {
        self.ended.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The phases that have ended, with their seconds.
impl Serialize for Phases {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let ended = self.ended();
        let mut map = serializer.serialize_map(Some(ended.len()))?;
        let mut begun = self.started;
        for &(name, end) in ended.iter() {
            map.serialize_entry(name, &end.duration_since(begun).as_secs_f64())?;
            begun = end;
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use std::{thread::sleep, time::Duration};

    use super::*;

    #[test]
    fn phases_follow_each_other_and_leave_no_gap() {
        let phases = Phases::begin();
        sleep(Duration::from_millis(5));
        phases.end("first");
        phases.end("second");
        let seconds = serde_json::to_value(&phases).unwrap();
        let of = |name: &str| seconds[name].as_f64().unwrap();
        assert!(of("first") >= 0.005, "{seconds}");
        let whole = phases.ended().last().unwrap().1.duration_since(phases.started()).as_secs_f64();
        assert!((of("first") + of("second") - whole).abs() < 1e-9, "{seconds}");
    }
}
