//! The CPU executor by the requirements of every executor.

use specula_cpu::{CpuExecutor, CpuViewer};
use specula_tests::conformance;

conformance::renderer_tests!(|| Some(CpuExecutor::new()));
conformance::executor_tests!(|| Some(CpuExecutor::new()));
conformance::read_back_tests!(|| Some(CpuExecutor::new()));

#[test]
fn the_viewer_agrees_with_the_executor() {
    let (executor, viewer) = (CpuExecutor::new, CpuViewer::default);
    let (executor, viewer) = (conformance::Subject::new(&executor), conformance::Subject::new(&viewer));
    conformance::check_agreement(&executor, &viewer).expect("they are one program");
}
