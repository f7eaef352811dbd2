//! `winze replay`: a question that was kept, asked again.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context as _, bail};
use serde_json::Value;
use winze::locate::Progress as Told;
use winze::outcome::Stage;
use winze::{Cloud, KeptMap, KeptQuery, Outcome, PoseDistance};
use winze_bundle::Bundle;
use winze_front::{Page, Prior, settings};
use winze_io::{CloudFile, Format};
use winze_report::{Document, Source};

use crate::args::{Global, Replay};
use crate::command;
use crate::locate::{Answer, exit_code, steps};
use crate::output::{check_outputs, talk};
use crate::progress::Progress;

pub(crate) fn run(args: &Replay, global: &Global) -> anyhow::Result<ExitCode> {
    check(args, global)?;
    let file = args.bundle.display();
    let bundle = Bundle::open(&args.bundle)?;
    let progress = Progress::new(global.quiet, steps(bundle.asked.method));
    let whole = match &args.map {
        Some(path) => {
            progress.say("read map");
            let map = Prior::open(path)?;
            if map.digest() != bundle.map.digest {
                bail!(
                    "{}: is not the map that was asked then ({:?}, {}); give that one, or leave --map out",
                    path.display(),
                    bundle.map.path,
                    bundle.map.digest
                );
            }
            Some(map)
        }
        None => None,
    };
    let told = |name: &str, stage: Option<&Stage>| progress.told(name, stage);
    let answered = answer(&bundle, whole.as_ref(), &told).with_context(|| file.to_string())?;
    let drawn = args.outputs.drawn();
    let map = match &whole {
        Some(map) if drawn => map.picture()?,
        None if drawn => Cow::Owned(picture(&bundle)?),
        _ => Cow::Owned(Cloud::default()),
    };
    let differ = differences(&bundle.outcome, &answered.document.to_json())
        .with_context(|| format!("{file}: outcome.json"))?;
    let page = match args.outputs.report {
        Some(_) => {
            progress.say("draw");
            let mut kept_map = kept(&bundle, whole.as_ref());
            let mut kept_query = KeptQuery::new(&answered.query.cloud);
            let kept = (&mut kept_map, &mut kept_query);
            let command = command::command();
            Some(Page::of(
                &map,
                kept,
                &answered.outcome,
                &bundle.config,
                command,
            )?)
        }
        None => None,
    };
    let answer = Answer {
        map: &map,
        query: &answered.query.cloud,
        outcome: &answered.outcome,
        error: answered.error,
        document: answered.document,
        page,
    };
    progress.finish();
    answer.tell(global.quiet, args.outputs.json_to_stdout())?;
    answer.write(&args.outputs)?;
    let now = env!("CARGO_PKG_VERSION");
    if whole.is_none() && !global.quiet {
        talk(
            "\nthe poses that features of the whole map led to were taken from the bundle, all else was done anew; --map does all of it anew\n",
        );
    }
    if !differ.is_empty() {
        bail!(
            "{file}: the answer is not the one recorded: {}; winze {} gave that one, this is {now}",
            few(&differ),
            bundle.winze
        );
    }
    if !global.quiet {
        talk(&format!(
            "\nthe same answer, bit for bit, as was recorded in {file}\n"
        ));
    }
    Ok(exit_code(&answered.outcome))
}

/// Refuses at once what could not be done in the end.
fn check(args: &Replay, global: &Global) -> anyhow::Result<()> {
    let mut settings = global.set.iter().map(|s| format!("--set {s}"));
    let config = global.config.as_ref().map(|_| "--config".to_owned());
    let seed = global.seed.map(|_| "--seed".to_owned());
    if let Some(given) = settings.next().or(config).or(seed) {
        bail!("{given}: a bundle is replayed with the settings in it; leave this out");
    }
    if let Some(path) = &args.outputs.save_aligned {
        Format::for_writing(path)?;
    }
    let outputs = args.outputs.files();
    let inputs = args.map.iter().chain([&args.bundle]);
    let inputs: Vec<&Path> = inputs.map(PathBuf::as_path).collect();
    check_outputs(&outputs, &inputs)
}

