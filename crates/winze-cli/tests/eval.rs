//! `winze eval`, end to end, on the clouds of the demo.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

mod common;

use std::path::Path;
use std::sync::OnceLock;

use common::{demo, locate, winze};
use serde_json::{Value, json};

/// Settings that make a run short and leave the demo's query findable.
const QUICK: &str =
    "--set scale.tries=1 --set ransac.max_samples=60000 --set ransac.min_samples=20000";

fn truth() -> Value {
    let text = std::fs::read_to_string(demo().join("truth.txt")).unwrap();
    let numbers: Vec<f64> = text
        .split_whitespace()
        .map(|t| t.parse().unwrap())
        .collect();
    json!(numbers.chunks(4).collect::<Vec<_>>())
}

fn case(name: &str, truth: &Value) -> Value {
    json!({
        "name": name, "map": "map.pcd", "query": "query.pcd", "truth": truth, "family": "demo",
        "tolerance": {"translation_m": 0.5, "rotation_deg": 5.0}, "gravity_aligned": false,
    })
}

/// A map of other rock on the same plan, and a folder with cases on both maps.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let made = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let f = folder.path();
        for name in ["map.pcd", "query.pcd"] {
            std::fs::copy(demo().join(name), f.join(name)).unwrap();
        }
        std::fs::create_dir(f.join("other")).unwrap();
        let run = winze(&f.join("other"), "demo --quiet --seed 1 --out mine");
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let mut wrong = truth();
        wrong[0][3] = json!(wrong[0][3].as_f64().unwrap() + 3.0);
        let mut elsewhere = case("demo/other_mine", &Value::Null);
        elsewhere["map"] = json!("other/mine/map.pcd");
        elsewhere["family"] = json!("out-of-map");
        // The label is wrong on purpose, so that a right answer is a wrong accept.
        let cases = json!({"cases": [
            case("demo/here", &truth()), elsewhere, case("demo/mislabelled", &wrong)
        ]});
        std::fs::write(f.join("cases.json"), cases.to_string()).unwrap();
        folder
    });
    made.path()
}

