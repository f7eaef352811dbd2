//! Parallel drifts with equal crosscuts.

use super::kinds::Parallel;
use super::plan::{Leg, Plan};
use super::{Layout, Mark, Run, Station};

/// Lays parallel drifts out, along x from the origin, with crosscuts along y.
pub(super) fn lay_out(spec: &Parallel) -> Layout {
    let station = |x: f64, y: f64| Station {
        floor: [x, y, spec.grade * x],
        width: spec.width,
        height: spec.height,
    };
    let mut legs = Vec::new();
    let mut runs = Vec::new();
    let mut marks = Vec::new();
    let mut length = 0.0;
    let mut add = |from: Station, to: Station, faces: bool| {
        let leg = Leg {
            ends: [from.floor, to.floor],
            width: [spec.width; 2],
            height: [spec.height; 2],
            arch: spec.arch,
            face: [faces; 2],
            drift: legs.len(),
        };
        length += leg.length();
        runs.push(Run {
            stations: vec![from, to],
            heading: faces.then_some(legs.len()),
        });
        legs.push(leg);
    };
    let mut mark = |name: String, s: Station, azimuth: f64| {
        marks.push(Mark {
            name,
            floor: s.floor,
            azimuth,
        });
    };
    for d in 0..spec.drifts {
        let y = f64::from(d) * spec.spacing;
        add(station(0.0, y), station(spec.length, y), true);
        mark(format!("drift {} west", d + 1), station(3.0, y), 0.0);
        let east = station(spec.length - 3.0, y);
        mark(format!("drift {} east", d + 1), east, std::f64::consts::PI);
    }
    let first = 0.5 * (spec.length - f64::from(spec.crosscuts.max(1) - 1) * spec.pitch);
    for d in 1..spec.drifts {
        let y = f64::from(d - 1) * spec.spacing;
        for c in 0..spec.crosscuts {
            let x = first + f64::from(c) * spec.pitch;
            add(station(x, y), station(x, y + spec.spacing), false);
            for (end, y) in [("south", y), ("north", y + spec.spacing)] {
                let name = format!("crosscut {d} {} {end}", c + 1);
                mark(name, station(x, y), 0.0);
            }
        }
    }
    Layout {
        plan: Plan::Legs(legs),
        runs,
        marks,
        length,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crosscuts_repeat_at_their_pitch() {
        let spec = Parallel {
            grade: 0.02,
            ..Parallel::default()
        };
        let layout = lay_out(&spec);
        assert_eq!(layout.length, 2.0 * 260.0 + 9.0 * 40.0);
        assert_eq!(layout.marks.len(), 4 + 18);
        let everything: Vec<u32> = (0..11).collect();
        for i in 0..8000u32 {
            let [x, y, z] = [i % 20, i / 20 % 20, i / 400].map(f64::from);
            let p = [100.0 + 1.5 * x, 2.1 * y - 1.0, 2.0 + 0.2 * z];
            let q = [p[0] + 30.0, p[1], p[2] + 0.6];
            let [a, b] = [p, q].map(|p| layout.plan.at(p, &everything));
            assert!((a.clearance - b.clearance).abs() < 1e-9);
            assert!((a.up - b.up).abs() < 1e-9 || a.clearance < -0.5);
        }
    }
}
