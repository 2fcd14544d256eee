//! Ceilings of this machine, with the vectors and threads of the executor: upper bounds for the
//! stages.

use core::hint::black_box;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use fearless_simd::{Level, Simd, dispatch};
use rayon::{ThreadPool, prelude::*};
use specula_core::{real::Real, scene::BLOCK};
use specula_cpu::lanes::Lanes;

/// Numbers of an array that no cache holds.
const LARGE: usize = 1 << 24;
/// Numbers of an array that the nearest cache holds.
const SMALL: usize = 1 << 12;
/// Sums side by side, enough to hide an addition's latency.
const SUMS: usize = 12;
/// Steps that take milliseconds, beside which waking the threads is nothing.
const STEPS: usize = 500_000;
/// Times that the small array is gone through.
const ROUNDS: usize = 1000;

/// Multiply-adds on vectors in registers.
#[inline(always)]
fn multiply_add<S: Simd>(simd: S, factor: f32) -> f32 {
    let (factor, addend) = (Lanes::splat(simd, factor), Lanes::splat(simd, 1e-3));
    let mut sums = [factor; SUMS];
    for _ in 0..STEPS {
        for k in 0..SUMS {
            sums[k] = sums[k].mul_add(factor, addend);
        }
    }
    let mut total = sums[0];
    for k in 1..SUMS {
        total = total + sums[k];
    }
    total.sum()
}

#[inline(always)]
fn powers<S: Simd>(simd: S, values: &[f32]) -> f32 {
    let mut sums = [Lanes::splat(simd, 0.0); 4];
    for _ in 0..ROUNDS {
        for values in black_box(values).chunks_exact(4 * BLOCK) {
            for k in 0..4 {
                sums[k] = sums[k] + Lanes::load(simd, &values[k * BLOCK..]).exp2();
            }
        }
    }
    ((sums[0] + sums[1]) + (sums[2] + sums[3])).sum()
}

#[inline(always)]
fn read<S: Simd>(simd: S, values: &[f32]) -> f32 {
    let mut sums = [Lanes::splat(simd, 0.0); 4];
    for values in values.chunks_exact(4 * BLOCK) {
        for k in 0..4 {
            sums[k] = sums[k] + Lanes::load(simd, &values[k * BLOCK..]);
        }
    }
    ((sums[0] + sums[1]) + (sums[2] + sums[3])).sum()
}

fn ceilings(criterion: &mut Criterion) {
    let most = std::thread::available_parallelism().map_or(1, usize::from);
    for threads in if most > 1 { vec![1, most] } else { vec![1] } {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
        ceilings_of(criterion, &pool);
    }
}

fn ceilings_of(criterion: &mut Criterion, pool: &ThreadPool) {
    let threads = pool.current_num_threads();
    let level = Level::new();
    let every_thread = |work: &(dyn Fn() -> f32 + Sync)| -> f32 { pool.broadcast(|_| work()).into_iter().sum() };
    let mut run = |name: &str, throughput: Throughput, work: &mut dyn FnMut() -> f32| {
        let mut group = criterion.benchmark_group(name);
        group.sample_size(20).throughput(throughput);
        group.bench_function(BenchmarkId::new("threads", threads), |bench| bench.iter(&mut *work));
        group.finish();
    };
    // A multiply-add is two operations.
    let operations = 2 * threads * STEPS * SUMS * BLOCK;
    run("fma", Throughput::Elements(operations as u64), &mut || {
        every_thread(&|| dispatch!(level, simd => multiply_add(simd, black_box(0.999))))
    });
    let small: Vec<f32> = (0..SMALL).map(|k| -(k as f32) / 512.0).collect();
    run("exp2", Throughput::Elements((threads * ROUNDS * SMALL) as u64), &mut || {
        every_thread(&|| dispatch!(level, simd => powers(simd, &small)))
    });
    let source = vec![1.0_f32; LARGE];
    let mut target = vec![0.0_f32; LARGE];
    let share = LARGE / (8 * threads);
    run("read", Throughput::Bytes(4 * LARGE as u64), &mut || {
        pool.install(|| source.par_chunks(share).map(|values| dispatch!(level, simd => read(simd, values))).sum())
    });
    run("copy", Throughput::Bytes(8 * LARGE as u64), &mut || {
        let parts = target.par_chunks_mut(share).zip(source.par_chunks(share));
        pool.install(|| parts.for_each(|(to, from)| to.copy_from_slice(from)));
        target[0]
    });
}

criterion_group!(benches, ceilings);
criterion_main!(benches);
