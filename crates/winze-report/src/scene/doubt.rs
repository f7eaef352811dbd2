//! What is not known of the pose: directions that the geometry leaves open, and how far off the rest may be.

use serde::Serialize;
use winze::Outcome;
use winze::degeneracy::DirectionKind;
use winze::eigen3::eigen3;

/// A direction that nothing resists.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Open {
    kind: DirectionKind,
    direction: [f64; 3],
}

/// Those of an outcome.
pub(super) fn open(outcome: &Outcome) -> Vec<Open> {
    let all = outcome.unobservable.iter().flatten();
    all.map(|d| Open {
        kind: d.kind,
        direction: d.direction,
    })
    .collect()
}

/// Where the query's centroid lies with a probability of 95 %, were errors normal.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Ellipsoid {
    /// Unit vectors, map axes.
    axes: [[f64; 3]; 3],
    /// Half its length along each, metres, ascending.
    pub(crate) half: [f64; 3],
}

impl Ellipsoid {
    /// Along its longest axis.
    pub(crate) fn long(&self) -> [f64; 3] {
        // Minus zero reads badly.
        self.axes[2].map(|v| (100.0 * v).round() / 100.0 + 0.0)
    }
}

/// Square root of the 95 % point of χ² with three degrees of freedom.
const WITHIN_95: f64 = 2.795_483;

/// That of an outcome's covariance.
pub(crate) fn ellipsoid(outcome: &Outcome) -> Option<Ellipsoid> {
    let c = outcome.covariance?;
    let e = eigen3(&[c[0][0], c[0][1], c[0][2], c[1][1], c[1][2], c[2][2]]);
    let half = e.values.map(|v| WITHIN_95 * v.max(0.0).sqrt());
    half.iter().all(|v| v.is_finite()).then_some(Ellipsoid {
        axes: e.vectors,
        half,
    })
}
