//! The one error type of this crate.
//!
//! Errors are for bad input and bad options. "I don't know where this is" is never an error:
//! it is a [`Verdict`](crate::Verdict).

/// What can go wrong before an answer is possible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A configuration value is outside its domain.
    #[error("config: {key} = {value}: {rule}")]
    Config {
        /// Dotted path of the value, such as `ransac.confidence`.
        key: String,
        /// The value as given.
        value: String,
        /// What the value must be.
        rule: String,
    },

    /// Too many points lie too far from the rest for 32-bit offsets to keep a millimetre.
    #[error(
        "cloud too wide: {far} of {total} points lie more than {limit_m} m from its centre, \
         where a millimetre would be lost; split the cloud into tiles"
    )]
    TooWide {
        /// Points beyond the limit.
        far: usize,
        /// Finite points in all.
        total: usize,
        /// The limit, metres.
        limit_m: f64,
    },

    /// More points than 32-bit indices can address.
    #[error(
        "{what} has {count} points; at most {limit} fit one cloud: downsample it or split it into tiles"
    )]
    TooManyPoints {
        /// Which cloud.
        what: &'static str,
        /// How many points it has.
        count: usize,
        /// How many it may have.
        limit: usize,
    },

    /// The prior map holds nothing to locate a query in.
    #[error("usable points in the map: {points}, too few to locate anything in; check its file")]
    EmptyMap {
        /// Finite points, or 1 where they all coincide.
        points: usize,
    },

    /// The search region holds nothing of the map.
    #[error(
        "no point of the map lies where the query could be if its middle is within {radius_m} m of \
         ({x}, {y}, {z}); give the region in the map's frame, in metres"
    )]
    EmptyRegion {
        /// Centre of the region, map frame, metres.
        x: f64,
        /// As `x`.
        y: f64,
        /// As `x`.
        z: f64,
        /// Its radius, metres.
        radius_m: f64,
    },

    /// A prepared map cannot be used.
    #[error("{0}")]
    Map(String),

    /// A matrix that should be a rigid transform is not.
    #[error("not a rigid transform: {0}")]
    NotRigid(String),
}

/// A result with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
