//! Plays a scenario: builds its mines, maps them, drives through them.

use winze::rng::Rng;
use winze::{Cloud, Pose};

use super::frame::{frame, warped};
use super::way::{self, Border};
use super::{MapSpec, Mine, Place, QuerySpec, Scenario};
use crate::cases::{Case, CaseTolerance, OpenDirection};
use crate::dust::Dust;
use crate::error::{Error, Result};
use crate::free_space::FreeSpace;
use crate::labels::{self, Labels, MappedSurface, SeenSurface, Tolerance};
use crate::mesh::Mesh;
use crate::mesh_file::MeshReport;
use crate::motion::Trajectory;
use crate::raycast::Caster;
use crate::survey::{Gathered, Gathering, QueryGatherer};
use crate::{mesh_file, world};

/// Drives tried where mapped surface must not be seen, and the share of a query that it may be all the same.
const DRAWS: u64 = 30;
const UNSEEN: f64 = 0.005;

/// How far a play has come: what it does, and how much of that is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step<'a> {
    /// What is under way.
    pub what: &'a str,
    /// Cases that are done.
    pub done: usize,
    /// Cases in all.
    pub of: usize,
}

/// Something that a scenario made.
#[derive(Debug)]
pub enum Made<'a> {
    /// A mine, as it was when it was mapped, or as some of its queries found it.
    Mesh {
        /// The mine's name.
        mine: &'a str,
        /// The queries that found it changed.
        later: Option<&'a str>,
        /// Its surface, world frame.
        mesh: &'a Mesh,
        /// What was read, where it comes from a file.
        read: Option<MeshReport>,
    },
    /// A map.
    Map(MadeMap<'a>),
    /// A query with its truth.
    Query(Box<MadeQuery>),
}

/// A map.
#[derive(Debug)]
pub struct MadeMap<'a> {
    /// The mine's name.
    pub mine: &'a str,
    /// The cloud, map frame.
    pub cloud: &'a Cloud,
    /// Way of the survey, metres.
    pub way: f64,
    /// Scans that it took.
    pub scans: usize,
}

/// A query.
#[derive(Debug)]
pub struct MadeQuery {
    /// The question with its answer.
    pub case: Case,
    /// The mine whose map is asked.
    pub asks_in: String,
    /// The cloud, query frame.
    pub cloud: Cloud,
    /// Where the sensor truly was at each scan, in the frame of its own mine's map.
    pub map_from_sensor: Vec<Pose>,
    /// Where odometry believed it to be, query frame.
    pub query_from_sensor: Vec<Pose>,
    /// Time of each scan, seconds.
    pub seconds: Vec<f64>,
    /// Share of the returns that came from no surface: dust, mirrors, edges.
    pub spurious: f64,
}

/// Plays `scenario`; `each` gets what is made as soon as it is. The same seed makes the same bits, whichever other
/// queries there are.
///
/// # Errors
/// [`Error::NoFreeSpace`] where a mine has no room for its robot or a drive; the errors of meshes; and whatever
/// `each` gives back.
pub fn simulate<E: From<Error>>(
    scenario: &Scenario,
    seed: u64,
    progress: &(dyn Fn(Step<'_>) + Sync),
    mut each: impl FnMut(Made<'_>) -> std::result::Result<(), E>,
) -> std::result::Result<(), E> {
    scenario.validate()?;
    let mut play = Play {
        scenario,
        seed,
        progress,
        done: 0,
        of: scenario.cases(),
    };
    for mine in &scenario.mines {
        play.mine(mine, &mut each)?;
    }
    Ok(())
}

struct Play<'a> {
    scenario: &'a Scenario,
    seed: u64,
    progress: &'a (dyn Fn(Step<'_>) + Sync),
    done: usize,
    of: usize,
}

/// A mine as it is at one time.
struct Session<'c> {
    caster: &'c Caster,
    free: Option<FreeSpace<'c>>,
}

/// A map with what labels need.
struct Mapped {
    surface: MappedSurface,
    border: Option<Border>,
    map_from_world: Pose,
}

