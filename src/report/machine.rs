//! The circumstances of a measurement.

use std::fs;
use std::path::Path;

/// The name of a SIMD feature, and a test whether the processor has it.
type Width = (&'static str, fn() -> bool);

/// The features, the widest first.
#[cfg(target_arch = "x86_64")]
const WIDTHS: [Width; 3] = [
    ("AVX-512", || std::arch::is_x86_feature_detected!("avx512f")),
    ("AVX2", || std::arch::is_x86_feature_detected!("avx2")),
    ("SSE4.2", || std::arch::is_x86_feature_detected!("sse4.2")),
];
#[cfg(not(target_arch = "x86_64"))]
const WIDTHS: [Width; 0] = [];

/// Returns the widest SIMD feature of the processor that a renderer benefits from; "baseline" if there is none.
pub fn simd() -> &'static str {
    WIDTHS.iter().find(|(_, present)| present()).map_or("baseline", |(name, _)| name)
}

/// Returns the processor's name as the system reports it.
pub fn processor() -> String {
    let cpuinfo = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = cpuinfo.lines().find_map(|l| l.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(|| std::env::consts::ARCH.into(), |(_, name)| name.trim().into())
}

/// Returns the date and time, in UTC, to the second: 2026-11-21T10:20:30Z.
pub fn date() -> String {
    let now = jiff::Timestamp::now();
    now.round(jiff::Unit::Second).unwrap_or(now).to_string()
}

/// Returns the command line, quoted for a shell: the program by its name alone, and files below the current folder by
/// their relative paths.
pub fn command_line() -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+@%".contains(c);
    let quoted = |word: String| {
        if !word.is_empty() && word.chars().all(plain) {
            word
        } else {
            format!("'{}'", word.replace('\'', r"'\''"))
        }
    };
    let folder = std::env::current_dir().unwrap_or_default();
    let short = |(i, word): (usize, std::ffi::OsString)| {
        let path = Path::new(&word);
        let shown = if i == 0 { path.file_name().map(Path::new) } else { path.strip_prefix(&folder).ok() };
        let shown = shown.filter(|shown| !shown.as_os_str().is_empty()).unwrap_or(path);
        quoted(shown.to_string_lossy().into_owned())
    };
    std::env::args_os().enumerate().map(short).collect::<Vec<_>>().join(" ")
}

/// Returns names and values: processor, system, Buffon's version, command line, date.
pub fn facts() -> Vec<(&'static str, String)> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let release = fs::read_to_string("/etc/os-release").unwrap_or_default();
    let system = release.lines().find_map(|l| l.strip_prefix("PRETTY_NAME=")).map(|n| n.trim_matches('"'));
    vec![
        ("Processor", format!("{}, {threads} hardware threads, {}", processor(), simd())),
        ("System", format!("{}, {}", system.unwrap_or(std::env::consts::OS), std::env::consts::ARCH)),
        ("Buffon", env!("BUFFON_VERSION").to_string()),
        ("Command", command_line()),
        ("Date", date()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fact_is_told() {
        for (name, value) in facts() {
            assert!(!name.is_empty() && !value.is_empty(), "{name}: {value}");
        }
        assert!(date().ends_with('Z') && date().len() == 20, "{}", date());
    }
}
