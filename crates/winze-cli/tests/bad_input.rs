//! Whatever it is given, it says one clear line or answers honestly. Never a panic, never a hang.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

mod common;

use std::fmt::Write as _;
use std::path::Path;

use common::{demo, locate, winze};

fn write_points(folder: &Path, name: &str, points: impl Iterator<Item = [f64; 3]>) {
    let mut text = String::new();
    for p in points {
        writeln!(text, "{} {} {}", p[0], p[1], p[2]).unwrap();
    }
    std::fs::write(folder.join(name), text).unwrap();
}

/// Evenly scattered numbers without a generator.
fn scatter(i: u32, k: f64) -> f64 {
    (f64::from(i) * k).fract()
}

fn clouds() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    write_points(f, "nan.xyz", (0..50).map(|_| [f64::NAN; 3]));
    write_points(f, "one.xyz", (0..1).map(|_| [1.0, 2.0, 3.0]));
    write_points(f, "equal.xyz", (0..5000).map(|_| [1.0, 2.0, 3.0]));
    write_points(
        f,
        "line.xyz",
        (0..5000).map(|i| [f64::from(i) * 0.01, 0.0, 0.0]),
    );
    write_points(
        f,
        "plane.xyz",
        (0..20_000).map(|i| {
            [
                10.0 * scatter(i, 0.618_034),
                10.0 * scatter(i, 0.414_214),
                0.0,
            ]
        }),
    );
    write_points(
        f,
        "grid.xyz",
        (0..10_000).map(|i| [f64::from(i % 100) * 0.1, f64::from(i / 100) * 0.1, 0.0]),
    );
    write_points(
        f,
        "ten.xyz",
        (0..10).map(|i| [scatter(i, 0.618), scatter(i, 0.414), scatter(i, 0.732)]),
    );
    let stray = (0..4000).map(|i| {
        if i == 7 {
            [1e30, 0.0, 0.0]
        } else {
            [
                10.0 * scatter(i, 0.618),
                10.0 * scatter(i, 0.414),
                scatter(i, 0.732),
            ]
        }
    });
    write_points(f, "stray.xyz", stray);
    write_points(
        f,
        "huge.xyz",
        (0..1000).map(|i| [1e30 * scatter(i, 0.618), 1e30, 3.0]),
    );
    std::fs::write(f.join("empty.xyz"), "").unwrap();
    std::fs::write(f.join("empty.pcd"), "").unwrap();
    let lie = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 4000000000\nHEIGHT 1\nPOINTS 4000000000\nDATA binary\nabc";
    std::fs::write(f.join("lie.pcd"), lie).unwrap();
    let lie = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\nabc";
    std::fs::write(f.join("lie.ply"), lie).unwrap();
    let whole = std::fs::read(demo().join("query.pcd")).unwrap();
    std::fs::write(f.join("cut.pcd"), &whole[..whole.len() / 2]).unwrap();
    std::fs::create_dir(f.join("folder.pcd")).unwrap();
    folder
}

/// One line that says where and what, exit code 2.
fn refused(folder: &Path, args: &str, parts: &[&str]) -> String {
    let run = winze(folder, args);
    assert_eq!(run.code, Some(2), "{args}: {}{}", run.stdout, run.stderr);
    assert!(run.stdout.is_empty(), "{args}: {}", run.stdout);
    let errors: Vec<&str> = run
        .stderr
        .lines()
        .filter(|l| l.starts_with("winze: error: "))
        .collect();
    assert_eq!(errors.len(), 1, "{args}: {}", run.stderr);
    for part in parts {
        assert!(
            errors[0].contains(part),
            "{args}: {} does not name {part}",
            errors[0]
        );
    }
    errors[0].to_owned()
}