/// An answer given again.
pub(crate) struct Answered {
    pub(crate) query: CloudFile,
    pub(crate) outcome: Outcome,
    pub(crate) error: Option<PoseDistance>,
    pub(crate) document: Document,
}

/// Asks a bundle's question again, of the `whole` map or of the part of it in the bundle.
pub(crate) fn answer(
    bundle: &Bundle,
    whole: Option<&Prior>,
    told: &Told<'_>,
) -> anyhow::Result<Answered> {
    let begun = Instant::now();
    let query = bundle.read_query()?;
    let read = |name: &str, seconds, count_in, count_out| Stage {
        name: name.into(),
        seconds,
        count_in,
        count_out,
    };
    let points = query.cloud.len();
    let reading = [
        read(
            "read map",
            0.0,
            bundle.map.points_in_file,
            bundle.part.points,
        ),
        read(
            "read query",
            begun.elapsed().as_secs_f64(),
            query.report.points_in_file,
            points,
        ),
    ];
    let mut kept_map = kept(bundle, whole);
    let mut kept_query = KeptQuery::new(&query.cloud);
    let request = bundle.asked.request(Some(told));
    let mut outcome = winze::locate_in(&mut kept_map, &mut kept_query, &bundle.config, &request)?;
    outcome.seconds += reading.iter().map(|s| s.seconds).sum::<f64>();
    outcome.stages.splice(0..0, reading);
    let truth = bundle.asked.truth;
    let error = truth.and_then(|t| outcome.error(&t, &query.cloud));
    let document = Document::new(
        &outcome,
        error.as_ref(),
        (&request).into(),
        settings::digest(&bundle.config)?,
        Source {
            path: Some(bundle.map.path.clone()),
            digest: Some(bundle.map.digest.clone()),
            points: bundle.part.points,
        },
        Source {
            path: Some(bundle.query.path.clone()),
            digest: Some(query.report.digest.clone()),
            points,
        },
    );
    Ok(Answered {
        query,
        outcome,
        error,
        document,
    })
}

/// The `whole` map, or the part of it in the bundle.
fn kept<'a>(bundle: &'a Bundle, whole: Option<&'a Prior>) -> KeptMap<'a> {
    whole.map_or_else(|| KeptMap::part(&bundle.part), Prior::kept)
}

/// The part of the map at its finest.
fn picture(bundle: &Bundle) -> anyhow::Result<Cloud> {
    let levels = bundle.part.levels.iter();
    let Some(level) = levels.min_by(|a, b| a.voxel.total_cmp(&b.voxel)) else {
        return Ok(Cloud::default());
    };
    let at = |p: &[f32; 3]| std::array::from_fn(|a| level.origin[a] + f64::from(p[a]));
    let points: Vec<[f64; 3]> = level.points.iter().map(at).collect();
    Ok(Cloud::from_points(&points)?.0)
}

/// What two outcomes, as JSON, differ in, a field each; times do not count. Where one is of another version of winze, neither do the version,
/// the digest of settings that one of them may not have, nor fields that only one of them knows.
pub(crate) fn differences(then: &str, now: &str) -> anyhow::Result<Vec<String>> {
    let parse = |text: &str| -> serde_json::Result<Value> { serde_json::from_str(text) };
    let (mut then, mut now) = (parse(then)?, parse(now)?);
    if let (Value::Object(a), Value::Object(b)) = (&mut then, &mut now)
        && a.get(VERSION) != b.get(VERSION)
    {
        for key in [VERSION, "config_digest"] {
            a.remove(key);
            b.remove(key);
        }
        a.retain(|key, _| b.contains_key(key));
        b.retain(|key, _| a.contains_key(key));
    }
    let mut differ = Vec::new();
    compare("", &then, &now, &mut differ);
    Ok(differ)
}

/// The field that tells the version.
const VERSION: &str = "winze";

