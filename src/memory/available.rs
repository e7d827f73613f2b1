//! The available memory: of the machine, of the process's control groups, and of its address space.
//!
//! It is read from Linux's files; on other systems it is unknown. [proc(5), cgroups(7)]

use super::LimitSource;
use std::fs;
use std::path::Path;

/// Returns the number of bytes that the process can still allocate, and the source of that limit; `None` if unknown.
/// System files are read below `root`.
pub fn available(root: &Path) -> Option<(u64, LimitSource)> {
    let groups = control_groups(root).map(|left| (left, LimitSource::ControlGroup));
    let machine = field(&root.join("proc/meminfo"), "MemAvailable:").map(|left| (left, LimitSource::Machine));
    let space = address_space(root).map(|left| (left, LimitSource::AddressSpace));
    // The first one of equal limits is returned.
    [machine, groups, space].into_iter().flatten().min_by_key(|(left, _)| *left)
}

/// Returns the resident bytes of the process, without pages of files (its code and that of libraries), which the
/// system can drop.
pub fn resident(root: &Path) -> Option<u64> {
    field(&root.join("proc/self/status"), "RssAnon:")
}

/// Returns the number of kibibytes after a name, in bytes.
fn field(path: &Path, name: &str) -> Option<u64> {
    let text = fs::read_to_string(path).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// Returns the bytes that remain below the soft limit of the address space.
fn address_space(root: &Path) -> Option<u64> {
    let limits = fs::read_to_string(root.join("proc/self/limits")).ok()?;
    let line = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    let limit: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(limit.saturating_sub(field(&root.join("proc/self/status"), "VmSize:")?))
}

/// The files of a control group: limit, usage, and the name of the part of the usage that can be reclaimed (files
/// that were read).
struct ControlGroupFiles {
    limit: &'static str,
    usage: &'static str,
    reclaimable: &'static str,
}

const VERSION_1: ControlGroupFiles = ControlGroupFiles {
    limit: "memory.limit_in_bytes",
    usage: "memory.usage_in_bytes",
    reclaimable: "total_inactive_file",
};
const VERSION_2: ControlGroupFiles =
    ControlGroupFiles { limit: "memory.max", usage: "memory.current", reclaimable: "inactive_file" };

/// Returns the least remaining memory of the process's control groups and of their ancestors.
fn control_groups(root: &Path) -> Option<u64> {
    let groups = fs::read_to_string(root.join("proc/self/cgroup")).ok()?;
    let mounted = root.join("sys/fs/cgroup");
    let left = groups.lines().filter_map(|line| {
        let mut parts = line.splitn(3, ':').skip(1);
        let (controllers, path) = (parts.next()?, parts.next()?);
        match controllers {
            "" => least(&mounted, path, &VERSION_2),
            _ if controllers.split(',').any(|name| name == "memory") => {
                least(&mounted.join("memory"), path, &VERSION_1)
            }
            _ => None,
        }
    });
    left.min()
}

/// Returns the least remaining memory of a group and its ancestors. In a container, the mounted root may be the group
/// itself.
fn least(mounted: &Path, path: &str, files: &ControlGroupFiles) -> Option<u64> {
    let path = Path::new(path.trim_start_matches('/'));
    path.ancestors().filter_map(|group| left_in(&mounted.join(group), files)).min()
}

/// Returns the remaining memory of one group; `None` without a limit.
fn left_in(group: &Path, files: &ControlGroupFiles) -> Option<u64> {
    let number = |name: &str| fs::read_to_string(group.join(name)).ok()?.trim().parse::<u64>().ok();
    let (limit, usage) = (number(files.limit)?, number(files.usage)?);
    let stat = fs::read_to_string(group.join("memory.stat")).unwrap_or_default();
    let reclaimable = stat.lines().find_map(|line| {
        let (name, value) = line.split_once(' ')?;
        (name == files.reclaimable).then(|| value.trim().parse::<u64>().ok()).flatten()
    });
    Some(limit.saturating_sub(usage.saturating_sub(reclaimable.unwrap_or(0))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tempfile::TempDir;

    /// Creates the files of a system.
    fn system(files: &[(&str, &str)]) -> TempDir {
        let root = TempDir::new().unwrap();
        for (name, text) in files {
            let path = root.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        root
    }

    const MACHINE: (&str, &str) =
        ("proc/meminfo", "MemTotal:  4000 kB\nMemFree: 10 kB\nMemAvailable:    3000 kB\n");

    #[test]
    fn without_control_groups_the_machine_counts() {
        let root = system(&[
            MACHINE,
            ("proc/self/status", "VmSize:\t  900 kB\nVmRSS:\t  99 kB\nRssAnon:\t  12 kB\n"),
        ]);
        assert_eq!(available(root.path()), Some((3000 << 10, LimitSource::Machine)));
        assert_eq!(resident(root.path()), Some(12 << 10));
        assert_eq!(available(system(&[]).path()), None);
    }

    #[test]
    fn the_tightest_group_of_version_2_counts_and_files_in_memory_do_not() {
        let root = system(&[
            MACHINE,
            ("proc/self/cgroup", "0::/user/job\n"),
            ("sys/fs/cgroup/user/job/memory.max", "max\n"),
            ("sys/fs/cgroup/user/job/memory.current", "5000\n"),
            ("sys/fs/cgroup/user/memory.max", "10000\n"),
            ("sys/fs/cgroup/user/memory.current", "7000\n"),
            ("sys/fs/cgroup/user/memory.stat", "anon 1\ninactive_file 2500\nactive_file 1\n"),
        ]);
        assert_eq!(available(root.path()), Some((5500, LimitSource::ControlGroup)));
    }

    #[test]
    fn groups_of_version_1_are_read_and_in_a_container_that_which_is_mounted() {
        let unlimited = "9223372036854771712\n";
        let root = system(&[
            MACHINE,
            ("proc/self/cgroup", "7:cpu,cpuacct:/x\n4:memory:/docker/abc\n0::/\n"),
            ("sys/fs/cgroup/memory/memory.limit_in_bytes", "20000"),
            ("sys/fs/cgroup/memory/memory.usage_in_bytes", "21000"),
            ("sys/fs/cgroup/memory/memory.stat", "total_inactive_file 4000\n"),
        ]);
        assert_eq!(available(root.path()), Some((3000, LimitSource::ControlGroup)));
        fs::write(root.path().join("sys/fs/cgroup/memory/memory.limit_in_bytes"), unlimited).unwrap();
        assert_eq!(available(root.path()), Some((3000 << 10, LimitSource::Machine)));
    }

    #[test]
    fn the_address_space_may_be_the_least() {
        let limits = "Limit   Soft Limit   Hard Limit  Units\nMax address space  2000000  unlimited  bytes\n";
        let root =
            system(&[MACHINE, ("proc/self/limits", limits), ("proc/self/status", "VmSize:\t 1000 kB\n")]);
        assert_eq!(available(root.path()), Some((2_000_000 - 1_024_000, LimitSource::AddressSpace)));
    }
}
