//! One small mine for each verdict: what is asked, what is answered, and a picture of it.
//!
//! Writes the picture of `docs/verdicts.md` and prints the sentences. Into a folder, if one is named too, it puts the clouds, a folder
//! for each verdict, of which `winze locate` makes the pages of `docs/report.md`.
//!
//! ```sh
//! cargo run --release --example verdicts -- docs/images/verdicts.png mines
//! winze locate mines/ambiguous/map.pcd mines/ambiguous/query.pcd --report ambiguous.html
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use std::path::PathBuf;

use common::{Result, random_frame};
use winze::rng::Rng;
use winze::{Cloud, Config, Verdict};
use winze_report::{Thumb, contact_sheet};

/// A straight drift: where it begins, the way it goes (radians from x), its length, and the rock it is cut in.
#[derive(Clone, Copy)]
struct Drift {
    from: [f64; 2],
    heading: f64,
    length: f64,
    /// Metres of relief, and whose.
    relief: f64,
    /// How far its walls lean over, metres across for each up: what a vein's dip leaves.
    dip: f64,
    rock: u64,
}

const HALF_WIDTH: f64 = 2.2;
const HEIGHT: f64 = 3.6;

impl Drift {
    /// `n` points on its walls, roof and floor.
    fn points(&self, n: usize, rng: &mut Rng) -> Vec<[f64; 3]> {
        let waves = waves(self.rock);
        let (sin, cos) = self.heading.sin_cos();
        (0..n)
            .map(|_| {
                let s = rng.range(0.0, self.length);
                let a = rng.range(0.0, std::f64::consts::TAU);
                let bump: f64 = waves
                    .iter()
                    .map(|[k, turns, phase, size]| size * (k * s + turns * a + phase).sin())
                    .sum();
                let r = 1.0 + self.relief / HALF_WIDTH * bump + 0.004 * rng.normal();
                let across = HALF_WIDTH * r * a.cos();
                // Rails and wheels have levelled the floor.
                let up = (0.5 * HEIGHT * r * a.sin()).max(-1.3 + 0.3 * self.relief * bump);
                let across = across + self.dip * up;
                let [x, y] = self.from;
                [x + cos * s - sin * across, y + sin * s + cos * across, up]
            })
            .collect()
    }

    /// Whether a point lies inside, where there is no rock.
    fn holds(&self, p: [f64; 3]) -> bool {
        let (sin, cos) = self.heading.sin_cos();
        let (dx, dy) = (p[0] - self.from[0], p[1] - self.from[1]);
        let (along, across) = (cos * dx + sin * dy, cos * dy - sin * dx);
        along > 0.3 && along < self.length && across.abs() < HALF_WIDTH - 0.4
    }
}

/// Waves of the rock's relief: along the drift, around it, phase, size.
fn waves(rock: u64) -> Vec<[f64; 4]> {
    let mut rng = Rng::new(rock, 7);
    let wave = |i: i32| {
        let length = 7.0 * 0.86_f64.powi(i);
        let k = std::f64::consts::TAU / length;
        let along = rng.range(-1.0, 1.0);
        let around = (HALF_WIDTH * k * (1.0 - along * along).sqrt()).round();
        let phase = rng.range(0.0, std::f64::consts::TAU);
        [k * along, around, phase, 0.06 * length]
    };
    (0..22).map(wave).collect()
}

/// What a survey of `drifts` sees, `seed` of its own.
fn seen(drifts: &[Drift], seed: u64) -> Vec<[f64; 3]> {
    let mut rng = Rng::new(seed, 3);
    let mut all = Vec::new();
    for (i, drift) in drifts.iter().enumerate() {
        let others = || drifts.iter().enumerate().filter(|(j, _)| *j != i);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "points"
        )]
        let n = (drift.length * 2_500.0) as usize;
        let own = drift.points(n, &mut rng).into_iter();
        all.extend(own.filter(|p| !others().any(|(_, d)| d.holds(*p))));
    }
    all
}

struct Scene {
    asked: &'static str,
    map: Vec<[f64; 3]>,
    query: Vec<[f64; 3]>,
    expected: Verdict,
}

