//! Adapters of wgpu on this machine.

use core::fmt;
use wgpu::{Adapter, AdapterInfo, Backend, Backends, DeviceType, Instance, InstanceDescriptor, Limits};

/// Description of an adapter, without opening its device.
#[derive(Clone, Debug)]
pub struct AdapterReport {
    /// Name, driver, kind.
    pub info: AdapterInfo,
    /// Limits of its devices.
    pub limits: Limits,
    /// True for a software driver, which computes on the CPU.
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
    // Adapters without compute shaders are useless: OpenGL's are skipped.
    let backends = Backends::PRIMARY;
    let instance = Instance::new(InstanceDescriptor { backends, ..InstanceDescriptor::new_without_display_handle() });
    pollster::block_on(instance.enumerate_adapters(backends))
}

pub(crate) fn report(adapter: &Adapter) -> AdapterReport {
    let info = adapter.get_info();
    AdapterReport { is_software: info.device_type == DeviceType::Cpu, limits: adapter.limits(), info }
}

/// Index of an adapter among those assigned to the ranks of one machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AdapterPlace {
    /// Number of the adapter, from 0.
    pub number: usize,
    /// Count of adapters, at least 1.
    pub count: usize,
}

/// Properties of an adapter for the assignment to ranks.
#[derive(Clone, Debug)]
pub(crate) struct Traits {
    name: String,
    backend: Backend,
    is_software: bool,
}

impl Traits {
    pub(crate) fn of(adapter: &Adapter) -> Self {
        let AdapterReport { info, is_software, .. } = report(adapter);
        Self { name: info.name.to_lowercase(), backend: info.backend, is_software }
    }
}

/// Index and place of the adapter of a rank, by its number among the ranks of a machine. The first
/// adapter with `wanted` in its name, of hardware if there is any, decides the backend and whether
/// drivers compute on the CPU; ranks cycle through the adapters of this kind.
pub(crate) fn selected(adapters: &[Traits], wanted: &str, rank: usize) -> Option<(usize, AdapterPlace)> {
    let wanted = wanted.to_lowercase();
    let named = || adapters.iter().enumerate().filter(|(_, adapter)| adapter.name.contains(&wanted));
    let (_, first) = named().min_by_key(|(_, adapter)| adapter.is_software)?;
    let alike = named()
        .filter(|(_, adapter)| (adapter.backend, adapter.is_software) == (first.backend, first.is_software))
        .map(|(index, _)| index);
    let alike: Vec<usize> = alike.collect();
    let number = rank % alike.len();
    Some((alike[number], AdapterPlace { number, count: alike.len() }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(name: &str, backend: Backend, is_software: bool) -> Traits {
        Traits { name: name.to_lowercase(), backend, is_software }
    }

    /// Indices of the adapters of the first ranks of a machine.
    fn of_ranks<const N: usize>(adapters: &[Traits], wanted: &str) -> [Option<usize>; N] {
        core::array::from_fn(|rank| selected(adapters, wanted, rank).map(|(index, _)| index))
    }

    #[test]
    fn ranks_cycle_through_the_hardware_of_a_machine() {
        use Backend::{Dx12, Vulkan};
        let adapters = [
            adapter("llvmpipe", Vulkan, true),
            adapter("NVIDIA A", Vulkan, false),
            adapter("NVIDIA A", Vulkan, false),
            adapter("AMD B", Vulkan, false),
            adapter("NVIDIA A", Dx12, false),
        ];
        assert_eq!(of_ranks(&adapters, ""), [Some(1), Some(2), Some(3), Some(1)]);
        assert_eq!(of_ranks(&adapters, "nvidia"), [Some(1), Some(2), Some(1)]);
        assert_eq!(of_ranks(&adapters, "amd"), [Some(3), Some(3)]);
        assert_eq!(of_ranks(&adapters, "LLVM"), [Some(0), Some(0)], "a driver that is named is used");
        assert_eq!(of_ranks(&adapters, "intel"), [None]);
        assert_eq!(selected(&adapters, "", 4), Some((2, AdapterPlace { number: 1, count: 3 })));
    }

    #[test]
    fn software_drivers_are_used_only_without_hardware() {
        let drivers = [adapter("llvmpipe", Backend::Vulkan, true), adapter("swiftshader", Backend::Vulkan, true)];
        assert_eq!(of_ranks(&drivers, ""), [Some(0), Some(1), Some(0)]);
        assert_eq!(of_ranks(&[], ""), [None]);
    }
}
