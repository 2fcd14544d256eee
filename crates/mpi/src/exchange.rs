//! Exchange over MPI, with only sends and receives: no reduction, whose order MPI would choose.
//!
//! MPI may keep a sender waiting until its message is received. So messages queue until this rank
//! receives itself, as every rank does at the end of a step; meanwhile all that arrives is taken
//! in, so no two ranks wait for each other.

use core::time::Duration;
use mpi::{
    point_to_point::MatchedReceiveVec,
    request::scope,
    topology::{Communicator, SimpleCommunicator},
    traits::{Destination, Source},
};
use specula_train::exchange::{Exchange, ExchangeError};
use std::{collections::VecDeque, thread, time::Instant};

/// Bytes of one message of MPI at most, which counts in 32 bits.
const FRAME_MAX: usize = 1 << 30;
/// Pause between two polls of the network, once it was idle for a while.
const PAUSE: Duration = Duration::from_micros(50);
/// Polls of an idle network before the first pause.
const EAGER_LOOKS: u32 = 2000;

/// Exchange over the world of MPI.
#[derive(Debug)]
pub(crate) struct MpiExchange {
    rank: usize,
    patience: Duration,
    /// Frames to be sent, with their receivers.
    outbox: Vec<(usize, Vec<u8>)>,
    /// Frames that arrived from each rank.
    inbox: Vec<VecDeque<Vec<u8>>>,
}

impl MpiExchange {
    pub(crate) fn new(rank: usize, size: usize, patience: Duration) -> Self {
        Self { rank, patience, outbox: Vec::new(), inbox: vec![VecDeque::new(); size] }
    }

    /// Sends the queued frames, and receives until there is a frame of `from`.
    fn progress(&mut self, from: usize) -> Result<Vec<u8>, ExchangeError> {
        let Self { patience, outbox, inbox, .. } = self;
        let world = SimpleCommunicator::world();
        let frames = core::mem::take(outbox);
        let arrived = scope(|scope| {
            let mut requests = Vec::with_capacity(frames.len());
            for (to, frame) in &frames {
                requests.push(world.process_at_rank(rank_of(*to)).immediate_send(scope, &frame[..]));
            }
            let start = Instant::now();
            let mut idle = 0;
            loop {
                idle += 1;
                while let Some(message) = world.any_process().immediate_matched_probe() {
                    let (frame, status) = message.matched_receive_vec::<u8>();
                    let sender = usize::try_from(status.source_rank()).expect("ranks count from 0");
                    inbox[sender].push_back(frame);
                    idle = 0;
                }
                requests = requests.into_iter().filter_map(|request| request.test().err()).collect();
                if requests.is_empty() && !inbox[from].is_empty() {
                    return true;
                }
                if start.elapsed() > *patience {
                    if !requests.is_empty() {
                        // MPI still reads the messages, so that they cannot be given up.
                        let error = ExchangeError::Silent { rank: from, patience: *patience };
                        tracing::error!(
                            target: "specula",
                            "the training ends because {error}; --resume continues from the last checkpoint"
                        );
                        world.abort(2);
                    }
                    return false;
                }
                if idle > EAGER_LOOKS {
                    thread::sleep(PAUSE);
                }
            }
        });
        match inbox[from].pop_front() {
            Some(frame) if arrived => Ok(frame),
            _ => Err(ExchangeError::Silent { rank: from, patience: *patience }),
        }
    }
}

fn rank_of(rank: usize) -> i32 {
    i32::try_from(rank).expect("MPI counts ranks in 32 bits")
}

impl Exchange for MpiExchange {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.inbox.len()
    }

    /// Queues the length of the message, then its frames.
    fn send(&mut self, to: usize, message: Vec<u8>) -> Result<(), ExchangeError> {
        self.outbox.push((to, (message.len() as u64).to_le_bytes().to_vec()));
        if message.len() <= FRAME_MAX {
            self.outbox.push((to, message));
        } else {
            self.outbox.extend(message.chunks(FRAME_MAX).map(|frame| (to, frame.to_vec())));
        }
        Ok(())
    }

    fn receive(&mut self, from: usize) -> Result<Vec<u8>, ExchangeError> {
        let wrong = |_| ExchangeError::Transport(format!("rank {from} sent a length that is none"));
        let length = u64::from_le_bytes(self.progress(from)?.try_into().map_err(wrong)?) as usize;
        let mut message = self.progress(from)?;
        while message.len() < length {
            message.extend(self.progress(from)?);
        }
        Ok(message)
    }
}
