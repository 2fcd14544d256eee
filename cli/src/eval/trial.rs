//! A network is a program that somebody wrote: it may run for ever, or ask for any memory, before it has seen a view. So it
//! is read and run over the pictures of its check in a process of its own first, which may take so much and no more.

use crate::{args::TryNetwork, eval::lpips::Judge, failure::Failure};
use std::{
    fs,
    path::Path,
    process::{Command, Output, Stdio},
};

/// Seconds of a processor for a network of ten megabytes; larger ones have a second more for each megabyte. VGG takes one.
const SECONDS: u64 = 10;
const SECONDS_OF_BYTES: u64 = 10_000_000;
const BYTES_A_SECOND: u64 = 1_000_000;
/// Addresses that the process may have, the program itself included, and for each byte of the file.
const MEMORY: u64 = 1 << 30;
const MEMORY_OF_BYTE: u64 = 16;
/// The same for a view: VGG holds 64 numbers of a pixel a few times over, and multiplies as often as a
/// slow core does in a minute.
const SECONDS_OF_MEGAPIXEL: u64 = 120;
const MEMORY_OF_PIXEL: u64 = 6 << 10;
/// Sets limits, where the system has them, and becomes the program.
const LIMITED: &str = "ulimit -c 0; ulimit -t $0; ulimit -v $1 2>/dev/null; shift; exec \"$@\"";
/// The runtime's threads, each of which would take addresses.
const THREADS: &str = "RTEN_NUM_THREADS";

/// Reads a network in this process, which is one of its own.
pub(crate) fn run(args: &TryNetwork) -> Result<(), Failure> {
    let judge = Judge::trusted(&args.network)?;
    if let [width, height] = args.size[..] {
        judge.try_size([width, height]);
    }
    Ok(())
}

/// Tries within bounds whether a network can be read, and compares pictures of this width and height.
pub(super) fn try_network(path: &Path, size: [u32; 2]) -> Result<(), Failure> {
    let len = fs::metadata(path).map_or(0, |file| file.len());
    let pixels = size.into_iter().map(u64::from).product::<u64>();
    let seconds = SECONDS
        + len.saturating_sub(SECONDS_OF_BYTES) / BYTES_A_SECOND
        + pixels.saturating_mul(SECONDS_OF_MEGAPIXEL) / 1_000_000;
    let memory = MEMORY + len.saturating_mul(MEMORY_OF_BYTE) + pixels.saturating_mul(MEMORY_OF_PIXEL);
    let output = output_of(path, size, seconds, memory)
        .map_err(|error| Failure::Internal(format!("cannot try {path:?} in a process of its own: {error}")))?;
    match output.status.code() {
        Some(0) => Ok(()),
        Some(2) => Err(Failure::Input(sentence(&output))),
        _ => Err(Failure::Input(format!(
            "{path:?} holds no network for LPIPS: reading it and comparing two pictures takes more than {seconds} s of \
             a processor or {} MiB, or fails altogether ({}); scripts/lpips-onnx.py writes one",
            memory >> 20,
            output.status
        ))),
    }
}

fn output_of(path: &Path, [width, height]: [u32; 2], seconds: u64, memory: u64) -> std::io::Result<Output> {
    let program = std::env::current_exe()?;
    let mut command = if cfg!(unix) {
        let mut shell = Command::new("sh");
        shell.args(["-c", LIMITED, &seconds.to_string(), &(memory >> 10).to_string()]).arg(program);
        shell
    } else {
        Command::new(program)
    };
    command.args(["--threads", "1", "try-network"]).arg(path);
    command.args(["--size", &width.to_string(), &height.to_string()]).env(THREADS, "1").stdin(Stdio::null()).output()
}

/// Sentence of the other process.
fn sentence(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr);
    let line = text.lines().last().unwrap_or_default();
    line.strip_prefix("specula: ").unwrap_or(line).to_owned()
}
