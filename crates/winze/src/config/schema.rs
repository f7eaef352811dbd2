//! How a section is declared: fields with documentation, default and domain in one place.

use super::length::Length;

/// What a value must be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rule {
    /// Any value of its type.
    Any,
    /// Above zero.
    Positive,
    /// Zero or above.
    NonNegative,
    /// Above zero, at most this.
    UpTo(f64),
    /// Between the two, both allowed.
    Between(f64, f64),
    /// One of these, as it is written.
    OneOf(&'static [&'static str]),
}

impl Rule {
    pub(super) fn holds(self, value: &impl Checked) -> bool {
        let number = |ok: &dyn Fn(f64) -> bool| value.number().is_none_or(ok);
        match self {
            Self::Any => true,
            Self::Positive => number(&|v| v > 0.0 && v.is_finite()),
            Self::NonNegative => number(&|v| v >= 0.0 && v.is_finite()),
            Self::UpTo(most) => number(&|v| v > 0.0 && v <= most),
            Self::Between(a, b) => number(&|v| v >= a && v <= b),
            Self::OneOf(words) => words.contains(&value.shown().as_str()),
        }
    }
}

impl std::fmt::Display for Rule {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Any => write!(f, "may be anything"),
            Self::Positive => write!(f, "must be above 0"),
            Self::NonNegative => write!(f, "must be 0 or above"),
            Self::UpTo(most) => write!(f, "must be above 0, at most {most}"),
            Self::Between(a, b) => write!(f, "must lie between {a} and {b}"),
            Self::OneOf(words) => write!(f, "one of {}", words.join(", ")),
        }
    }
}

/// A value that a rule can be held against.
pub(super) trait Checked {
    fn number(&self) -> Option<f64>;
    fn shown(&self) -> String;
}

macro_rules! checked {
    ($($ty:ty => |$v:ident| $number:expr, $shown:expr;)*) => { $(
        impl Checked for $ty {
            fn number(&self) -> Option<f64> { let $v = self; $number }
            fn shown(&self) -> String { let $v = self; $shown }
        }
    )* };
}

#[expect(
    clippy::cast_precision_loss,
    reason = "counts, compared with small bounds"
)]
mod checked {
    use super::super::choices::{
        DescriptorVariant, IcpMetric, IssCentre, Kernel, NdtForm, Orientation,
    };
    use super::{Checked, Length};
    checked! {
        f64 => |v| Some(*v), format!("{v}");
        usize => |v| Some(*v as f64), format!("{v}");
        u64 => |_v| None, format!("{_v}");
        bool => |_v| None, format!("{_v}");
        Length => |v| Some(v.amount()), format!("{v}");
        Orientation => |_v| None, format!("{_v}");
        IcpMetric => |_v| None, format!("{_v}");
        IssCentre => |_v| None, format!("{_v}");
        DescriptorVariant => |_v| None, format!("{_v}");
        NdtForm => |_v| None, format!("{_v}");
        Kernel => |_v| None, format!("{_v}");
    }
}

/// What `winze config` says of one field.
#[derive(Debug, Clone, Copy)]
pub struct FieldDoc {
    /// Field name.
    pub name: &'static str,
    /// Its documentation, one line a source line.
    pub doc: &'static [&'static str],
    /// What it must be.
    pub rule: Rule,
}

/// Declares a section: the struct, its defaults, its documentation table and its check.
macro_rules! section {
    (
        $(#[doc = $doc:literal])+
        pub struct $name:ident($key:literal) {
            $( $(#[doc = $fdoc:literal])+ $field:ident: $ty:ty = $default:expr, $rule:expr; )+
        }
    ) => {
        $(#[doc = $doc])+
        #[derive(Debug, Clone, PartialEq)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        #[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
        pub struct $name {
            $( $(#[doc = $fdoc])+ #[doc = concat!("\n\nDefault: `", stringify!($default), "`.")] pub $field: $ty, )+
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $( $field: $default, )+ }
            }
        }

        impl $name {
            /// The section's name in a configuration file.
            pub const KEY: &'static str = $key;
            /// The section's documentation, one line a source line.
            pub const DOC: &'static [&'static str] = &[$($doc),+];
            /// Documentation and domain of each field, in order.
            pub const FIELDS: &'static [$crate::config::FieldDoc] = &[
                $( $crate::config::FieldDoc { name: stringify!($field), doc: &[$($fdoc),+], rule: $rule } ),+
            ];

            pub(super) fn check(&self) -> $crate::Result<()> {
                $( {
                    let rule: Rule = $rule;
                    if !rule.holds(&self.$field) {
                        return Err($crate::Error::Config {
                            key: concat!($key, ".", stringify!($field)).into(),
                            value: self.$field.shown(),
                            rule: rule.to_string(),
                        });
                    }
                } )+
                Ok(())
            }
        }
    };
}

pub(super) use section;
