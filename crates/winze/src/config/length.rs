//! Lengths in metres or in voxels.

/// A length: metres, or a multiple of the voxel size that the pipeline works at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Length {
    /// Metres.
    Metres(f64),
    /// Multiples of the voxel size.
    Voxels(f64),
}

impl Length {
    /// The length in metres where the voxel size is `voxel` metres.
    #[must_use]
    pub fn metres(self, voxel: f64) -> f64 {
        match self {
            Self::Metres(m) => m,
            Self::Voxels(v) => v * voxel,
        }
    }

    pub(super) fn amount(self) -> f64 {
        match self {
            Self::Metres(v) | Self::Voxels(v) => v,
        }
    }
}

impl std::fmt::Display for Length {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Metres(v) => write!(f, "{v} m"),
            Self::Voxels(v) => write!(f, "{v} voxels"),
        }
    }
}

impl std::str::FromStr for Length {
    type Err = String;

    /// `0.5`, `0.5 m`, `3 voxels`.
    fn from_str(s: &str) -> std::result::Result<Self, String> {
        let s = s.trim();
        let number = |t: &str| {
            t.trim().parse::<f64>().map_err(|_| {
                format!("{s:?} is no length; write 0.5 (metres), \"0.5 m\" or \"3 voxels\"")
            })
        };
        if let Some(v) = s.strip_suffix("voxels").or_else(|| s.strip_suffix("voxel")) {
            number(v).map(Self::Voxels)
        } else {
            number(s.strip_suffix('m').unwrap_or(s)).map(Self::Metres)
        }
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for Length {
    fn serialize<S: serde::Serializer>(
        &self,
        serializer: S,
    ) -> std::result::Result<S::Ok, S::Error> {
        match self {
            Self::Metres(m) => serializer.serialize_f64(*m),
            Self::Voxels(_) => serializer.collect_str(self),
        }
    }
}

#[cfg(feature = "serde")]
impl<'de> serde::Deserialize<'de> for Length {
    /// A number is metres; a string says its unit.
    fn deserialize<D: serde::Deserializer<'de>>(
        deserializer: D,
    ) -> std::result::Result<Self, D::Error> {
        struct Visitor;
        #[expect(clippy::cast_precision_loss, reason = "a length somebody typed")]
        impl serde::de::Visitor<'_> for Visitor {
            type Value = Length;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a length: 0.5 (metres), \"0.5 m\" or \"3 voxels\"")
            }

            fn visit_f64<E>(self, v: f64) -> std::result::Result<Length, E> {
                Ok(Length::Metres(v))
            }

            fn visit_i64<E>(self, v: i64) -> std::result::Result<Length, E> {
                Ok(Length::Metres(v as f64))
            }

            fn visit_u64<E>(self, v: u64) -> std::result::Result<Length, E> {
                Ok(Length::Metres(v as f64))
            }

            fn visit_str<E: serde::de::Error>(self, v: &str) -> std::result::Result<Length, E> {
                v.parse().map_err(E::custom)
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_parse_and_print() {
        assert_eq!("0.5".parse(), Ok(Length::Metres(0.5)));
        assert_eq!(" 1.25 m ".parse(), Ok(Length::Metres(1.25)));
        assert_eq!("3 voxels".parse(), Ok(Length::Voxels(3.0)));
        assert_eq!("1voxel".parse(), Ok(Length::Voxels(1.0)));
        assert!(
            "three voxels"
                .parse::<Length>()
                .unwrap_err()
                .contains("3 voxels")
        );
        for l in [Length::Metres(0.1), Length::Voxels(2.5)] {
            assert_eq!(l.to_string().parse(), Ok(l));
        }
        assert_eq!(Length::Voxels(3.0).metres(0.2), 3.0 * 0.2);
    }
}
