//! Threads of the engine: workers of the page that have its module and its memory.
//!
//! They are rayon's global pool. The worker that holds the engine is one of them, since rayon starts
//! no threads in a browser itself. Each other worker calls [`run_thread`], and the engine's then
//! [`start_threads`]. A module that is built without atomics has one thread.

use std::sync::{Condvar, Mutex, PoisonError};

use rayon::{ThreadBuilder, ThreadPoolBuilder};
use wasm_bindgen::prelude::*;

use crate::failure;

/// Threads of the pool that no worker runs yet.
static WAITING: Mutex<Vec<ThreadBuilder>> = Mutex::new(Vec::new());

/// A thread has been added to [`WAITING`].
static ADDED: Condvar = Condvar::new();

/// Makes the pool of `count` threads: this one, and those of `count - 1` other workers. Returns once
/// each of them runs its thread.
#[wasm_bindgen(js_name = startThreads)]
pub fn start_threads(count: usize) -> Result<(), JsError> {
    let pool = ThreadPoolBuilder::new().num_threads(count).use_current_thread().spawn_handler(|thread| {
        WAITING.lock().unwrap_or_else(PoisonError::into_inner).push(thread);
        ADDED.notify_one();
        Ok(())
    });
    pool.build_global().map_err(failure)
}

/// Runs one of the pool's threads in this worker, for as long as that lives.
#[wasm_bindgen(js_name = runThread)]
pub fn run_thread() {
    let waiting = WAITING.lock().unwrap_or_else(PoisonError::into_inner);
    let mut waiting = ADDED.wait_while(waiting, |waiting| waiting.is_empty()).unwrap_or_else(PoisonError::into_inner);
    let thread = waiting.pop();
    drop(waiting);
    if let Some(thread) = thread {
        thread.run();
    }
}
