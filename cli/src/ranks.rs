//! Ranks of a training: processes or threads that share it.

use crate::{
    failure::{Failure, shortened},
    progress,
};
use core::fmt;
use specula_scene::ExecutorChoice;
use specula_train::exchange::{Exchange, RANK_TIMEOUT, ThreadExchange, threads};
use std::{
    sync::Mutex,
    thread::{self, ScopedJoinHandle},
};

/// Variables with the number of a rank among those of its machine, of Open MPI, Intel MPI, MVAPICH
/// and MPICH, then of Slurm, whose number is that of the launcher where another one starts ranks.
const LOCAL_VARIABLES: [&str; 5] = [
    "OMPI_COMM_WORLD_LOCAL_RANK",
    "MPI_LOCALRANKID",
    "MV2_COMM_WORLD_LOCAL_RANK",
    "PALS_LOCAL_RANKID",
    "SLURM_LOCALID",
];

/// This process or thread among the ranks of a training.
pub struct Ranks<'a> {
    /// Number of this rank, from 0. The first one writes the model.
    pub rank: usize,
    /// Number of ranks, at least 1.
    pub size: usize,
    /// Number of this rank among those of its machine, from 0, which selects its GPU
    /// ([`local_rank`]).
    pub local: usize,
    /// Connects this rank with all others, once for each training.
    pub connect: &'a dyn Fn() -> Option<Box<dyn Exchange>>,
}

impl fmt::Debug for Ranks<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "Ranks({} of {})", self.rank, self.size)
    }
}

impl Ranks<'_> {
    /// The only rank of a training.
    pub const fn alone() -> Self {
        Self { rank: 0, size: 1, local: 0, connect: &|| None }
    }

    /// True for the rank that writes the model and prints notes.
    pub(crate) const fn is_first(&self) -> bool {
        self.rank == 0
    }

    /// Prefix of the notes of a rank other than the first.
    pub(crate) fn prefix(&self) -> String {
        if self.is_first() { String::new() } else { format!("rank {}: ", self.rank) }
    }

    /// Executor of this rank: one of several ranks has its own GPU if the machine has enough.
    pub(crate) fn executor(&self, choice: &ExecutorChoice) -> ExecutorChoice {
        if self.size > 1 { choice.of_rank(self.local) } else { choice.clone() }
    }
}

/// Number of a rank among those of its machine, from the environment that MPI or Slurm gives it;
/// `variable` returns the text of a variable. `None` if no variable has a number.
pub fn local_rank(variable: impl Fn(&str) -> Option<String>) -> Option<usize> {
    LOCAL_VARIABLES.into_iter().find_map(|name| variable(name)?.trim().parse().ok())
}

/// Runs a training on several ranks that are threads of this process; the first one is the calling
/// thread. All ranks share the threads of the program. Other failures than the returned one are
/// printed, unless they have the same text.
///
/// # Errors
/// The failure of the first rank that failed.
pub(crate) fn share_among_threads(
    count: usize,
    train: impl Fn(&Ranks<'_>) -> Result<(), Failure> + Sync,
) -> Result<(), Failure> {
    let is_quiet = progress::is_quiet();
    let run = |exchange: ThreadExchange| {
        let rank = exchange.rank();
        let exchange = Mutex::new(Some(exchange));
        let connect = || {
            let taken = exchange.lock().ok()?.take()?;
            Some(Box::new(taken) as Box<dyn Exchange>)
        };
        train(&Ranks { rank, size: count, local: rank, connect: &connect })
    };
    let run_other = |exchange: ThreadExchange| {
        tracing::subscriber::with_default(progress::subscriber(is_quiet, false), || run(exchange))
    };
    let mut exchanges = threads(count, RANK_TIMEOUT).into_iter();
    let first = exchanges.next().expect("there is a rank");
    thread::scope(|scope| {
        let others: Vec<ScopedJoinHandle<'_, _>> =
            exchanges.map(|exchange| scope.spawn(move || run_other(exchange))).collect();
        let mut outcome = run(first);
        for (other, rank) in others.into_iter().zip(1..) {
            let done = other.join().unwrap_or_else(|payload| {
                let failure = Failure::out_of_memory(payload.as_ref());
                Err(failure.unwrap_or_else(|| Failure::Internal("a rank panicked".into())))
            });
            match (&outcome, done) {
                (Ok(()), done) => outcome = done,
                (Err(failure), Err(other)) if failure.to_string() != other.to_string() => {
                    tracing::error!("rank {rank}: {}", shortened(&other.to_string()));
                }
                _ => {}
            }
        }
        outcome
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn local_of(variables: &[(&str, &str)]) -> Option<usize> {
        let value = |name: &str| variables.iter().find(|(known, _)| *known == name).map(|(_, text)| (*text).to_owned());
        local_rank(value)
    }

    #[test]
    fn the_local_rank_comes_from_the_launcher() {
        assert_eq!(local_of(&[]), None);
        assert_eq!(local_of(&[("OMPI_COMM_WORLD_LOCAL_RANK", "3")]), Some(3));
        assert_eq!(local_of(&[("MPI_LOCALRANKID", "2")]), Some(2));
        assert_eq!(local_of(&[("SLURM_LOCALID", "1")]), Some(1));
        // mpirun within a job of Slurm: the launcher is the job's task 0.
        assert_eq!(local_of(&[("SLURM_LOCALID", "0"), ("OMPI_COMM_WORLD_LOCAL_RANK", "5")]), Some(5));
        assert_eq!(local_of(&[("MPI_LOCALRANKID", "none"), ("SLURM_LOCALID", "4")]), Some(4));
    }

    #[test]
    fn one_of_several_ranks_has_its_own_gpu() {
        let gpu = ExecutorChoice::Gpu("A".into());
        let third = Ranks { rank: 6, size: 8, local: 2, connect: &|| None };
        assert_eq!(third.executor(&gpu), ExecutorChoice::GpuOfRank { name: "A".into(), rank: 2 });
        assert_eq!(third.executor(&ExecutorChoice::Cpu), ExecutorChoice::Cpu);
        assert_eq!(Ranks::alone().executor(&gpu), gpu);
    }

    #[test]
    fn threads_are_ranks_and_the_failure_of_any_is_returned() {
        let talk = |ranks: &Ranks<'_>| {
            let mut exchange = (ranks.connect)().expect("the exchange of this rank");
            assert!((ranks.connect)().is_none(), "a rank connects once");
            let all = exchange.all_gather(vec![ranks.rank as u8]).expect("all are there");
            assert_eq!(all, [[0], [1], [2]]);
        };
        let succeed = |ranks: &Ranks<'_>| {
            talk(ranks);
            Ok(())
        };
        assert!(share_among_threads(3, succeed).is_ok());
        for culprit in 0..3 {
            let fail = |ranks: &Ranks<'_>| {
                talk(ranks);
                if ranks.rank == culprit { Err(Failure::Input(format!("{culprit}"))) } else { Ok(()) }
            };
            let failure = share_among_threads(3, fail).expect_err("one of them fails");
            assert_eq!(failure.to_string(), culprit.to_string());
        }
    }
}
