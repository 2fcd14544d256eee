//! Work in two stages: while some views are rendered, those before them are measured, packed and written.

use crate::{failure::Failure, progress::Work};
use rayon::prelude::*;

/// Views that are handed over at once for each thread: rendering one keeps all threads busy but for its short serial
/// ends, finishing one keeps one thread busy.
const VIEWS_PER_THREAD: usize = 2;
/// At most so many views are handed over at once, so that memory stays bounded.
const VIEWS_MAX: usize = 16;

/// Makes one thing after the other, and finishes those that are made on whatever threads are free meanwhile. The
/// results are in the order of the things; the first failure ends the work.
pub(crate) fn relay<T: Send, R: Send>(
    count: usize,
    work: &Work,
    mut make: impl FnMut(usize) -> Result<T, Failure> + Send,
    finish: impl Fn(usize, T) -> Result<R, Failure> + Sync,
) -> Result<Vec<R>, Failure> {
    let at_once = (VIEWS_PER_THREAD * rayon::current_num_threads()).min(VIEWS_MAX);
    let mut results = Vec::with_capacity(count);
    let mut made: Vec<T> = Vec::new();
    while results.len() < count {
        let first = results.len();
        let next = first + made.len()..count.min(first + made.len() + at_once);
        let (finished, made_next) = rayon::join(
            || {
                made.into_par_iter()
                    .enumerate()
                    .map(|(k, thing)| finish(first + k, thing))
                    .collect::<Result<Vec<_>, _>>()
            },
            || next.map(&mut make).collect::<Result<Vec<T>, Failure>>(),
        );
        results.extend(finished?);
        made = made_next?;
        work.done(results.len() as u64, String::new);
    }
    Ok(results)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Talk;

    fn relayed(count: usize, bad: Option<usize>) -> Result<Vec<usize>, Failure> {
        let mut made = 0..;
        let finish = |index: usize, thing: usize| match Some(index) == bad {
            true => Err(Failure::Input(format!("{index}"))),
            false => Ok(index * thing),
        };
        relay(count, &Talk { quiet: true }.work("", 0), |index| Ok(index + made.next().expect("no end")), finish)
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