#[test]
fn bad_clouds() {
    let folder = clouds();
    let map = demo().join("map.pcd").display().to_string();
    let query = demo().join("query.pcd").display().to_string();
    for (name, verdict) in [
        ("nan.xyz", "insufficient"),
        ("one.xyz", "insufficient"),
        ("equal.xyz", "insufficient"),
        ("line.xyz", "insufficient"),
        ("ten.xyz", "insufficient"),
        ("plane.xyz", "not_found"),
        ("grid.xyz", "not_found"),
        ("stray.xyz", "not_found"),
    ] {
        let (outcome, code) = locate(folder.path(), &format!("{map} {name}"));
        assert_eq!(
            (outcome["verdict"].as_str(), code),
            (Some(verdict), Some(1)),
            "{name}: {}",
            outcome["reason"]
        );
    }
    for name in ["nan.xyz", "one.xyz", "equal.xyz", "ten.xyz"] {
        refused(
            folder.path(),
            &format!("locate {name} {query}"),
            &[name, "points in the map", "check its file"],
        );
    }
    for name in ["line.xyz", "plane.xyz"] {
        let (outcome, code) = locate(folder.path(), &format!("{name} {query}"));
        assert_eq!(
            (outcome["verdict"].as_str(), code),
            (Some("not_found"), Some(1)),
            "{name}"
        );
    }
    for (name, part) in [
        ("huge.xyz", "too wide"),
        ("empty.xyz", "no points"),
        ("empty.pcd", "cut short"),
        ("lie.pcd", "4000000000"),
        ("lie.ply", "4000000000"),
        ("cut.pcd", "cut short"),
        ("folder.pcd", "folder"),
        ("missing.pcd", "no such file"),
    ] {
        refused(
            folder.path(),
            &format!("locate {map} {name}"),
            &[name, part],
        );
        refused(
            folder.path(),
            &format!("locate {name} {query}"),
            &[name, part],
        );
        refused(folder.path(), &format!("info {name}"), &[name, part]);
        refused(
            folder.path(),
            &format!("convert {name} out.ply"),
            &[name, part],
        );
    }
    assert!(!folder.path().join("out.ply").exists());
}

#[test]
fn bad_words() {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    std::fs::write(f.join("negative.toml"), "[fpfh]\nradius = -1\n").unwrap();
    std::fs::write(f.join("misspelt.toml"), "[fpfh]\nradus = 1\n").unwrap();
    std::fs::write(f.join("broken.toml"), "[fpfh\nradius = 1\n").unwrap();
    std::fs::write(f.join("short.txt"), "1 0 0 0\n0 1 0\n").unwrap();
    let start = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    std::fs::write(f.join("start.txt"), start).unwrap();
    std::fs::write(
        f.join("mirror.txt"),
        "-1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n",
    )
    .unwrap();
    let clouds = format!("{0}/map.pcd {0}/query.pcd", demo().display());
    for (flags, parts) in [
        (
            "--config negative.toml",
            ["negative.toml", "fpfh.radius = -1 m: must be above 0"],
        ),
        ("--config misspelt.toml", ["misspelt.toml", "radus"]),
        ("--config broken.toml", ["broken.toml", "line 1"]),
        ("--config missing.toml", ["missing.toml", "cannot be read"]),
        (
            "--set ransac.confidence=2",
            ["ransac.confidence = 2", "must lie between"],
        ),
        ("--set ransac.confidnce=0.9", ["confidnce", "confidence"]),
        ("--set scale.voxel", ["scale.voxel", "KEY=VALUE"]),
        ("--truth short.txt", ["short.txt", "16"]),
        ("--truth mirror.txt", ["mirror.txt", "rigid"]),
        ("--initial missing.txt", ["missing.txt", "no such file"]),
        ("--initial start.txt", ["--initial", "ndt+icp"]),
        ("--near 1e5,0,0,4", ["--near", "map's frame"]),
        ("--save-aligned out.pts", ["out.pts", ".pcd"]),
        ("--json .", [".: is a folder", "name a file"]),
        (
            "--json short.txt --truth short.txt",
            ["overwrite", "another name"],
        ),
        (
            "--json o.json --report o.json",
            ["overwrite", "another name"],
        ),
        ("--save-aligned out.stl", ["out.stl", ".pcd"]),
        ("--picture nowhere/p.png", ["nowhere/p.png", "folder"]),
    ] {
        refused(f, &format!("locate {clouds} {flags}"), &parts);
    }
    for flags in [
        "--method icp",
        "--near 1,2,3",
        "--threads many",
        "--seed -1",
        "--colour",
    ] {
        assert_eq!(
            winze(f, &format!("locate {clouds} {flags}")).code,
            Some(2),
            "{flags}"
        );
    }
    assert_eq!(winze(f, "locate").code, Some(2));
    assert_eq!(winze(f, "dig").code, Some(2));
}

