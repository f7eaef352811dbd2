//! What a world is made of, and whether its settings go together.

use serde::{Deserialize, Serialize};

use super::kinds::{Cave, Drifts, Parallel, Rock, Rooms, Wall};
use super::settings::refused;
use crate::error::Result;

/// What a world is made of, as the table `world` of a scenario says it.
///
/// ```toml
/// [world]
/// kind = "drifts"
/// length = 2000.0
/// roughness = 0.3
/// [world.fittings]
/// bolts = 60.0
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum WorldSpec {
    /// A branching network of drifts.
    Drifts(Drifts),
    /// Rooms between pillars.
    Rooms(Rooms),
    /// Parallel drifts with equal crosscuts at equal pitch.
    Parallel(Parallel),
    /// A natural cave.
    Cave(Cave),
    /// A patch of wall.
    Wall(Wall),
}

/// A world with the kind's defaults.
impl Default for WorldSpec {
    fn default() -> Self {
        Self::Drifts(Drifts::default())
    }
}

impl WorldSpec {
    /// Its name in a scenario.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Drifts(_) => "drifts",
            Self::Rooms(_) => "rooms",
            Self::Parallel(_) => "parallel",
            Self::Cave(_) => "cave",
            Self::Wall(_) => "wall",
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// [`Error::Setting`](crate::Error::Setting) naming the first that lies outside its domain, or does not go with another.
    pub fn validate(&self) -> Result<()> {
        match self {
            Self::Drifts(w) => w.check()?,
            Self::Rooms(w) => w.check()?,
            Self::Parallel(w) => w.check()?,
            Self::Cave(w) => w.check()?,
            Self::Wall(w) => w.check()?,
        }
        match self {
            Self::Drifts(w) => {
                w.fittings.check()?;
                ordered("width", w.width)?;
                ordered("height", w.height)?;
                open("width", w.width[0], &self.rock())?;
                open("height", w.height[0], &self.rock())
            }
            Self::Rooms(w) => {
                w.fittings.check()?;
                open("height", w.height, &self.rock())?;
                // Half a room is left between the widest pillar and the border.
                let room = 0.5 * (w.pitch - w.pillar * (1.0 + w.irregular));
                open("pillar", room, &self.rock())?;
                if w.extent_x < w.pitch || w.extent_y < w.pitch {
                    return Err(refused("pitch", "must not exceed the mine's extent".into()));
                }
                Ok(())
            }
            Self::Parallel(w) => {
                w.fittings.check()?;
                open("width", w.width, &self.rock())?;
                open("height", w.height, &self.rock())?;
                let taken = f64::from(w.crosscuts.max(1) - 1) * w.pitch + w.width;
                if taken > w.length {
                    let why = format!(
                        "{} crosscuts {} m apart need {taken} m of drift, there are {}",
                        w.crosscuts, w.pitch, w.length
                    );
                    return Err(refused("crosscuts", why));
                }
                if w.pitch < w.width + 2.0 || w.spacing < w.width + 2.0 {
                    return Err(refused(
                        "pitch",
                        "leave 2 m of rock between drifts: raise pitch or spacing".into(),
                    ));
                }
                Ok(())
            }
            Self::Cave(w) => {
                ordered("radius", w.radius)?;
                open("radius", 2.0 * w.radius[0] * w.flatness, &self.rock())
            }
            Self::Wall(w) => open("height", w.height, &self.rock()),
        }
    }

    /// The settings of its rock.
    #[must_use]
    pub fn rock(&self) -> Rock {
        match self {
            Self::Drifts(w) => w.rock(),
            Self::Rooms(w) => w.rock(),
            Self::Parallel(w) => w.rock(),
            Self::Cave(w) => w.rock(),
            Self::Wall(w) => w.rock(),
        }
    }
}

fn ordered(key: &str, range: [f64; 2]) -> Result<()> {
    if range[0] <= range[1] {
        return Ok(());
    }
    Err(refused(key, format!("{range:?} is not [least, greatest]")))
}

