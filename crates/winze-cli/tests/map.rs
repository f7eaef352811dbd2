//! `winze map`: built maps from the outside, and what is left of them when a build is killed.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

mod common;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use common::{locate, timeless, winze};
use serde_json::Value;
use winze::rng::Rng;
use winze_map::Map;

/// Points of a rough drift along x; `draw` picks other points of the same walls.
fn drift(n: usize, [from, to]: [f64; 2], draw: u64) -> String {
    let mut rng = Rng::new(draw, 1);
    let point = |_| {
        let (x, a) = (rng.range(from, to), rng.range(0.0, std::f64::consts::TAU));
        let rough = 0.3 * ((1.3 * x + 2.0 * a.sin()).sin() + (0.41 * x * x).cos() * a.cos());
        let r = 2.0 + rough + 0.1 * (5.0 * x + 3.0 * a).sin();
        format!("{x:.4} {:.4} {:.4}\n", r * a.cos(), 0.8 * r * a.sin())
    };
    (0..n).map(point).collect()
}

/// Settings that ask little.
const CHEAP: &str = "--set ransac.min_samples=4000 --set ransac.max_samples=8000";

/// A folder with two clouds of a drift, a query, and a map of the first.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let put = |name, text: String| std::fs::write(folder.path().join(name), text).unwrap();
        put("a.xyz", drift(8_000, [0.0, 12.0], 1));
        put("b.xyz", drift(8_000, [0.0, 12.0], 2));
        put("query.xyz", drift(4_000, [3.0, 9.0], 3));
        let run = winze(folder.path(), "map build a.xyz -o a.wmap --crs EPSG:32633");
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        assert!(run.stdout.contains("built in"), "{}", run.stdout);
        folder
    });
    folder.path()
}

/// `args` must fail, and say so in one line.
fn refused(folder: &Path, args: &str, wanted: &str) {
    let run = winze(folder, args);
    assert_eq!(run.code, Some(2), "{args}: {}{}", run.stdout, run.stderr);
    assert!(run.stderr.contains(wanted), "{args}: {}", run.stderr);
    assert_eq!(run.stderr.lines().count(), 1, "{args}: {}", run.stderr);
}

/// Temporary files of builds that were killed.
fn left_over(folder: &Path) -> Vec<PathBuf> {
    let names = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path());
    names
        .filter(|p| p.to_string_lossy().contains(".winze-tmp-"))
        .collect()
}

#[test]
fn a_map_is_built_told_of_verified_and_asked() {
    let f = folder();
    let told = winze(f, "map info a.wmap").stdout;
    for part in ["EPSG:32633", "levels", "a.xyz", "sha256:", "META 0"] {
        let found = told.contains(part.trim_end_matches('s'));
        assert!(found, "{part}: {told}");
    }
    let facts: Value = serde_json::from_str(&winze(f, "map info --json a.wmap").stdout).unwrap();
    for field in [
        "path",
        "bytes",
        "digest",
        "winze",
        "points",
        "origin",
        "crs",
        "bounds",
        "robust_bounds",
        "measure",
        "noise_floor",
        "noise_patch",
        "base_voxel",
        "base_points",
        "levels",
        "sources",
        "settings",
        "config_digest",
        "sections",
    ] {
        assert!(
            facts.get(field).is_some_and(|v| !v.is_null()),
            "{field}: {facts:#}"
        );
    }
    assert_eq!(facts["points"], 8_000);
    assert_eq!(
        facts["bytes"],
        std::fs::metadata(f.join("a.wmap")).unwrap().len()
    );
    assert_eq!(facts["sections"][0]["known"], true);
    let run = winze(f, "map check a.wmap");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stdout.starts_with("a.wmap: sound: "), "{}", run.stdout);
    let (built, code) = locate(f, &format!("a.wmap query.xyz {CHEAP}"));
    assert_eq!(code, Some(0), "{}", built["reason"]);
    assert_eq!(built["map"]["digest"], facts["digest"]);
    assert_eq!(built["map"]["points"], 8_000);
    // As its cloud answers.
    let (read, _) = locate(f, &format!("a.xyz query.xyz {CHEAP}"));
    let pose = |o| timeless(o)["map_from_query"].clone();
    assert_eq!(pose(built), pose(read));
}

