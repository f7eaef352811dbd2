//! `winze sim`: a simulated mine with its map, its queries and the truth.

use std::process::ExitCode;

use anyhow::{Context as _, bail};
use winze_front::mines::{CASES, Told, simulate};
use winze_front::settings;
use winze_report::evaluation::quantile;
use winze_sim::cases::Case;
use winze_sim::scenario::{self, Scenario};

use crate::args::{Global, Sim};
use crate::output::{print, talk};
use crate::progress::Progress;

pub(crate) fn run(args: &Sim, global: &Global) -> anyhow::Result<ExitCode> {
    let Some(name) = &args.scenario else {
        return list();
    };
    let mut scenario = Scenario::open(name)?;
    if args.show {
        return show(name);
    }
    let Some(out) = &args.out else {
        bail!("--out: say where to write; --show prints the scenario instead");
    };
    if let Some(count) = args.count {
        scenario.limit(count);
    }
    let seed = settings::effective(&global.layers())?.seed;
    let progress = Progress::new(global.quiet, scenario.cases() as u64);
    let told = |told: Told<'_>| match told {
        Told::Step(step) => progress.at(step.what, step.done as u64),
        Told::Note(note) => talk(&format!("winze: note: {note}\n")),
    };
    let played = simulate(&scenario, seed, out, !args.no_mesh, &told)?;
    progress.finish();
    if played.cases.is_empty() {
        talk(&format!(
            "winze: note: no queries were asked for; {} holds maps and meshes alone\n",
            out.display()
        ));
    } else if !global.quiet {
        print(&shares(&played.cases))?;
        talk(&format!(
            "\n{} cases in {1}/{CASES}; look at {1}/{2}; then:\n  winze eval {1}\n",
            played.cases.len(),
            out.display(),
            played.sheets.join(", "),
        ));
    }
    Ok(ExitCode::SUCCESS)
}

fn list() -> anyhow::Result<ExitCode> {
    let mut text = String::from("built-in scenarios:\n");
    for name in scenario::builtin::names() {
        let scenario = Scenario::open(name)?;
        text += &format!(
            "  {name:<12} {:>4} cases  {}\n",
            scenario.cases(),
            scenario.about
        );
    }
    text +=
        "`winze sim NAME --show` prints one to start from; `winze sim NAME --out DIR` plays it.\n";
    print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// The scenario's text as it was written.
fn show(name: &str) -> anyhow::Result<ExitCode> {
    if let Some(text) = scenario::builtin::text(name) {
        print(text)?;
    } else {
        let text = std::fs::read_to_string(name);
        print(&text.with_context(|| format!("{name}: cannot be read"))?)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// How many cases of each family are what: nobody can shrink a denominator unseen.
fn shares(cases: &[Case]) -> String {
    let mut families: Vec<&str> = Vec::new();
    for c in cases {
        if !families.contains(&c.family.as_str()) {
            families.push(&c.family);
        }
    }
    let mut text = format!(
        "{:<26}{:>6}{:>8}{:>12}{:>11}{:>11}{:>16}{:>13}\n",
        "family",
        "cases",
        "z up",
        "not in map",
        "ambiguous",
        "can slide",
        "overlap median",
        "bend median"
    );
    let mut row = |name: &str, cases: &[&Case]| {
        let count = |f: fn(&Case) -> bool| cases.iter().filter(|c| f(c)).count();
        let median = |f: fn(&Case) -> Option<f64>| {
            let values: Vec<f64> = cases.iter().filter_map(|c| f(c)).collect();
            quantile(&values, 0.5)
        };
        let show =
            |v: Option<f64>, digits: usize| v.map_or("-".into(), |v| format!("{v:.digits$}"));
        text += &format!(
            "{name:<26}{:>6}{:>8}{:>12}{:>11}{:>11}{:>16}{:>13}\n",
            cases.len(),
            count(|c| c.gravity_aligned),
            count(|c| c.truth.is_none()),
            count(|c| c.ambiguous),
            count(|c| !c.unobservable.is_empty()),
            show(median(|c| c.truth.and(c.overlap)), 3),
            show(median(|c| Some(c.bend_rms_m)), 3),
        );
    };
    for family in families {
        let own: Vec<&Case> = cases.iter().filter(|c| c.family == family).collect();
        row(family, &own);
    }
    row("all", &cases.iter().collect::<Vec<_>>());
    text
}
