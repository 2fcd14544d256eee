//! Criterion's groups: one for each stage, with throughput in the stage's own unit of work.

use crate::stages::{Amounts, Meter, Stage};
use core::{
    fmt::{self, Debug},
    hint::black_box,
    time::Duration,
};
use criterion::{BenchmarkId, Criterion, Throughput};
use specula_core::executor::Renderer;
use std::time::Instant;

/// Benches of one scene on an executor.
pub struct Groups<'a, E: Renderer> {
    /// Criterion instance.
    pub criterion: &'a mut Criterion,
    /// The scene's name.
    pub name: String,
    /// Samples for each stage.
    pub samples: usize,
    /// Work of the stage.
    pub amounts: Amounts,
    /// Waits until all that an executor was asked for is done.
    pub finish: fn(&mut E) -> Result<(), E::Error>,
}

impl<E: Renderer> Debug for Groups<'_, E> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, samples, amounts, .. } = self;
        write!(out, "Groups {{ {name:?}, {samples}, {amounts:?} }}")
    }
}

impl<E: Renderer> Groups<'_, E> {
    /// Measures an operation on the scene without its preparation `prepare`.
    ///
    /// # Panics
    ///
    /// If the executor fails.
    pub fn bench<I, O>(
        &mut self,
        exec: &mut E,
        name: &str,
        elements: usize,
        mut prepare: impl FnMut(&mut E) -> Result<I, E::Error>,
        mut run: impl FnMut(&mut E, I) -> Result<O, E::Error>,
    ) {
        let mut once = || -> Result<Duration, E::Error> {
            let prepared = black_box(prepare(exec)?);
            (self.finish)(exec)?;
            let start = Instant::now();
            let result = run(exec, prepared)?;
            (self.finish)(exec)?;
            let duration = start.elapsed();
            black_box(result);
            Ok(duration)
        };
        let mut group = self.criterion.benchmark_group(name);
        group.sample_size(self.samples).throughput(Throughput::Elements(elements as u64));
        group.bench_function(BenchmarkId::from_parameter(&self.name), |bench| {
            bench.iter_custom(|count| (0..count).map(|_| once().expect("every stage runs")).sum());
        });
        group.finish();
    }
}

impl<E: Renderer> Meter<E> for Groups<'_, E> {
    fn measure<I, O>(
        &mut self,
        exec: &mut E,
        stage: Stage,
        prepare: impl FnMut(&mut E) -> Result<I, E::Error>,
        run: impl FnMut(&mut E, I) -> Result<O, E::Error>,
    ) -> Result<(), E::Error> {
        self.bench(exec, stage.name(), self.amounts.elements(stage), prepare, run);
        Ok(())
    }
}
