//! Ranks of a training: processes that share it.

use core::fmt;
use specula_train::exchange::Exchange;

/// This process among the ranks of a training.
pub struct Ranks<'a> {
    /// Number of this rank, from 0. The first one writes the model.
    pub rank: usize,
    /// Number of ranks, at least 1.
    pub size: usize,
    /// Connects this rank with all others, once for each training.
    pub connect: &'a dyn Fn() -> Option<Box<dyn Exchange>>,
}

impl fmt::Debug for Ranks<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "Ranks({} of {})", self.rank, self.size)
    }
}

impl Ranks<'_> {
    /// A process that shares its training with none.
    pub const fn alone() -> Self {
        Self { rank: 0, size: 1, connect: &|| None }
    }

    /// Whether this rank writes the model and prints notes.
    pub(crate) const fn is_first(&self) -> bool {
        self.rank == 0
    }

    /// Start of the sentences of a rank that is not the first.
    pub(crate) fn prefix(&self) -> String {
        if self.is_first() { String::new() } else { format!("rank {}: ", self.rank) }
    }
}
