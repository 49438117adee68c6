//! Compiles the shim between Rust and the C++ of libudt.

fn main() {
    println!("cargo::rerun-if-changed=src/shim.cpp");
    cc::Build::new()
        .cpp(true)
        .std("c++11")
        .warnings_into_errors(true)
        .file("src/shim.cpp")
        .compile("fipa_udt_shim");
    println!("cargo::rustc-link-lib=udt");
}
