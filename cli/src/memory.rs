//! Memory of this program and of its machine, on systems with `/proc`.

use std::{fs, path::Path};

/// Peak memory of the program in bytes.
pub(crate) fn peak() -> Option<u64> {
    kibibytes_after("/proc/self/status", "VmHWM:")
}

/// Memory that is free on the machine and granted to this program, in bytes.
pub(crate) fn available() -> Option<u64> {
    let free = kibibytes_after("/proc/meminfo", "MemAvailable:")?;
    Some(granted().map_or(free, |granted| granted.min(free)))
}

/// Number of KiB after a word at the start of a line.
fn kibibytes_after(path: &str, word: &str) -> Option<u64> {
    let text = fs::read_to_string(path).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(word))?;
    let kibibytes: u64 = line.trim().trim_end_matches(" kB").parse().ok()?;
    Some(kibibytes << 10)
}

/// Memory left within the limits of this program's control groups, such as those of Slurm and
/// containers; `None` without a limit.
fn granted() -> Option<u64> {
    let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
    let group = groups.lines().find_map(|line| line.strip_prefix("0::/"))?;
    let root = Path::new("/sys/fs/cgroup");
    let own = root.join(group);
    let number = |folder: &Path, name: &str| fs::read_to_string(folder.join(name)).ok()?.trim().parse::<u64>().ok();
    let left = |folder: &Path| Some(number(folder, "memory.max")?.saturating_sub(number(folder, "memory.current")?));
    own.ancestors().take_while(|folder| folder.starts_with(root)).filter_map(left).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_has_less_memory_than_is_free() {
        if Path::new("/proc/meminfo").exists() {
            let (peak, available) = (peak().unwrap(), available().unwrap());
            assert!(peak > 1 << 20 && available > 0, "{peak} bytes, {available} free");
        }
    }
}
