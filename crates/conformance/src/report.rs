//! Requirements, the executors that they are checked on, and the results.

use core::fmt;
use specula_core::pack::Storage;

/// Executor to check.
pub struct Subject<'a, E> {
    make: &'a dyn Fn() -> E,
    storage: Storage,
}

impl<E> fmt::Debug for Subject<'_, E> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("Subject").field("storage", &self.storage).finish_non_exhaustive()
    }
}

impl<'a, E> Subject<'a, E> {
    /// Executors of a function, which store numbers in full.
    pub const fn new(make: &'a dyn Fn() -> E) -> Self {
        Self { make, storage: Storage::F32 }
    }

    /// The same with the format in which uploaded Gaussians and filtered lights are stored.
    #[must_use]
    pub const fn with_storage(self, storage: Storage) -> Self {
        Self { storage, ..self }
    }

    /// New executor.
    pub fn executor(&self) -> E {
        (self.make)()
    }

    /// Format of its Gaussians and lights.
    pub const fn storage(&self) -> Storage {
        self.storage
    }
}

/// Requirement on executors; `Err` says how it was missed.
pub type Check<E> = fn(&Subject<'_, E>) -> Result<(), String>;

/// Results of several requirements.
#[derive(Clone, Debug, Default)]
pub struct Report {
    results: Vec<(&'static str, Result<(), String>)>,
}

impl Report {
    /// Checks all requirements.
    pub(crate) fn of<E>(subject: &Subject<'_, E>, checks: &[(&'static str, Check<E>)]) -> Self {
        Self { results: checks.iter().map(|(name, check)| (*name, check(subject))).collect() }
    }

    /// Names of the requirements that were missed.
    pub fn failed(&self) -> Vec<&'static str> {
        self.results.iter().filter(|(_, result)| result.is_err()).map(|(name, _)| *name).collect()
    }

    /// Names of the requirements that were met.
    pub fn passed(&self) -> Vec<&'static str> {
        self.results.iter().filter(|(_, result)| result.is_ok()).map(|(name, _)| *name).collect()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, result) in &self.results {
            match result {
                Ok(()) => writeln!(out, "{name}: met")?,
                Err(fault) => writeln!(out, "{name}: missed, {fault}")?,
            }
        }
        Ok(())
    }
}

/// Message of an error.
pub(crate) fn said(error: impl fmt::Display) -> String {
    format!("the executor failed: {error}")
}

/// Fault unless a condition holds.
pub(crate) fn require(condition: bool, fault: impl FnOnce() -> String) -> Result<(), String> {
    if condition { Ok(()) } else { Err(fault()) }
}

/// Declares the requirements of a trait: a function that lists them, and a macro that writes a
/// test of each. `$d` is the dollar sign.
macro_rules! requirements {
    ($d:tt $list:ident: $bound:path; $module:ident::{$($name:ident),* $(,)?}; $(#[$doc:meta])* $tests:ident) => {
        /// Every requirement, by name.
        pub fn $list<E: $bound>() -> Vec<(&'static str, $crate::Check<E>)> {
            vec![$((stringify!($name), $name::<E>)),*]
        }

        $(#[$doc])*
        #[macro_export]
        macro_rules! $tests {
            ($d make:expr) => {
                $d crate::$tests!($d make, F32);
            };
            ($d make:expr, $d storage:ident) => {
                $(
                    #[test]
                    fn $name() {
                        let make = $d make;
                        if make().is_none() {
                            return;
                        }
                        let make = || make().expect("there was one before");
                        let subject = $d crate::Subject::new(&make).with_storage($d crate::view::Storage::$d storage);
                        if let Err(fault) = $d crate::$module::$name(&subject) {
                            panic!("{fault}");
                        }
                    }
                )*
            };
        }
    };
}

pub(crate) use requirements;
