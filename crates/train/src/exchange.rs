//! Messages between the ranks of a training: processes or threads that share its work.
//!
//! An [`Exchange`] moves bytes and computes nothing. In particular it offers no sums, because a
//! library would choose their order: a rank uses the received numbers in the order of the views
//! ([`crate::ranks`]). [`threads`] connects threads of one process and is the reference for all
//! other exchanges.

use core::{fmt::Debug, time::Duration};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};

/// Time after which a rank that does not answer counts as lost, by default. Ranks wait for the
/// first one while it writes a checkpoint or measures test views.
pub const RANK_TIMEOUT: Duration = Duration::from_secs(600);

/// Failure of an exchange. The training of this rank ends with it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ExchangeError {
    /// A rank ended before the training.
    #[error("rank {rank} has ended")]
    Ended {
        /// Number of the rank.
        rank: usize,
    },
    /// A rank is too slow or hangs.
    #[error("rank {rank} has not answered for {} s", patience.as_secs_f32())]
    Silent {
        /// Number of the rank.
        rank: usize,
        /// Waiting time.
        patience: Duration,
    },
    /// A message's length differs from the one that all ranks expect.
    #[error("rank {rank} sent {found} bytes instead of {expected}")]
    Length {
        /// Number of the rank.
        rank: usize,
        /// Bytes that were expected.
        expected: usize,
        /// Bytes that came.
        found: usize,
    },
    /// A rank has other data or settings.
    #[error(
        "{what} of rank {rank} differ from those of rank 0; start all ranks with the same options, pictures and kind \
         of executor"
    )]
    Different {
        /// Number of the rank.
        rank: usize,
        /// Plural noun of the difference.
        what: &'static str,
    },
    /// The network or the library beneath failed.
    #[error("the ranks cannot communicate: {0}")]
    Transport(String),
}

/// Connection of one rank with all others.
///
/// Messages between two ranks arrive in the order in which they were sent. A message in transit is
/// delivered even if its sender ends.
pub trait Exchange: Debug + Send {
    /// Number of this rank, from 0.
    fn rank(&self) -> usize;

    /// Number of ranks, at least 1.
    fn size(&self) -> usize;

    /// Sends bytes to another rank, without waiting for their reception.
    ///
    /// # Errors
    ///
    /// [`ExchangeError::Ended`], or a failure of the transport.
    fn send(&mut self, to: usize, message: Vec<u8>) -> Result<(), ExchangeError>;

    /// Waits for the next message of another rank.
    ///
    /// # Errors
    ///
    /// [`ExchangeError::Ended`] or [`ExchangeError::Silent`], or a failure of the transport.
    fn receive(&mut self, from: usize) -> Result<Vec<u8>, ExchangeError>;

    /// Sends bytes to all ranks, and returns the bytes of all ranks in the order of their numbers.
    ///
    /// # Errors
    ///
    /// As [`Exchange::send`] and [`Exchange::receive`].
    fn all_gather(&mut self, own: Vec<u8>) -> Result<Vec<Vec<u8>>, ExchangeError> {
        let (rank, size) = (self.rank(), self.size());
        for other in (0..size).filter(|other| *other != rank) {
            self.send(other, own.clone())?;
        }
        let mut own = Some(own);
        let mut of =
            |other: usize| if other == rank { Ok(own.take().unwrap_or_default()) } else { self.receive(other) };
        (0..size).map(&mut of).collect()
    }
}

/// Exchange between threads of one process. Dropping it signals the end of this rank to the others.
#[derive(Debug)]
pub struct ThreadExchange {
    rank: usize,
    patience: Duration,
    /// Channels to all ranks, including this one.
    to: Vec<Sender<Vec<u8>>>,
    from: Vec<Receiver<Vec<u8>>>,
}

/// Exchanges of `count` ranks in the order of their numbers, one for each thread. A rank that does
/// not answer within `patience` counts as lost.
pub fn threads(count: usize, patience: Duration) -> Vec<ThreadExchange> {
    let mut ranks: Vec<ThreadExchange> =
        (0..count).map(|rank| ThreadExchange { rank, patience, to: Vec::new(), from: Vec::new() }).collect();
    for from in 0..count {
        for to in 0..count {
            let (sender, receiver) = channel();
            ranks[from].to.push(sender);
            ranks[to].from.push(receiver);
        }
    }
    ranks
}

impl Exchange for ThreadExchange {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.to.len()
    }

    fn send(&mut self, to: usize, message: Vec<u8>) -> Result<(), ExchangeError> {
        self.to[to].send(message).map_err(|_| ExchangeError::Ended { rank: to })
    }

    fn receive(&mut self, from: usize) -> Result<Vec<u8>, ExchangeError> {
        self.from[from].recv_timeout(self.patience).map_err(|error| match error {
            RecvTimeoutError::Disconnected => ExchangeError::Ended { rank: from },
            RecvTimeoutError::Timeout => ExchangeError::Silent { rank: from, patience: self.patience },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    /// Longer than any thread of these tests is kept from running.
    const AMPLE: Duration = Duration::from_secs(60);

    #[test]
    fn all_gather_returns_the_bytes_of_all_ranks_in_order() {
        let ranks = threads(3, AMPLE);
        let gather = |mut rank: ThreadExchange| rank.all_gather(vec![rank.rank() as u8; rank.rank()]);
        let handles: Vec<_> = ranks.into_iter().map(|rank| thread::spawn(move || gather(rank))).collect();
        for handle in handles {
            let gathered = handle.join().expect("no rank panics").expect("all are there");
            assert_eq!(gathered, [vec![], vec![1], vec![2, 2]]);
        }
    }

    #[test]
    fn all_gather_of_one_rank_returns_its_own_bytes() {
        let mut single = threads(1, AMPLE).remove(0);
        assert_eq!(single.all_gather(vec![7]), Ok(vec![vec![7]]));
    }

    #[test]
    fn messages_arrive_before_the_end_of_their_sender() {
        let mut ranks = threads(2, AMPLE);
        let mut gone = ranks.remove(1);
        gone.send(0, vec![4]).expect("rank 0 is there");
        drop(gone);
        assert_eq!(ranks[0].receive(1), Ok(vec![4]));
        assert_eq!(ranks[0].receive(1), Err(ExchangeError::Ended { rank: 1 }));
        assert_eq!(ranks[0].send(1, vec![5]), Err(ExchangeError::Ended { rank: 1 }));
    }

    #[test]
    fn receiving_from_a_silent_rank_times_out() {
        let patience = Duration::from_millis(20);
        let mut ranks = threads(2, patience);
        let error = ranks[0].receive(1).expect_err("nothing was sent");
        assert_eq!(error, ExchangeError::Silent { rank: 1, patience });
        assert_eq!(error.to_string(), "rank 1 has not answered for 0.02 s");
    }
}
