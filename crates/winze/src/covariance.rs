//! How far off a pose may be: a covariance that knows that neighbouring points err together.
//!
//! Were the residuals of a point-to-plane fit independent, `σ² (Σ JᵀJ)⁻¹` would be its covariance, and thousands of points would make
//! that a fraction of a millimetre. But a bump that the map has smoothed away or a vehicle that has moved shifts all points around it alike,
//! and an odometry that bends shifts whole sections of the passage. Both are measured, on blocks of several sizes, and in each direction the one that
//! leaves most doubt is believed.
//!
//! * **Patches err together**: each block's pull on the pose, `s = Σ Jᵀr`, counts as one observation, which gives the covariance
//!   `H⁻¹ (Σ s sᵀ) H⁻¹` (the cluster-robust sandwich: White 1980, Liang & Zeger 1986). It needs many blocks.
//! * **Sections are displaced**: each block's own best displacement is fitted to its residuals. Their variance, one for level displacements and one for
//!   upright ones, which gravity holds, is carried over to the pose. A few blocks tell it, since all of them tell two numbers.
//!
//! Some of the error no residual shows: the map was made by an odometry too and may be off around the query as a whole, and a fit clings to some walls
//! more than to others. That much is added ([`OdometryConfig::map`]), level, since gravity holds the rest where the map's z is up.
//!
//! What of the query is not in the map hangs on the rest by the query's own odometry, whose errors are added: those of odometry as one is used to it
//! ([`OdometryConfig`]), or those of an arc that goes on as the query is seen to bend where it lies on the map, if that is more.
//!
//! Along a direction that the geometry leaves open ([`degeneracy`](crate::degeneracy)) residuals say nothing. There the pose is moved until the
//! query no longer lies on the map, and the way is the uncertainty.

use rayon::prelude::*;
use rustc_hash::FxHashMap;

use crate::config::{OdometryConfig, VerifyConfig};
use crate::degeneracy::{DirectionKind, Unobservable};
use crate::icp::{Information, Row, Rows, rows};
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::symmetric::eigen;
use crate::vec3::{distance, dot, scale, sub, voxel_of};
use crate::verify::fit;

use extrapolate::extrapolate;

/// Covariance of a perturbation `[δt, δθ]` of a pose, in the axes of the map: `p ← exp(δθ)(p − c) + c + δt`
/// ([`Pose::perturbed`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Covariance {
    /// m², m·rad and rad².
    pub matrix: [[f64; 6]; 6],
    /// The point `c`, map frame, metres.
    pub about: [f64; 3],
}

impl Covariance {
    /// The same uncertainty, stated about another point of the map: turns about the old one move the new one.
    #[must_use]
    pub fn about(&self, point: [f64; 3]) -> Self {
        // δt' = δt + δθ × (c' − c)
        let [x, y, z] = sub(point, self.about);
        let mut change = identity();
        let cross = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]];
        for (row, cross) in change.iter_mut().zip(cross) {
            row[3..].copy_from_slice(&cross);
        }
        Self {
            matrix: sandwich(&change, &self.matrix),
            about: point,
        }
    }

    /// The same uncertainty in another frame: `frame_from_map` takes points of the map to it.
    #[must_use]
    pub fn in_frame(&self, frame_from_map: &Pose) -> Self {
        let mut change = [[0.0; 6]; 6];
        for j in 0..3 {
            let axis = std::array::from_fn(|k| f64::from(u8::from(k == j)));
            for (i, v) in frame_from_map.rotate(axis).into_iter().enumerate() {
                (change[i][j], change[i + 3][j + 3]) = (v, v);
            }
        }
        Self {
            matrix: sandwich(&change, &self.matrix),
            about: frame_from_map.transform(self.about),
        }
    }

    /// The squared length of a perturbation in units of this covariance (the normalised estimation error squared): 6 on average where
    /// the covariance is right. `None` where it is not positive definite.
    #[must_use]
    pub fn nees(&self, perturbation: [f64; 6]) -> Option<f64> {
        let inverse = inverted(&self.matrix, 0.0)?;
        let along =
            |row: &[f64; 6]| -> f64 { row.iter().zip(perturbation).map(|(a, b)| a * b).sum() };
        Some(
            inverse
                .iter()
                .zip(perturbation)
                .map(|(row, b)| along(row) * b)
                .sum(),
        )
    }
}

