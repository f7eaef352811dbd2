//! `winze locate --bundle` and `winze replay`: the same answer, bit for bit, without the map.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

mod common;

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use common::{demo, timeless, winze};
use serde_json::Value;
use winze::rng::Rng;
use winze_bundle::Bundle;

/// Points of a rough drift along x; `draw` picks other points of the same walls.
fn drift(n: usize, [from, to]: [f64; 2], aside: f64, draw: u64) -> String {
    let mut rng = Rng::new(draw, 1);
    let point = |_| {
        let (x, a) = (rng.range(from, to), rng.range(0.0, std::f64::consts::TAU));
        let rough = 0.3 * ((1.3 * x + 2.0 * a.sin()).sin() + (0.41 * x * x).cos() * a.cos());
        let r = 2.0 + rough + 0.1 * (5.0 * x + 3.0 * a).sin();
        let y = aside + r * a.cos();
        format!("{x:.4} {y:.4} {:.4}\n", 0.8 * r * a.sin())
    };
    (0..n).map(point).collect()
}

/// Settings that ask little.
const CHEAP: &str = "--set ransac.min_samples=4000 --set ransac.max_samples=8000";

/// A folder with a cloud of a drift, a map built of it, a cloud of the drift and its twin, and queries.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let put = |name, text: String| std::fs::write(folder.path().join(name), text).unwrap();
        put("map.xyz", drift(8_000, [0.0, 12.0], 0.0, 1));
        let twin = drift(8_000, [0.0, 12.0], 30.0, 2);
        put("twins.xyz", drift(8_000, [0.0, 12.0], 0.0, 1) + &twin);
        put("query.XYZ", drift(4_000, [3.0, 9.0], 0.0, 3));
        put("elsewhere.xyz", drift(4_000, [40.0, 46.0], 0.0, 3));
        let ten = (0..10).map(|i| format!("{i} {} 0\n", i * i));
        put("ten.xyz", ten.collect());
        put("one.xyz", "1 2 3\n".repeat(50));
        let run = winze(folder.path(), "map build map.xyz -o map.wmap");
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        folder
    });
    folder.path()
}

/// Locates with `args`, replays what was kept at one and two threads from another folder, and compares; what was kept, and the verdict.
fn replayed(folder: &Path, args: &str) -> (tempfile::TempDir, String) {
    let away = tempfile::tempdir().unwrap();
    let kept = away.path().join("kept.zip").display().to_string();
    let then = winze(
        folder,
        &format!("locate --quiet --json - --bundle {kept} {args}"),
    );
    assert!(then.stderr.is_empty(), "{args}: {}", then.stderr);
    let parse = |text: &str| -> Value { serde_json::from_str(text).unwrap() };
    let outcome = timeless(parse(&then.stdout));
    for threads in [1, 2] {
        let now = winze(
            away.path(),
            &format!("replay kept.zip --json - --threads {threads}"),
        );
        assert_eq!(now.code, then.code, "{args}: {}", now.stderr);
        assert_eq!(timeless(parse(&now.stdout)), outcome, "{args}");
        let said = "the same answer, bit for bit, as was recorded in kept.zip";
        assert!(now.stderr.contains(said), "{args}: {}", now.stderr);
    }
    let verdict = outcome["verdict"].as_str().unwrap().to_owned();
    assert_eq!(then.code, Some(i32::from(verdict != "located")), "{args}");
    (away, verdict)
}

/// `args` must fail, and say so in one line.
fn refused(folder: &Path, args: &str, wanted: &str) {
    let run = winze(folder, args);
    assert_eq!(run.code, Some(2), "{args}: {}{}", run.stdout, run.stderr);
    assert!(run.stderr.contains(wanted), "{args}: {}", run.stderr);
    assert_eq!(run.stderr.lines().count(), 1, "{args}: {}", run.stderr);
}

