//! Refuses to build xatlas with the wrong flags.
//!
//! The flags come from `.cargo/config.toml`, which Cargo reads only when it is started inside this repository (for
//! example not for `cargo install --git` or a dependency). Without them xatlas aborts the process on odd meshes and
//! crashes on machines with one CPU, so a build that lacks them must stop here and say what to do.

fn main() {
    println!("cargo::rerun-if-env-changed=CXXFLAGS");
    println!("cargo::rerun-if-changed=build.rs");
    let flags = std::env::var("CXXFLAGS").unwrap_or_default();
    for needed in ["-std=c++14", "-DNDEBUG", "-DXA_MULTITHREADED=0"] {
        if !flags.split_whitespace().any(|flag| flag == needed) {
            println!(
                "cargo::error=the environment variable CXXFLAGS lacks {needed}, which xatlas needs; build inside the \
                 repository (its .cargo/config.toml sets it), or set CXXFLAGS=\"-std=c++14 -DNDEBUG \
                 -DXA_MULTITHREADED=0\""
            );
        }
    }
}