/// The perturbation `[δt, δθ]` in map axes that takes `pose` to `truth` (both `map_from_query`), about where `pose` puts the point `at` of
/// the query.
#[must_use]
pub fn perturbation(pose: &Pose, truth: &Pose, at: [f64; 3]) -> [f64; 6] {
    let [x, y, z] = sub(truth.transform(at), pose.transform(at));
    let [a, b, c] = truth.compose(&pose.inverse()).rotation_vector();
    [x, y, z, a, b, c]
}

/// Sizes of blocks that err together, in patches of wall ([`VerifyConfig::patch_size`]).
pub const PATCHES: [f64; 3] = [0.5, 1.0, 2.0];
/// Blocks of these below which nothing is said: a pose alone takes six.
const FEWEST: usize = 15;
/// Sizes of blocks that are displaced as one, in patches of wall.
pub const SECTIONS: [f64; 4] = [1.0, 2.0, 4.0, 8.0];
/// Upward part of a direction above which it counts as upright.
const UPRIGHT: f64 = 0.7;
/// Share of a block's normals that must face a direction for its displacement along it to count.
const FACING: f64 = 0.1;
/// Smallest curvature, as a share of the largest, that resists.
const FLOOR: f64 = 1e-6;

/// The covariance of `map_from_query`, a pose at which `query` was fitted to `map` by point-to-plane residuals; `open` are the
/// directions that its geometry leaves open, `beyond` is how far off the query's centroid its bend may leave the pose, metres, where that was
/// measured ([`Relief::beyond`](crate::relief::Relief::beyond)). `None` where too little of the query lies on the map to tell.
#[must_use]
pub fn estimate(
    map: &Surface<'_>,
    query: &Surface<'_>,
    map_from_query: &Pose,
    open: &[Unobservable],
    config: &VerifyConfig,
    odometry: &OdometryConfig,
    beyond: Option<f64>,
) -> Option<Covariance> {
    let blocks = config.patch_size.metres(map.voxel);
    let residuals = Residuals::of(map, query, map_from_query, config);
    let patches = PATCHES.par_iter();
    let sections = SECTIONS.par_iter();
    let told: Vec<Option<Covariance>> = patches
        .map(|size| residuals.of_patches(size * blocks))
        .chain(sections.map(|size| residuals.of_sections(size * blocks)))
        .collect();
    let envelope = told
        .iter()
        .flatten()
        .map(|c| scaled(&c.matrix, residuals.length))
        .reduce(|a, b| envelope(&a, &b))?;
    let mut matrix = scaled(&envelope, 1.0 / residuals.length);
    let elsewhere = residuals.of_odometry(odometry, beyond.unwrap_or(0.0));
    let map_itself = residuals.of_map(odometry);
    for more in [elsewhere, map_itself] {
        for (row, more) in matrix.iter_mut().zip(more.matrix) {
            for (v, more) in row.iter_mut().zip(more) {
                *v += more;
            }
        }
    }
    let mut covariance = Covariance {
        matrix,
        about: residuals.about,
    };
    for direction in open {
        stretch(
            &mut covariance,
            direction,
            map,
            query,
            map_from_query,
            config,
        );
    }
    Some(covariance)
}

/// The covariance were all residuals independent, `σ² H⁻¹`: what is commonly taken for the covariance of a registration, and far too small. For
/// comparison. `None` where a direction is altogether open.
#[must_use]
pub fn inverse_hessian(information: &Information) -> Option<Covariance> {
    let inverse = inverted(&information.matrix, 0.0)?;
    Some(Covariance {
        matrix: inverse.map(|row| row.map(|v| v * information.residual_variance)),
        about: information.about,
    })
}