fn compare(path: &str, then: &Value, now: &Value, differ: &mut Vec<String>) {
    let inner = |key: &str| {
        if path.is_empty() {
            key.to_owned()
        } else {
            format!("{path}.{key}")
        }
    };
    let nothing = &Value::Null;
    match (then, now) {
        (Value::Object(a), Value::Object(b)) => {
            let keys = a.keys().chain(b.keys().filter(|k| !a.contains_key(*k)));
            for key in keys.filter(|k| *k != "seconds") {
                let (a, b) = (a.get(key), b.get(key));
                let missing = a.is_none() != b.is_none();
                let (a, b) = (a.unwrap_or(nothing), b.unwrap_or(nothing));
                // A field of another version is none, even where it is null.
                if missing && a == b {
                    differ.push(inner(key));
                }
                compare(&inner(key), a, b, differ);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                compare(&format!("{path}[{i}]"), a, b, differ);
            }
        }
        // Their texts tell zeros of either sign apart.
        _ => {
            let (a, b) = (then.to_string(), now.to_string());
            if a != b {
                differ.push(format!("{path} (then {}, now {})", short(&a), short(&b)));
            }
        }
    }
}

/// The beginning of a text that may be long or hold what cannot be shown.
fn short(text: &str) -> String {
    let shown = |c: char| if c.is_control() { ' ' } else { c };
    let mut out: String = text.chars().map(shown).take(60).collect();
    if text.chars().nth(60).is_some() {
        out.push_str("...");
    }
    out
}

/// The first few of the fields.
pub(crate) fn few(differ: &[String]) -> String {
    const FEW: usize = 4;
    let first = differ.iter().take(FEW).cloned().collect::<Vec<_>>();
    match differ.len().saturating_sub(FEW) {
        0 => first.join(", "),
        more => format!("{}, and {more} more", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_do_not_count_and_every_other_bit_does() {
        let of = |a: &str, b: &str| differences(a, b).unwrap();
        let (a, b) = (
            r#"{"seconds": 1, "stages": [{"seconds": 2, "in": 3}], "t": 0.1}"#,
            r#"{"seconds": 2, "stages": [{"seconds": 3, "in": 3}], "t": 0.1}"#,
        );
        assert!(of(a, b).is_empty());
        assert_eq!(
            of(r#"{"a": [1, 2.0]}"#, r#"{"a": [1, 2.5]}"#),
            ["a[1] (then 2.0, now 2.5)"]
        );
        assert_eq!(
            of(r#"{"a": {"b": 0.0}}"#, r#"{"a": {"b": -0.0}}"#),
            ["a.b (then 0.0, now -0.0)"]
        );
        assert_eq!(
            of(r#"{"a": 0.1}"#, r#"{"a": 0.10000000000000002}"#).len(),
            1
        );
        assert_eq!(of(r#"{"a": null}"#, "{}"), ["a"]);
        assert_eq!(of("{}", r#"{"a": null}"#), ["a"]);
        assert_eq!(
            of(r#"{"a": [1]}"#, r#"{"a": [1, 2]}"#),
            ["a (then [1], now [1,2])"]
        );
        assert!(differences("{", "{}").is_err());
    }

    #[test]
    fn of_another_version_the_answer_counts_and_no_more() {
        let of = |a: &str, b: &str| differences(a, b).unwrap();
        let then = r#"{"winze": "0.0.9", "config_digest": "a", "old": 1, "t": 0.5}"#;
        assert!(
            of(
                then,
                r#"{"winze": "0.1.0", "config_digest": "b", "new": 1, "t": 0.5}"#
            )
            .is_empty()
        );
        assert_eq!(
            of(then, r#"{"winze": "0.1.0", "t": 0.6}"#),
            ["t (then 0.5, now 0.6)"]
        );
        assert_eq!(
            of(
                then,
                r#"{"winze": "0.0.9", "config_digest": "b", "old": 1, "t": 0.5}"#
            )
            .len(),
            1
        );
    }

    #[test]
    fn long_lists_of_differences_are_cut() {
        let many: Vec<String> = (0..9).map(|i| i.to_string()).collect();
        assert_eq!(few(&many), "0, 1, 2, 3, and 5 more");
        assert_eq!(few(&many[..4]), "0, 1, 2, 3");
        assert_eq!(short(&"x".repeat(61)).len(), 63);
    }
}
