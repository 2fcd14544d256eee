//! `specula` as one of several ranks, which MPI connects.

mod exchange;

use core::time::Duration;
use exchange::MpiExchange;
use mpi::{Threading, traits::Communicator};
use specula::{Ranks, local_rank};
use specula_train::exchange::{Exchange, RANK_TIMEOUT};
use std::{env, process::ExitCode, thread};

/// Allocator that keeps pages between steps, since each step allocates its frames and gradients.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Variable with the seconds after which a rank that does not answer counts as lost.
const PATIENCE_VARIABLE: &str = "SPECULA_RANK_PATIENCE";
/// Time for the first rank to print its error before another one ends all.
const LAST_WORDS: Duration = Duration::from_secs(2);
/// Exit code of an interrupted training, which all ranks end orderly.
const INTERRUPTED: u8 = 130;

fn main() -> ExitCode {
    // Only the training thread calls MPI.
    let Some((universe, _)) = mpi::initialize_with_threading(Threading::Funneled) else {
        eprintln!("specula-mpi: MPI cannot be started");
        return ExitCode::FAILURE;
    };
    let world = universe.world();
    let (Ok(rank), Ok(size)) = (usize::try_from(world.rank()), usize::try_from(world.size())) else {
        eprintln!("specula-mpi: MPI counts its ranks below zero");
        return ExitCode::FAILURE;
    };
    let patience = match patience() {
        Ok(patience) => patience,
        Err(sentence) => {
            eprintln!("specula-mpi: {sentence}");
            return ExitCode::from(2);
        }
    };
    let connect = || (size > 1).then(|| Box::new(MpiExchange::new(rank, size, patience)) as Box<dyn Exchange>);
    let local = local_rank(|name| env::var(name).ok()).unwrap_or(rank);
    let code = specula::run(&Ranks { rank, size, local, connect: &connect });
    if code != 0 && code != INTERRUPTED && size > 1 {
        if rank != 0 {
            thread::sleep(LAST_WORDS);
        }
        world.abort(code.into());
    }
    ExitCode::from(code)
}

/// Time after which a rank that does not answer counts as lost.
fn patience() -> Result<Duration, String> {
    let Ok(text) = env::var(PATIENCE_VARIABLE) else { return Ok(RANK_TIMEOUT) };
    match text.parse() {
        Ok(seconds) if seconds > 0 => Ok(Duration::from_secs(seconds)),
        _ => Err(format!("{PATIENCE_VARIABLE} is {text:?}; set it to a number of seconds")),
    }
}
