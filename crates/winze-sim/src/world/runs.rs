//! Ways through a world, along which fittings are put.

/// A place on a way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Station {
    /// The planned floor, metres.
    pub(super) floor: [f64; 3],
    /// Width there, metres.
    pub(super) width: f64,
    /// Height there, metres.
    pub(super) height: f64,
}

/// A way.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Run {
    /// Its stations.
    pub(super) stations: Vec<Station>,
    /// The number of the leg at whose end there is a face, where there is.
    pub(super) heading: Option<usize>,
}

/// A place along a way with its directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spot {
    pub(super) floor: [f64; 3],
    /// Unit vector along the way, level.
    pub(super) along: [f64; 2],
    pub(super) width: f64,
    pub(super) height: f64,
}

impl Spot {
    /// The place `ahead`, to the `left` and `up` of it, metres.
    pub(super) fn place(&self, ahead: f64, left: f64, up: f64) -> [f64; 3] {
        let [c, s] = self.along;
        [
            self.floor[0] + c * ahead - s * left,
            self.floor[1] + s * ahead + c * left,
            self.floor[2] + up,
        ]
    }

    /// A direction given to the left and up.
    pub(super) fn direction(&self, left: f64, up: f64) -> [f64; 3] {
        [-self.along[1] * left, self.along[0] * left, up]
    }
}

impl Run {
    fn steps(&self) -> impl Iterator<Item = (&Station, &Station, f64)> {
        self.stations
            .iter()
            .zip(self.stations.iter().skip(1))
            .map(|(a, b)| {
                let d = [b.floor[0] - a.floor[0], b.floor[1] - a.floor[1]];
                (a, b, (d[0] * d[0] + d[1] * d[1]).sqrt())
            })
    }

    /// Length in plan, metres.
    pub(super) fn length(&self) -> f64 {
        self.steps().map(|s| s.2).sum()
    }

    /// The place `s` metres along it, `None` beyond its ends.
    pub(super) fn at(&self, s: f64) -> Option<Spot> {
        let mut before = 0.0;
        for (a, b, length) in self.steps() {
            if s >= before && s <= before + length && length > 0.0 {
                let t = (s - before) / length;
                return Some(Spot {
                    floor: super::between(&[a.floor, b.floor], t),
                    along: [
                        (b.floor[0] - a.floor[0]) / length,
                        (b.floor[1] - a.floor[1]) / length,
                    ],
                    width: a.width + t * (b.width - a.width),
                    height: a.height + t * (b.height - a.height),
                });
            }
            before += length;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_along_a_way() {
        let station = |x: f64, y: f64, z: f64| Station {
            floor: [x, y, z],
            width: 4.0 + z,
            height: 3.0,
        };
        let run = Run {
            stations: vec![
                station(0.0, 0.0, 0.0),
                station(10.0, 0.0, 1.0),
                station(10.0, 5.0, 1.0),
            ],
            heading: None,
        };
        assert_eq!(run.length(), 15.0);
        let spot = run.at(5.0).unwrap();
        assert_eq!((spot.floor, spot.width), ([5.0, 0.0, 0.5], 4.5));
        assert_eq!(spot.place(1.0, 2.0, 3.0), [6.0, 2.0, 3.5]);
        let spot = run.at(12.0).unwrap();
        assert_eq!(spot.place(0.0, 1.0, 0.0), [9.0, 2.0, 1.0]);
        assert_eq!(run.at(15.1), None);
    }
}
