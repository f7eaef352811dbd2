//! The library as the Python module calls it: in one process, on files.
#![allow(clippy::unwrap_used, reason = "a test")]

use std::path::Path;

use winze::config::Length;
use winze::rng::Rng;
use winze::{Config, KeptQuery, Method, Request, locate_in};
use winze_front::evaluation::{cases, evaluate, text};
use winze_front::{Facts, Page, Prior, settings};
use winze_map::BuildOptions;
use winze_report::evaluation::Class;
use winze_report::{Document, Source};

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

/// A folder with a map, a query in it, and two cases of which the first has no query file.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let put = |name, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("map.xyz", &drift(8_000, [0.0, 12.0], 1));
    put("query.xyz", &drift(4_000, [3.0, 9.0], 3));
    put(
        "cases.json",
        r#"{"cases": [
            {"name": "gone", "map": "map.xyz", "query": "none.xyz", "truth": null, "family": "a"},
            {"name": "here", "map": "map.xyz", "query": "query.xyz", "family": "b",
             "truth": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"#,
    );
    folder
}

fn cheap() -> Config {
    let table = "[ransac]\nmin_samples = 4000\nmax_samples = 8000";
    settings::from_table(None, table.parse().unwrap()).unwrap()
}

#[test]
fn an_evaluation_counts_what_broke_off_and_can_be_ended() {
    let folder = folder();
    let (cases, _) = cases::read(&folder.path().join("cases.json")).unwrap();
    let methods = [Method::Auto, Method::Fpfh, Method::Auto];
    let mut heard = Vec::new();
    let mut told = |case: &str, done: usize, all: usize| {
        heard.push((case.to_owned(), done, all));
        Ok(())
    };
    let found = evaluate(&cases, &methods, &[3, 4], &cheap(), "x".into(), &mut told).unwrap();
    let heard: Vec<_> = heard.iter().map(|(c, d, a)| (c.as_str(), *d, *a)).collect();
    let here = [("here", 4, 6), ("here", 5, 6), ("here", 6, 6)];
    assert_eq!(heard, [&[("gone", 3, 6)][..], &here].concat());
    let runs: Vec<_> = found
        .runs
        .iter()
        .map(|r| (r.method.as_str(), r.case.as_str(), r.seed))
        .collect();
    assert_eq!(
        runs,
        [
            ("auto", "gone", 3),
            ("auto", "here", 3),
            ("fpfh", "gone", 3),
            ("fpfh", "gone", 4),
            ("fpfh", "here", 3),
            ("fpfh", "here", 4),
        ]
    );
    for run in &found.runs {
        assert_eq!(run.verdict.is_none(), run.case == "gone");
        assert!(run.case != "gone" || run.mark.class == Class::Refusal);
    }
    let errors: Vec<_> = found.errors.iter().map(|e| e.method.as_str()).collect();
    assert_eq!(errors, ["auto", "fpfh"]);
    assert_eq!(
        (found.together, found.jobs, &found.seeds[..]),
        (true, 1, &[3, 4][..])
    );
    assert_eq!(found.costs[0].maps.len(), 1);
    assert!(text(&found).contains("fpfh"));

    let mut stop = |_: &str, _, _| Err(std::io::Error::other("stop").into());
    let e = evaluate(&cases, &methods, &[3], &cheap(), "x".into(), &mut stop).unwrap_err();
    assert!(e.is::<std::io::Error>());
    assert!(
        evaluate(&cases, &[], &[3], &cheap(), "x".into(), &mut |_, _, _| Ok(
            ()
        ))
        .is_err()
    );
}

#[test]
fn a_built_map_brings_its_settings_and_tells_of_itself() {
    let folder = folder();
    let (cloud, file) = (
        folder.path().join("map.xyz"),
        folder.path().join("map.wmap"),
    );
    let with = settings::from_table(None, "[fpfh]\nradius = 1.25".parse().unwrap()).unwrap();
    winze_map::build(&[cloud], &file, &with, &BuildOptions::default()).unwrap();
    let prior = Prior::open(&file).unwrap();
    let map = prior.built().unwrap();
    let config = settings::from_table(Some(map), "seed = 7".parse().unwrap()).unwrap();
    assert_eq!((config.seed, config.fpfh.radius), (7, Length::Metres(1.25)));
    assert_eq!(prior.config(&Default::default()).unwrap().fpfh, with.fpfh);
    let facts = serde_json::to_value(Facts::of(&file, map)).unwrap();
    assert_eq!(facts["points"], 8_000);
    assert!(
        facts["sections"]
            .as_array()
            .unwrap()
            .iter()
            .all(|s| s["known"] == true)
    );
}

#[test]
fn files_become_an_answer_and_its_page() {
    let folder = folder();
    let file = |name: &str| folder.path().join(name);
    let map = Prior::open(&file("map.xyz")).unwrap();
    let query = winze_front::reading::read(&file("query.xyz")).unwrap();
    let (mut kept_map, mut kept_query) = (map.kept(), KeptQuery::new(&query.cloud));
    let (config, request) = (cheap(), Request::default());
    let outcome = locate_in(&mut kept_map, &mut kept_query, &config, &request).unwrap();
    let document = Document::new(
        &outcome,
        None,
        (&request).into(),
        settings::digest(&config).unwrap(),
        map.source(&file("map.xyz")),
        Source {
            path: None,
            digest: None,
            points: query.cloud.len(),
        },
    );
    let picture = map.picture().unwrap();
    let kept = (&mut kept_map, &mut kept_query);
    let page = Page::of(&picture, kept, &outcome, &config, "a command".into()).unwrap();
    assert!(
        page.html(&outcome, None, &document, b"")
            .contains("a command")
    );
}

#[test]
fn typed_errors_stay_in_the_chain() {
    let none = Path::new("none/none.pcd");
    assert!(Prior::open(none).unwrap_err().is::<winze_io::Error>());
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("broken.wmap");
    std::fs::write(&broken, "no map").unwrap();
    assert!(Prior::open(&broken).unwrap_err().is::<winze_map::Error>());
    let e = cases::read(Path::new("none/cases.json")).unwrap_err();
    assert!(e.chain().any(<dyn std::error::Error>::is::<std::io::Error>));
    let tilted = r#"{"cases": [{"name": "a", "map": "m", "query": "q", "truth": [[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"#;
    let e = cases::parse(tilted.as_bytes(), Path::new("")).unwrap_err();
    assert!(e.chain().any(<dyn std::error::Error>::is::<winze::Error>));
}
