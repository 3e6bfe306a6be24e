//! Partial settings laid over complete ones.

use std::path::Path;

use gs_train::SettingsFile;
use toml::{Table, Value};

/// Pairs of keys of the same table that exclude each other.
const CHOICES: [[&str; 2]; 3] = [["fixed", "fraction"], ["extent-fraction", "pixels"], ["cosine", "exponential"]];

/// A key whose table has the name of a choice as its only key, so that it is replaced as a whole.
const CHOICE: &str = "loss";

/// Merges `over` into `base`, key by key. A table is replaced as a whole if `over` has another
/// `kind`, or the other one of two keys that exclude each other.
pub(crate) fn lay_upon(base: &mut Table, over: &Table) {
    let other_kind = base.get("kind").zip(over.get("kind")).is_some_and(|(a, b)| a != b);
    let other_choice = CHOICES
        .iter()
        .any(|[a, b]| base.contains_key(*a) && over.contains_key(*b) || base.contains_key(*b) && over.contains_key(*a));
    if other_kind || other_choice {
        base.clone_from(over);
        return;
    }
    for (key, value) in over {
        match (base.get_mut(key), value) {
            (Some(Value::Table(base)), Value::Table(over)) if key != CHOICE => lay_upon(base, over),
            _ => drop(base.insert(key.to_owned(), value.clone())),
        }
    }
}

/// `settings` with the values of `over` in place of their own.
///
/// # Errors
/// What is wrong with `over`: an unknown key, or a value that is not possible.
pub fn applied<T: SettingsFile>(settings: &T, over: &Table) -> Result<T, String> {
    let unreadable = |error: toml::de::Error| error.to_string();
    let text = settings.to_toml().map_err(|error| error.to_string())?;
    let mut table: Table = text.parse().map_err(unreadable)?;
    lay_upon(&mut table, over);
    // The line number is left out: it is one of the merged text, which the user does not see.
    T::from_toml(&table.to_string(), Path::new("")).map_err(|error| match error {
        gs_train::Error::Settings { problem, .. } => problem,
        error => error.to_string(),
    })
}

/// `settings` with the rounds of density control of `over`. Call this before a policy is chosen,
/// because some policies depend on the rounds. Rounds that are not possible are ignored here;
/// [`applied`] reports them.
pub fn with_rounds<T: SettingsFile>(settings: T, over: &Table) -> T {
    let Some(rounds) = over.get("rounds") else { return settings };
    applied(&settings, &Table::from_iter([("rounds".to_owned(), rounds.clone())])).unwrap_or(settings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs_density::Policy;
    use gs_train::{FitSettings, InitialCount, TrainSettings};

    fn with(text: &str) -> Result<FitSettings, String> {
        applied(&FitSettings::paper(), &text.parse().unwrap())
    }

    #[test]
    fn parts_are_replaced_and_the_rest_stays() {
        let settings =
            with("initial = { fraction = 0.5 }\nadam.mean.learning-rate = 0.5\npolicy.percent = 20").unwrap();
        let mut expected = FitSettings::paper().with(|s| s.initial = InitialCount::Fraction(0.5));
        expected.adam.mean.learning_rate = 0.5;
        let Policy::Grow(paper) = &mut expected.policy else { panic!("the paper's policy") };
        paper.percent = 20.0;
        assert_eq!(settings, expected);
        assert_eq!(with("").unwrap(), FitSettings::paper());
    }

    #[test]
    fn partial_settings_add_up() {
        let mut base: Table = "adam.mean.beta1 = 0.5\npolicy.actions.densify.shrink = 2.0".parse().unwrap();
        lay_upon(&mut base, &"adam.scale.beta1 = 0.6\npolicy.kind = 'absolute'".parse().unwrap());
        let settings = applied(&FitSettings::paper(), &base).unwrap();
        assert_eq!((settings.adam.mean.beta1, settings.adam.scale.beta1), (0.5, 0.6));
        let Policy::Grow(absolute) = settings.policy else { panic!("the policy is {:?}", settings.policy) };
        assert_eq!(absolute.actions.densify.shrink, 2.0);
    }

    #[test]
    fn another_kind_starts_from_its_own_defaults() {
        let settings = with("policy = { kind = 'percentile' }\ninit.kind = 'gradient'").unwrap();
        assert_eq!(settings.policy, Policy::from_name("percentile").unwrap());
        assert!(matches!(settings.init, gs_train::Init::Gradient(_)));
    }

    #[test]
    fn unknown_keys_are_named_wherever_they_stand() {
        for (text, expected) in [
            ("iteration = 7", "iteration"),
            ("adam.means.learning-rate = 1.0", "`means` in [adam]: did you mean `mean`?"),
            ("adam.mean.rate = 1.0", "`rate` in [adam.mean]"),
            ("policy = { kind = 'percentile', percentage = 5 }", "percentage"),
            ("policy = { kind = 'none', percent = 5 }", "`percent` in [policy]"),
            ("policy.kind = 'everything'", "everything"),
        ] {
            let message = with(text).unwrap_err();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }

    #[test]
    fn values_of_a_wrong_type_are_named_by_their_keys() {
        for (text, expected) in [
            ("iterations = 'a'", "iterations: invalid type: string \"a\""),
            ("adam.mean.learning-rate = 'a'", "adam.mean.learning-rate: invalid type: string \"a\""),
        ] {
            let message = with(text).unwrap_err();
            assert!(message.starts_with(expected), "{text}: {message}");
        }
    }

    #[test]
    fn settings_of_trainings_are_replaced_in_the_same_way() {
        let over = "resolution = { coarse-to-fine = { from = 4, full-after = 0.5 } }\nadam.epsilon = 0.5\n\
                    render.effects.order = 'per-pixel'\npolicy.kind = 'mcmc'";
        let settings = applied(&TrainSettings::default(), &over.parse().unwrap()).unwrap();
        assert_eq!((settings.adam.epsilon, settings.resolution.factor(0.0)), (0.5, 4));
        assert_eq!(settings.policy, Policy::from_name("mcmc").unwrap());
        let wrong = applied(&TrainSettings::default(), &"rebin-every = 4".parse().unwrap()).unwrap_err();
        assert!(wrong.starts_with("unknown key `rebin-every`"), "{wrong}");
    }
}
