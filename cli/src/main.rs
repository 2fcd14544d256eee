//! The program, as a single rank.

use std::process::ExitCode;

/// Allocator that keeps pages between steps, since each step allocates its frames and gradients.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    #[cfg(all(target_os = "linux", feature = "gpu"))]
    start_without_display();
    ExitCode::from(specula::run(&specula::Ranks::alone()))
}

/// Starts the program again on machines without a display, with the variable set to an empty
/// folder: layers of Vulkan drivers print errors if it is not set.
#[cfg(all(target_os = "linux", feature = "gpu"))]
fn start_without_display() {
    use std::{env, os::unix::process::CommandExt, process::Command};
    const VARIABLE: &str = "XDG_RUNTIME_DIR";
    if env::var_os(VARIABLE).is_some() {
        return;
    }
    let (Ok(program), Some(name)) = (env::current_exe(), env::args_os().next()) else { return };
    // `exec` returns only on failure; the program then continues, and the driver prints its errors.
    let _ = Command::new(program).arg0(name).args(env::args_os().skip(1)).env(VARIABLE, "/dev/null").exec();
}
