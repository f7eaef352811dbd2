//! How settings are declared and checked.

use crate::error::Error;
pub(super) use crate::error::within;

/// A setting of the world that is refused.
pub(super) fn refused(key: &str, why: String) -> Error {
    Error::Setting {
        key: format!("world.{key}"),
        why,
    }
}

/// The numbers in a setting: one, or a range of two.
pub(super) trait Numbers {
    /// Each of them.
    fn numbers(&self) -> impl Iterator<Item = f64>;
}

impl Numbers for f64 {
    fn numbers(&self) -> impl Iterator<Item = f64> {
        std::iter::once(*self)
    }
}

impl Numbers for u32 {
    fn numbers(&self) -> impl Iterator<Item = f64> {
        std::iter::once(f64::from(*self))
    }
}

impl Numbers for bool {
    fn numbers(&self) -> impl Iterator<Item = f64> {
        std::iter::once(f64::from(u8::from(*self)))
    }
}

impl Numbers for [f64; 2] {
    fn numbers(&self) -> impl Iterator<Item = f64> {
        self.iter().copied()
    }
}

/// Declares settings: the struct, its defaults and the check of their domains.
macro_rules! settings {
    ( $(#[$doc:meta])* $key:literal $name:ident {
        $( $(#[doc = $fdoc:literal])+ $field:ident: $ty:ty = $default:expr, $low:expr, $high:expr; )+
    } { $( $(#[doc = $odoc:literal])+ $other:ident: $oty:ty = $odefault:expr; )* } ) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name {
            $( $(#[doc = $fdoc])+
            #[doc = concat!("\n\nDefault: `", stringify!($default), "`; from ", stringify!($low), " to ", stringify!($high), ".")]
            pub $field: $ty, )+
            $( $(#[doc = $odoc])+ pub $other: $oty, )*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $( $field: $default, )+ $( $other: $odefault, )* }
            }
        }

        impl $name {
            pub(super) fn check(&self) -> Result<()> {
                $( for v in self.$field.numbers() {
                    within(concat!($key, ".", stringify!($field)), v, $low, $high)?;
                } )+
                Ok(())
            }
        }
    };
}

/// The same for a kind of world, with the settings of its rock.
macro_rules! world {
    ( $(#[$doc:meta])* $name:ident {
        $( $(#[doc = $fdoc:literal])+ $field:ident: $ty:ty = $default:expr, $low:expr, $high:expr; )+
    } { $( $(#[doc = $odoc:literal])+ $other:ident: $oty:ty = $odefault:expr; )* }
    roughness $roughness:literal, blocky $blocky:literal, cell $cell:literal, reflectivity $reflectivity:literal ) => {
        settings! { $(#[$doc])* "world" $name {
            $( $(#[doc = $fdoc])+ $field: $ty = $default, $low, $high; )+
            /// How far the rock strays from its plan at most, metres; its standard deviation is about a third
            /// of that. 0.05 shotcrete, 0.4 blasted rock.
            roughness: f64 = $roughness, 0.0, 2.0;
            /// Share of the roughness that is left on the floor.
            floor_roughness: f64 = 0.3, 0.0, 1.0;
            /// Share of the relief that steps along joints and beds rather than rolls.
            blocky: f64 = $blocky, 0.0, 1.0;
            /// Edge of the mesh's cells, metres; relief shorter than two of them is left out.
            cell: f64 = $cell, 0.01, 1.0;
            /// Share of the floor under puddles, and of the walls that are wet.
            wet: f64 = 0.0, 0.0, 1.0;
            /// Share of near-infrared light that dry rock gives back: 0.1 coal, 0.3 grey rock, 0.5 shotcrete.
            reflectivity: f64 = $reflectivity, 0.01, 1.0;
        } { $( $(#[doc = $odoc])+ $other: $oty = $odefault; )* } }

        impl $name {
            pub(super) fn rock(&self) -> Rock {
                Rock {
                    roughness: self.roughness,
                    floor_roughness: self.floor_roughness,
                    blocky: self.blocky,
                    cell: self.cell,
                    wet: self.wet,
                    reflectivity: self.reflectivity,
                }
            }
        }
    };
}

pub(super) use {settings, world};
