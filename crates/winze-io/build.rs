//! Sets `cfg(winze_data)` where the real clouds lie, so that tests which need them show as ignored
//! where they do not.
//!
//! The folder is that of the environment variable `WINZE_DATA`, else `../shared/data` from the
//! project's root. Where it appears only later, set the variable or touch this file.

use std::path::PathBuf;

fn main() {
    println!("cargo::rustc-check-cfg=cfg(winze_data)");
    println!("cargo::rerun-if-env-changed=WINZE_DATA");
    println!("cargo::rerun-if-changed=build.rs");
    let folder = std::env::var_os("WINZE_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    if folder.is_dir() {
        println!("cargo::rustc-cfg=winze_data");
        println!("cargo::rerun-if-changed={}", folder.display());
    }
}