#[test]
fn inputs_are_not_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let query = folder.path().join("q.pcd");
    std::fs::copy(demo().join("query.pcd"), &query).unwrap();
    let map = demo().join("map.pcd").display().to_string();
    let before = std::fs::read(&query).unwrap();
    for args in [
        format!("locate {map} q.pcd --json q.pcd"),
        format!("locate {map} q.pcd --save-aligned ./q.pcd"),
        "convert q.pcd q.pcd".into(),
        "demo --out .".into(),
    ] {
        let said = refused(folder.path(), &args, &[]);
        assert!(
            said.contains("another name") || said.contains("--out"),
            "{said}"
        );
        assert_eq!(std::fs::read(&query).unwrap(), before, "{args}");
    }
}

/// A run that may take this much address space and no more.
#[cfg(target_os = "linux")]
fn winze_within(megabytes: u64, folder: &Path, args: &str) -> std::process::Output {
    let program = env!("CARGO_BIN_EXE_winze");
    std::process::Command::new("sh")
        .args([
            "-c",
            &format!(
                "ulimit -v {}; exec {program} --threads 2 {args}",
                megabytes * 1024
            ),
        ])
        .current_dir(folder)
        .output()
        .unwrap()
}

#[cfg(target_os = "linux")]
#[test]
fn lying_files_and_odd_scales_take_no_memory_that_the_file_does_not_warrant() {
    let folder = clouds();
    for name in ["lie.pcd", "lie.ply", "cut.pcd", "empty.pcd"] {
        let out = winze_within(300, folder.path(), &format!("info {name}"));
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{name}: {said}");
        assert!(said.contains(name), "{said}");
    }
    // Voxels of a micrometre and of a thousand kilometres.
    for voxel in ["0.000001", "1000000"] {
        let args = format!(
            "locate --quiet --json - map.pcd query.pcd --set scale.voxel={voxel} --set prepare.statistical_neighbours=0 --set iss.max_keypoints=500"
        );
        let out = winze_within(1500, demo(), &args);
        assert!(
            matches!(out.status.code(), Some(1 | 2)),
            "{voxel}: {}",
            String::from_utf8_lossy(&out.stderr)
        );
    }
}

#[cfg(unix)]
#[test]
fn nobody_reading_does_not_make_it_located() {
    let folder = clouds();
    let map = demo().join("map.pcd").display().to_string();
    for flags in ["--json -", ""] {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_winze"))
            .args(format!("locate {map} ten.xyz {flags}").split_whitespace())
            .current_dir(folder.path())
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        assert_eq!(child.wait().unwrap().code(), Some(1), "{flags}");
    }
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_nothing_half_written() {
    use std::process::{Command, Stdio};
    use std::time::Duration;

    let out = tempfile::tempdir().unwrap();
    let names = || -> Vec<String> {
        std::fs::read_dir(out.path())
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect()
    };
    let mut stopped = 0;
    for _ in 0..20 {
        let target = out.path().join("c.csv");
        let mut child = Command::new(env!("CARGO_BIN_EXE_winze"))
            .args(["convert", "map.pcd"])
            .arg(&target)
            .current_dir(demo())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // Strike while it writes: a temporary file is there.
        while names().is_empty() && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        let pid = child.id().to_string();
        let _ = Command::new("kill")
            .args(["-INT", &pid])
            .stderr(Stdio::null())
            .status();
        let code = child.wait().unwrap().code();
        assert!(matches!(code, Some(0 | 130)), "{code:?}");
        assert!(names().is_empty() || names() == ["c.csv"], "{:?}", names());
        if let Ok(text) = std::fs::read_to_string(&target) {
            assert!(text.ends_with('\n'), "half a file");
            std::fs::remove_file(&target).unwrap();
        }
        stopped += u32::from(code == Some(130));
        if stopped == 3 {
            return;
        }
    }
    panic!("it always ended before it could be stopped");
}
