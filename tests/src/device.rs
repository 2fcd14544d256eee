//! The device that tests run on.

use specula_gpu::{Gpu, GpuError, GpuExecutor};
use std::sync::LazyLock;

/// An executor on the first adapter. Without one tests are skipped with a note; in CI they fail.
pub fn executor() -> Option<GpuExecutor> {
    executor_with_arrays_of(u64::MAX)
}

/// Executor whose arrays have at most a number of bytes.
pub fn executor_with_arrays_of(bytes: u64) -> Option<GpuExecutor> {
    device().map(|gpu| GpuExecutor::new(gpu.limited(bytes)))
}

/// Executor that divides Gaussians into chunks of a number of bytes.
pub fn executor_in_chunks_of(bytes: u64) -> Option<GpuExecutor> {
    device().map(|gpu| GpuExecutor::new(gpu.with_chunks_of(bytes)))
}

/// Executor on a separate device, which may be destroyed.
pub fn executor_of_its_own() -> Option<GpuExecutor> {
    or_skipped(Gpu::new("")).map(GpuExecutor::new)
}

/// One device for all tests of a program, whose kernels are compiled once.
fn device() -> Option<Gpu> {
    static DEVICE: LazyLock<Result<Gpu, GpuError>> = LazyLock::new(|| Gpu::new(""));
    or_skipped(DEVICE.clone())
}

fn or_skipped(device: Result<Gpu, GpuError>) -> Option<Gpu> {
    match device {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("CI").is_some() => panic!("CI needs an adapter: {error}"),
        Err(error) => {
            eprintln!("NOT TESTED, because {error}");
            None
        }
    }
}