/// Refuses a passage that relief could close or that the cells cannot show.
fn open(key: &str, size: f64, rock: &Rock) -> Result<()> {
    let least = f64::max(2.0 * rock.roughness + 0.5, 6.0 * rock.cell);
    if size >= least {
        return Ok(());
    }
    let why = format!(
        "a passage of {size:.2} m is too narrow for a roughness of {} m and cells of {} m: at least {least:.2} m",
        rock.roughness, rock.cell
    );
    Err(refused(key, why))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use crate::world::Change;

    #[test]
    fn a_table_names_its_kind_and_leaves_the_rest_to_defaults() {
        let spec: WorldSpec =
            toml::from_str("kind = \"wall\"\nwidth = 20.0\nheight = 4\n").unwrap();
        let expected = Wall {
            width: 20.0,
            height: 4.0,
            ..Wall::default()
        };
        assert_eq!(spec, WorldSpec::Wall(expected));
        assert_eq!(spec.kind(), "wall");
        let text = "kind = \"drifts\"\n[fittings]\nbolts = 3.0\n";
        let WorldSpec::Drifts(drifts) = toml::from_str(text).unwrap() else {
            panic!("another kind");
        };
        assert_eq!((drifts.fittings.bolts, drifts.fittings.pipes), (3.0, 0.0));
        let all = [
            WorldSpec::Drifts(Drifts::default()),
            WorldSpec::Rooms(Rooms::default()),
            WorldSpec::Parallel(Parallel::default()),
            WorldSpec::Cave(Cave::default()),
            WorldSpec::Wall(Wall::limestone()),
        ];
        for spec in all {
            spec.validate().unwrap();
            let again: WorldSpec = toml::from_str(&toml::to_string(&spec).unwrap()).unwrap();
            assert_eq!(again, spec);
        }
    }

    #[test]
    fn misspelt_keys_and_kinds_are_named() {
        let said = |text: &str| {
            toml::from_str::<WorldSpec>(text)
                .unwrap_err()
                .message()
                .to_string()
        };
        assert!(said("kind = \"drifts\"\nlenght = 3.0").contains("lenght"));
        assert!(said("kind = \"rooms\"\n[fittings]\nbolt = 3.0").contains("bolt"));
        assert!(said("kind = \"drift\"").contains("drift"));
        assert!(said("length = 3.0").contains("kind"));
        let change = toml::from_str::<Change>("vehicle = 0.5").unwrap_err();
        assert!(change.message().contains("vehicle"));
    }

    #[test]
    fn numbers_outside_their_domain_are_refused_by_name() {
        let key = |spec: WorldSpec| match spec.validate() {
            Err(Error::Setting { key, why }) => {
                assert!(!why.is_empty());
                key
            }
            other => panic!("{other:?}"),
        };
        let d = Drifts::default;
        let bad = [
            (
                Drifts {
                    roughness: f64::NAN,
                    ..d()
                },
                "world.roughness",
            ),
            (
                Drifts {
                    roughness: -0.1,
                    ..d()
                },
                "world.roughness",
            ),
            (
                Drifts {
                    length: f64::INFINITY,
                    ..d()
                },
                "world.length",
            ),
            (Drifts { cell: 0.0, ..d() }, "world.cell"),
            (
                Drifts {
                    width: [5.0, 4.0],
                    ..d()
                },
                "world.width",
            ),
            (
                Drifts {
                    width: [1.0, 4.0],
                    roughness: 0.4,
                    ..d()
                },
                "world.width",
            ),
            (
                Drifts {
                    height: [3.0, f64::NAN],
                    ..d()
                },
                "world.height",
            ),
            (Drifts { cell: 0.8, ..d() }, "world.width"),
        ];
        for (spec, expected) in bad {
            assert_eq!(key(WorldSpec::Drifts(spec)), expected);
        }
        let mut spec = d();
        spec.fittings.mesh = 1.5;
        assert_eq!(key(WorldSpec::Drifts(spec)), "world.fittings.mesh");
        let rooms = Rooms {
            pillar: 19.0,
            ..Rooms::default()
        };
        assert_eq!(key(WorldSpec::Rooms(rooms)), "world.pillar");
        let parallel = Parallel {
            pitch: 40.0,
            ..Parallel::default()
        };
        assert_eq!(key(WorldSpec::Parallel(parallel)), "world.crosscuts");
        let change = Change {
            muck: 2.0,
            ..Change::default()
        };
        assert!(
            change
                .validate()
                .unwrap_err()
                .to_string()
                .contains("change.muck")
        );
    }
}
