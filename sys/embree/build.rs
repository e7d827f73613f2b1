//! Finds Embree 3, checks its version and generates the declarations of its C interface.
//!
//! `EMBREE_DIR` names an installation (a folder with `include/` and `lib/`); without it the system's folders are
//! searched. Embree 3 has no pkg-config file. Dependent crates get the version as `DEP_EMBREE3_VERSION`.

use std::path::{Path, PathBuf};
use std::{env, fs, process};

const PACKAGE: &str = "libembree-dev";

fn main() {
    println!("cargo::rerun-if-env-changed=EMBREE_DIR");
    println!("cargo::rerun-if-changed=build.rs");
    if let Err(message) = run() {
        eprintln!("\nbuffon-embree-sys: {message}\n");
        process::exit(1);
    }
}

fn run() -> Result<(), String> {
    let root = env::var_os("EMBREE_DIR").map(PathBuf::from);
    let include = find_include(root.as_deref())?;
    let config = include.join("embree3/rtcore_config.h");
    println!("cargo::rerun-if-changed={}", config.display());
    let version = read_version(&config)?;
    check_version(&version, &config)?;
    if let Some(root) = &root {
        for lib in ["lib", "lib64"].map(|l| root.join(l)).into_iter().filter(|l| l.is_dir()) {
            println!("cargo::rustc-link-search=native={}", lib.display());
        }
    }
    println!("cargo::rustc-link-lib=dylib=embree3");
    println!("cargo::metadata=version={}.{}.{}", version[0], version[1], version[2]);
    write_bindings(&include)
}

/// Returns the include folder that contains `embree3/rtcore_config.h`.
fn find_include(root: Option<&Path>) -> Result<PathBuf, String> {
    let candidates: Vec<PathBuf> = match root {
        Some(root) => vec![root.join("include")],
        None => ["/usr/include", "/usr/local/include"].map(PathBuf::from).to_vec(),
    };
    let found = candidates.iter().find(|c| c.join("embree3/rtcore_config.h").is_file());
    found.cloned().ok_or_else(|| {
        let places: Vec<String> = candidates.iter().map(|c| c.display().to_string()).collect();
        format!(
            "no embree3/rtcore_config.h in {}. Install Embree 3 (on Debian: apt-get install {PACKAGE}), \
             or set EMBREE_DIR to a folder with include/embree3, \
             or build without it (--no-default-features).",
            places.join(" or ")
        )
    })
}

/// Returns the major, minor and patch number defined in the header.
fn read_version(config: &Path) -> Result<[u32; 3], String> {
    let text = fs::read_to_string(config).map_err(|e| format!("{}: {e}", config.display()))?;
    let number = |name: &str| {
        text.lines()
            .filter_map(|line| line.strip_prefix("#define ")?.strip_prefix(name))
            .find_map(|rest| rest.trim().parse().ok())
            .ok_or_else(|| format!("{}: no number {name}", config.display()))
    };
    Ok([number("RTC_VERSION_MAJOR ")?, number("RTC_VERSION_MINOR ")?, number("RTC_VERSION_PATCH ")?])
}

fn check_version(version: &[u32; 3], config: &Path) -> Result<(), String> {
    let [major, minor, patch] = version;
    if *major == 3 && *minor >= 13 {
        return Ok(());
    }
    Err(format!(
        "{} is of Embree {major}.{minor}.{patch}, but Embree 3.13 or a later 3.x is needed. \
         Install it (on Debian 12: apt-get install {PACKAGE}) or set EMBREE_DIR.",
        config.display()
    ))
}

fn write_bindings(include: &Path) -> Result<(), String> {
    let bindings = bindgen::Builder::default()
        .header_contents("embree.h", "#include <embree3/rtcore.h>\n")
        .clang_arg(format!("-I{}", include.display()))
        .allowlist_function("rtc.*")
        .allowlist_type("RTC.*")
        .allowlist_var("RTC.*")
        .bitfield_enum("RTCSceneFlags|RTCIntersectContextFlags|RTCCurveFlags")
        .newtype_enum("RTC.*")
        .layout_tests(true)
        .generate_comments(false)
        .prepend_enum_name(false)
        .generate()
        .map_err(|e| format!("bindgen: {e} (it needs libclang: apt-get install libclang-dev)"))?;
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR")).join("bindings.rs");
    bindings.write_to_file(&out).map_err(|e| format!("{}: {e}", out.display()))
}
