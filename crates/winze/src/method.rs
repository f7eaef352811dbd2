//! The methods by name.

/// How to look for the query: the paper's five configurations, and `auto`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Method {
    /// The full chain at scales taken from the data, on several hypotheses, with point-to-plane ICP
    /// to end with.
    #[default]
    Auto,
    /// ISS, FPFH and RANSAC alone.
    Fpfh,
    /// Then NDT.
    FpfhNdt,
    /// Then ICP.
    FpfhIcp,
    /// NDT and ICP from a given start, no features.
    NdtIcp,
    /// The paper's whole chain: features, NDT, ICP.
    FpfhNdtIcp,
}

impl Method {
    /// All of them, `auto` first.
    pub const ALL: [Self; 6] = [
        Self::Auto,
        Self::Fpfh,
        Self::FpfhNdt,
        Self::FpfhIcp,
        Self::NdtIcp,
        Self::FpfhNdtIcp,
    ];

    /// The name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Fpfh => "fpfh",
            Self::FpfhNdt => "fpfh+ndt",
            Self::FpfhIcp => "fpfh+icp",
            Self::NdtIcp => "ndt+icp",
            Self::FpfhNdtIcp => "fpfh+ndt+icp",
        }
    }

    /// Finds its own start from features.
    #[must_use]
    pub fn uses_features(self) -> bool {
        self != Self::NdtIcp
    }

    /// Draws at random, so that the seed matters.
    #[must_use]
    pub fn draws_at_random(self) -> bool {
        !matches!(self, Self::Auto | Self::NdtIcp)
    }

    /// Refines by NDT.
    #[must_use]
    pub fn uses_ndt(self) -> bool {
        !matches!(self, Self::Fpfh | Self::FpfhIcp)
    }

    /// Refines by ICP.
    #[must_use]
    pub fn uses_icp(self) -> bool {
        !matches!(self, Self::Fpfh | Self::FpfhNdt)
    }

    /// About how many stages a run has at one voxel size, for whoever shows how far it is.
    #[must_use]
    pub fn stages(self) -> u64 {
        let searched = if self.uses_features() { 5 } else { 0 };
        let rivals = u64::from(self.uses_features() && self != Self::Auto);
        8 + searched + rivals + 2 * u64::from(self.uses_ndt()) + u64::from(self.uses_icp())
    }
}

impl std::fmt::Display for Method {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Method {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|m| m.name() == s)
            .ok_or_else(|| {
                let names: Vec<&str> = Self::ALL.iter().map(|m| m.name()).collect();
                format!("no method {s:?}; choose one of {}", names.join(", "))
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_go_both_ways() {
        for m in Method::ALL {
            assert_eq!(m.name().parse(), Ok(m));
        }
        assert!(
            "icp"
                .parse::<Method>()
                .unwrap_err()
                .contains("fpfh+ndt+icp")
        );
    }
}
