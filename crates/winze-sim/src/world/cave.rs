//! A cave that meanders.

use winze::rng::Rng;

use super::kinds::Cave;
use super::plan::{Plan, Tube};
use super::{Layout, Mark, Run, Station};

/// Length of a step, metres.
const STEP: f64 = 3.0;
/// Steepest slope, metres of rise a metre.
const STEEPEST: f64 = 0.3;
/// Depth of the sediment's top below the axis, share of the half height.
const FLOOR: f64 = 0.6;

/// The end of a passage that still grows.
#[derive(Clone, Copy)]
struct Head {
    at: [f64; 3],
    azimuth: f64,
    /// Turn a step, which itself wanders: passages meander.
    turn: f64,
    slope: f64,
    radius: f64,
    left: u32,
}

/// Grows a cave from the origin.
pub(super) fn grow(spec: &Cave, seed: u64) -> Layout {
    let mut rng = Rng::new(seed, 0x6361_7665);
    let mut layout = Layout {
        plan: Plan::Tubes(Vec::new()),
        runs: Vec::new(),
        marks: Vec::new(),
        length: 0.0,
    };
    let mut tubes = Vec::new();
    let mut heads = std::collections::VecDeque::from([Head {
        at: [0.0; 3],
        azimuth: rng.range(0.0, std::f64::consts::TAU),
        turn: 0.0,
        slope: 0.0,
        radius: rng.range(spec.radius[0], spec.radius[1]),
        left: u32::MAX,
    }]);
    let (mut chambers, mut branches) = (0, 0);
    while let Some(mut head) = heads.pop_front() {
        let mut stations = vec![station(&head, spec)];
        // A side passage is followed to its end, the main one as far as there is cave left.
        while head.left > 0 && layout.length < spec.length {
            let from = head;
            let step = STEP.min(spec.length - layout.length).max(0.5);
            wander(&mut head, step, spec, &mut rng);
            tubes.push(Tube {
                ends: [from.at, head.at],
                radius: [from.radius, head.radius],
                flatness: spec.flatness,
                floor: FLOOR,
            });
            stations.push(station(&head, spec));
            layout.length += step;
            let mark = |name: String| Mark {
                name,
                floor: floor(&head, spec),
                azimuth: head.azimuth,
            };
            if layout.marks.is_empty() {
                layout.marks.push(mark("start".into()));
            }
            if rng.uniform() < spec.chambers * STEP / 100.0 {
                chambers += 1;
                layout.marks.push(mark(format!("chamber {chambers}")));
                tubes.push(chamber(&head, spec, &mut rng));
            }
            if rng.uniform() < spec.branches * STEP / 100.0 {
                branches += 1;
                layout.marks.push(mark(format!("junction {branches}")));
                let side = if rng.uniform() < 0.5 { 1.0 } else { -1.0 };
                heads.push_back(Head {
                    azimuth: head.azimuth + side * rng.range(0.9, 1.8),
                    turn: 0.0,
                    radius: mixed(spec.radius, rng.range(0.0, 0.5)),
                    left: 4 + rng.below(14),
                    ..head
                });
            }
            // Side passages get their share of the length before the main one uses it up.
            if head.left > 1000 && heads.len() > 2 {
                break;
            }
        }
        layout.marks.push(Mark {
            name: format!("end {}", layout.runs.len() + 1),
            floor: floor(&head, spec),
            azimuth: head.azimuth + std::f64::consts::PI,
        });
        layout.runs.push(Run {
            stations,
            heading: None,
        });
        if head.left > 0 && layout.length < spec.length {
            layout.marks.pop();
            heads.push_back(head);
        }
    }
    layout.plan = Plan::Tubes(tubes);
    layout
}

/// Moves a head one step on.
fn wander(head: &mut Head, step: f64, spec: &Cave, rng: &mut Rng) {
    head.turn = (0.8 * head.turn + 0.12 * rng.normal()).clamp(-0.5, 0.5);
    head.azimuth += head.turn;
    head.slope = (0.85 * head.slope + 0.08 * rng.normal()).clamp(-STEEPEST, STEEPEST);
    head.at[0] += step * libm::cos(head.azimuth);
    head.at[1] += step * libm::sin(head.azimuth);
    head.at[2] += step * head.slope;
    let grown = head.radius * libm::exp(0.18 * rng.normal());
    head.radius = grown.clamp(spec.radius[0], spec.radius[1]);
    head.left = head.left.saturating_sub(1);
}

fn mixed(range: [f64; 2], t: f64) -> f64 {
    range[0] + t * (range[1] - range[0])
}

/// A wide place about a head, on the same floor.
fn chamber(head: &Head, spec: &Cave, rng: &mut Rng) -> Tube {
    let radius = spec.chamber * rng.range(0.7, 1.1);
    let flatness = spec.flatness.min(0.7);
    let reach = 0.4 * radius;
    let (c, s) = (libm::cos(head.azimuth), libm::sin(head.azimuth));
    let z = floor(head, spec)[2] + FLOOR * flatness * radius;
    let end = |by: f64| [head.at[0] + by * c, head.at[1] + by * s, z];
    Tube {
        ends: [end(-reach), end(reach)],
        radius: [radius, 0.9 * radius],
        flatness,
        floor: FLOOR,
    }
}

/// The floor below a head.
fn floor(head: &Head, spec: &Cave) -> [f64; 3] {
    let [x, y, z] = head.at;
    [x, y, z - FLOOR * spec.flatness * head.radius]
}

fn station(head: &Head, spec: &Cave) -> Station {
    Station {
        floor: floor(head, spec),
        width: 1.6 * head.radius,
        height: (1.0 + FLOOR) * spec.flatness * head.radius,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cave_has_its_length_and_is_open_where_it_is_marked() {
        for seed in 0..5 {
            let spec = Cave::default();
            let layout = grow(&spec, seed);
            assert!((layout.length - 300.0).abs() < 1.0, "{}", layout.length);
            let Plan::Tubes(tubes) = &layout.plan else {
                panic!("a cave");
            };
            let near: Vec<u32> = (0..tubes.len() as u32).collect();
            for mark in &layout.marks {
                let [x, y, z] = mark.floor;
                let place = layout.plan.at([x, y, z + 1.0], &near);
                assert!(place.clearance > 0.3, "{mark:?} {place:?}");
            }
            assert!(layout.runs.len() > 3 && layout.marks[0].name == "start");
        }
    }
}
