//! Finds OpenImageIO, compiles the C++ shim and generates its declarations.

use std::env;
use std::path::PathBuf;

/// The oldest supported version; the shim uses `ImageInput`/`ImageOutput` as they are from 2.4 to 3.x.
const AT_LEAST: &str = "2.4";

fn main() {
    for file in ["build.rs", "shim/buffon_oiio.h", "shim/buffon_oiio.cpp"] {
        println!("cargo:rerun-if-changed={file}");
    }
    let library = match pkg_config::Config::new().atleast_version(AT_LEAST).probe("OpenImageIO") {
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
    cc::Build::new()
        .cpp(true)
        .std("c++17")
        .file("shim/buffon_oiio.cpp")
        .includes(&library.include_paths)
        // OpenImageIO's own headers cause these warnings.
        .flag_if_supported("-Wno-unused-parameter")
        .flag_if_supported("-Wno-deprecated-declarations")
        .compile("buffon_oiio");
    let bindings = bindgen::Builder::default()
        .header("shim/buffon_oiio.h")
        .allowlist_function("buffon_oiio_.*")
        .allowlist_type("BuffonOiio.*")
        .allowlist_var("BUFFON_OIIO_.*")
        .layout_tests(true)
        .generate()
        .expect("bindgen cannot read shim/buffon_oiio.h: is libclang there (apt-get install libclang-dev)?");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR")).join("bindings.rs");
    bindings.write_to_file(&out).expect("cargo's OUT_DIR can be written");
}
