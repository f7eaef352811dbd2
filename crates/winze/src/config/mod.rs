//! Every parameter of every stage, as plain structs.
//!
//! Lengths are either metres or multiples of the voxel size ([`Length`]), which itself comes from
//! the data unless it is given, so that nothing needs tuning for a new sensor or a new mine.
//! The doc comment, default and domain of a field are written once and also feed
//! `winze config` and [`Config::validate`].

mod choices;
mod length;
mod schema;
mod sections;

pub use choices::{DescriptorVariant, IcpMetric, IssCentre, Kernel, NdtForm, Orientation};
pub use length::Length;
pub use schema::{FieldDoc, Rule};
pub use sections::{
    FpfhConfig, GraphConfig, IcpConfig, IssConfig, MatchingConfig, NdtConfig, OdometryConfig,
    PrepareConfig, RansacConfig, ScaleConfig, VerifyConfig,
};

use crate::error::Result;

/// What `winze config` says of a section.
#[derive(Debug, Clone, Copy)]
pub struct SectionDoc {
    /// Its name in a configuration file.
    pub key: &'static str,
    /// Its documentation, one line a source line.
    pub doc: &'static [&'static str],
    /// Its fields in order.
    pub fields: &'static [FieldDoc],
}

/// The whole configuration: one section a stage.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Config {
    /// Seed of every random choice (`auto` makes none).
    pub seed: u64,
    /// The length scale.
    pub scale: ScaleConfig,
    /// Preparation of clouds.
    pub prepare: PrepareConfig,
    /// Keypoints.
    pub iss: IssConfig,
    /// Descriptors.
    pub fpfh: FpfhConfig,
    /// Matching.
    pub matching: MatchingConfig,
    /// Estimation.
    pub ransac: RansacConfig,
    /// Estimation by agreement (`auto`).
    pub graph: GraphConfig,
    /// Refinement by NDT.
    pub ndt: NdtConfig,
    /// Refinement by ICP.
    pub icp: IcpConfig,
    /// Verification and verdict.
    pub verify: VerifyConfig,
    /// What is believed of the query's odometry.
    pub odometry: OdometryConfig,
}

impl Config {
    /// Holds every value against its domain.
    ///
    /// # Errors
    /// [`Error::Config`](crate::Error::Config) for the first value outside it.
    pub fn validate(&self) -> Result<()> {
        self.scale.check()?;
        self.prepare.check()?;
        self.iss.check()?;
        self.fpfh.check()?;
        self.matching.check()?;
        self.ransac.check()?;
        self.graph.check()?;
        self.ndt.check()?;
        self.icp.check()?;
        self.verify.check()?;
        self.odometry.check()
    }

    /// Documentation of every section, in the order of the pipeline.
    #[must_use]
    pub fn sections() -> [SectionDoc; 11] {
        macro_rules! docs {
            ($($section:ident),+) => {
                [$(SectionDoc { key: $section::KEY, doc: $section::DOC, fields: $section::FIELDS }),+]
            };
        }
        docs!(
            ScaleConfig,
            PrepareConfig,
            IssConfig,
            FpfhConfig,
            MatchingConfig,
            RansacConfig,
            GraphConfig,
            NdtConfig,
            IcpConfig,
            VerifyConfig,
            OdometryConfig
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;

    #[test]
    fn the_defaults_are_valid() {
        assert_eq!(Config::default().validate(), Ok(()));
    }

    #[test]
    fn a_value_outside_its_domain_is_named() {
        let mut config = Config::default();
        config.fpfh.radius = Length::Metres(-1.0);
        let Err(Error::Config { key, value, rule }) = config.validate() else {
            panic!("a negative radius passed");
        };
        assert_eq!(
            (key.as_str(), value.as_str(), rule.as_str()),
            ("fpfh.radius", "-1 m", "must be above 0, at most 1000")
        );
        let mut config = Config::default();
        config.ransac.confidence = 1.0;
        assert!(
            config
                .validate()
                .unwrap_err()
                .to_string()
                .starts_with("config: ransac.confidence = 1:")
        );
        let mut config = Config::default();
        config.ndt.outlier_ratio = f64::NAN;
        assert!(config.validate().is_err());
    }

    #[test]
    fn every_field_is_documented() {
        for section in Config::sections() {
            assert!(!section.fields.is_empty() && !section.doc.is_empty());
            for field in section.fields {
                assert!(
                    !field.doc.concat().trim().is_empty(),
                    "{}.{}",
                    section.key,
                    field.name
                );
            }
        }
    }
}