/// The residuals of a fit, and what they say by themselves.
#[derive(Debug, Clone)]
pub struct Residuals {
    rows: Vec<Row>,
    /// The query's points at the pose, on the map or not, and their centroid, as offsets in the map.
    points: Vec<[f64; 3]>,
    centre: [f64; 3],
    /// `H⁻¹`, of all rows.
    inverse: Option<[[f64; 6]; 6]>,
    /// The query's centroid in the map.
    about: [f64; 3],
    /// Root mean square distance of the points from it.
    length: f64,
}

impl Residuals {
    /// Those of `query` on `map` at a pose.
    #[must_use]
    pub fn of(
        map: &Surface<'_>,
        query: &Surface<'_>,
        map_from_query: &Pose,
        config: &VerifyConfig,
    ) -> Self {
        let distance = config.overlap_distance.metres(map.voxel);
        let Rows {
            rows,
            points,
            centre,
            length,
        } = rows(map, query, map_from_query, distance, config.max_points);
        let mut information = [[0.0; 6]; 6];
        for row in &rows {
            add_outer(&mut information, &row.jacobian);
        }
        Self {
            inverse: inverted_scaled(&information, length),
            about: std::array::from_fn(|a| centre[a] + map.origin[a]),
            rows,
            points,
            centre,
            length,
        }
    }

    /// What the odometry does to the part of the query that is not on the map, where a bend is seen to leave the centroid so many metres off.
    #[must_use]
    pub fn of_odometry(&self, odometry: &OdometryConfig, beyond: f64) -> Covariance {
        let on_map: Vec<[f64; 3]> = self.rows.iter().map(|r| r.at).collect();
        Covariance {
            matrix: extrapolate(&self.points, &on_map, self.centre, odometry, beyond),
            about: self.about,
        }
    }

    /// How far off the pose may be as a whole for what no residual shows ([`OdometryConfig::map`]).
    #[must_use]
    pub fn of_map(&self, odometry: &OdometryConfig) -> Covariance {
        let mut matrix = [[0.0; 6]; 6];
        for axis in 0..3 {
            // Gravity holds what is upright and the tilt.
            let held = |free: bool| if free { 1.0 } else { odometry.tilt };
            let (off, turned) = (
                held(axis < 2) * odometry.map,
                held(axis == 2) * odometry.map / self.length.max(f64::MIN_POSITIVE),
            );
            matrix[axis][axis] = off * off;
            matrix[axis + 3][axis + 3] = turned * turned;
        }
        Covariance {
            matrix,
            about: self.about,
        }
    }

    /// The covariance where the points of a block of so many metres err together, those of two blocks do not; `None` for too few blocks.
    #[must_use]
    pub fn of_patches(&self, metres: f64) -> Option<Covariance> {
        let block_of = self.blocks(metres);
        let count = block_of.iter().max()? + 1;
        if count < FEWEST {
            return None;
        }
        let mut pulls = vec![[0.0; 6]; count];
        for (row, block) in self.rows.iter().zip(block_of) {
            for (p, j) in pulls[block].iter_mut().zip(row.jacobian) {
                *p += j * row.residual;
            }
        }
        let mut meat = [[0.0; 6]; 6];
        for pull in &pulls {
            add_outer(&mut meat, pull);
        }
        // The fit has taken six degrees of freedom out of the pulls.
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let lost = count as f64 / (count - 6) as f64;
        self.of_pulls(&meat, lost)
    }

