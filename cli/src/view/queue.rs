//! Who is served next: clients take turns, however many pictures each of them asks for.

use std::sync::{Condvar, Mutex, MutexGuard};

/// Pictures that may wait.
const WAITING_MAX: usize = 64;
/// Clients whose turns are remembered.
const CLIENTS_MAX: usize = 64;

const HELD_SHORTLY: &str = "nothing panics while it holds the queue";

/// Why work is not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refused {
    /// Too much is waiting.
    Full,
    /// Nobody takes it any more.
    Closed,
}

/// Work that waits.
#[derive(Debug)]
pub(super) struct Queue<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct State<T> {
    /// In order of arrival.
    waiting: Vec<(u64, T)>,
    /// Clients that had their turn, the latest last.
    served: Vec<u64>,
    is_closed: bool,
}

impl<T> Queue<T> {
    pub(super) fn new() -> Self {
        let state = State { waiting: Vec::new(), served: Vec::new(), is_closed: false };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Puts work of a client at the end. What the same client still waits for is dropped: it has moved on since. Clients
    /// without a number (0) may wait for several things.
    pub(super) fn push(&self, client: u64, work: T) -> Result<(), Refused> {
        let mut state = self.lock();
        if state.is_closed {
            return Err(Refused::Closed);
        }
        if client != 0 {
            state.waiting.retain(|(other, _)| *other != client);
        }
        if state.waiting.len() >= WAITING_MAX {
            return Err(Refused::Full);
        }
        state.waiting.push((client, work));
        self.changed.notify_one();
        Ok(())
    }

    /// Waits for work; none when the queue is closed.
    pub(super) fn next(&self) -> Option<T> {
        let mut state = self.lock();
        loop {
            if state.is_closed {
                return None;
            }
            if let Some(work) = state.take() {
                return Some(work);
            }
            state = self.changed.wait(state).expect(HELD_SHORTLY);
        }
    }

    /// Drops what waits, and takes no more.
    pub(super) fn close(&self) {
        let mut state = self.lock();
        state.is_closed = true;
        state.waiting.clear();
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().expect(HELD_SHORTLY)
    }
}

impl<T> State<T> {
    /// Work of the client whose last turn was longest ago; of several, that which came first.
    fn take(&mut self) -> Option<T> {
        let turn_of = |client: u64| self.served.iter().position(|served| *served == client).map_or(0, |turn| turn + 1);
        let next = (0..self.waiting.len()).min_by_key(|index| turn_of(self.waiting[*index].0))?;
        let (client, work) = self.waiting.remove(next);
        self.served.retain(|served| *served != client);
        self.served.push(client);
        if self.served.len() > CLIENTS_MAX {
            self.served.remove(0);
        }
        Some(work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_take_turns() {
        let queue = Queue::new();
        for (client, work) in [(1, "a"), (2, "b")] {
            queue.push(client, work).unwrap();
        }
        assert_eq!(queue.next(), Some("a"));
        // The first is back before the second had its turn.
        queue.push(1, "c").unwrap();
        assert_eq!([queue.next(), queue.next()], [Some("b"), Some("c")]);
    }

    #[test]
    fn what_a_client_asked_for_before_is_dropped() {
        let queue = Queue::new();
        for work in ["old", "new"] {
            queue.push(7, work).unwrap();
        }
        queue.push(0, "of nobody").unwrap();
        queue.push(0, "of nobody else").unwrap();
        assert_eq!(
            [queue.next(), queue.next(), queue.next()],
            [Some("new"), Some("of nobody"), Some("of nobody else")]
        );
    }

    #[test]
    fn what_waits_is_bounded_and_a_closed_queue_takes_nothing() {
        let queue = Queue::new();
        for work in 0..WAITING_MAX {
            queue.push(0, work).unwrap();
        }
        assert_eq!(queue.push(0, 0), Err(Refused::Full));
        queue.close();
        assert_eq!((queue.next(), queue.push(0, 0)), (None, Err(Refused::Closed)));
    }
}
