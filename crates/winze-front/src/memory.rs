//! Memory of the machine.

/// Where the system does not tell what is free.
const MEMORY: u64 = 1 << 30;

/// Half of the memory that is free, bytes, since others want some too: as Linux tells it, or 1 GiB.
#[must_use]
pub fn half_of_what_is_free() -> u64 {
    let free = std::fs::read_to_string("/proc/meminfo")
        .ok()
        .and_then(|text| {
            let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
            let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
            Some(kib * 1024)
        });
    // A container may have less than the machine.
    let number = |path: &str| -> Option<u64> {
        let text = std::fs::read_to_string(path).ok()?;
        text.trim().parse().ok()
    };
    let allowed = number("/sys/fs/cgroup/memory.max")
        .map(|most| most.saturating_sub(number("/sys/fs/cgroup/memory.current").unwrap_or(0)));
    let least = free.into_iter().chain(allowed).min();
    least.map_or(MEMORY, |bytes| bytes / 2)
}

/// The most memory that this process held, bytes; `None` where the system does not tell (it does on
/// Linux).
#[must_use]
pub fn peak_memory() -> Option<u64> {
    high_water(&std::fs::read_to_string("/proc/self/status").ok()?)
}

fn high_water(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peak_memory_is_read_from_the_kernel_s_text() {
        let status = "Name:\twinze\nVmPeak:\t  9000 kB\nVmHWM:\t    1234 kB\n";
        assert_eq!(high_water(status), Some(1234 * 1024));
        assert_eq!(high_water("Name:\twinze\n"), None);
        #[cfg(target_os = "linux")]
        assert!(peak_memory().unwrap() > 1 << 20);
    }
}