#[test]
fn a_located_query_is_replayed_without_the_map_and_shown() {
    let (away, verdict) = replayed(demo(), "map.pcd query.pcd --truth truth.txt");
    assert_eq!(verdict, "located");
    let a = away.path();
    let run = winze(
        a,
        "replay kept.zip --report r.html --picture p.png --save-aligned a.ply --json o.json",
    );
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(
        run.stdout.starts_with("verdict       located"),
        "{}",
        run.stdout
    );
    assert!(std::fs::read(a.join("p.png")).unwrap().len() > 50_000);
    assert!(a.join("r.html").exists() && a.join("a.ply").exists() && a.join("o.json").exists());
    // And with the map at hand.
    let map = demo().join("map.pcd").display().to_string();
    let run = winze(a, &format!("replay kept.zip --map {map}"));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stderr.contains("the same answer, bit for bit"));
    let quiet = winze(a, "replay kept.zip --quiet");
    assert_eq!(
        (quiet.code, &*quiet.stdout, &*quiet.stderr),
        (Some(0), "", "")
    );
}

#[test]
fn every_method_is_replayed() {
    for method in [
        "auto",
        "fpfh",
        "fpfh+ndt",
        "fpfh+icp",
        "ndt+icp",
        "fpfh+ndt+icp",
    ] {
        let args = format!("map.xyz query.XYZ --seed 3 --method {method} {CHEAP}");
        assert_eq!(replayed(folder(), &args).1, "located", "{method}");
    }
}

#[test]
fn a_built_map_is_replayed() {
    for method in ["auto", "fpfh+ndt+icp"] {
        let args = format!("map.wmap query.XYZ --method {method} {CHEAP}");
        let (away, verdict) = replayed(folder(), &args);
        assert_eq!(verdict, "located", "{method}");
        let map = folder().join("map.wmap").display().to_string();
        let run = winze(away.path(), &format!("replay kept.zip --quiet --map {map}"));
        assert_eq!(run.code, Some(0), "{}", run.stderr);
    }
}

#[test]
fn other_verdicts_are_replayed() {
    for (args, wanted) in [
        ("twins.xyz query.XYZ", "ambiguous"),
        ("map.xyz elsewhere.xyz", "not_found"),
        ("map.xyz ten.xyz --truth t.txt", "insufficient"),
        ("map.xyz one.xyz", "insufficient"),
        ("map.wmap ten.xyz", "insufficient"),
        (
            "map.xyz query.XYZ --near 1,0,0,1 --gravity-aligned",
            "not_found",
        ),
        ("twins.xyz query.XYZ --near 6,0,0,4", "located"),
    ] {
        let truth = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
        std::fs::write(folder().join("t.txt"), truth).unwrap();
        assert_eq!(replayed(folder(), args).1, wanted, "{args}");
    }
}

#[test]
fn what_can_slide_is_replayed() {
    let bare = |n: u32, length: f64| -> String {
        let point = |i: u32| {
            let (x, a) = (
                length * (f64::from(i) * 0.618_034).fract(),
                f64::from(i) * 2.4,
            );
            format!("{x:.4} {:.4} {:.4}\n", 2.0 * a.cos(), 2.0 * a.sin())
        };
        (0..n).map(point).collect()
    };
    let out = tempfile::tempdir().unwrap();
    std::fs::write(out.path().join("tube.xyz"), bare(20_000, 40.0)).unwrap();
    std::fs::write(out.path().join("part.xyz"), bare(4_000, 8.0)).unwrap();
    let (_, verdict) = replayed(out.path(), "tube.xyz part.xyz --method ndt+icp");
    assert_ne!(verdict, "located");
}

#[test]
#[cfg(unix)]
fn a_query_from_a_pipe_is_kept_too() {
    let out = tempfile::tempdir().unwrap();
    let query = std::fs::File::open(folder().join("query.XYZ")).unwrap();
    let kept = out.path().join("kept.zip");
    let run = Command::new(env!("CARGO_BIN_EXE_winze"))
        .args(["locate", "--quiet", "map.xyz", "/dev/stdin", "--bundle"])
        .arg(&kept)
        .current_dir(folder())
        .stdin(query)
        .stdout(Stdio::null())
        .status()
        .unwrap();
    assert_eq!(run.code(), Some(0));
    assert_eq!(winze(out.path(), "replay --quiet kept.zip").code, Some(0));
    let bytes = Bundle::open(&kept).unwrap().query.bytes;
    assert_eq!(bytes, std::fs::read(folder().join("query.XYZ")).unwrap());
}

