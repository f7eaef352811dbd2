//! The settings of each kind of world, of fittings and of changes.

use serde::{Deserialize, Serialize};

use super::settings::{Numbers, settings, within, world};
use crate::error::Result;

/// What the rock of every kind of world has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rock {
    /// How far the rock strays from its plan, metres.
    pub roughness: f64,
    /// Share of it that is left on the floor.
    pub floor_roughness: f64,
    /// Share of the relief that steps along joints and beds.
    pub blocky: f64,
    /// Edge of the mesh's cells, metres.
    pub cell: f64,
    /// Share of floor and walls that is wet.
    pub wet: f64,
    /// Share of near-infrared light given back by dry rock.
    pub reflectivity: f64,
}

world! {
    /// A branching network of drifts: main drifts that bend and climb, crosscuts, dead-end headings.
    Drifts {
        /// Length of all drifts together, metres.
        length: f64 = 600.0, 30.0, 50_000.0;
        /// Least and greatest width, metres.
        width: [f64; 2] = [3.6, 5.2], 1.0, 20.0;
        /// Least and greatest height, metres.
        height: [f64; 2] = [3.4, 4.8], 1.0, 20.0;
        /// Mean distance between branches, metres.
        branching: f64 = 32.0, 8.0, 1000.0;
        /// Steepest grade, metres of rise a metre.
        grade: f64 = 0.12, 0.0, 0.3;
        /// How much drifts bend, radians a step of 8 m (standard deviation).
        bend: f64 = 0.12, 0.0, 0.6;
        /// How round the back is: 0 a rectangle, 1 a half circle.
        arch: f64 = 0.6, 0.0, 1.0;
    } {
        /// What hangs on its walls and stands on its floor.
        fittings: Fittings = Fittings::typical();
    }
    roughness 0.25, blocky 0.3, cell 0.12, reflectivity 0.3
}

world! {
    /// A room-and-pillar mine in a gently rolling seam.
    Rooms {
        /// Extent along x, metres.
        extent_x: f64 = 260.0, 10.0, 3000.0;
        /// Extent along y, metres.
        extent_y: f64 = 150.0, 10.0, 3000.0;
        /// Distance between the pillars' centres, metres.
        pitch: f64 = 20.0, 4.0, 200.0;
        /// Mean edge of a pillar, metres.
        pillar: f64 = 12.0, 1.0, 190.0;
        /// How much pillars differ in size and place, share of their edge.
        irregular: f64 = 0.12, 0.0, 0.6;
        /// Height, metres.
        height: f64 = 3.8, 1.0, 20.0;
        /// Dip of the seam along x, metres a metre.
        dip: f64 = 0.015, -0.3, 0.3;
        /// How far the seam rolls up and down, metres.
        roll: f64 = 0.6, 0.0, 10.0;
    } {
        /// What hangs on its walls and stands on its floor.
        fittings: Fittings = Fittings::default();
    }
    roughness 0.2, blocky 0.4, cell 0.2, reflectivity 0.3
}

world! {
    /// Parallel drifts joined by crosscuts of the same plan at equal pitch: only the rock's relief tells one
    /// place from the next.
    Parallel {
        /// Number of drifts.
        drifts: u32 = 2, 1.0, 50.0;
        /// Length of each, metres.
        length: f64 = 260.0, 20.0, 10_000.0;
        /// Distance between their centrelines, metres.
        spacing: f64 = 40.0, 4.0, 1000.0;
        /// Number of crosscuts between neighbours.
        crosscuts: u32 = 9, 0.0, 1000.0;
        /// Distance between the crosscuts' centrelines, metres.
        pitch: f64 = 30.0, 4.0, 1000.0;
        /// Width, metres.
        width: f64 = 4.4, 1.0, 20.0;
        /// Height, metres.
        height: f64 = 4.0, 1.0, 20.0;
        /// Rise along x, metres a metre.
        grade: f64 = 0.0, -0.3, 0.3;
        /// How round the back is: 0 a rectangle, 1 a half circle.
        arch: f64 = 0.6, 0.0, 1.0;
    } {
        /// What hangs on its walls and stands on its floor: nothing, or it would tell the crosscuts apart.
        fittings: Fittings = Fittings::default();
    }
    roughness 0.25, blocky 0.0, cell 0.12, reflectivity 0.3
}

