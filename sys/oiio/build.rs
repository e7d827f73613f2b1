//! Finds OpenImageIO, links the C++ shim against it as a shared object of its own, and generates its declarations.

use std::env;
use std::path::PathBuf;
use std::process::Command;

/// The oldest supported version; the shim uses `ImageInput`/`ImageOutput` as they are from 2.4 to 3.x.
const AT_LEAST: &str = "2.4";

fn main() {
    for file in ["build.rs", "shim/buffon_oiio.h", "shim/buffon_oiio.cpp"] {
        println!("cargo:rerun-if-changed={file}");
    }
    let library = match pkg_config::Config::new()
        .atleast_version(AT_LEAST)
        .cargo_metadata(false)
        .probe("OpenImageIO")
    {
        Ok(library) => library,
        Err(error) => {
            eprintln!("{error}\n");
            eprintln!("Buffon needs OpenImageIO {AT_LEAST} or later, found through pkg-config.");
            eprintln!("On Debian and Ubuntu: apt-get install libopenimageio-dev pkg-config");
            eprintln!(
                "Without it: build with --no-default-features --features embree (images by Rust crates)."
            );
            std::process::exit(1);
        }
    };
    println!("cargo:version={}", library.version);
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let mut build = cc::Build::new();
    let objects = build
        .cpp(true)
        .pic(true)
        .std("c++17")
        .file("shim/buffon_oiio.cpp")
        .includes(&library.include_paths)
        // OpenImageIO's own headers cause these warnings.
        .flag_if_supported("-Wno-unused-parameter")
        .flag_if_supported("-Wno-deprecated-declarations")
        .compile_intermediates();
    // Only this object is linked against the library, so that a program loads it when it first needs it.
    let mut linker = build.get_compiler().to_command();
    linker.arg("-shared").arg("-s").arg("-o").arg(out.join("libbuffon_oiio.so")).args(objects);
    linker.args(library.link_paths.iter().map(|path| format!("-L{}", path.display())));
    linker.args(library.libs.iter().map(|name| format!("-l{name}")));
    run(&mut linker);
    let bindings = bindgen::Builder::default()
        .header("shim/buffon_oiio.h")
        .allowlist_function("buffon_oiio_.*")
        .allowlist_type("BuffonOiio.*")
        .allowlist_var("BUFFON_OIIO_.*")
        .layout_tests(true)
        .dynamic_library_name("Functions")
        .dynamic_link_require_all(true)
        .wrap_unsafe_ops(true)
        .generate()
        .expect("bindgen cannot read shim/buffon_oiio.h: is libclang there (apt-get install libclang-dev)?");
    bindings.write_to_file(out.join("bindings.rs")).expect("cargo's OUT_DIR can be written");
}

fn run(command: &mut Command) {
    let status = command.status().unwrap_or_else(|e| panic!("{command:?} cannot be started: {e}"));
    assert!(status.success(), "{command:?} failed: {status}");
}
