//! Fair queue: clients take turns, for any number of requests of each.

use std::sync::{Condvar, Mutex, MutexGuard};

/// Largest number of waiting jobs.
const WAITING_MAX: usize = 64;
/// Largest number of clients whose last turns are recorded.
const CLIENTS_MAX: usize = 64;

const NO_POISON: &str = "nothing panics under the lock of the queue";

/// Reason why a job is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum QueueError {
    /// Too many jobs are waiting.
    Full,
    /// The queue was closed.
    Closed,
}

/// Waiting jobs by client.
#[derive(Debug)]
pub(crate) struct Queue<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct State<T> {
    /// In order of arrival.
    waiting: Vec<(u64, T)>,
    /// Clients in the order of their last turns.
    served: Vec<u64>,
    is_closed: bool,
}

impl<T> Queue<T> {
    pub(crate) fn new() -> Self {
        let state = State { waiting: Vec::new(), served: Vec::new(), is_closed: false };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Appends a job of a client and drops its outdated waiting job. Client 0 is anonymous and may
    /// have several waiting jobs.
    pub(crate) fn push(&self, client: u64, job: T) -> Result<(), QueueError> {
        let mut state = self.lock();
        if state.is_closed {
            return Err(QueueError::Closed);
        }
        if client != 0 {
            state.waiting.retain(|(other, _)| *other != client);
        }
        if state.waiting.len() >= WAITING_MAX {
            return Err(QueueError::Full);
        }
        state.waiting.push((client, job));
        self.changed.notify_one();
        Ok(())
    }

    /// Waits for a job; `None` after the queue is closed.
    pub(crate) fn next(&self) -> Option<T> {
        let mut state = self.lock();
        loop {
            if state.is_closed {
                return None;
            }
            if let Some(job) = state.take() {
                return Some(job);
            }
            state = self.changed.wait(state).expect(NO_POISON);
        }
    }

    /// Drops all waiting jobs and accepts no more.
    pub(crate) fn close(&self) {
        let mut state = self.lock();
        state.is_closed = true;
        state.waiting.clear();
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().expect(NO_POISON)
    }
}

impl<T> State<T> {
    /// Removes the job of the client whose last turn was longest ago; the first of several.
    fn take(&mut self) -> Option<T> {
        let turn_of = |client: u64| self.served.iter().position(|served| *served == client).map_or(0, |turn| turn + 1);
        let next = (0..self.waiting.len()).min_by_key(|index| turn_of(self.waiting[*index].0))?;
        let (client, job) = self.waiting.remove(next);
        self.served.retain(|served| *served != client);
        self.served.push(client);
        if self.served.len() > CLIENTS_MAX {
            self.served.remove(0);
        }
        Some(job)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_take_turns() {
        let queue = Queue::new();
        for (client, job) in [(1, "a"), (2, "b")] {
            queue.push(client, job).unwrap();
        }
        assert_eq!(queue.next(), Some("a"));
        // The first client returns before the second had its turn.
        queue.push(1, "c").unwrap();
        assert_eq!([queue.next(), queue.next()], [Some("b"), Some("c")]);
    }

    #[test]
    fn outdated_jobs_of_a_client_are_dropped() {
        let queue = Queue::new();
        for job in ["old", "new"] {
            queue.push(7, job).unwrap();
        }
        queue.push(0, "of nobody").unwrap();
        queue.push(0, "of nobody else").unwrap();
        assert_eq!(
            [queue.next(), queue.next(), queue.next()],
            [Some("new"), Some("of nobody"), Some("of nobody else")]
        );
    }

    #[test]
    fn waiting_jobs_are_bounded_and_a_closed_queue_rejects_jobs() {
        let queue = Queue::new();
        for job in 0..WAITING_MAX {
            queue.push(0, job).unwrap();
        }
        assert_eq!(queue.push(0, 0), Err(QueueError::Full));
        queue.close();
        assert_eq!((queue.next(), queue.push(0, 0)), (None, Err(QueueError::Closed)));
    }
}
