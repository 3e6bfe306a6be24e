//! Buffers for each thread, so that warm passes allocate nothing.

use std::sync::{Mutex, PoisonError};

/// A `T` for every thread.
#[derive(Debug, Default)]
pub(crate) struct Scratches<T>(Vec<Mutex<T>>);

impl<T: Default> Scratches<T> {
    /// Makes one for each thread of the current pool.
    pub(crate) fn fit(&mut self) {
        self.0.resize_with(rayon::current_num_threads(), Mutex::default);
    }

    /// Runs `work` with this thread's `T`.
    pub(crate) fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        let buffers = rayon::current_thread_index().and_then(|thread| self.0.get(thread));
        match buffers {
            Some(scratch) => work(&mut scratch.lock().unwrap_or_else(PoisonError::into_inner)),
            None => work(&mut T::default()),
        }
    }
}
