//! Work in two stages: while some views are rendered, those before them are measured, packed and written.

use crate::{failure::Failure, progress::Work};
use core::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Mutex;

/// So many views may wait for each thread. More than one, so that whoever waits for room finds a view to finish.
const VIEWS_PER_THREAD: usize = 2;
/// At most so many views wait, so that memory stays bounded.
const VIEWS_MAX: usize = 16;

const HELD_SHORTLY: &str = "nothing panics while it holds the results";

/// Makes one thing after the other, and finishes those that are made on whatever threads are free meanwhile. The
/// results are in the order of the things; a failure ends the work.
pub(crate) fn relay<T: Send, R: Send>(
    count: usize,
    work: &Work,
    make: impl FnMut(usize) -> Result<T, Failure> + Send,
    finish: impl Fn(usize, T) -> Result<R, Failure> + Sync,
) -> Result<Vec<R>, Failure> {
    let finished = Finished { results: Mutex::new(Vec::with_capacity(count)), waiting: AtomicUsize::new(0) };
    rayon::scope(|scope| -> Result<(), Failure> {
        let mut make = make;
        for index in 0..count {
            finished.wait_for_room();
            let made = make(index)?;
            finished.waiting.fetch_add(1, Ordering::Relaxed);
            let (finished, finish) = (&finished, &finish);
            scope.spawn(move |_| finished.add(index, finish(index, made)));
            finished.tell(work);
            if finished.failed() {
                break;
            }
        }
        Ok::<(), Failure>(())
    })?;
    finished.tell(work);
    finished.in_order()
}

/// What came of the views so far, and how many wait for it.
struct Finished<R> {
    results: Mutex<Vec<(usize, Result<R, Failure>)>>,
    waiting: AtomicUsize,
}

impl<R> Finished<R> {
    /// Finishes views while too many wait.
    fn wait_for_room(&self) {
        let room = (VIEWS_PER_THREAD * rayon::current_num_threads()).min(VIEWS_MAX);
        while self.waiting.load(Ordering::Relaxed) >= room {
            if rayon::yield_now() != Some(rayon::Yield::Executed) {
                std::thread::yield_now();
            }
        }
    }

    fn add(&self, index: usize, result: Result<R, Failure>) {
        self.results.lock().expect(HELD_SHORTLY).push((index, result));
        self.waiting.fetch_sub(1, Ordering::Relaxed);
    }

    fn tell(&self, work: &Work) {
        work.done(self.results.lock().expect(HELD_SHORTLY).len() as u64, String::new);
    }

    fn failed(&self) -> bool {
        self.results.lock().expect(HELD_SHORTLY).iter().any(|(_, result)| result.is_err())
    }

    fn in_order(self) -> Result<Vec<R>, Failure> {
        let mut results = self.results.into_inner().expect(HELD_SHORTLY);
        results.sort_unstable_by_key(|(index, _)| *index);
        results.into_iter().map(|(_, result)| result).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress;

    fn relayed(count: usize, bad: Option<usize>) -> Result<Vec<usize>, Failure> {
        let mut made = 0..;
        let finish = |index: usize, thing: usize| match Some(index) == bad {
            true => Err(Failure::Input(format!("{index}"))),
            false => Ok(index * thing),
        };
        relay(count, &progress::work("", 0), |index| Ok(index + made.next().expect("no end")), finish)
    }

    #[test]
    fn results_come_in_order_and_each_once() {
        for count in [0, 1, 5, 100] {
            let expected: Vec<usize> = (0..count).map(|k| 2 * k * k).collect();
            assert_eq!(relayed(count, None).expect("nothing fails"), expected);
        }
    }

    #[test]
    fn a_failure_ends_the_work() {
        assert_eq!(relayed(100, Some(7)).expect_err("one fails").to_string(), Failure::Input("7".into()).to_string());
    }
}
