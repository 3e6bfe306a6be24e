//! The macro that makes [`Policy`](super::Policy) of the table of policies.

/// Declares [`Policy`] and its form in settings files from the table of policies: variant, type,
/// name, whether it reads evidence, and what it does in one line. Those of the second part are for 2D
/// scenes only.
macro_rules! policies {
    (
        $($(#[$docs:meta])* $variant:ident($type:ty) = $name:literal $(, by $evidence:ident)?: $summary:literal;)*
        2D only:
        $($(#[$flat_docs:meta])* $flat_variant:ident($flat_type:ty) = $flat_name:literal: $flat_summary:literal;)*
    ) => {
        /// Any of the policies. In a settings file, `kind` names the policy, next to its settings.
        ///
        /// ```
        /// use gs_density::{Grow, Policy};
        ///
        /// let policy: Policy = toml::from_str("kind = 'percentile'\npercent = 5.0\nactions.densify.shrink = 2.0").unwrap();
        /// assert!(matches!(policy, Policy::Grow(Grow { percent: 5.0, .. })));
        /// ```
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(from = "Form", into = "Form")]
        #[non_exhaustive]
        pub enum Policy {
            /// Grow by rank and threshold.
            Grow(Grow),
            $($(#[$docs])* $variant($type),)*
            $($(#[$flat_docs])* $flat_variant($flat_type),)*
            /// Grow nothing, and prune only Gaussians that are not finite. A control for measuring
            /// what growth is worth.
            None,
        }

        /// A policy in a settings file. The kinds of [`Grow`] are the names of its constructors.
        #[derive(Serialize, Deserialize)]
        #[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
        enum Form {
            Absolute(GrowForm),
            Percentile(GrowForm),
            Paper(GrowForm),
            $(#[serde(rename = $name)] $variant($type),)*
            $(#[serde(rename = $flat_name)] $flat_variant($flat_type),)*
            None {},
        }

        impl From<Form> for Policy {
            fn from(form: Form) -> Self {
                match form {
                    Form::Absolute(form) => Self::Grow(form.or(Grow::absolute)),
                    Form::Percentile(form) => Self::Grow(form.or(Grow::percentile)),
                    Form::Paper(form) => Self::Grow(form.or(Grow::paper)),
                    $(Form::$variant(policy) => Self::$variant(policy),)*
                    $(Form::$flat_variant(policy) => Self::$flat_variant(policy),)*
                    Form::None {} => Self::None,
                }
            }
        }

        impl From<Policy> for Form {
            fn from(policy: Policy) -> Self {
                match policy {
                    Policy::Grow(policy) => match grow::kind(&policy) {
                        "paper" => Self::Paper(policy.into()),
                        "absolute" => Self::Absolute(policy.into()),
                        _ => Self::Percentile(policy.into()),
                    },
                    $(Policy::$variant(policy) => Self::$variant(policy),)*
                    $(Policy::$flat_variant(policy) => Self::$flat_variant(policy),)*
                    Policy::None => Self::None {},
                }
            }
        }

        $($(declare_listed!($type, $name, $evidence);)?)*

        /// The policies that are no [`Grow`], by name.
        const OTHERS: &[Named] = &[
            $(Named { name: $name, summary: $summary, make: || Policy::$variant(<$type>::default()) },)*
            $(Named { name: $flat_name, summary: $flat_summary, make: || Policy::$flat_variant(<$flat_type>::default()) },)*
            Named { name: "none", summary: "Keep the initial Gaussians", make: || Policy::None },
        ];

        impl Policy {
            /// Name of the policy, as in [`Self::NAMES`], by its rule, signal and kind of split.
            pub fn name(&self) -> &'static str {
                match self {
                    Self::Grow(policy) => grow::name(policy),
                    $(Self::$variant(_) => $name,)*
                    $(Self::$flat_variant(_) => $flat_name,)*
                    Self::None => "none",
                }
            }

            fn rule(&self) -> &dyn Rule {
                match self {
                    Self::Grow(policy) => policy,
                    $(Self::$variant(policy) => policy,)*
                    $(Self::$flat_variant(policy) => policy,)*
                    Self::None => &NoGrowth,
                }
            }

            fn rule_mut(&mut self) -> Option<&mut dyn Rule> {
                match self {
                    Self::Grow(policy) => Some(policy),
                    $(Self::$variant(policy) => Some(policy),)*
                    $(Self::$flat_variant(policy) => Some(policy),)*
                    Self::None => None,
                }
            }

            fn of_2d_scenes(&self) -> &dyn DensityPolicy<Scene2d> {
                match self {
                    Self::Grow(policy) => policy,
                    $(Self::$variant(policy) => policy,)*
                    $(Self::$flat_variant(policy) => policy,)*
                    Self::None => &NoGrowth,
                }
            }

            /// `None` for policies that are for 2D scenes only.
            fn of_3d_scenes(&self) -> Option<&dyn DensityPolicy<Scene3d>> {
                match self {
                    Self::Grow(policy) => Some(policy),
                    $(Self::$variant(policy) => Some(policy),)*
                    $(Self::$flat_variant(_) => None,)*
                    Self::None => Some(&NoGrowth),
                }
            }
        }
    };
}

/// Implements [`Listed`](crate::policy::rule::Listed) for a policy that reads evidence.
macro_rules! declare_listed {
    ($type:ty, $name:literal, evidence) => {
        impl Listed for $type {
            const NAME: &'static str = $name;

            fn own_actions(&self) -> &Actions {
                &self.actions
            }

            fn own_actions_mut(&mut self) -> &mut Actions {
                &mut self.actions
            }
        }
    };
}
