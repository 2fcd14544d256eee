//! Trial of a network for LPIPS in a process with limits on time and memory. A network is a
//! program: one from a stranger may run for ever, or allocate any amount of memory, before it has
//! seen a view. The reader bounds the bytes and fields of a file, but a file of a hundred bytes can
//! ask for numbers by the billion (`ConstantOfShape`), for which the runtime aborts the process.

use crate::{args::TryNetwork, command_line, failure::Failure};
use specula_report::lpips::LpipsNetwork;
use std::{
    fs,
    path::Path,
    process::{Command, Output, Stdio},
};

/// CPU seconds for a network of at most [`BYTES_FREE`]; VGG takes one.
const SECONDS: u64 = 10;
/// Bytes of a network above which it gets more time.
const BYTES_FREE: u64 = 10_000_000;
/// Bytes above [`BYTES_FREE`] per additional second.
const BYTES_PER_SECOND: u64 = 1_000_000;
/// Bytes of address space for the program.
const MEMORY: u64 = 1 << 30;
/// Bytes of address space per byte of the file.
const MEMORY_PER_BYTE: u64 = 16;
/// CPU seconds per megapixel of a view; a slow core takes a minute with VGG.
const SECONDS_PER_MEGAPIXEL: u64 = 120;
/// Bytes of address space per pixel of a view; VGG holds several copies of 64 numbers.
const MEMORY_PER_PIXEL: u64 = 6 << 10;
/// Shell script that sets limits, where the system has them, and becomes the program.
const LIMITED: &str = "ulimit -c 0; ulimit -t $0; ulimit -v $1 2>/dev/null; shift; exec \"$@\"";
/// Variable of the runtime's number of threads, each of which takes address space.
const THREADS: &str = "RTEN_NUM_THREADS";

/// Reads a network and compares two pictures, in this process with limits.
pub(crate) fn run(args: &TryNetwork) -> Result<(), Failure> {
    let network = LpipsNetwork::read(&args.network)?;
    if let [width, height] = args.size[..] {
        network.try_size([width, height]);
    }
    Ok(())
}

/// Tests a network in a process with limits: reads it and compares pictures of this width and
/// height.
pub(super) fn try_network(path: &Path, size: [u32; 2]) -> Result<(), Failure> {
    let len = fs::metadata(path).map_or(0, |file| file.len());
    let pixels = size.into_iter().map(u64::from).product::<u64>();
    let seconds = SECONDS
        + len.saturating_sub(BYTES_FREE) / BYTES_PER_SECOND
        + pixels.saturating_mul(SECONDS_PER_MEGAPIXEL) / 1_000_000;
    let memory = MEMORY + len.saturating_mul(MEMORY_PER_BYTE) + pixels.saturating_mul(MEMORY_PER_PIXEL);
    let output = output_of(path, size, seconds, memory)
        .map_err(|error| Failure::Internal(format!("cannot test {path:?} in another process: {error}")))?;
    match output.status.code() {
        Some(0) => Ok(()),
        Some(2) => Err(Failure::Input(sentence(&output))),
        _ => Err(Failure::Input(format!(
            "{path:?} is not a usable LPIPS network: reading it and comparing two pictures failed, or took more than \
             {seconds} s of CPU time or {} MiB ({}); scripts/lpips-onnx.py writes one",
            memory >> 20,
            output.status
        ))),
    }
}

fn output_of(path: &Path, [width, height]: [u32; 2], seconds: u64, memory: u64) -> std::io::Result<Output> {
    let program = &command_line::given().program;
    let mut command = if cfg!(unix) {
        let mut shell = Command::new("sh");
        shell.args(["-c", LIMITED, &seconds.to_string(), &(memory >> 10).to_string()]).args(program);
        shell
    } else {
        let mut command = Command::new(&program[0]);
        command.args(&program[1..]);
        command
    };
    command.args(["--threads", "1", "try-network"]).arg(path);
    command.args(["--size", &width.to_string(), &height.to_string()]).env(THREADS, "1").stdin(Stdio::null()).output()
}

/// Error message of the other process.
fn sentence(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr);
    let line = text.lines().last().unwrap_or_default();
    line.strip_prefix("specula: ").unwrap_or(line).to_owned()
}
