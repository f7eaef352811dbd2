//! Choices by name.

macro_rules! choice {
    ($(#[doc = $doc:literal])+ pub enum $name:ident { $( $(#[doc = $vdoc:literal])+ $variant:ident = $text:literal, )+ }) => {
        $(#[doc = $doc])+
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        pub enum $name {
            $( $(#[doc = $vdoc])+ #[cfg_attr(feature = "serde", serde(rename = $text))] $variant, )+
        }

        impl $name {
            /// All of them, as they are written.
            pub const NAMES: &'static [&'static str] = &[$($text),+];
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(match self { $( Self::$variant => $text, )+ })
            }
        }
    };
}

choice! {
    /// Where the sign of a normal comes from.
    pub enum Orientation {
        /// Towards the sensor where the cloud has a viewpoint, else towards the open side.
        Auto = "auto",
        /// Towards the open side: where more of the surrounding cloud lies.
        OpenSide = "open-side",
    }
}

choice! {
    /// What the ISS scatter matrix is taken about.
    pub enum IssCentre {
        /// The point itself, as in Zhong 2009 and PCL.
        Point = "point",
        /// The neighbourhood's centroid, as in Open3D.
        Centroid = "centroid",
    }
}

choice! {
    /// How SPFH histograms are summed into FPFH.
    pub enum DescriptorVariant {
        /// Rusu et al. 2009 and the paper: own SPFH plus 1/k of the neighbours', each over its
        /// distance.
        Paper = "paper",
        /// PCL: the neighbours' over their squared distance, each of the three parts scaled to 100.
        Pcl = "pcl",
        /// Open3D: as PCL, plus the own SPFH.
        Open3d = "open3d",
    }
}

choice! {
    /// The objective that NDT climbs.
    pub enum NdtForm {
        /// Magnusson 2009: a Gaussian mixed with a uniform outlier density, Newton steps.
        Mixture = "mixture",
        /// The paper's plain form: the likelihood of one Gaussian, gradient ascent.
        Plain = "plain",
    }
}

choice! {
    /// How residuals are weighted in ICP.
    pub enum Kernel {
        /// All alike.
        None = "none",
        /// Huber: linear beyond the scale.
        Huber = "huber",
        /// Geman-McClure: outliers lose their say.
        GemanMcClure = "geman-mcclure",
    }
}

choice! {
    /// What ICP minimises.
    pub enum IcpMetric {
        /// Distances to the nearest map points, in closed form.
        PointToPoint = "point-to-point",
        /// Distances to the tangent planes at them, by Gauss-Newton.
        PointToPlane = "point-to-plane",
        /// Distances between the surfaces at both points, plane to plane (Segal, Haehnel & Thrun 2009), by Gauss-Newton.
        Generalized = "generalized",
    }
}