    /// The covariance where each block of so many metres is displaced by its own; `None` for too few blocks.
    #[must_use]
    pub fn of_sections(&self, metres: f64) -> Option<Covariance> {
        let block_of = self.blocks(metres);
        let count = block_of.iter().max()? + 1;
        let mut sections = vec![Section::default(); count];
        for (row, block) in self.rows.iter().zip(block_of) {
            sections[block].add(row);
        }
        let displaced: Vec<[(f64, usize); 2]> = sections.iter().map(Section::displaced).collect();
        let variances = variances(&displaced)?;
        let mut meat = [[0.0; 6]; 6];
        for section in &sections {
            for axis in 0..3 {
                let variance = variances[usize::from(axis == 2)];
                let pull = section.lever.map(|row| row[axis] * variance.sqrt());
                add_outer(&mut meat, &pull);
            }
        }
        self.of_pulls(&meat, 1.0)
    }

    /// `H⁻¹ m H⁻¹`, times a factor.
    fn of_pulls(&self, meat: &[[f64; 6]; 6], factor: f64) -> Option<Covariance> {
        let matrix = sandwich(self.inverse.as_ref()?, meat);
        Some(Covariance {
            matrix: matrix.map(|row| row.map(|v| v * factor)),
            about: self.about,
        })
    }

    /// The block of each row. A block is what lies nearest to one of some points that are no nearer to each other than so many metres: in a passage
    /// narrower than that its whole section.
    fn blocks(&self, metres: f64) -> Vec<usize> {
        let mut middles: Vec<[f64; 3]> = Vec::new();
        // Whatever is within a cell's size of a point lies in its cell or beside it.
        let mut cells: FxHashMap<[i64; 3], Vec<usize>> = FxHashMap::default();
        let around = |at: [f64; 3]| {
            let [x, y, z] = voxel_of(at, metres);
            let steps = |v: i64| [v.saturating_sub(1), v, v.saturating_add(1)];
            let [x, y, z] = [x, y, z].map(steps);
            let cells = x.into_iter().flat_map(move |x| y.map(|y| (x, y)));
            cells.flat_map(move |(x, y)| z.map(|z| [x, y, z]))
        };
        for row in &self.rows {
            let mut near = around(row.at).filter_map(|c| cells.get(&c)).flatten();
            if near.all(|&m| distance(middles[m], row.at) > metres) {
                let cell = voxel_of(row.at, metres);
                cells.entry(cell).or_default().push(middles.len());
                middles.push(row.at);
            }
        }
        let nearest = |row: &Row| {
            let near = around(row.at).filter_map(|c| cells.get(&c)).flatten();
            let away = near.map(|&m| (distance(middles[m], row.at), m));
            away.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
                .map_or(0, |(_, m)| m)
        };
        self.rows.iter().map(nearest).collect()
    }
}

/// Sums over the rows of a block.
#[derive(Debug, Clone, Copy, Default)]
struct Section {
    /// `Σ n nᵀ`.
    facing: [[f64; 3]; 3],
    /// `Σ n r`.
    off: [f64; 3],
    /// `Σ Jᵀ nᵀ`: what its displacement pulls at the pose.
    lever: [[f64; 3]; 6],
    rows: usize,
}

impl Section {
    fn add(&mut self, row: &Row) {
        let normal = [row.jacobian[0], row.jacobian[1], row.jacobian[2]];
        for i in 0..3 {
            self.off[i] += normal[i] * row.residual;
            for j in 0..3 {
                self.facing[i][j] += normal[i] * normal[j];
            }
        }
        for (lever, j) in self.lever.iter_mut().zip(row.jacobian) {
            for (l, n) in lever.iter_mut().zip(normal) {
                *l += j * n;
            }
        }
        self.rows += 1;
    }

    /// Sum of the squares of its best displacement along the directions that tell it, and how many those are: the level ones, then the upright
    /// ones.
    fn displaced(&self) -> [(f64, usize); 2] {
        let e = eigen(self.facing);
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let least = FACING * self.rows as f64;
        let told = e.values.iter().zip(&e.vectors).filter(|(v, _)| **v > least);
        told.fold([(0.0, 0); 2], |mut sums, (value, vector)| {
            let along = dot(*vector, self.off) / value;
            let (square, count) = &mut sums[usize::from(vector[2].abs() > UPRIGHT)];
            *square += along * along;
            *count += 1;
            sums
        })
    }
}

