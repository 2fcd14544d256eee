//! `specula doctor`: the hardware of this machine, and other programs that specula uses.

use crate::{args::Doctor, failure::Failure, output};
use serde_json::{Value, json};
use specula_capture::Tool;
use specula_cpu::CpuExecutor;

/// Prints the CPU, the adapters, and the executor that `--executor auto` selects.
pub(crate) fn run(args: &Doctor) -> Result<(), Failure> {
    let gpus = gpus();
    let (threads, vectors) = (rayon::current_num_threads(), CpuExecutor::new().vectors());
    let colmap = Tool::find(None).map(|tool| tool.to_string());
    let has_ffmpeg = specula_capture::has_ffmpeg();
    if args.json {
        return output::say_json(&json!({
            "cpu": {"threads": threads, "vectors": vectors},
            "adapters": gpus.iter().map(|gpu| gpu.json.clone()).collect::<Vec<Value>>(),
            "auto": gpus.iter().find(|gpu| gpu.is_used).map_or("cpu", |gpu| &gpu.name),
            "colmap": colmap.as_ref().ok(),
            "ffmpeg": has_ffmpeg,
        }));
    }
    let noun = if threads == 1 { "thread" } else { "threads" };
    output::say(&format!("CPU       {threads} {noun}, {vectors}"))?;
    for gpu in &gpus {
        output::say(&gpu.text)?;
    }
    output::say(&verdict(&gpus))?;
    output::say(&format!("cameras   {}", colmap.unwrap_or_else(|error| error.to_string())))?;
    let ffmpeg =
        if has_ffmpeg { "ffmpeg" } else { "ffmpeg is not installed: apt install ffmpeg, or brew install ffmpeg" };
    output::say(&format!("videos    {ffmpeg}"))
}

/// Adapter as text and as JSON.
#[derive(Debug)]
struct GpuReport {
    name: String,
    text: String,
    json: Value,
    is_used: bool,
}

/// Executor that `--executor auto` selects, and the reason.
fn verdict(gpus: &[GpuReport]) -> String {
    match gpus.iter().find(|gpu| gpu.is_used) {
        Some(gpu) => format!("auto      the adapter {:?}: real hardware", gpu.name),
        None if gpus.is_empty() => {
            format!("auto      the CPU: there is no adapter{}", hint())
        }
        None => "auto      the CPU: all adapters are software, which is slower than the CPU executor".into(),
    }
}

#[cfg(feature = "gpu")]
fn gpus() -> Vec<GpuReport> {
    use specula_gpu::adapters;
    use specula_scene::device::preferred_adapter;
    let adapters = adapters();
    let used = preferred_adapter(&adapters).map(|report| report.info.name.clone());
    adapters
        .iter()
        .map(|report| {
            let (info, limits) = (&report.info, &report.limits);
            let mib = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) >> 20;
            let [low, high] = [info.subgroup_min_size, info.subgroup_max_size];
            GpuReport {
                text: format!(
                    "adapter   {report}\n          arrays up to {mib} MiB, {} KiB shared by a workgroup, subgroups of {low} to {high}",
                    limits.max_compute_workgroup_storage_size >> 10
                ),
                json: json!({
                    "name": info.name,
                    "backend": info.backend.to_string(),
                    "driver": info.driver,
                    "driver_info": info.driver_info,
                    "is_software": report.is_software,
                    "array_mib_max": mib,
                    "workgroup_memory_bytes": limits.max_compute_workgroup_storage_size,
                    "subgroups": [low, high],
                }),
                is_used: used.as_ref() == Some(&info.name),
                name: info.name.clone(),
            }
        })
        .collect()
}

#[cfg(not(feature = "gpu"))]
fn gpus() -> Vec<GpuReport> {
    Vec::new()
}

/// Advice for a machine without adapters.
fn hint() -> &'static str {
    if !cfg!(feature = "gpu") {
        "; this program was built without its feature `gpu`"
    } else if cfg!(target_os = "linux") {
        "; drivers for Vulkan come with your GPU's driver or in mesa-vulkan-drivers, and /dev/dri must be readable"
    } else {
        "; update the driver of your GPU"
    }
}
