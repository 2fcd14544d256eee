//! Rendering overlapped with the host's work on earlier views.

use core::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Mutex;

/// Waiting results per thread. With more than one, a producer that waits for capacity can finish a
/// result.
const WAITING_PER_THREAD: usize = 2;
/// Maximum number of waiting results, which bounds their memory.
const WAITING_MAX: usize = 16;

const HELD_SHORTLY: &str = "nothing panics while it holds the results";

/// Produces `count` items one after another, such as rendered views, while free threads of rayon's
/// current pool finish them: measure, pack or write them.
///
/// The results are in the order of the items. `progress` receives the number of finished items
/// after each produced item, and at the end.
///
/// # Errors
///
/// The first error of `produce`, which ends the work; else that of the first item that `finish`
/// failed on.
pub fn overlap<T: Send, R: Send, E: Send>(
    count: usize,
    mut progress: impl FnMut(usize) + Send,
    produce: impl FnMut(usize) -> Result<T, E> + Send,
    finish: impl Fn(usize, T) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let finished = Finished { results: Mutex::new(Vec::with_capacity(count)), waiting: AtomicUsize::new(0) };
    rayon::scope(|scope| -> Result<(), E> {
        let mut produce = produce;
        for index in 0..count {
            finished.wait_for_capacity();
            let item = produce(index)?;
            finished.waiting.fetch_add(1, Ordering::Relaxed);
            let (finished, finish) = (&finished, &finish);
            scope.spawn(move |_| finished.add(index, finish(index, item)));
            progress(finished.count());
            if finished.failed() {
                break;
            }
        }
        Ok::<(), E>(())
    })?;
    progress(finished.count());
    finished.in_order()
}

/// Results so far, and the number of unfinished items.
struct Finished<R, E> {
    results: Mutex<Vec<(usize, Result<R, E>)>>,
    waiting: AtomicUsize,
}

impl<R, E> Finished<R, E> {
    /// Finishes items while too many are waiting.
    fn wait_for_capacity(&self) {
        let capacity = (WAITING_PER_THREAD * rayon::current_num_threads()).min(WAITING_MAX);
        while self.waiting.load(Ordering::Relaxed) >= capacity {
            if rayon::yield_now() != Some(rayon::Yield::Executed) {
                std::thread::yield_now();
            }
        }
    }

    fn add(&self, index: usize, result: Result<R, E>) {
        self.results.lock().expect(HELD_SHORTLY).push((index, result));
        self.waiting.fetch_sub(1, Ordering::Relaxed);
    }

    fn count(&self) -> usize {
        self.results.lock().expect(HELD_SHORTLY).len()
    }

    fn failed(&self) -> bool {
        self.results.lock().expect(HELD_SHORTLY).iter().any(|(_, result)| result.is_err())
    }

    fn in_order(self) -> Result<Vec<R>, E> {
        let mut results = self.results.into_inner().expect(HELD_SHORTLY);
        results.sort_unstable_by_key(|(index, _)| *index);
        results.into_iter().map(|(_, result)| result).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn overlapped(count: usize, bad: Option<usize>) -> Result<Vec<usize>, String> {
        let mut made = 0..;
        let finish = |index: usize, item: usize| match Some(index) == bad {
            true => Err(format!("{index}")),
            false => Ok(index * item),
        };
        overlap(count, |_| {}, |index| Ok(index + made.next().expect("no end")), finish)
    }

    #[test]
    fn results_come_in_order_and_each_once() {
        for count in [0, 1, 5, 100] {
            let expected: Vec<usize> = (0..count).map(|k| 2 * k * k).collect();
            assert_eq!(overlapped(count, None).expect("nothing fails"), expected);
        }
    }

    #[test]
    fn a_failure_ends_the_work() {
        assert_eq!(overlapped(100, Some(7)).expect_err("one fails"), "7");
    }
}