fn json_of(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn confidence_is_held_against_what_came_true() {
    let f = folder();
    let args = "eval . --method auto --family demo --json sure.json --report sure.html";
    let run = winze(f, args);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let e = json_of(&f.join("sure.json"));
    let here = &e["runs"][0];
    assert!(here["confidence"].as_f64().unwrap() > 0.9, "{here}");
    assert_eq!(here["evidence"], "located");
    // As sure of the one whose label lies.
    let told = e["calibrations"].as_array().unwrap();
    let told = told.iter().find(|c| c["family"].is_null()).unwrap();
    assert_eq!(told["answers"], 2, "{told}");
    assert!(told["brier"].as_f64().unwrap() > 0.3, "{told}");
    for part in ["ECE", "its mean"] {
        assert!(run.stdout.contains(part), "{part}: {}", run.stdout);
    }
    assert!(run.stdout.lines().all(|l| l.chars().count() <= 120));
    let page = std::fs::read_to_string(f.join("sure.html")).unwrap();
    assert!(
        page.contains("<svg") && !page.contains("xmlns="),
        "no diagram"
    );
}

#[test]
fn cases_are_answered_judged_and_counted() {
    let f = folder();
    let args = format!(
        "eval . --method auto --method ndt+icp --seed 3 --json out.json --report out.html {QUICK}"
    );
    let run = winze(f, &args);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stderr.is_empty(), "{}", run.stderr);
    let e = json_of(&f.join("out.json"));
    let runs = e["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 6);
    let names: Vec<&str> = runs.iter().map(|r| r["case"].as_str().unwrap()).collect();
    let order = ["demo/here", "demo/other_mine", "demo/mislabelled"];
    assert_eq!(names, [order, order].concat());
    let here = &runs[0];
    assert_eq!(here["verdict"], "located", "{}", here["reason"]);
    assert_eq!(here["mark"]["class"], "right");
    assert!(here["mark"]["translation_m"].as_f64().unwrap() < 0.1);
    assert!(here["ceiling"]["fraction"].as_f64().unwrap() > 0.5);
    assert_eq!(here["seed"], 3);
    // In a mine of the same plan but other rock it is refused, in one word or another.
    assert_ne!(runs[1]["mark"]["class"], "wrong_accept", "{}", runs[1]);
    assert!(!runs[1]["verdict"].is_null(), "{}", runs[1]);
    assert_eq!(runs[2]["mark"]["class"], "wrong_accept", "{}", runs[2]);
    // From the identity it finds nothing.
    assert_eq!(runs[3]["mark"]["class"], "refusal");
    let all = e["summaries"]
        .as_array()
        .unwrap()
        .iter()
        .find(|s| s["method"] == "auto" && s["family"].is_null())
        .unwrap();
    assert_eq!(
        (&all["recall"]["count"], &all["recall"]["of"]),
        (&json!(1), &json!(2))
    );
    assert_eq!(all["wrong_accepts"]["count"], 1);
    assert_eq!(e["labels"][2]["out_of_map"], 1);
    // Nothing was counted with such settings.
    assert_eq!(here["confidence"], json!(null));
    assert_eq!(e["calibrations"], json!([]));
    let covered = &e["coverages"][0];
    assert_eq!(covered["family"], "demo");
    // The label that lies does so by a few metres: too near for another place, far beyond any covariance.
    assert_eq!(
        (&covered["located"], &covered["answers"]),
        (&json!(2), &json!(2))
    );
    assert!(
        covered["answered"]["mean_nees"].as_f64().unwrap() > 100.0,
        "{covered}"
    );
    let cost = &e["costs"][0];
    assert_eq!(cost["maps"].as_array().unwrap().len(), 2, "each map once");
    assert!(cost["maps"][0]["work_seconds"].as_f64().unwrap() > 0.0);
    #[cfg(target_os = "linux")]
    assert!(cost["peak_memory_bytes"].as_u64().unwrap() > 10_000_000);
    for part in [
        "recall % [95 %]",
        "out-of-map",
        "1/2 50.0 [9.5-90.5]",
        "NEES",
        "peak memory",
    ] {
        assert!(run.stdout.contains(part), "{part}: {}", run.stdout);
    }
    assert!(
        run.stdout.lines().all(|l| l.chars().count() <= 120),
        "{}",
        run.stdout
    );
    let page = std::fs::read_to_string(f.join("out.html")).unwrap();
    assert!(page.contains("demo/mislabelled") && page.contains("wrong accept"));
    assert!(page.contains("data:image/png;base64,") && page.contains("default-src 'none'"));
    for part in ["src=\"http", "href=\"http", "@import", "url("] {
        assert!(!page.contains(part), "{part}");
    }

    // Alone, by either of the command lines given, it is the same answer.
    let again = here["again"][0]
        .as_str()
        .unwrap()
        .strip_prefix("winze ")
        .unwrap();
    let run = winze(f, &format!("{again} --json -"));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let alone: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(alone["runs"].as_array().unwrap().len(), 1);
    assert_eq!(alone["runs"][0]["map_from_query"], here["map_from_query"]);
    let again = here["again"][1]
        .as_str()
        .unwrap()
        .strip_prefix("winze locate ")
        .unwrap();
    let (alone, code) = locate(f, again);
    assert_eq!(code, Some(0));
    assert_eq!(alone["map_from_query"], here["map_from_query"]);
    assert_eq!(alone["reason"], here["reason"]);
}

#[test]
fn a_case_without_its_file_costs_no_other() {
    let f = folder();
    let mut lost = case("lost", &truth());
    lost["query"] = json!("no_such.pcd");
    let mut no_map = case("no_map", &truth());
    no_map["map"] = json!("no_such_map.pcd");
    let cases = json!({"cases": [lost, no_map, case("demo/here", &truth())]});
    std::fs::write(f.join("lost.json"), cases.to_string()).unwrap();
    let run = winze(f, &format!("eval lost.json --json lost_out.json {QUICK}"));
    assert_eq!(run.code, Some(2));
    for part in [
        "lost (auto): ./no_such.pcd",
        "no_map (auto)",
        "2 cases gave no answer",
    ] {
        let said = run.stderr.replace("): no_such", "): ./no_such");
        assert!(said.contains(part), "{part}: {}", run.stderr);
    }
    let e = json_of(&f.join("lost_out.json"));
    assert_eq!(e["errors"].as_array().unwrap().len(), 2);
    assert_eq!(e["costs"][0]["errors"], 2);
    // They stay in every denominator.
    assert_eq!(e["runs"].as_array().unwrap().len(), 3);
    assert!(e["runs"][0]["verdict"].is_null(), "{}", e["runs"][0]);
    assert_eq!(e["runs"][2]["mark"]["class"], "right", "{}", e["runs"][2]);
    let all = e["summaries"].as_array().unwrap().last().unwrap();
    assert_eq!(
        (&all["recall"]["count"], &all["recall"]["of"]),
        (&json!(1), &json!(3))
    );
}

#[test]
fn the_paper_s_tables_from_six_clouds() {
    let f = folder();
    let clouds = [
        "cloud_1",
        "cloud_2",
        "cloud_3",
        "cloud_4",
        "coal_wall",
        "limestone_wall",
    ];
    let cases: Vec<Value> = clouds.map(|c| case(&format!("paper/{c}"), &truth())).into();
    std::fs::write(f.join("paper.json"), json!({"cases": cases}).to_string()).unwrap();
    let args = format!(
        "eval paper.json --paper --seeds 2 --figures figures --json paper_out.json {QUICK}"
    );
    let run = winze(f, &args);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    for part in [
        "Inlier RMSE, metres",
        "(0.1253)",
        "(33.97)",
        "| ceiling",
        "| auto",
        "in 2 of 2 seeds",
    ] {
        assert!(run.stdout.contains(part), "{part}: {}", run.stdout);
    }
    let e = json_of(&f.join("paper_out.json"));
    // Four methods with two seeds, two that draw nothing at random.
    assert_eq!(e["runs"].as_array().unwrap().len(), 6 * (4 * 2 + 2));
    assert_eq!(e["paper"]["cells"].as_array().unwrap().len(), 36);
    let runs = e["runs"].as_array().unwrap();
    assert!(runs.iter().any(|r| r["query_kept"] == true));
    for cloud in clouds {
        let png = std::fs::read(f.join(format!("figures/paper_{cloud}.png"))).unwrap();
        assert!(png.starts_with(b"\x89PNG"));
    }
    let missing = winze(f, "eval . --paper");
    assert_eq!(missing.code, Some(2));
    assert!(
        missing.stderr.contains("no case paper/cloud_1"),
        "{}",
        missing.stderr
    );
}

#[test]
fn mistakes_are_told_at_once() {
    let f = folder();
    std::fs::write(
        f.join("bad.json"),
        r#"{"cases": [{"name": "a", "map": 3, "truth": null}]}"#,
    )
    .unwrap();
    for (args, part) in [
        ("eval nowhere", "cases.json or a folder"),
        ("eval other", "cases.json: cannot be read"),
        ("eval bad.json", "bad.json: case 1 (a): map: "),
        ("eval . --only nothing", "no case is left"),
        ("eval . --json cases.json", "would overwrite"),
        ("eval . --report no/such.html", "its folder does not exist"),
        ("eval . --method best", "no method \"best\""),
        ("eval . --seeds 0", "--seeds"),
        ("eval . --figures x", "--paper"),
    ] {
        let run = winze(f, args);
        assert_eq!(run.code, Some(2), "{args}");
        assert!(run.stderr.contains(part), "{args}: {}", run.stderr);
        assert!(run.stdout.is_empty(), "{args}");
    }
}

/// The processes that process `id` has started, once there is one. A thread's children are listed under that thread;
/// none are where the system does not list them.
#[cfg(unix)]
fn workers_of(id: u32) -> Vec<String> {
    let children = || -> Vec<String> {
        let threads = std::fs::read_dir(format!("/proc/{id}/task"));
        threads
            .into_iter()
            .flatten()
            .filter_map(|t| std::fs::read_to_string(t.ok()?.path().join("children")).ok())
            .flat_map(|t| {
                t.split_whitespace()
                    .map(ToOwned::to_owned)
                    .collect::<Vec<_>>()
            })
            .collect()
    };
    for _ in 0..600 {
        let found = children();
        if !found.is_empty() || !cfg!(target_os = "linux") {
            return found;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    Vec::new()
}

/// A process that dies (as when memory runs out) costs the case it was at; another does the rest.
#[cfg(target_os = "linux")]
#[test]
fn a_worker_that_dies_costs_one_case() {
    use std::process::{Command, Stdio};
    let f = folder();
    let mut eval = Command::new(env!("CARGO_BIN_EXE_winze"));
    eval.args([
        "eval",
        ".",
        "--only",
        "demo/here",
        "--only",
        "demo/mislabelled",
    ])
    .args(["--method", "ndt+icp", "--quiet", "--json", "-"])
    .args(QUICK.split(' '))
    .current_dir(f)
    .stdin(Stdio::null())
    .stdout(Stdio::piped())
    .stderr(Stdio::piped());
    let eval = eval.spawn().unwrap();
    let worker = workers_of(eval.id()).remove(0);
    let killed = Command::new("kill").args(["-9", &worker]).status();
    assert!(killed.unwrap().success());
    let done = eval.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(2));
    let e: Value = serde_json::from_slice(&done.stdout).unwrap();
    let errors = e["errors"].as_array().unwrap();
    assert_eq!(errors.len(), 1, "{errors:?}");
    let why = errors[0]["message"].as_str().unwrap();
    assert!(why.contains("process that ran it ended"), "{why}");
    let runs = e["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 2);
    let answered = runs.iter().filter(|r| !r["map_from_query"].is_null());
    assert_eq!(answered.count(), 1, "the other case was still asked");
}

#[test]
fn methods_that_share_their_work_answer_as_they_do_apart() {
    let f = folder();
    let runs = |rest: &str| -> Vec<Value> {
        let methods = "-m fpfh -m fpfh+ndt -m fpfh+ndt+icp -m auto";
        let run = winze(
            f,
            &format!("eval . --only demo/here {methods} --json - {QUICK} {rest}"),
        );
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let e: Value = serde_json::from_str(&run.stdout).unwrap();
        let mut runs = e["runs"].as_array().unwrap().clone();
        for run in &mut runs {
            for differs in ["seconds", "query_kept"] {
                run.as_object_mut().unwrap().remove(differs).unwrap();
            }
        }
        runs
    };
    let apart = runs("");
    assert_eq!(apart.len(), 4);
    assert_eq!(apart, runs("--together"));
}

#[cfg(unix)]
#[test]
fn a_worker_that_is_told_to_go_leaves_nobody_behind() {
    use std::process::{Command, Stdio};
    let f = folder();
    let mut eval = Command::new(env!("CARGO_BIN_EXE_winze"))
        .args([
            "eval", ".", "--method", "fpfh", "--seeds", "1000", "--quiet",
        ])
        .current_dir(f)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let found = workers_of(eval.id());
    let killed = Command::new("kill").arg(eval.id().to_string()).status();
    assert!(killed.unwrap().success());
    assert_eq!(eval.wait().unwrap().code(), Some(130));
    #[cfg(target_os = "linux")]
    assert!(!found.is_empty(), "no worker was started");
    for id in found {
        assert!(!Path::new(&format!("/proc/{id}")).exists(), "{id} lives on");
    }
}

#[test]
fn a_journal_goes_on_where_it_was_cut_short() {
    let f = folder();
    let args = |rest: &str| {
        format!(
            "eval . --only demo/here --method ndt+icp --journal runs.jsonl --json - {QUICK} {rest}"
        )
    };
    let first = winze(f, &args(""));
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    let journal = f.join("runs.jsonl");
    let whole = std::fs::read_to_string(&journal).unwrap();
    assert_eq!(whole.lines().count(), 3, "head, run, map: {whole}");
    // Nothing is left to do: the same runs, to the second.
    let again = winze(f, &args(""));
    assert_eq!(again.stdout, first.stdout);
    // Cut in the middle of the run's line, it is made anew.
    let lines: Vec<&str> = whole.lines().collect();
    std::fs::write(&journal, format!("{}\n{}", lines[0], &lines[1][..50])).unwrap();
    let mended = winze(f, &args(""));
    assert_eq!(mended.code, Some(0), "{}", mended.stderr);
    let run = |text: &str| serde_json::from_str::<Value>(text).unwrap()["runs"][0].clone();
    assert_eq!(
        run(&mended.stdout)["map_from_query"],
        run(&first.stdout)["map_from_query"]
    );
    // Other settings, and files that are no journals, are refused and left alone.
    let other = winze(f, &args("--seed 9"));
    assert_eq!(other.code, Some(2), "{}", other.stderr);
    assert!(other.stderr.contains("other settings"), "{}", other.stderr);
    std::fs::write(&journal, "my notes\n").unwrap();
    let foreign = winze(f, &args(""));
    assert_eq!(foreign.code, Some(2));
    assert_eq!(std::fs::read_to_string(&journal).unwrap(), "my notes\n");
}
