//! The GPU executor by the requirements of every executor, and its agreement with the CPU executor.

use specula_cpu::CpuExecutor;
use specula_tests::{conformance, device::executor};

mod full {
    use specula_tests::{conformance, device::executor};

    conformance::renderer_tests!(executor);
    conformance::executor_tests!(executor);
    conformance::read_back_tests!(executor);
}

mod halves {
    use specula_core::pack::Storage;
    use specula_gpu::GpuExecutor;
    use specula_tests::{conformance, device::executor};

    /// Viewer on the first adapter.
    fn viewer() -> Option<GpuExecutor<Storage>> {
        executor().map(|exec| GpuExecutor::viewer(exec.gpu().clone(), Storage::F16))
    }

    conformance::renderer_tests!(viewer, F16);
}

#[test]
fn both_executors_render_the_same_pictures() {
    let Some(_) = executor() else { return };
    let (gpu, cpu) = (|| executor().expect("there was one before"), CpuExecutor::new);
    let (gpu, cpu) = (conformance::Subject::new(&gpu), conformance::Subject::new(&cpu));
    if let Err(faults) = conformance::check_agreement(&gpu, &cpu) {
        panic!("{faults}");
    }
}
