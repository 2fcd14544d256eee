//! Threads that calls compute on, without the interpreter's lock.

use crate::errors::{Failure, Result};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::{
    process,
    sync::{Arc, Mutex, PoisonError},
};

/// Threads of this process, and its number: a process that was forked has none of its parent's
/// threads and needs its own.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Threads of this process: one for each core, or `RAYON_NUM_THREADS`. Called with the interpreter
/// attached, so that no other thread forks meanwhile.
pub(crate) fn pool(_: Python<'_>) -> Result<Arc<ThreadPool>> {
    let mut known = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    match &*known {
        Some((owner, pool)) if *owner == process::id() => Ok(pool.clone()),
        _ => {
            let built = ThreadPoolBuilder::new().thread_name(|number| format!("specula-{number}")).build();
            let pool = built.map_err(|error| Failure::Named("DeviceError", format!("no thread can start: {error}")))?;
            let pool = Arc::new(pool);
            // Dropping the parent's pool would wait for threads that do not exist here.
            core::mem::forget(known.replace((process::id(), pool.clone())));
            Ok(pool)
        }
    }
}

/// Computes on all threads while other threads of Python run.
pub(crate) fn compute<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> Result<T> {
    let pool = pool(py)?;
    Ok(py.detach(|| pool.install(work)))
}

/// Computes on all threads; both kinds of failure are one.
pub(crate) fn try_compute<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    compute(py, work)?
}

/// Computes with a state that other calls share. Its lock is taken before the threads begin, since
/// a thread that waits inside one call may compute for another meanwhile.
pub(crate) fn try_compute_with<S: Send, T: Send>(
    py: Python<'_>,
    state: &Mutex<S>,
    work: impl FnOnce(&mut S) -> Result<T> + Send,
) -> Result<T> {
    let pool = pool(py)?;
    py.detach(|| {
        let mut guard = state.lock().unwrap_or_else(PoisonError::into_inner);
        let state = &mut *guard;
        pool.install(move || work(state))
    })
}

/// Number of threads that calls compute on.
#[pyfunction]
pub(crate) fn thread_count(py: Python<'_>) -> PyResult<usize> {
    Ok(pool(py)?.current_num_threads())
}