fn scenes() -> Vec<Scene> {
    let drift = |from, heading, length, rock| Drift {
        from,
        heading,
        length,
        relief: 0.3,
        dip: 0.0,
        rock,
    };
    let main = drift([0.0, 0.0], 0.0, 70.0, 1);
    let crosscut = drift([28.0, 0.0], 1.4, 25.0, 2);
    let twin = drift([28.0, 0.0], 1.4, 25.0, 3);
    let mine = [main, crosscut];
    let around = |all: Vec<[f64; 3]>, x: [f64; 2]| -> Vec<[f64; 3]> {
        let inside = |p: &[f64; 3]| p[0] > x[0] && p[0] < x[1] && p[1] < 9.0;
        all.into_iter().filter(inside).collect()
    };
    let copy = |drifts: [Drift; 2]| {
        drifts.map(|d| Drift {
            from: [d.from[0], d.from[1] - 40.0],
            ..d
        })
    };
    let bare = Drift {
        relief: 0.0,
        dip: 0.5,
        ..main
    };
    let here = [18.0, 42.0];
    vec![
        Scene {
            asked: "a drive past the crosscut",
            map: seen(&mine, 1),
            query: around(seen(&mine, 2), here),
            expected: Verdict::Located,
        },
        Scene {
            asked: "the same, in a map with the same rock twice",
            map: [seen(&mine, 1), seen(&copy(mine), 3)].concat(),
            query: around(seen(&mine, 2), here),
            expected: Verdict::Ambiguous,
        },
        Scene {
            asked: "a drift without relief, its walls leaning",
            map: seen(&[bare], 1),
            query: around(seen(&[bare], 2), here),
            expected: Verdict::Degenerate,
        },
        Scene {
            asked: "a drive in another mine",
            map: seen(&mine, 1),
            query: around(seen(&[drift([0.0, 0.0], 0.0, 70.0, 8), twin], 2), here),
            expected: Verdict::NotFound,
        },
        Scene {
            asked: "a few points of one wall",
            map: seen(&mine, 1),
            query: around(seen(&mine, 2), [10.0, 14.0])
                .into_iter()
                .filter(|p| p[1] > 1.2)
                .step_by(40)
                .collect(),
            expected: Verdict::Insufficient,
        },
    ]
}

fn main() -> Result<()> {
    let file = std::env::args().nth(1);
    let folder = std::env::args().nth(2).map(PathBuf::from);
    let scenes = scenes();
    let mut thumbs = Vec::new();
    for (i, scene) in (0u64..).zip(&scenes) {
        let frame = random_frame(i);
        let query: Vec<[f64; 3]> = scene.query.iter().map(|p| frame.transform(*p)).collect();
        let (map, _) = Cloud::from_points(&scene.map)?;
        let (query_cloud, _) = Cloud::from_points(&query)?;
        if let Some(folder) = &folder {
            let own = folder.join(scene.expected.name());
            std::fs::create_dir_all(&own)?;
            for (name, cloud) in [("map.pcd", &map), ("query.pcd", &query_cloud)] {
                winze_io::write_cloud(&own.join(name), cloud, &Default::default())?;
            }
        }
        let outcome = winze::locate(&map, &query_cloud, &Config::default())?;
        println!(
            "{}: {:?}\n  {}",
            scene.asked, outcome.verdict, outcome.reason
        );
        if outcome.verdict != scene.expected {
            println!("  (expected: {:?})", scene.expected);
        }
        // Where it lies, or, where it was refused, beside the map.
        let places = match outcome.verdict {
            Verdict::Ambiguous => 2,
            Verdict::Located | Verdict::Degenerate => 1,
            _ => 0,
        };
        let step = query.len().div_ceil(20_000);
        let some = || query.iter().step_by(step);
        let mut shown: Vec<[f64; 3]> = outcome.hypotheses[..places.min(outcome.hypotheses.len())]
            .iter()
            .flat_map(|h| some().map(|p| h.map_from_query.transform(*p)))
            .collect();
        if shown.is_empty() {
            let beside = |p: &[f64; 3]| [p[0], p[1] - 22.0, p[2]];
            shown = scene.query.iter().step_by(step).map(beside).collect();
        }
        thumbs.push(Thumb {
            map: &scene.map,
            query: shown,
            in_map: places > 0,
            title: outcome.verdict.to_string(),
            note: scene.asked.into(),
        });
    }
    if let Some(file) = file {
        std::fs::write(
            file,
            contact_sheet(
                "a verdict each: map magenta, query green where it was found",
                &thumbs,
            )?,
        )?;
    }
    Ok(())
}
