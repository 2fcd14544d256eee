//! Progress of a measurement.

/// Begins a phase with a title and a number of steps; returns its observer, which takes the number
/// of steps done and is dropped at the end of the phase.
pub type StartProgress<'a> = dyn Fn(&str, u64) -> Box<dyn Fn(u64) + Sync> + 'a;
