//! A query as a line along its longest axis, in equal sections, each as broad as the whole: how errors that grow along it move its pose.

use nalgebra::{Matrix3, Vector3};

use crate::symmetric::eigen;

/// Sections of the line.
pub(crate) const SECTIONS: usize = 32;

/// Nobody's odometry turns by more than this, radians a metre.
pub(crate) const MOST_TURNED: f64 = 0.05;

/// How one kind of error moves and turns each section.
pub(crate) type Motion = [(Vector3<f64>, Vector3<f64>); SECTIONS];

/// A query as a line, and the part of it that lies on the map.
#[derive(Debug, Clone)]
pub(crate) struct Line {
    pub(crate) axis: Vector3<f64>,
    /// Where it begins, along the axis from the query's centroid, and the length of a section.
    start: f64,
    pub(crate) step: f64,
    /// What resists turning about the line itself: `tr(T) - T` of the scatter `T` across it.
    breadth: Matrix3<f64>,
    /// Share of the points in each section, of all and of those on the map.
    all: [f64; SECTIONS],
    on_map: [f64; SECTIONS],
}

impl Line {
    pub(crate) fn of(all: &[[f64; 3]], on_map: &[[f64; 3]], centre: [f64; 3]) -> Self {
        let centre = Vector3::from(centre);
        let from_centre = |p: &[f64; 3]| Vector3::from(*p) - centre;
        let sum = all.iter().map(from_centre).map(|p| p * p.transpose());
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let scatter: Matrix3<f64> = sum.sum::<Matrix3<f64>>() / all.len() as f64;
        let e = eigen(scatter.into());
        let axis = Vector3::from(e.vectors[2]);
        let across = Matrix3::identity() - axis * axis.transpose();
        let across = across * scatter * across;
        let along = |p: &[f64; 3]| from_centre(p).dot(&axis);
        let (least, most) = all
            .iter()
            .map(along)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), s| {
                (a.min(s), b.max(s))
            });
        #[expect(clippy::cast_precision_loss, reason = "a small count")]
        let step = ((most - least) / SECTIONS as f64).max(f64::MIN_POSITIVE);
        let shares = |points: &[[f64; 3]]| {
            let mut shares = [0.0; SECTIONS];
            for p in points {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "saturates"
                )]
                let section = ((along(p) - least) / step) as usize;
                #[expect(clippy::cast_precision_loss, reason = "a count")]
                let share = 1.0 / points.len() as f64;
                shares[section.min(SECTIONS - 1)] += share;
            }
            shares
        };
        Self {
            axis,
            start: least,
            step,
            breadth: Matrix3::identity() * across.trace() - across,
            all: shares(all),
            on_map: shares(on_map),
        }
    }

    /// How one kind of error moves and turns each section, given how far along the line it lies.
    pub(crate) fn motion(&self, of: impl Fn(f64) -> (Vector3<f64>, Vector3<f64>)) -> Motion {
        std::array::from_fn(|i| of(self.at(i) - self.start))
    }

    /// What such errors put between the pose of all points and the pose of those on the map: `[δt, δθ]` about the query's centroid.
    pub(crate) fn apart(&self, motion: &Motion) -> [f64; 6] {
        let (whole, part) = (
            self.pose(&self.all, motion),
            self.pose(&self.on_map, motion),
        );
        std::array::from_fn(|i| whole[i] - part[i])
    }

    /// How far off the query's centroid the pose of the part on the map is, in units of how much that part is bent, root mean square, where
    /// the whole turns at one rate. 0 where all of it lies there.
    fn leverage(&self) -> f64 {
        let arc = self.arc();
        let [x, y, z, turn @ ..] = self.pose(&self.on_map, &arc);
        let (shift, turn) = (Vector3::new(x, y, z), Vector3::from(turn));
        let left = |i: usize| {
            let rigid = shift + turn.cross(&(self.axis * self.at(i)));
            self.on_map[i] * (arc[i].0 - rigid).norm_squared()
        };
        let bend = (0..SECTIONS).map(left).sum::<f64>().sqrt();
        // A part that is one section has no bend that could be seen.
        self.off_by_turning() / bend.max(1e-9)
    }

    /// How far off the query's centroid the pose of the part on the map is, metres, where that part is bent by so much, root mean square, and
    /// the rest bends on alike; as far as anybody's odometry turns.
    pub(crate) fn beyond(&self, bend: f64) -> f64 {
        if bend > 0.0 {
            (self.leverage() * bend).min(self.off_by_turning() * MOST_TURNED)
        } else {
            0.0
        }
    }

    /// How far off the query's centroid the pose of the part on the map is, metres, where the whole turns by a radian a metre.
    pub(crate) fn off_by_turning(&self) -> f64 {
        let [x, y, z, ..] = self.apart(&self.arc());
        Vector3::new(x, y, z).norm()
    }

    /// The line, turned by a radian a metre about some axis across it.
    fn arc(&self) -> Motion {
        let aside = Vector3::ith(self.axis.iamin(), 1.0);
        let across = self.axis.cross(&aside).normalize();
        let push = across.cross(&self.axis);
        self.motion(|way| (push * (way * way / 2.0), across * way))
    }

    /// The middle of a section, from the query's centroid.
    fn at(&self, section: usize) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "a small count")]
        let section = section as f64;
        self.start + (section + 0.5) * self.step
    }

    /// The rigid motion `[δt, δθ]` about the query's centroid that fits the motions of the sections best, in the least-squares sense over points.
    fn pose(&self, shares: &[f64; SECTIONS], motion: &Motion) -> [f64; 6] {
        let sections = || shares.iter().zip(motion).enumerate();
        let middle: f64 = sections().map(|(i, (share, _))| share * self.at(i)).sum();
        let (mut shift, mut turn, mut lever) =
            (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        let mut spread = 0.0;
        for (i, (share, (moved, turned))) in sections() {
            let s = self.at(i) - middle;
            shift += moved * *share;
            turn += turned * *share;
            lever += moved * (share * s);
            spread += share * s * s;
        }
        let across = Matrix3::identity() - self.axis * self.axis.transpose();
        let resists = self.breadth + across * spread;
        let pulls = self.axis.cross(&lever) + self.breadth * turn;
        // What has no breadth at all turns as its sections do on average.
        let turn = resists.lu().solve(&pulls).unwrap_or(turn);
        let shift = shift - turn.cross(&(self.axis * middle));
        [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The leverage of the first `share` of a thin line of 60 m.
    fn leverage(share: f64) -> f64 {
        let points = |length: f64| -> Vec<[f64; 3]> {
            let at = |i: u32| {
                let a = f64::from(i) * 2.4;
                let x = length * (f64::from(i) + 0.5) / 20_000.0;
                [x - 30.0, 0.01 * libm::cos(a), 0.01 * libm::sin(a)]
            };
            (0..20_000).map(at).collect()
        };
        Line::of(&points(60.0), &points(60.0 * share), [0.0; 3]).leverage()
    }

    #[test]
    fn a_part_too_short_to_show_a_bend_may_hide_any() {
        let all: Vec<[f64; 3]> = (0..1000).map(|i| [0.06 * f64::from(i), 0.0, 0.0]).collect();
        let line = Line::of(&all, &all[..20], [30.0, 0.0, 0.0]);
        assert_eq!(line.beyond(0.0), 0.0);
        let off = line.beyond(0.01);
        assert!(
            off > 5.0 && off <= line.off_by_turning() * MOST_TURNED,
            "{off}"
        );
        let one = Line::of(&all[..1], &all[..1], [0.0; 3]);
        assert!(one.beyond(0.01) < 1e-9);
    }

    #[test]
    fn an_arc_of_which_a_part_is_seen_is_off_in_the_middle() {
        // y = kx²/2 on the unit line: a line fitted to the first f of it misses the one fitted to all at the middle by
        // k/2 ((1-f)²/4 - f²/12 + 1/12), where its own residual is k/2 f² / (6 √5). A quarter of the line is eight sections.
        for f in [0.25, 0.5, 0.75] {
            let off = (1.0 - f) * (1.0 - f) / 4.0 - f * f / 12.0 + 1.0 / 12.0;
            let expected = off / (f * f / (6.0 * 5.0f64.sqrt()));
            let found = leverage(f);
            assert!(
                (found / expected - 1.0).abs() < 0.06,
                "{f}: {found} {expected}"
            );
        }
        assert!(leverage(1.0) < 1e-9);
    }
}