/// The variances of level and of upright displacements, of which the pose takes three each: gravity holds what is upright. One for both where
/// there are too few of either; `None` where there are too few of them together.
fn variances(sections: &[[(f64, usize); 2]]) -> Option<[f64; 2]> {
    let sum = |kind: usize| {
        let own = sections.iter().map(|s| s[kind]);
        own.fold((0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1))
    };
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let variance = |(square, told): (f64, usize), taken: usize| {
        let left = told.checked_sub(taken).filter(|left| *left >= taken)?;
        Some(square / left as f64)
    };
    let (level, upright) = (sum(0), sum(1));
    match (variance(level, 3), variance(upright, 3)) {
        (Some(level), Some(upright)) => Some([level, upright]),
        _ => variance((level.0 + upright.0, level.1 + upright.1), 6).map(|both| [both; 2]),
    }
}

/// Share of its fitness down to which a query, moved along an open direction, still lies on the map.
const STILL_LIES: f64 = 0.8;
/// Steps, in metres or radians, by which it is moved: each twice the last.
const FIRST_STEP: [f64; 2] = [0.25, 0.05];
/// Nobody slides further, metres, or turns further, radians.
const FURTHEST: [f64; 2] = [128.0, std::f64::consts::PI];

/// Where the query, at a pose and moved from there one way along an `open` direction (turned about a point, where that is a turn), still lies on the map: by how
/// much it is moved, metres or radians, and its pose.
pub(crate) fn way(
    open: &Unobservable,
    sign: f64,
    map: &Surface<'_>,
    query: &Surface<'_>,
    (map_from_query, about): (&Pose, [f64; 3]),
    config: &VerifyConfig,
) -> Vec<(f64, Pose)> {
    let kind = match open.kind {
        DirectionKind::Translation => 0,
        DirectionKind::Rotation => 1,
    };
    let at_home = fit(map, query, map_from_query, config).fitness;
    let (mut step, mut way) = (FIRST_STEP[kind], Vec::new());
    while step <= FURTHEST[kind] {
        let moved = scale(open.direction, sign * step);
        let (t, r) = if kind == 0 {
            (moved, [0.0; 3])
        } else {
            ([0.0; 3], moved)
        };
        let pose = map_from_query.perturbed(t, r, about);
        if fit(map, query, &pose, config).fitness < STILL_LIES * at_home {
            break;
        }
        way.push((step, pose));
        step *= 2.0;
    }
    way
}

/// Adds the way that the pose can be moved along an open direction.
fn stretch(
    covariance: &mut Covariance,
    open: &Unobservable,
    map: &Surface<'_>,
    query: &Surface<'_>,
    map_from_query: &Pose,
    config: &VerifyConfig,
) {
    let (kind, offset) = match open.kind {
        DirectionKind::Translation => (0, 0),
        DirectionKind::Rotation => (1, 3),
    };
    let reach = |sign: f64| -> f64 {
        let way = way(
            open,
            sign,
            map,
            query,
            (map_from_query, covariance.about),
            config,
        );
        let reached = way.last().map_or(0.0, |(step, _)| *step);
        // Between the last step that held and the one that did not.
        f64::min(1.5 * reached.max(0.5 * FIRST_STEP[kind]), FURTHEST[kind])
    };
    let (back, forth) = (reach(-1.0), reach(1.0));
    // Second moment, about the pose, of a place anywhere on the way.
    let variance = (back.powi(3) + forth.powi(3)) / (3.0 * (back + forth));
    let d = open.direction;
    let known: f64 = (0..3)
        .map(|i| {
            (0..3)
                .map(|j| d[i] * covariance.matrix[offset + i][offset + j] * d[j])
                .sum::<f64>()
        })
        .sum();
    let more = (variance - known).max(0.0);
    for i in 0..3 {
        for j in 0..3 {
            covariance.matrix[offset + i][offset + j] += more * d[i] * d[j];
        }
    }
}