#[test]
fn a_map_is_not_replaced_unless_asked_to_be() {
    let f = tempfile::tempdir().unwrap();
    let f = f.path();
    std::fs::write(f.join("a.xyz"), drift(2_000, [0.0, 6.0], 1)).unwrap();
    std::fs::write(f.join("a.wmap"), "mine").unwrap();
    refused(
        f,
        "map build a.xyz -o a.wmap",
        "a.wmap: exists; give --force",
    );
    assert_eq!(std::fs::read(f.join("a.wmap")).unwrap(), b"mine");
    refused(
        f,
        "map build a.xyz -o a.xyz --force",
        "would overwrite a.xyz",
    );
    refused(
        f,
        "map build a.xyz -o no/a.wmap",
        "its folder does not exist",
    );
    refused(f, "map build none.xyz -o b.wmap", "none.xyz");
    refused(f, "map build a.xyz -o . --force", "is a folder");
    assert_eq!(winze(f, "map build a.xyz -o a.wmap --force").code, Some(0));
    assert_eq!(winze(f, "map check a.wmap --quiet").code, Some(0));
    assert_eq!(
        std::fs::read_dir(f).unwrap().count(),
        2,
        "and no temporary file"
    );
}

#[test]
fn clouds_that_make_no_map_are_refused_and_nothing_is_left() {
    let f = tempfile::tempdir().unwrap();
    let f = f.path();
    let pcd = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 0\nHEIGHT 1\nPOINTS 0\n\
               DATA ascii\n";
    std::fs::write(f.join("none.pcd"), pcd).unwrap();
    std::fs::write(f.join("few.xyz"), drift(50, [0.0, 6.0], 1)).unwrap();
    std::fs::write(f.join("one.xyz"), "1 2 3\n".repeat(500)).unwrap();
    std::fs::write(f.join("a.xyz"), drift(2_000, [0.0, 6.0], 1)).unwrap();
    std::fs::write(f.join("no.xyz"), "").unwrap();
    refused(f, "map build none.pcd -o o.wmap", "at least 100 are needed");
    refused(
        f,
        "map build few.xyz -o o.wmap",
        "50, at least 100 are needed",
    );
    refused(f, "map build one.xyz -o o.wmap", "at least 100 are needed");
    refused(f, "map build no.xyz -o o.wmap", "no.xyz");
    // Six of its voxels are more than all of it.
    refused(f, "map build a.xyz -o o.wmap --set scale.voxel=2", "a.xyz");
    let sizes = "map build a.xyz -o o.wmap --set prepare.denoise_first=true";
    refused(f, sizes, "prepare.denoise_first = true");
    assert!(!f.join("o.wmap").exists());
    assert_eq!(left_over(f), Vec::<PathBuf>::new());
}

#[test]
fn a_cloud_smaller_than_a_descriptor_is_refused() {
    let f = tempfile::tempdir().unwrap();
    let text: String = (0..400)
        .map(|i| {
            format!(
                "{} {} 0\n",
                0.1 * f64::from(i % 20),
                0.1 * f64::from(i / 20)
            )
        })
        .collect();
    std::fs::write(f.path().join("patch.xyz"), text).unwrap();
    let args = "map build patch.xyz -o o.wmap --set fpfh.radius=5";
    refused(f.path(), args, "patch.xyz");
    assert_eq!(std::fs::read_dir(f.path()).unwrap().count(), 1);
}

#[test]
fn what_is_no_sound_map_is_refused_by_every_verb() {
    let f = tempfile::tempdir().unwrap();
    let sound = std::fs::read(folder().join("a.wmap")).unwrap();
    let put = |name: &str, bytes: &[u8]| std::fs::write(f.path().join(name), bytes).unwrap();
    put("text.wmap", b"1 2 3\n4 5 6\n");
    put("empty.wmap", b"");
    put("short.wmap", &sound[..sound.len() - 1000]);
    let mut newer = sound.clone();
    newer[8] = 2;
    let crc = crc32(&newer[..60]);
    newer[60..64].copy_from_slice(&crc.to_le_bytes());
    put("newer.wmap", &newer);
    let mut flipped = sound.clone();
    flipped[2_000] ^= 1;
    put("flipped.wmap", &flipped);
    let query = folder().join("query.xyz").display().to_string();
    for (name, wanted) in [
        ("text.wmap", "is no prepared map"),
        ("empty.wmap", "it is empty"),
        ("short.wmap", "cut short"),
        ("newer.wmap", "update winze"),
        ("none.wmap", "no such file"),
    ] {
        for args in [
            format!("map info {name}"),
            format!("map check {name}"),
            format!("locate {name} {query}"),
        ] {
            refused(f.path(), &args, wanted);
        }
    }
    refused(
        f.path(),
        "map check flipped.wmap",
        "its checksum does not match",
    );
    // Known by what is in it, whatever its name.
    put("map.pcd", &sound);
    let (outcome, _) = locate(f.path(), &format!("map.pcd {query} {CHEAP}"));
    assert_eq!(outcome["verdict"], "located");
}

