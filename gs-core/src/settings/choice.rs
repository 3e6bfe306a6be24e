//! Settings whose values have names.

/// A setting that users choose by name: in flags, in settings files and from Python.
///
/// [`choices!`](crate::choices) declares such a type with the names and summaries of its values.
pub trait Choice: Copy + Send + Sync + 'static {
    /// The values that can be chosen, in the order of help texts.
    const CHOICES: &'static [Self];

    /// Name of the value.
    fn name(self) -> &'static str;

    /// What the value means, in one line.
    fn summary(self) -> &'static str;

    /// The value of this name; `None` for an unknown name.
    fn from_name(name: &str) -> Option<Self> {
        Self::CHOICES.iter().copied().find(|value| value.name() == name)
    }
}

/// Declares an enum whose values have names. Settings files (serde), flags and messages (`Display`)
/// use these names. A value that is offered to users also has a summary. The calling crate needs
/// `serde` with its feature `derive`.
///
/// ```
/// use gs_core::Choice as _;
///
/// gs_core::choices! {
///     /// A fruit.
///     #[derive(Default)]
///     pub enum Fruit {
///         /// Red or green.
///         #[default]
///         Apple = "apple": "Keeps for months",
///         /// Yellow.
///         Pear = "pear": "Keeps for days",
///     }
/// }
///
/// assert_eq!(Fruit::from_name("pear"), Some(Fruit::Pear));
/// assert_eq!(Fruit::ALL.map(Fruit::name), ["apple", "pear"]);
/// assert_eq!(Fruit::Pear.summary(), "Keeps for days");
/// ```
#[macro_export]
macro_rules! choices {
    (
        $(#[$about:meta])*
        $access:vis enum $Type:ident {
            $($(#[$of_value:meta])* $Value:ident = $name:literal $(: $summary:literal)?,)+
        }
    ) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, ::serde::Serialize, ::serde::Deserialize)]
        $access enum $Type {
            $($(#[$of_value])* #[serde(rename = $name)] $Value,)+
        }

        impl $Type {
            /// All values.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$Value),+];

            /// Name in flags, files and messages.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$Value => $name,)+
                }
            }
        }

        impl $crate::Choice for $Type {
            const CHOICES: &'static [Self] = &Self::ALL;

            fn name(self) -> &'static str {
                self.name()
            }

            fn summary(self) -> &'static str {
                match self {
                    $(Self::$Value => concat!("", $($summary)?),)+
                }
            }
        }

        impl ::std::fmt::Display for $Type {
            fn fmt(&self, f: &mut ::std::fmt::Formatter<'_>) -> ::std::fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Loss, adam::Participants, effects::Statistics};

    #[test]
    fn names_lead_back_to_their_values() {
        fn check<T: Choice + PartialEq + std::fmt::Debug>() {
            for value in T::CHOICES {
                assert_eq!(T::from_name(value.name()), Some(*value));
            }
            assert_eq!(T::from_name("no such name"), None);
        }
        check::<Loss>();
        check::<Participants>();
        assert_eq!(Loss::L1Dssim { lambda: 0.5 }.name(), Loss::PAPER.name());
    }

    #[test]
    fn files_have_the_same_names() {
        for value in Statistics::ALL {
            let text = serde_json::to_string(&value).unwrap();
            assert_eq!(text, format!("\"{value}\""));
            assert_eq!(serde_json::from_str::<Statistics>(&text).unwrap(), value);
        }
    }
}