impl Play<'_> {
    fn say(&self, what: &str) {
        (self.progress)(Step {
            what,
            done: self.done,
            of: self.of,
        });
    }

    fn mine<E: From<Error>>(
        &mut self,
        mine: &Mine,
        each: &mut impl FnMut(Made<'_>) -> std::result::Result<(), E>,
    ) -> std::result::Result<(), E> {
        let (caster, read) = self.build(mine, None, None)?;
        each(Made::Mesh {
            mine: &mine.name,
            later: None,
            mesh: caster.mesh(),
            read,
        })?;
        let name = format!("mine \"{}\"", mine.name);
        let first = self.session(mine, &caster).map_err(|e| e.at(&name))?;
        let mapped = match &mine.map {
            Some(spec) => {
                let (mapped, cloud, way, scans) = self
                    .map(mine, spec, &first)
                    .map_err(|e| e.at(&format!("{name}, map")))?;
                each(Made::Map(MadeMap {
                    mine: &mine.name,
                    cloud: &cloud,
                    way,
                    scans,
                }))?;
                Some(mapped)
            }
            None => None,
        };
        for spec in &mine.queries {
            let changed = if spec.change.is_some() || spec.later_mesh.is_some() {
                Some(self.build(mine, Some(spec), read.map(|r| r.origin))?)
            } else {
                None
            };
            if let Some((caster, read)) = &changed {
                each(Made::Mesh {
                    mine: &mine.name,
                    later: Some(&spec.name),
                    mesh: caster.mesh(),
                    read: *read,
                })?;
            }
            let later = match &changed {
                Some((caster, _)) => Some(
                    self.session(mine, caster)
                        .map_err(|e| e.at(&query_name(mine, spec)))?,
                ),
                None => None,
            };
            let session = later.as_ref().unwrap_or(&first);
            for i in 0..spec.made() {
                self.say(&format!("{}: {} {}", mine.name, spec.name, i + 1));
                let made = self.query(mine, spec, i, session, mapped.as_ref())?;
                each(Made::Query(Box::new(made)))?;
                self.done += 1;
            }
        }
        self.say(&format!("{}: done", mine.name));
        Ok(())
    }

    /// A number that belongs to one thing of this play alone.
    fn seed_of(&self, words: &[&str], index: usize) -> u64 {
        // FNV-1a over the words.
        let mut h = 0xCBF2_9CE4_8422_2325u64;
        for byte in words.iter().flat_map(|w| w.bytes().chain([0])) {
            h = (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3);
        }
        Rng::new(self.seed, h ^ index as u64).next_u64()
    }

    /// The mine as it was mapped, or as it is for some of its queries. `origin`: what was subtracted from the first mesh.
    fn build(
        &self,
        mine: &Mine,
        later: Option<&QuerySpec>,
        origin: Option<[f64; 3]>,
    ) -> Result<(Caster, Option<MeshReport>)> {
        let change = later.and_then(|q| q.change.as_ref());
        let what = match later {
            Some(q) => format!("{}: changing the mine for {}", mine.name, q.name),
            None => format!("{}: making the mine", mine.name),
        };
        self.say(&what);
        let (mesh, read) = match (&mine.world, &mine.mesh) {
            (Some(spec), _) => {
                let seed = self.seed_of(&[&mine.name, "world"], 0);
                let told = |share: f64| self.say(&format!("{what}, {:.0} %", 100.0 * share));
                (world::build(spec, seed, change, &told)?.mesh, None)
            }
            (None, Some(path)) => {
                let later = later.and_then(|q| q.later_mesh.as_ref());
                let (mesh, read) = mesh_file::read_mesh_about(later.unwrap_or(path), origin)?;
                (mesh, Some(read))
            }
            (None, None) => (Mesh::default(), None),
        };
        Ok((Caster::new(mesh)?, read))
    }

    /// Looks for room in a mine, unless all its drives are given.
    fn session<'c>(&self, mine: &Mine, caster: &'c Caster) -> Result<Session<'c>> {
        let led = |q: &QuerySpec| q.through.is_some();
        let mapped_by_hand = mine.map.as_ref().is_none_or(|m| m.through.is_some());
        let free = if mapped_by_hand && mine.queries.iter().all(led) {
            None
        } else {
            self.say(&format!("{}: looking for room", mine.name));
            Some(FreeSpace::measure(caster, &mine.robot)?)
        };
        Ok(Session { caster, free })
    }

    fn map(
        &self,
        mine: &Mine,
        spec: &MapSpec,
        session: &Session<'_>,
    ) -> Result<(Mapped, Cloud, f64, usize)> {
        let free = session.free.as_ref();
        let border = free.and_then(|f| Border::of(f, spec));
        let legs = match (&spec.through, &spec.via, free) {
            (Some(lines), ..) => {
                for line in lines {
                    way::check(session.caster, line, mine.world.is_some())?;
                }
                lines.clone()
            }
            (None, Some(places), Some(free)) => vec![way::past(free, places)?],
            (None, None, Some(free)) => way::survey(free, border, spec.spacing)?,
            (None, _, None) => Vec::new(),
        };
        let scan_seed = self.seed_of(&[&mine.name, "map"], 0);
        let air = Dust {
            seed: self.seed_of(&[&mine.name, "air"], 0),
            ..spec.dust
        };
        let warp_seed = self.seed_of(&[&mine.name, "warp"], 0);
        let mut gathered = Gathered::new(spec.voxel);
        let mut seen = SeenSurface::default();
        let (mut way, mut scans) = (0.0, 0u64);
        let mut stands = Vec::new();
        for (i, leg) in legs.iter().enumerate() {
            self.say(&format!(
                "{}: mapping, leg {} of {}",
                mine.name,
                i + 1,
                legs.len()
            ));
            let trajectory = spec
                .motion
                .follow(leg, self.seed_of(&[&mine.name, "leg"], i));
            way += trajectory.way.last().copied().unwrap_or(0.0);
            for world_from_sensor in &trajectory.world_from_sensor {
                stands.push(world_from_sensor.translation());
                let scan =
                    spec.sensor
                        .0
                        .scan(session.caster, world_from_sensor, &air, scan_seed, scans);
                scans += 1;
                for r in &scan {
                    let p = world_from_sensor.transform(r.point());
                    if border.is_some_and(|b| !b.mapped(p)) {
                        continue;
                    }
                    gathered.add(warped(p, spec.warp, warp_seed), r.intensity);
                    seen.add(r, world_from_sensor, |_| 0.0, |_| false);
                }
            }
        }
        if gathered.is_empty() {
            return Err(Error::NoFreeSpace(
                "the survey saw nothing; its sensor may reach no wall, or its lines may lie in the rock".into(),
            ));
        }
        let map_from_world = Pose::from_translation(spec.origin);
        let cloud = gathered.cloud(&map_from_world, spec.intensity)?;
        let places = free.map_or(stands, way::every_metre);
        let mapped = Mapped {
            surface: MappedSurface::new(&seen.witnesses(), &places),
            border,
            map_from_world,
        };
        #[expect(clippy::cast_possible_truncation, reason = "scans fit in memory")]
        Ok((mapped, cloud, way, scans as usize))
    }

    fn query(
        &self,
        mine: &Mine,
        spec: &QuerySpec,
        i: usize,
        session: &Session<'_>,
        mapped: Option<&Mapped>,
    ) -> Result<MadeQuery> {
        // A sensor may see from the unmapped part into the mapped one: then another drive is tried.
        for draw in 1..=DRAWS {
            let (made, overlap) = self
                .draw(mine, spec, i, draw, session, mapped)
                .map_err(|e| e.at(&query_name(mine, spec)))?;
            if spec.place != Place::Unmapped || overlap <= UNSEEN {
                return Ok(made);
            }
        }
        let why =
            "from the unmapped part mapped surface is always in sight; leave more out of the map";
        Err(Error::NoFreeSpace(why.into()).at(&query_name(mine, spec)))
    }

    /// One try at a query, with its overlap.
    fn draw(
        &self,
        mine: &Mine,
        spec: &QuerySpec,
        i: usize,
        draw: u64,
        session: &Session<'_>,
        mapped: Option<&Mapped>,
    ) -> Result<(MadeQuery, f64)> {
        let mut rng = Rng::new(self.seed_of(&[&mine.name, &spec.name], i), draw);
        let length = rng.range(spec.length[0], spec.length[1]);
        let border = mapped.and_then(|m| m.border);
        let way = match (&spec.through, &spec.via, &session.free) {
            (Some(line), ..) => {
                way::check(session.caster, line, mine.world.is_some())?;
                line.clone()
            }
            (None, Some(places), Some(free)) => way::past(free, places)?,
            (None, None, Some(free)) => way::drive(free, border, spec, length, &mut rng)?,
            (None, _, None) => Vec::new(),
        };
        let trajectory = spec.motion.follow(&way, rng.next_u64());
        let believed = trajectory.drifted(&spec.drift, rng.next_u64());
        let world_from_map = mapped
            .map_or_else(Pose::identity, |m| m.map_from_world)
            .inverse();
        let (query_from_world, level) = frame(spec, i, &trajectory, &world_from_map, &mut rng);
        let gathering = self.drive(
            spec,
            i,
            session,
            (&trajectory, &believed),
            query_from_world,
            &mut rng,
        )?;
        let at_home = spec.asks_in.as_ref().is_none_or(|m| *m == mine.name);
        let lost = !at_home || spec.place == Place::Unmapped;
        let tolerance = Tolerance {
            translation: spec.tolerance[0],
            rotation: spec.tolerance[1].to_radians(),
        };
        let labels = match mapped {
            Some(m) if at_home => {
                let stands: Vec<[f64; 3]> = trajectory
                    .world_from_sensor
                    .iter()
                    .map(Pose::translation)
                    .collect();
                let query = labels::Seen {
                    witnesses: &gathering.witnesses,
                    stands: &stands,
                };
                labels::label(&m.surface, query, tolerance, rng.next_u64())
            }
            _ => Labels::default(),
        };
        let overlap = labels.overlap;
        // Nothing is true of a query that is not there.
        let labels = if lost { Labels::default() } else { labels };
        let asks_in = spec.asks_in.clone().unwrap_or_else(|| mine.name.clone());
        let family = format!("{}/{}", self.scenario.name, spec.name);
        let name = if spec.count == 1 {
            family.clone()
        } else {
            format!("{family}_{i:03}")
        };
        let map_from_world = world_from_map.inverse();
        let map_from_query = map_from_world.compose(&gathering.world_from_query);
        let case = Case {
            map: format!("maps/{asks_in}.pcd"),
            query: format!("queries/{}.pcd", name.replace('/', "_")),
            truth: (!lost).then(|| map_from_query.to_matrix()),
            bend_rms_m: gathering.bend_rms,
            tolerance: CaseTolerance {
                translation_m: spec.tolerance[0],
                rotation_deg: spec.tolerance[1],
            },
            gravity_aligned: level,
            overlap: (!lost).then_some(overlap),
            ambiguous: !labels.alternatives.is_empty(),
            alternatives: labels
                .alternatives
                .iter()
                .map(|moved| {
                    map_from_world
                        .compose(moved)
                        .compose(&gathering.world_from_query)
                        .to_matrix()
                })
                .collect(),
            unobservable: labels.unobservable.iter().map(Into::into).collect(),
            family,
            sensor: sensor_of(spec, i).map_or(String::new(), |s| s.0.name()),
            name,
        };
        let total = (gathering.returns[0] + gathering.returns[1]).max(1);
        #[expect(clippy::cast_precision_loss, reason = "a share")]
        let spurious = gathering.returns[1] as f64 / total as f64;
        let made = MadeQuery {
            case,
            asks_in,
            cloud: gathering.cloud,
            map_from_sensor: trajectory
                .world_from_sensor
                .iter()
                .map(|p| map_from_world.compose(p))
                .collect(),
            query_from_sensor: believed
                .iter()
                .map(|p| query_from_world.compose(p))
                .collect(),
            seconds: trajectory.seconds,
            spurious,
        };
        Ok((made, overlap))
    }

    /// Scans along a trajectory, gathered where odometry believes it to be.
    fn drive(
        &self,
        spec: &QuerySpec,
        i: usize,
        session: &Session<'_>,
        (trajectory, believed): (&Trajectory, &[Pose]),
        query_from_world: Pose,
        rng: &mut Rng,
    ) -> Result<Gathering> {
        let (scan_seed, air_seed) = (rng.next_u64(), rng.next_u64());
        let air = Dust {
            seed: air_seed,
            ..spec.dust
        };
        let bent = !spec.drift.is_none();
        let mut gatherer = QueryGatherer::new(query_from_world, spec.voxel, bent);
        let Some(sensor) = sensor_of(spec, i) else {
            return gatherer.finish(spec.intensity);
        };
        let parts = session.caster.mesh().parts();
        let poses = trajectory.world_from_sensor.iter().zip(believed);
        for (scan, (world_from_sensor, believed)) in (0u64..).zip(poses) {
            let returns = sensor
                .0
                .scan(session.caster, world_from_sensor, &air, scan_seed, scan);
            gatherer.add(
                &returns,
                world_from_sensor,
                believed,
                |range| sensor.0.noise_at(range),
                |part| parts.get(usize::from(part)).is_some_and(|p| p.new),
            );
        }
        gatherer.finish(spec.intensity)
    }
}

fn query_name(mine: &Mine, spec: &QuerySpec) -> String {
    format!("mine \"{}\", query \"{}\"", mine.name, spec.name)
}

fn sensor_of(spec: &QuerySpec, i: usize) -> Option<&crate::sensor::SensorSpec> {
    spec.sensors.get(i % spec.sensors.len().max(1))
}

impl From<&labels::Open> for OpenDirection {
    fn from(open: &labels::Open) -> Self {
        let kind = if open.rotation {
            "rotation"
        } else {
            "translation"
        };
        Self {
            kind: kind.into(),
            direction: open.direction,
        }
    }
}
