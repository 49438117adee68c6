//! Writes the gRPC service of the comparison, and finds out which versions are compared.

use tonic_build::manual::{Builder, Method, Service};

/// Crates that the table names with their versions.
const NAMED: [&str; 3] = ["async-nats", "tonic", "zenoh"];

fn main() {
    let method = || {
        Method::builder()
            .input_type("crate::peers::grpc::Letter")
            .output_type("crate::peers::grpc::Letter")
            .codec_path("tonic_prost::ProstCodec")
    };
    let put = method().name("put").route_name("Put").client_streaming();
    let take = method().name("take").route_name("Take").server_streaming();
    let service = Service::builder()
        .package("peers")
        .name("Relay")
        .method(put.build())
        .method(take.build());
    Builder::new().compile(&[service.build()]);

    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=Cargo.lock");
    let lock = std::fs::read_to_string("Cargo.lock").expect("the lock file");
    for name in NAMED {
        let version = version(&lock, name).expect("a dependency");
        let variable = name.replace('-', "_").to_uppercase();
        println!("cargo::rustc-env=VERSION_{variable}={version}");
    }
}

fn version<'a>(lock: &'a str, name: &str) -> Option<&'a str> {
    let entry = format!("name = \"{name}\"\nversion = \"");
    let (_, rest) = lock.split_once(&entry)?;
    rest.split('"').next()
}
