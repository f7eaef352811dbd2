//! Tests of whole worlds, at coarse cells.

use super::*;
use crate::error::Error;
use std::collections::{BTreeMap, BTreeSet};

fn quiet(_: f64) {}

fn built(spec: &WorldSpec, seed: u64, change: Option<&Change>) -> World {
    build(spec, seed, change, &quiet).unwrap()
}

fn small() -> Vec<WorldSpec> {
    vec![
        WorldSpec::Drifts(Drifts {
            length: 70.0,
            cell: 0.3,
            wet: 0.2,
            roughness: 0.35,
            fittings: Fittings {
                vehicles: 3.0,
                ..Fittings::typical()
            },
            ..Drifts::default()
        }),
        WorldSpec::Rooms(Rooms {
            extent_x: 40.0,
            extent_y: 25.0,
            cell: 0.4,
            ..Rooms::default()
        }),
        WorldSpec::Parallel(Parallel {
            length: 60.0,
            spacing: 20.0,
            pitch: 20.0,
            crosscuts: 3,
            cell: 0.3,
            ..Parallel::default()
        }),
        WorldSpec::Cave(Cave {
            length: 40.0,
            cell: 0.35,
            ..Cave::default()
        }),
        WorldSpec::Wall(Wall {
            width: 4.0,
            cell: 0.08,
            ..Wall::default()
        }),
    ]
}

type Corner = [u32; 3];

/// The rock's triangles by the bits of their corners, and whether they are new.
fn rock(mesh: &Mesh) -> Vec<([Corner; 3], bool)> {
    let mut out = Vec::new();
    for i in 0..mesh.triangles().len() {
        let part = &mesh.parts()[usize::from(mesh.part_of()[i])];
        if ["rock", "floor", "water", "wet rock"].contains(&part.name.as_str()) {
            out.push((
                mesh.corners(i).unwrap().map(|c| c.map(f32::to_bits)),
                part.new,
            ));
        }
    }
    out
}

#[test]
fn the_rock_is_closed() {
    // All but the wall, which is a patch.
    for spec in small().into_iter().take(4) {
        let world = built(&spec, 3, None);
        let mut edges: BTreeMap<(Corner, Corner), [u32; 2]> = BTreeMap::new();
        let triangles = rock(&world.mesh);
        assert!(
            triangles.len() > 2000,
            "{} {}",
            spec.kind(),
            triangles.len()
        );
        for (t, _) in &triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                edges.entry((a.min(b), a.max(b))).or_default()[usize::from(a < b)] += 1;
            }
        }
        // Two triangles at every edge, wound alike.
        let bad = edges.values().filter(|n| **n != [1, 1]).count();
        assert_eq!(bad, 0, "{} of {} edges, {}", bad, edges.len(), spec.kind());
        let marks = world
            .marks
            .iter()
            .map(|m| m.name.clone())
            .collect::<BTreeSet<_>>();
        assert_eq!(
            marks.len(),
            world.marks.len(),
            "marks have names of their own"
        );
    }
}

#[test]
fn vertices_lie_on_the_surface() {
    let WorldSpec::Parallel(spec) = small().swap_remove(2) else {
        panic!("parallel")
    };
    let field = Field {
        plan: parallel::lay_out(&spec).plan,
        relief: Relief::new(WorldSpec::Parallel(spec.clone()).rock(), 3.5, 0.6, 9),
    };
    let surface = polygonise::polygonise(&field, &quiet).unwrap();
    let (mut off, mut from_plan) = (Vec::new(), Vec::new());
    for v in &surface.vertices {
        let p = v.map(f64::from);
        let near = field.near([p, p]);
        off.push(field.at(p, &near).abs());
        let place = field.plan.at(p, &near);
        assert!(place.clearance.abs() < 0.25 + 0.1, "{place:?}");
        if place.up > 1.0 {
            from_plan.push(place.clearance);
        }
    }
    off.sort_by(f64::total_cmp);
    let [half, most] = [off.len() / 2, off.len() * 95 / 100].map(|i| off[i]);
    assert!(half < 0.001 && most < 0.02, "{half} {most}");
    let n = from_plan.len() as f64;
    let mean = from_plan.iter().sum::<f64>() / n;
    let deviation = (from_plan
        .iter()
        .map(|v| (v - mean) * (v - mean))
        .sum::<f64>()
        / n)
        .sqrt();
    assert!((0.05..0.14).contains(&deviation), "{deviation}");
}

