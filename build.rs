//! Stamps the version: commit, target features, and the versions of the libraries that the sys crates found.

use std::process::Command;

fn main() {
    println!("cargo::rustc-check-cfg=cfg(buffon_baseline)");
    println!("cargo:rerun-if-changed=build.rs");
    // What says which commit is there; not the index, which `git status` alone refreshes.
    let head = std::fs::read_to_string(".git/HEAD").unwrap_or_default();
    let branch = head.strip_prefix("ref: ").map(|name| format!(".git/{}", name.trim()));
    for path in [".git/HEAD".into(), ".git/packed-refs".into()].into_iter().chain(branch) {
        if std::path::Path::new(&path).exists() {
            println!("cargo:rerun-if-changed={path}");
        }
    }
    let mut parts = Vec::new();
    if let Some(commit) = git(&["rev-parse", "--short=12", "HEAD"]) {
        parts.push(format!("commit {commit}"));
    }
    for (name, variable) in [("Embree", "DEP_EMBREE3_VERSION"), ("OpenImageIO", "DEP_OIIO_VERSION")] {
        println!("cargo:rerun-if-env-changed={variable}");
        if let Ok(version) = std::env::var(variable) {
            if name == "OpenImageIO" {
                println!("cargo:rustc-env=BUFFON_OIIO_VERSION={version}");
            }
            parts.push(format!("{name} {version}"));
        }
    }
    let features = std::env::var("CARGO_CFG_TARGET_FEATURE").unwrap_or_default();
    let wide = ["avx512f", "avx2", "sse4.2", "sse2", "neon"]
        .into_iter()
        .find(|f| features.split(',').any(|g| g == *f));
    parts.push(format!(
        "{} {}",
        std::env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default(),
        wide.unwrap_or("scalar")
    ));
    println!("cargo:rustc-env=BUFFON_VERSION={} ({})", env!("CARGO_PKG_VERSION"), parts.join(", "));
}

/// The output of a git command, if there is a repository and git.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_string())
}
