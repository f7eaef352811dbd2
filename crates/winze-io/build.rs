//! Sets `cfg(winze_data)` where the real clouds lie, so that tests which need them show as ignored
//! where they do not.
//!
//! The folder is that of the environment variable `WINZE_DATA`, else `../shared/data`, both from the
//! project's root. Where the variable is set, the tests run whatever is there, so that a mistyped
//! path fails them. Where the default folder appears only later, touch this file.

use std::path::Path;

/// What the tests read, by folder.
const FOLDERS: [&str; 4] = ["gazebo_tunnel", "jinchuan", "pairs", "worlds"];

fn main() {
    println!("cargo::rustc-check-cfg=cfg(winze_data)");
    println!("cargo::rerun-if-env-changed=WINZE_DATA");
    // The packages that share this script all lie two folders below the root.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let named = std::env::var_os("WINZE_DATA");
    let folder = root.join(named.as_deref().unwrap_or("../shared/data".as_ref()));
    if named.is_some() || FOLDERS.iter().all(|name| folder.join(name).is_dir()) {
        println!("cargo::rustc-cfg=winze_data");
    }
    // A package that watches what is not there is never up to date.
    if folder.exists() {
        println!("cargo::rerun-if-changed={}", folder.display());
    }
}