/// As in zip and PNG, the slow way.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |mut crc: u32, byte| {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = crc >> 1 ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 };
        }
        crc
    })
}

#[test]
fn a_map_is_asked_with_the_settings_it_was_built_with() {
    let f = folder();
    let args = "locate a.wmap query.xyz --set fpfh.radius=0.9";
    refused(
        f,
        args,
        "fpfh.radius = 0.9: the map was built with 6 voxels",
    );
    let (outcome, code) = locate(
        f,
        &format!("a.wmap query.xyz {CHEAP} --set icp.max_iterations=20"),
    );
    assert_eq!(code, Some(0), "{}", outcome["reason"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_and_a_folder_that_takes_nothing_are_told() {
    use std::os::unix::fs::PermissionsExt;
    let f = folder();
    let run = winze(f, "map build a.xyz -o /dev/full --force");
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    assert!(run.stderr.contains("disk is full"), "{}", run.stderr);
    let closed = tempfile::tempdir().unwrap();
    std::fs::set_permissions(closed.path(), PermissionsExt::from_mode(0o555)).unwrap();
    // Root may write anywhere.
    if std::fs::write(closed.path().join("probe"), "").is_err() {
        let out = closed.path().join("a.wmap").display().to_string();
        refused(f, &format!("map build a.xyz -o {out}"), "not allowed");
    }
    // Where nothing can be put, whoever asks.
    refused(f, "map build a.xyz -o /proc/a.wmap", "/proc");
}

/// Kills builds at random moments. `WINZE_KILLS` sets how many.
#[test]
fn a_build_that_is_killed_leaves_the_old_map_or_the_new_one() {
    let kills: u64 = std::env::var("WINZE_KILLS").map_or(40, |n| n.parse().unwrap());
    let source = folder();
    let f = tempfile::tempdir().unwrap();
    let out = f.path().join("out.wmap");
    let start = |cloud: &str| {
        Command::new(env!("CARGO_BIN_EXE_winze"))
            .args(["map", "build", cloud, "--force", "--quiet", "-o"])
            .arg(&out)
            .current_dir(source)
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    };
    let mut slowest = Duration::ZERO;
    let maps = ["b.xyz", "a.xyz"].map(|cloud| {
        let begun = Instant::now();
        assert!(start(cloud).wait().unwrap().success());
        slowest = slowest.max(begun.elapsed());
        (cloud, std::fs::read(&out).unwrap())
    });
    let (mut rng, mut now) = (Rng::new(9, 0), 1);
    let (mut kept, mut replaced, mut most_left) = (0, 0, 0);
    for kill in 0..kills {
        let next = 1 - now;
        // Every fourth dies near the end, where the new map takes its name.
        let share = if kill.is_multiple_of(4) { 0.8 } else { 0.0 };
        let delay = slowest.mul_f64(rng.range(share, 1.2));
        let mut build = start(maps[next].0);
        std::thread::sleep(delay);
        build.kill().unwrap();
        build.wait().unwrap();
        let map = Map::open(&out).unwrap_or_else(|e| panic!("kill {kill} after {delay:?}: {e}"));
        map.check(&mut |_, _| ()).unwrap();
        let found = std::fs::read(&out).unwrap();
        if found == maps[next].1 {
            (replaced, now) = (replaced + 1, next);
        } else {
            assert!(
                found == maps[now].1,
                "kill {kill} after {delay:?}: neither map"
            );
            kept += 1;
        }
        most_left = most_left.max(left_over(f.path()).len());
    }
    println!(
        "{kills} kills within {:?}: {kept} left the old map, {replaced} the new one; at most {most_left} temporary files",
        slowest.mul_f64(1.2)
    );
    assert!(kept > 0 && replaced > 0, "{kept} old, {replaced} new");
    // A build clears away what those before it left.
    if cfg!(unix) {
        assert!(most_left <= 1, "{most_left} temporary files");
        assert!(start("a.xyz").wait().unwrap().success());
        assert_eq!(left_over(f.path()), Vec::<PathBuf>::new());
    }
}
