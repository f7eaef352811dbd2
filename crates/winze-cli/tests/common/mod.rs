//! Runs the program and looks at what it says.
#![allow(
    dead_code,
    unreachable_pub,
    clippy::unwrap_used,
    clippy::panic,
    reason = "shared by several test programs"
)]

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use serde_json::Value;

/// What a run left behind.
pub struct Run {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

/// Runs `winze` with `args`, words split at blanks, in `folder`.
pub fn winze(folder: &Path, args: &str) -> Run {
    let out = Command::new(env!("CARGO_BIN_EXE_winze"))
        .args(args.split_whitespace())
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let run = Run {
        code: out.status.code(),
        stdout: String::from_utf8(out.stdout).unwrap(),
        stderr: String::from_utf8(out.stderr).unwrap(),
    };
    assert!(!run.stderr.contains("panicked"), "{args}: {}", run.stderr);
    run
}

/// The outcome of `locate` with `args`, and the exit code.
pub fn locate(folder: &Path, args: &str) -> (Value, Option<i32>) {
    let run = winze(folder, &format!("locate --quiet --json - {args}"));
    let outcome = serde_json::from_str(&run.stdout)
        .unwrap_or_else(|e| panic!("{args}: {e}\n{}{}", run.stdout, run.stderr));
    (outcome, run.code)
}

/// The outcome without its times, the one thing that may differ between runs.
pub fn timeless(mut outcome: Value) -> Value {
    fn strip(v: &mut Value) {
        match v {
            Value::Object(map) => {
                map.remove("seconds");
                map.values_mut().for_each(strip);
            }
            Value::Array(list) => list.iter_mut().for_each(strip),
            _ => {}
        }
    }
    strip(&mut outcome);
    outcome
}

/// A folder with the clouds of the demo, made once a test program.
pub fn demo() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let run = winze(folder.path(), "demo --out .");
        assert_eq!(run.code, Some(0), "{}{}", run.stdout, run.stderr);
        std::fs::write(folder.path().join("said.txt"), run.stdout).unwrap();
        folder
    });
    folder.path()
}
