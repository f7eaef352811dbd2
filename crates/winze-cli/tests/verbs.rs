//! Every verb, end to end, as a user would type it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

mod common;

use common::{demo, locate, timeless, winze};

#[test]
fn the_demo_locates_its_query_and_shows_it() {
    let folder = demo();
    let said = std::fs::read_to_string(folder.join("said.txt")).unwrap();
    for part in [
        "verdict       located",
        "describe map",
        "refine by ICP",
        "error",
    ] {
        assert!(said.contains(part), "{said}");
    }
    let json = std::fs::read_to_string(folder.join("outcome.json")).unwrap();
    let outcome: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(outcome["verdict"], "located");
    assert!(
        outcome["error"]["translation_m"].as_f64().unwrap() < 0.05,
        "{json}"
    );
    assert!(
        outcome["error"]["rotation_deg"].as_f64().unwrap() < 0.5,
        "{json}"
    );
    // As sure as what was counted allows, and no surer.
    let confidence = outcome["confidence"].as_f64().unwrap();
    assert!((0.95..0.999).contains(&confidence), "{confidence}");
    // The demo's pose is good to a few centimetres, and says so.
    for field in ["covariance", "covariance_at_origin"] {
        let variance = |i: usize| outcome[field][i][i].as_f64().unwrap();
        for i in 0..6 {
            assert!(variance(i) > 0.0, "{field}");
        }
    }
    for i in 0..3 {
        let sigma = outcome["covariance"][i][i].as_f64().unwrap().sqrt();
        assert!(sigma > 0.0005 && sigma < 0.1, "{sigma}");
    }
    let png = std::fs::read(folder.join("before_and_after.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 50_000);
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    // Nothing can be fetched, nor is anything named that would have to be; crates/winze-report/browser looks at it as people do.
    for part in [
        "data:image/png;base64,",
        "default-src 'none'",
        "id=\"scene-0\"",
        "60 of 88 patches agree",
        "winze locate ",
    ] {
        assert!(page.contains(part), "{part}");
    }
    for part in ["src=\"http", "href=\"http", "<link", "@import", "url("] {
        assert!(!page.contains(part), "{part}");
    }
}

#[test]
fn locate_from_the_files_gives_the_demo_s_answer() {
    let (from_files, code) = locate(demo(), "map.pcd query.pcd --truth truth.txt");
    assert_eq!(
        (from_files["verdict"].as_str(), code),
        (Some("located"), Some(0))
    );
    let json = std::fs::read_to_string(demo().join("outcome.json")).unwrap();
    let in_memory: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(from_files["map_from_query"], in_memory["map_from_query"]);
    assert_eq!(from_files["config_digest"], in_memory["config_digest"]);
    assert!(
        from_files["map"]["digest"]
            .as_str()
            .unwrap()
            .starts_with("sha256:")
    );
}

#[test]
fn the_same_json_at_any_thread_count_for_every_method() {
    for method in [
        "auto",
        "fpfh",
        "fpfh+ndt",
        "fpfh+icp",
        "ndt+icp --initial truth.txt",
        "fpfh+ndt+icp",
    ] {
        let run = |threads| {
            let args = format!("map.pcd query.pcd --method {method} --seed 3 --threads {threads}");
            timeless(locate(demo(), &args).0)
        };
        let one = run(1);
        assert_eq!(one["verdict"], "located", "{method}: {}", one["reason"]);
        assert_eq!(one, run(2), "{method} at 2 threads");
        assert_eq!(one, run(8), "{method} at 8 threads");
    }
}

#[test]
fn a_query_from_other_rock_on_the_same_plan_is_not_located() {
    let other = tempfile::tempdir().unwrap();
    assert_eq!(
        winze(other.path(), "demo --quiet --seed 1 --out .").code,
        Some(0)
    );
    let query = other.path().join("query.pcd");
    let (outcome, code) = locate(demo(), &format!("map.pcd {}", query.display()));
    assert_ne!(outcome["verdict"], "located", "{}", outcome["reason"]);
    assert_eq!(code, Some(1));
    // The paper's metric would have believed it.
    assert!(outcome["inlier_fraction"].as_f64().unwrap() > 0.9);
}

#[test]
fn what_is_known_beforehand_helps_and_rules_out() {
    let (outcome, code) = locate(
        demo(),
        "map.pcd query.pcd --near 66,-1,4,15 --truth truth.txt",
    );
    assert_eq!(code, Some(0), "{}", outcome["reason"]);
    assert!(outcome["error"]["translation_m"].as_f64().unwrap() < 0.05);
    assert_eq!(outcome["request"]["near"][3], 15.0);
    let (outcome, code) = locate(demo(), "map.pcd query.pcd --near 5,0,1,6");
    assert_eq!(code, Some(1), "{}", outcome["reason"]);
    // The demo's query frame is not upright.
    let (outcome, code) = locate(demo(), "map.pcd query.pcd --gravity-aligned");
    assert_eq!(code, Some(1), "{}", outcome["reason"]);
    winze(demo(), "convert aligned.pcd upright.ply");
    let (outcome, code) = locate(demo(), "map.pcd upright.ply --gravity-aligned");
    assert_eq!(code, Some(0), "{}", outcome["reason"]);
}

#[test]
fn outputs_are_written_and_stdout_is_data() {
    let out = tempfile::tempdir().unwrap();
    let at = |name: &str| out.path().join(name).display().to_string();
    let args = format!(
        "locate map.pcd query.pcd --json {} --picture {} --report {} --save-aligned {}",
        at("o.json"),
        at("p.png"),
        at("r.html"),
        at("a.ply")
    );
    let run = winze(demo(), &args);
    assert_eq!(run.code, Some(0));
    assert!(
        run.stdout.starts_with("verdict") && run.stderr.is_empty(),
        "{}",
        run.stderr
    );
    let mut names: Vec<_> = std::fs::read_dir(out.path())
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(
        names,
        ["a.ply", "o.json", "p.png", "r.html"],
        "and no temporary file"
    );
    // The aligned query lies in the map where it is.
    let (outcome, _) = locate(demo(), &format!("map.pcd {} --method ndt+icp", at("a.ply")));
    let m = &outcome["map_from_query"];
    for i in 0..3 {
        assert!(m[i][3].as_f64().unwrap().abs() < 0.05, "{m}");
    }
}

#[test]
fn convert_and_info_agree_about_a_cloud() {
    let out = tempfile::tempdir().unwrap();
    for (name, encoding) in [
        ("c.pcd", "compressed"),
        ("c.ply", "ascii"),
        ("c.csv", "ascii"),
    ] {
        let path = out.path().join(name);
        let run = winze(
            demo(),
            &format!("convert query.pcd {} --encoding {encoding}", path.display()),
        );
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let facts = |path: &str| -> serde_json::Value {
            serde_json::from_str(&winze(demo(), &format!("info --json {path}")).stdout).unwrap()
        };
        let (before, after) = (facts("query.pcd"), facts(&path.display().to_string()));
        for field in ["points", "low", "high", "spacing"] {
            assert!(!before[field].is_null(), "{field}");
            assert_eq!(before[field], after[field], "{name}: {field}");
        }
    }
    let table = winze(demo(), "info query.pcd map.pcd").stdout;
    assert_eq!(table.matches("spacing").count(), 2, "{table}");
}

#[test]
fn printed_settings_can_be_given_back() {
    let out = tempfile::tempdir().unwrap();
    let text = winze(out.path(), "config --set iss.gamma_21=0.9 --seed 5").stdout;
    std::fs::write(out.path().join("w.toml"), &text).unwrap();
    assert_eq!(winze(out.path(), "config --config w.toml").stdout, text);
}

#[test]
fn help_for_shells_and_man() {
    let here = std::env::current_dir().unwrap();
    for shell in ["bash", "zsh", "fish"] {
        assert!(
            winze(&here, &format!("completions {shell}"))
                .stdout
                .contains("locate")
        );
    }
    let man = winze(&here, "man").stdout;
    assert!(
        man.contains("winze-locate") && man.contains("gravity"),
        "{man}"
    );
    assert_eq!(
        winze(&here, "--version").stdout.trim(),
        concat!("winze ", env!("CARGO_PKG_VERSION"))
    );
}

/// The contract that programs rely on: every field is there, whatever the verdict.
#[test]
fn the_json_has_every_field_of_the_contract() {
    let folder = tempfile::tempdir().unwrap();
    let points: String = (0..10).map(|i| format!("{i} {} 0\n", i * i)).collect();
    std::fs::write(folder.path().join("ten.xyz"), points).unwrap();
    let ten = folder.path().join("ten.xyz").display().to_string();
    for (args, located) in [
        ("map.pcd query.pcd --truth truth.txt".to_owned(), true),
        (format!("map.pcd {ten} --truth truth.txt"), false),
    ] {
        let (o, code) = locate(demo(), &args);
        assert_eq!(code, Some(i32::from(!located)));
        for field in [
            "winze",
            "verdict",
            "confidence",
            "reason",
            "map_from_query",
            "covariance",
            "covariance_at",
            "covariance_at_origin",
            "unobservable",
            "hypotheses",
            "inlier_fraction",
            "inlier_rmse",
            "inlier_distance",
            "inlier_reference",
            "error",
            "stages",
            "seconds",
            "method",
            "seed",
            "config_digest",
            "map",
            "query",
        ] {
            assert!(o.get(field).is_some(), "{field} is missing");
        }
        for field in ["path", "digest", "points"] {
            assert!(
                !o["map"][field].is_null() && !o["query"][field].is_null(),
                "{field}"
            );
        }
        for field in ["name", "seconds", "in", "out"] {
            assert!(!o["stages"][0][field].is_null(), "{field}");
        }
        let computed = [
            "map_from_query",
            "covariance",
            "covariance_at",
            "covariance_at_origin",
            "inlier_fraction",
            "inlier_rmse",
            "error",
        ];
        for field in computed {
            assert_eq!(o[field].is_null(), !located, "{field}");
        }
        if located {
            assert_eq!(
                o["map_from_query"][3],
                serde_json::json!([0.0, 0.0, 0.0, 1.0])
            );
            assert_eq!(o["inlier_reference"], "map as read");
            for field in [
                "map_from_query",
                "score",
                "median_point_to_plane",
                "inlier_fraction",
                "stop",
            ] {
                assert!(!o["hypotheses"][0][field].is_null(), "{field}");
            }
            assert_eq!(o["information"]["matrix"].as_array().map(Vec::len), Some(6));
        }
    }
}

#[test]
fn a_picture_and_a_page_come_without_a_pose_too() {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    let points: String = (0..10).map(|i| format!("{i} {} 0\n", i * i)).collect();
    std::fs::write(f.join("ten.xyz"), points).unwrap();
    let map = demo().join("map.pcd").display().to_string();
    let run = winze(
        f,
        &format!("locate {map} ten.xyz --picture p.png --report r.html --save-aligned a.ply"),
    );
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(
        std::fs::read(f.join("p.png"))
            .unwrap()
            .starts_with(b"\x89PNG")
    );
    assert!(
        std::fs::read_to_string(f.join("r.html"))
            .unwrap()
            .contains("insufficient")
    );
    assert!(!f.join("a.ply").exists() && run.stderr.contains("no pose was found"));
}

#[test]
fn convert_tells_what_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    std::fs::write(
        f.join("c.csv"),
        "x,y,z,intensity,rgb,time\n1,2,3,4,5,6\n2,3,4,5,6,7\n",
    )
    .unwrap();
    let run = winze(f, "convert c.csv c.ply");
    assert_eq!(run.code, Some(0));
    assert!(run.stderr.contains("rgb, time"), "{}", run.stderr);
}