world! {
    /// A natural cave: meandering tubes of varying section and chambers.
    Cave {
        /// Length of all tubes together, metres.
        length: f64 = 300.0, 20.0, 20_000.0;
        /// Least and greatest half width of a tube, metres.
        radius: [f64; 2] = [1.6, 3.6], 0.5, 20.0;
        /// Height of a tube as a share of its width.
        flatness: f64 = 0.8, 0.3, 1.5;
        /// Chambers per 100 m of tube.
        chambers: f64 = 2.0, 0.0, 10.0;
        /// Half width of a chamber, metres.
        chamber: f64 = 7.0, 1.0, 30.0;
        /// Side passages per 100 m of tube.
        branches: f64 = 2.5, 0.0, 10.0;
        /// Heaps of fallen rock per 100 m of tube.
        rockfall: f64 = 2.0, 0.0, 50.0;
    } { }
    roughness 0.6, blocky 0.1, cell 0.15, reflectivity 0.35
}

world! {
    /// A patch of wall with its foot at z = 0 and its face towards -y: what a camera that flies along it sees.
    Wall {
        /// Width along x, metres.
        width: f64 = 10.0, 1.0, 500.0;
        /// Height, metres.
        height: f64 = 3.0, 1.0, 50.0;
        /// Thickness of the beds, metres.
        bed: f64 = 0.35, 0.02, 10.0;
        /// Floor in front of it.
        floor: bool = true, 0.0, 1.0;
        /// Back above it.
        back: bool = false, 0.0, 1.0;
        /// Ribs on both sides of it.
        ribs: bool = false, 0.0, 1.0;
    } { }
    roughness 0.12, blocky 0.5, cell 0.03, reflectivity 0.3
}

impl Wall {
    /// A face of coal, 10 x 3 m, with thin beds.
    #[must_use]
    pub fn coal() -> Self {
        Self {
            reflectivity: 0.12,
            bed: 0.25,
            ..Self::default()
        }
    }

    /// A face of limestone, 20 x 4 m, with thick beds.
    #[must_use]
    pub fn limestone() -> Self {
        Self {
            width: 20.0,
            height: 4.0,
            bed: 0.6,
            roughness: 0.2,
            reflectivity: 0.45,
            ..Self::default()
        }
    }
}

settings! {
    /// What hangs on the walls and stands on the floor. Nothing, unless it is asked for; a table that names
    /// some leaves the others out.
    "world.fittings" Fittings {
        /// Rock bolts with plates per 100 m.
        bolts: f64 = 0.0, 0.0, 2000.0;
        /// Share of the drifts' length that is covered with welded mesh.
        mesh: f64 = 0.0, 0.0, 1.0;
        /// Steel arches per 100 m.
        arches: f64 = 0.0, 0.0, 200.0;
        /// Timber sets per 100 m.
        timber: f64 = 0.0, 0.0, 200.0;
        /// Share of the length with a pair of pipes.
        pipes: f64 = 0.0, 0.0, 1.0;
        /// Share of the length with a cable tray.
        cable_trays: f64 = 0.0, 0.0, 1.0;
        /// Share of the length with a ventilation duct.
        duct: f64 = 0.0, 0.0, 1.0;
        /// Muck piles per 100 m.
        muck: f64 = 0.0, 0.0, 50.0;
        /// Vehicles per 100 m.
        vehicles: f64 = 0.0, 0.0, 10.0;
    } { }
}

impl Fittings {
    /// What a working mine has.
    #[must_use]
    pub fn typical() -> Self {
        Self {
            bolts: 60.0,
            mesh: 0.15,
            arches: 2.0,
            timber: 0.5,
            pipes: 0.4,
            cable_trays: 0.35,
            duct: 0.2,
            muck: 1.5,
            vehicles: 0.6,
        }
    }
}

settings! {
    /// What is different when the robot comes back.
    "change" Change {
        /// Share of the vehicles that stand elsewhere.
        vehicles: f64 = 0.0, 0.0, 1.0;
        /// Share of the muck piles that lie elsewhere.
        muck: f64 = 0.0, 0.0, 1.0;
        /// Share of the bare walls that were meshed since.
        mesh: f64 = 0.0, 0.0, 1.0;
        /// Share of the headings that were advanced.
        headings: f64 = 0.0, 0.0, 1.0;
        /// By how much they were advanced, metres.
        advance: f64 = 4.0, 0.5, 50.0;
    } { }
}

impl Change {
    /// Checks every number.
    ///
    /// # Errors
    /// [`Error::Setting`](crate::Error::Setting) naming the first that lies outside its domain.
    pub fn validate(&self) -> Result<()> {
        self.check()
    }
}
