//! Settings files in which any key of a policy's actions may be missing.
//!
//! A missing key has the value of the policy's own defaults, which may differ from those of
//! [`Actions`].

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use gs_core::edit::Moments;

use super::rule::Rule;
use crate::round::{Actions, Densify, OpacityCorrection, OpacityReset, Prune, SizeThreshold, SplitPlacement};

/// The form of a `T` in which any part may be missing.
pub(crate) trait Over<T>: Sized {
    /// The value of this form, completed from `usual`.
    fn over(self, usual: T) -> T;

    /// A form without missing parts.
    fn of(whole: T) -> Self;

    /// Whether all parts are missing.
    fn is_empty(&self) -> bool;
}

impl<T> Over<T> for Option<T> {
    fn over(self, usual: T) -> T {
        self.unwrap_or(usual)
    }

    fn of(whole: T) -> Self {
        Some(whole)
    }

    fn is_empty(&self) -> bool {
        self.is_none()
    }
}

/// Declares the form of a struct of settings, field by field.
macro_rules! form {
    ($form:ident of $settings:ident { $($field:ident: $part:ty),* $(,)? }) => {
        #[derive(Default, Serialize, Deserialize)]
        #[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
        pub(crate) struct $form {
            $(#[serde(skip_serializing_if = "Over::is_empty")] $field: $part,)*
        }

        impl Over<$settings> for $form {
            fn over(self, usual: $settings) -> $settings {
                $settings { $($field: self.$field.over(usual.$field)),* }
            }

            fn of(whole: $settings) -> Self {
                Self { $($field: Over::of(whole.$field)),* }
            }

            fn is_empty(&self) -> bool {
                true $(&& self.$field.is_empty())*
            }
        }
    };
}

impl ActionsForm {
    /// The form of these actions of a policy with these usual ones. Two keys are left out where
    /// they have their usual values, so that the digests of settings in records stay as they are.
    pub(crate) fn written(actions: Actions, usual: &Actions) -> Self {
        let mut form = Self::of(actions);
        form.growth_fraction = form.growth_fraction.filter(|&share| share != usual.growth_fraction);
        form.prune.larger_after = form.prune.larger_after.filter(|&step| step != usual.prune.larger_after);
        form
    }
}

/// Reads the actions of a policy of type `P`.
///
/// # Errors
/// Those of the deserializer; unknown keys.
pub(crate) fn read<'de, P: Rule + Default, D: Deserializer<'de>>(deserializer: D) -> Result<Actions, D::Error> {
    Ok(ActionsForm::deserialize(deserializer)?.over(usual::<P>()))
}

/// Writes the actions of a policy of type `P`.
///
/// # Errors
/// Those of the serializer.
pub(crate) fn write<P: Rule + Default, S: Serializer>(actions: &Actions, serializer: S) -> Result<S::Ok, S::Error> {
    ActionsForm::written(*actions, &usual::<P>()).serialize(serializer)
}

/// The actions of a policy of type `P` with its defaults.
fn usual<P: Rule + Default>() -> Actions {
    P::default().actions().copied().unwrap_or_default()
}

form!(ActionsForm of Actions {
    densify: DensifyForm,
    prune: PruneForm,
    reset: ResetForm,
    growth_fraction: Option<f32>,
});

form!(DensifyForm of Densify {
    split_above: Option<SizeThreshold>,
    shrink: Option<f32>,
    split_placement: Option<SplitPlacement>,
    opacity_correction: Option<OpacityCorrection>,
    newcomers: Option<Moments>,
});

form!(PruneForm of Prune {
    opacity: Option<f32>,
    larger_than: Option<Option<SizeThreshold>>,
    larger_after: Option<u32>,
});

form!(ResetForm of OpacityReset {
    every: Option<u32>,
    once_after: Option<u32>,
    to: Option<f32>,
});
