//! Error and time of the prefilter: the official scheme, ours, and the chains of mips that `specula
//! prefilter` writes, all in one run. Errors are those of [`specula_tests::prefilter_error`]; times
//! are the least of some runs.
//!
//! Arguments: resolutions of the base map, 64 and 128 by default.

use core::time::Duration;
use specula_core::{
    executor::Executor,
    pack::Storage,
    prefilter::{LevelRange, Levels, MipRoughness, PrefilterScheme},
};
use specula_cpu::{CpuExecutor, stages::prefilter::Light};
use specula_prefilter::Operator;
use specula_tests::prefilter_error::{DIRECTIONS, Errors, Truth};
use std::{sync::Arc, time::Instant};

const BUILDS: usize = 5;
const RUNS: usize = 25;
/// Bytes of a texel in full and as halves.
const TEXEL_LEN: [usize; 2] = [16, 8];

fn main() {
    let mut resolutions: Vec<usize> = std::env::args().skip(1).filter_map(|word| word.parse().ok()).collect();
    if resolutions.is_empty() {
        resolutions = vec![64, 128];
    }
    println!("{} threads, {DIRECTIONS} directions, 14 roughnesses from 0 to 1\n", rayon::current_num_threads());
    println!(
        "| base | levels | LDR rms | worst | HDR rms | worst | texels | KiB | weights, M | build, ms | filter, ms | back, ms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    for resolution in resolutions {
        let truth = Truth::new(resolution, DIRECTIONS);
        for variant in variants(resolution) {
            variant.measure(&truth);
        }
    }
}

/// Levels, and how they are weighted.
struct Variant {
    name: String,
    scheme: PrefilterScheme,
    levels: Levels,
}

fn variants(resolution: usize) -> Vec<Variant> {
    use PrefilterScheme::{Exact, Official};
    let chain = |roughness, coarsest: usize| {
        let count = (resolution / coarsest).ilog2() as usize + 1;
        let levels = Levels::mips(roughness, resolution, count).expect("a chain");
        Variant { name: format!("chain, {roughness:?}, down to {coarsest}"), scheme: Exact, levels }
    };
    let of = |name: &str, scheme, levels| Variant { name: name.into(), scheme, levels };
    vec![
        of("official", Official, Levels::new(Official, resolution)),
        of("official levels, our weights", Exact, Levels::new(Official, resolution)),
        of("ours", Exact, Levels::new(Exact, resolution)),
        chain(MipRoughness::Linear, 4),
        chain(MipRoughness::Filament, 4),
        chain(MipRoughness::Linear, 16),
        chain(MipRoughness::Filament, 16),
    ]
}

impl Variant {
    fn measure(&self, truth: &Truth) {
        let mut exec = CpuExecutor::new();
        let (build, operator) =
            least(BUILDS, || Arc::new(Operator::of_levels(self.scheme, self.levels, LevelRange::ALL)));
        let environments = truth.environments();
        let (filter, _) = least(RUNS, || exec.filter(&environments[0], &operator));
        let mut lights = environments.each_ref().map(|light| exec.filter(light, &operator));
        let grad = lights[0].grad(lights[0].texels());
        let (back, _) = least(RUNS, || exec.prefilter_vjp(&environments[0], &lights[0], &grad).expect("it goes back"));

        let texels: usize = self.levels.as_slice().iter().map(|level| 6 * level.resolution * level.resolution).sum();
        let weights = operator.product_count().unwrap_or(0);
        let row = |name: &str, errors: [Errors; 2], texel_len: usize| {
            let [shown, full] = errors;
            println!(
                "| {} | {name} | {:.4} | {:.4} | {:.4} | {:.4} | {texels} | {} | {:.1} | {:.0} | {:.2} | {:.2} |",
                truth.base.resolution,
                shown.rms(),
                shown.worst(),
                full.rms(),
                full.worst(),
                texels * texel_len / 1024,
                weights as f64 * 1e-6,
                milliseconds(build),
                milliseconds(filter),
                milliseconds(back),
            );
        };
        row(&self.name, self.errors(truth, &lights), TEXEL_LEN[0]);
        lights.iter_mut().for_each(|light| light.round(Storage::F16));
        row(&format!("{}, halves", self.name), self.errors(truth, &lights), TEXEL_LEN[1]);
    }

    fn errors(&self, truth: &Truth, lights: &[Light; 2]) -> [Errors; 2] {
        truth.errors(self.levels.as_slice(), [lights[0].texels(), lights[1].texels()])
    }
}

/// The least time of some runs, and the last result.
fn least<T>(runs: usize, mut run: impl FnMut() -> T) -> (Duration, T) {
    let mut once = || {
        let start = Instant::now();
        let result = run();
        (start.elapsed(), result)
    };
    let first = once();
    (1..runs).fold(first, |(least, _), _| {
        let (time, result) = once();
        (least.min(time), result)
    })
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