fn identity() -> [[f64; 6]; 6] {
    std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))))
}

fn add_outer(m: &mut [[f64; 6]; 6], v: &[f64; 6]) {
    for (row, a) in m.iter_mut().zip(v) {
        for (e, b) in row.iter_mut().zip(v) {
            *e += a * b;
        }
    }
}

/// `a m aᵀ`, symmetric to the bit.
fn sandwich(a: &[[f64; 6]; 6], m: &[[f64; 6]; 6]) -> [[f64; 6]; 6] {
    let am = product(a, m);
    let mut out = [[0.0; 6]; 6];
    for i in 0..6 {
        for j in 0..=i {
            let v = (0..6).map(|k| am[i][k] * a[j][k]).sum();
            (out[i][j], out[j][i]) = (v, v);
        }
    }
    out
}

fn product(a: &[[f64; 6]; 6], b: &[[f64; 6]; 6]) -> [[f64; 6]; 6] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..6).map(|k| a[i][k] * b[k][j]).sum()))
}

/// A covariance that is nowhere below either: in the coordinates in which `a` is a unit sphere and `b` an ellipsoid along the axes, the larger of
/// both for each axis.
fn envelope(a: &[[f64; 6]; 6], b: &[[f64; 6]; 6]) -> [[f64; 6]; 6] {
    let e = eigen(*a);
    let least = FLOOR * FLOOR * e.values[5].max(f64::MIN_POSITIVE);
    let root = |i: usize| e.values[i].max(least).sqrt();
    // To the sphere: rows are eigenvectors over their lengths.
    let to: [[f64; 6]; 6] = std::array::from_fn(|i| e.vectors[i].map(|v| v / root(i)));
    let in_sphere = eigen(sandwich(&to, b));
    // And back: columns are eigenvectors times their lengths.
    let back: [[f64; 6]; 6] =
        std::array::from_fn(|r| std::array::from_fn(|i| e.vectors[i][r] * root(i)));
    let mut larger = [[0.0; 6]; 6];
    for (value, vector) in in_sphere.values.iter().zip(&in_sphere.vectors) {
        let length = value.max(1.0).sqrt();
        add_outer(&mut larger, &vector.map(|v| v * length));
    }
    sandwich(&back, &larger)
}

/// A covariance with its rotations measured as arcs of a `length`, so that both halves compare.
fn scaled(m: &[[f64; 6]; 6], length: f64) -> [[f64; 6]; 6] {
    let s = |i: usize| if i < 3 { 1.0 } else { length };
    std::array::from_fn(|i| std::array::from_fn(|j| m[i][j] * s(i) * s(j)))
}

/// The inverse of a symmetric positive matrix, without directions whose eigenvalue is below `floor` times the largest; where the floor is 0,
/// `None` if there is one that is not positive.
fn inverted(m: &[[f64; 6]; 6], floor: f64) -> Option<[[f64; 6]; 6]> {
    let e = eigen(*m);
    let largest = e.values[5];
    if !(largest > 0.0 && largest.is_finite()) {
        return None;
    }
    let mut out = [[0.0; 6]; 6];
    for (value, vector) in e.values.iter().zip(&e.vectors) {
        if *value > floor * largest {
            for i in 0..6 {
                for j in 0..6 {
                    out[i][j] += vector[i] * vector[j] / value;
                }
            }
        } else if floor == 0.0 {
            return None;
        }
    }
    Some(out)
}

/// As [`inverted`], where the rotations of `information` are measured as arcs of a `length` first, so that both halves compare.
fn inverted_scaled(information: &[[f64; 6]; 6], length: f64) -> Option<[[f64; 6]; 6]> {
    let inverse = inverted(&scaled(information, 1.0 / length), FLOOR)?;
    Some(scaled(&inverse, 1.0 / length))
}

mod extrapolate;

#[cfg(test)]
mod tests;