#[test]
fn the_same_bits_at_any_thread_count_and_others_for_other_seeds() {
    for spec in small() {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| built(&spec, 5, None))
        };
        let one = on(1);
        assert_eq!(one, on(3), "{}", spec.kind());
        assert_ne!(one.mesh, built(&spec, 6, None).mesh);
    }
}

#[test]
fn a_change_leaves_the_rest_as_it_was() {
    let spec = small().swap_remove(0);
    let change = Change {
        vehicles: 1.0,
        muck: 1.0,
        mesh: 0.5,
        headings: 1.0,
        advance: 4.0,
    };
    let (before, after) = (built(&spec, 3, None), built(&spec, 3, Some(&change)));
    let was: BTreeSet<_> = rock(&before.mesh).into_iter().map(|t| t.0).collect();
    let (mut same, mut new) = (0, 0);
    for (t, is_new) in rock(&after.mesh) {
        if is_new {
            new += 1;
        } else {
            same += 1;
            assert!(was.contains(&t), "rock that changed is marked as new");
        }
    }
    assert!(
        new > 300 && same * 10 > was.len() * 6,
        "{new} {same} {}",
        was.len()
    );
    let parts = |w: &World, name: &str| {
        let found = w
            .mesh
            .parts()
            .iter()
            .filter(|p| p.name == name)
            .map(|p| p.new);
        found.collect::<Vec<_>>()
    };
    assert_eq!(parts(&before, "vehicle"), [false]);
    assert_eq!(parts(&after, "vehicle"), [true]);
    assert_eq!(parts(&after, "muck"), [true]);
    assert_eq!(parts(&after, "mesh"), [false, true]);
    assert_eq!(parts(&after, "bolt"), [false]);
    let nothing = Change::default();
    assert_eq!(built(&spec, 3, Some(&nothing)), before);
}

#[test]
fn below_every_mark_lies_the_floor() {
    for spec in small() {
        let world = built(&spec, 3, None);
        let caster = crate::raycast::Caster::new(world.mesh).unwrap();
        assert!(!world.marks.is_empty());
        for mark in &world.marks {
            let above = [mark.floor[0], mark.floor[1], mark.floor[2] + 1.0];
            let hit = caster.cast(above, [0.0, 0.0, -1.0], 5.0);
            let down = hit.map(|h| h.range);
            // Rough, littered with muck, or under water; but a floor, and the mark above it.
            assert!(
                down.is_some_and(|d| d > 0.05 && d < 2.0),
                "{mark:?}: {down:?}"
            );
        }
    }
}

#[test]
fn worlds_that_are_too_large_are_refused_with_the_remedy() {
    let spec = WorldSpec::Drifts(Drifts {
        length: 40_000.0,
        cell: 0.05,
        ..Drifts::default()
    });
    let Err(Error::Setting { key, why }) = build(&spec, 0, None, &quiet) else {
        panic!("built");
    };
    assert_eq!(key, "world.cell");
    assert!(why.contains("cell at least 0."), "{why}");
}

/// Speed and size of the worlds at their defaults, and 2 km of drift: run by hand, in release.
#[test]
#[ignore = "minutes"]
fn sizes() {
    let long = Drifts {
        length: 2000.0,
        ..Drifts::default()
    };
    for spec in [
        WorldSpec::Drifts(long),
        WorldSpec::Drifts(Drifts::default()),
        WorldSpec::Rooms(Rooms::default()),
        WorldSpec::Parallel(Parallel::default()),
        WorldSpec::Cave(Cave::default()),
        WorldSpec::Wall(Wall::coal()),
        WorldSpec::Wall(Wall::limestone()),
    ] {
        let start = std::time::Instant::now();
        let world = built(&spec, 1, None);
        println!(
            "{} {:.0} m: {} triangles, {} parts, {:.1} s",
            spec.kind(),
            world.drift_length,
            world.mesh.triangles().len(),
            world.mesh.parts().len(),
            start.elapsed().as_secs_f64()
        );
    }
}
