//! Adapters that wgpu finds on this machine.

use core::fmt;
use wgpu::{Adapter, AdapterInfo, Backends, DeviceType, Instance, InstanceDescriptor, Limits};

/// Description of an adapter, without opening a device on it.
#[derive(Clone, Debug)]
pub struct AdapterReport {
    /// Name, driver, kind.
    pub info: AdapterInfo,
    /// Limits of its devices.
    pub limits: Limits,
    /// Whether it is a software driver, which computes on the CPU.
    pub is_software: bool,
}

impl fmt::Display for AdapterReport {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let AdapterInfo { name, backend, driver, driver_info, .. } = &self.info;
        let kind = if self.is_software { ", software" } else { "" };
        write!(out, "{name} ({backend}{kind}; {driver} {driver_info})")
    }
}

/// All adapters of this machine, those of real hardware first.
pub fn adapters() -> Vec<AdapterReport> {
    let mut reports: Vec<AdapterReport> = all_adapters().iter().map(report).collect();
    reports.sort_by_key(|report| report.is_software);
    reports
}

pub(crate) fn all_adapters() -> Vec<Adapter> {
    // Without compute shaders an adapter is of no use: OpenGL's are left out.
    let backends = Backends::PRIMARY;
    let instance = Instance::new(InstanceDescriptor { backends, ..InstanceDescriptor::new_without_display_handle() });
    pollster::block_on(instance.enumerate_adapters(backends))
}

pub(crate) fn report(adapter: &Adapter) -> AdapterReport {
    let info = adapter.get_info();
    AdapterReport { is_software: info.device_type == DeviceType::Cpu, limits: adapter.limits(), info }
}