#[test]
#[cfg(target_os = "linux")]
fn a_file_that_cannot_be_written_does_not_cost_the_bundle() {
    let away = tempfile::tempdir().unwrap();
    let kept = away.path().join("kept.zip");
    let args = format!(
        "locate --quiet map.xyz query.XYZ --json /dev/full --bundle {}",
        kept.display()
    );
    let run = winze(folder(), &args);
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    assert!(run.stderr.contains("/dev/full"), "{}", run.stderr);
    assert!(Bundle::open(&kept).is_ok());
    refused(
        folder(),
        "locate map.xyz query.XYZ --bundle -",
        "name a file",
    );
}

#[test]
fn what_is_not_as_it_was_is_told() {
    let (away, _) = replayed(folder(), "map.xyz query.XYZ");
    let a = away.path();
    let at = |name: &str| a.join(name);
    // Another map, and settings that are not those of then.
    let other = folder().join("twins.xyz").display().to_string();
    refused(
        a,
        &format!("replay kept.zip --map {other}"),
        "is not the map that was asked then",
    );
    refused(a, "replay kept.zip --set scale.voxel=0.3", "leave this out");
    refused(a, "replay kept.zip --seed 3", "leave this out");
    refused(a, "replay none.zip", "no such file");
    refused(a, "replay kept.zip --json kept.zip", "would overwrite");
    // An answer that was changed, and a map that was.
    let kept = Bundle::open(&at("kept.zip")).unwrap();
    let mut changed = kept.clone();
    changed.outcome = kept.outcome.replace("\"located\"", "\"ambiguous\"");
    changed.write(&at("changed.zip")).unwrap();
    let run = winze(a, "replay changed.zip");
    assert_eq!(run.code, Some(2));
    assert!(run.stdout.contains("located"), "what it is now is shown");
    assert!(
        run.stderr
            .contains("verdict (then \"ambiguous\", now \"located\")"),
        "{}",
        run.stderr
    );
    // Of another version the answer counts, not the version.
    let mut older = kept.clone();
    let version = format!("\"winze\": \"{}\"", env!("CARGO_PKG_VERSION"));
    older.outcome = kept.outcome.replace(&version, "\"winze\": \"0.0.9\"");
    older.winze = "0.0.9".into();
    older.write(&at("older.zip")).unwrap();
    let run = winze(a, "replay older.zip");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stderr.contains("the same answer"), "{}", run.stderr);
    assert!(
        run.stderr.contains("taken from the bundle"),
        "{}",
        run.stderr
    );
    let mut changed = kept.clone();
    for p in changed.part.levels.iter_mut().flat_map(|l| &mut l.points) {
        p[0] += 0.01;
    }
    changed.write(&at("changed.zip")).unwrap();
    refused(
        a,
        "replay --quiet changed.zip",
        "the answer is not the one recorded",
    );
    let mut changed = kept;
    changed.part.levels.clear();
    changed.write(&at("changed.zip")).unwrap();
    refused(a, "replay changed.zip", "give the whole map");
    // Bytes that were changed, and ones that are missing.
    let bytes = std::fs::read(at("kept.zip")).unwrap();
    let mut flipped = bytes.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    std::fs::write(at("flipped.zip"), flipped).unwrap();
    refused(a, "replay flipped.zip", "get the bundle anew");
    std::fs::write(at("cut.zip"), &bytes[..bytes.len() - 9]).unwrap();
    refused(a, "replay cut.zip", "is no bundle");
    // Nothing is written over the inputs, or where nothing can be.
    let run = |args: &str, wanted: &str| refused(folder(), args, wanted);
    run(
        "locate map.xyz query.XYZ --bundle map.xyz",
        "would overwrite",
    );
    run(
        "locate map.xyz query.XYZ --bundle no/where.zip",
        "its folder does not exist",
    );
}
