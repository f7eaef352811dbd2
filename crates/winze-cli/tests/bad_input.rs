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
fn refused(folder: &Path, args: &str, parts: &[&str]) {
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
            &["points in the map"],
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
fn odd_scales_end_and_take_no_memory() {
    // Voxels of a micrometre and of a thousand kilometres.
    for voxel in ["0.000001", "1000000"] {
        let args = format!(
            "map.pcd query.pcd --set scale.voxel={voxel} --set prepare.statistical_neighbours=0 --set iss.max_keypoints=500"
        );
        let run = winze(demo(), &format!("locate --quiet --json - {args}"));
        assert!(
            matches!(run.code, Some(1 | 2)),
            "{voxel}: {}{}",
            run.stdout,
            run.stderr
        );
    }
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_nothing_half_written() {
    use std::process::{Command, Stdio};
    use std::time::Duration;

    let out = tempfile::tempdir().unwrap();
    for milliseconds in [50, 150, 300, 500, 800] {
        let target = out.path().join("c.csv");
        let mut child = Command::new(env!("CARGO_BIN_EXE_winze"))
            .args(["convert", "map.pcd"])
            .arg(&target)
            .current_dir(demo())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(milliseconds));
        let pid = child.id().to_string();
        // It may have ended by itself, and then there is nobody to interrupt.
        let _ = Command::new("kill")
            .args(["-INT", &pid])
            .stderr(Stdio::null())
            .status();
        let status = child.wait().unwrap();
        let names: Vec<_> = std::fs::read_dir(out.path())
            .unwrap()
            .map(|e| e.unwrap().file_name())
            .collect();
        match status.code() {
            Some(0) => assert_eq!(names, ["c.csv"]),
            Some(130) => assert!(names.is_empty() || names == ["c.csv"], "{names:?}"),
            other => panic!("ended with {other:?}"),
        }
        let whole = std::fs::read_to_string(&target)
            .map(|t| t.ends_with('\n'))
            .unwrap_or(true);
        assert!(whole, "half a file after {milliseconds} ms");
        let _ = std::fs::remove_file(&target);
    }
}
