//! Settings in TOML files, and what users write as JSON, with errors that name the line, the key
//! and the nearest known key.

use std::{fmt, ops::Range, path::Path};

use serde::{Serialize, de::DeserializeOwned};
use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use crate::error::Error;

/// Parses the text of a settings file. `file` is its name for the error.
///
/// ```
/// use gs_train::{FitSettings, parse_settings};
///
/// let text = "iterations = 7\n[render.effects]\nantialais = 'mip'";
/// let error = parse_settings::<FitSettings>(text, "settings.toml".as_ref()).unwrap_err();
/// let expected = "settings.toml:3: unknown key `antialais` in [render.effects]: did you mean `antialias`?";
/// assert_eq!(error.to_string(), expected);
/// ```
///
/// # Errors
/// [`Error::Settings`] where the text is not TOML, a key is unknown, or a value has the wrong type.
/// Ranges are checked by the settings' own `validate`.
pub fn parse_settings<T: DeserializeOwned>(text: &str, file: &Path) -> Result<T, Error> {
    parse(text).map_err(|(start, problem)| {
        let line = 1 + text[..start].matches('\n').count();
        Error::Settings { file: file.to_owned(), line, problem }
    })
}

/// Parses the text of a JSON file that a user wrote, with errors like those of [`parse_settings`].
/// `file` is its name for the error.
///
/// ```
/// use gs_core::view::CameraPath;
///
/// let text = "{ \"width\": 8,\n  \"heigth\": 6 }";
/// let error = gs_train::parse_json::<CameraPath>(text, "path.json".as_ref()).unwrap_err();
/// assert_eq!(error.to_string(), "path.json:2: unknown key `heigth`: did you mean `height`?");
/// ```
///
/// # Errors
/// [`Error::Settings`] where the text is not JSON, a key is unknown, or a value has the wrong type.
pub fn parse_json<T: DeserializeOwned>(text: &str, file: &Path) -> Result<T, Error> {
    serde_json::from_str(text).map_err(|error| {
        let (line, message) = (error.line(), error.to_string());
        let message = message.strip_suffix(&format!(" at line {line} column {}", error.column())).unwrap_or(&message);
        let problem = Unknown::of(message, "", 0).map_or_else(|| message.to_owned(), |unknown| unknown.to_string());
        Error::Settings { file: file.to_owned(), line: line.max(1), problem }
    })
}

/// Parses settings; an error is the byte at which it is, and what is wrong there.
fn parse<T: DeserializeOwned>(text: &str) -> Result<T, (usize, String)> {
    toml::from_str(text).map_err(|error| {
        let span = error.span().unwrap_or(0..0);
        let start = span.start;
        if let Some(unknown) = Unknown::of(error.message(), text, start) {
            return (unknown.start, unknown.to_string());
        }
        let is_date = |value: &str| value.parse::<toml::value::Datetime>().is_ok();
        let problem = match text.get(span.clone()).is_some_and(is_date) {
            true => "no setting is a date: put a text in quotes".to_owned(),
            false => error.message().replace("wanted string or table", "expected a name in quotes, or a table"),
        };
        let document = DeTable::parse(text).ok().filter(|_| !span.is_empty());
        let key = document.and_then(|document| key_of(document.get_ref(), &span, ""));
        (start, key.map(|key| key + ": ").unwrap_or_default() + &problem)
    })
}

/// Settings that are read from and written to TOML files.
///
/// The methods do what [`parse_settings`] and [`settings_to_toml`] do. They are compiled once for
/// each type of settings instead of in each crate that uses them.
pub trait SettingsFile: Sized {
    /// Parses the text of a settings file; `file` is its name for the error.
    ///
    /// # Errors
    /// Those of [`parse_settings`].
    fn from_toml(text: &str, file: &Path) -> Result<Self, Error>;

    /// The settings as the text of a TOML file.
    ///
    /// # Errors
    /// Those of [`settings_to_toml`].
    fn to_toml(&self) -> Result<String, Error>;
}

macro_rules! in_a_file {
    ($($Settings:ty),*) => {
        $(impl $crate::run::SettingsFile for $Settings {
            fn from_toml(text: &str, file: &std::path::Path) -> Result<Self, $crate::error::Error> {
                $crate::run::parse_settings(text, file)
            }

            fn to_toml(&self) -> Result<String, $crate::error::Error> {
                $crate::run::settings_to_toml(self)
            }
        })*
    };
}
in_a_file!(gs_core::RenderSettings, gs_density::Actions);
pub(crate) use in_a_file;

/// The settings as the text of a TOML file, for [`parse_settings`]. Numbers have as many digits as
/// `f32` needs.
///
/// # Errors
/// [`Error::UnwritableSettings`] where TOML has no form for them.
pub fn settings_to_toml(settings: &impl Serialize) -> Result<String, Error> {
    let unwritable = |error: toml::ser::Error| Error::UnwritableSettings(error.to_string());
    let mut value = toml::Value::try_from(settings).map_err(unwritable)?;
    shorten(&mut value);
    toml::to_string(&value).map_err(unwritable)
}

/// Shortens numbers, which are all `f32`, to the digits that matter.
fn shorten(value: &mut toml::Value) {
    match value {
        toml::Value::Float(number) => *number = (*number as f32).to_string().parse().unwrap_or(*number),
        toml::Value::Array(values) => values.iter_mut().for_each(shorten),
        toml::Value::Table(table) => table.iter_mut().for_each(|(_, value)| shorten(value)),
        _ => {}
    }
}

/// An unknown key, or an unknown name of a value.
struct Unknown<'a> {
    /// "key" or "name".
    what: &'static str,
    /// The key or the name.
    word: &'a str,
    /// The word's place in the text, bytes.
    start: usize,
    /// The table that it is in; empty for the file's own.
    table: String,
    /// The most similar known one.
    nearest: Option<&'a str>,
    /// All known names, for an unknown name.
    names: Vec<&'a str>,
}

impl<'a> Unknown<'a> {
    /// The unknown key or name of an error message, if it is about one, at its first place from
    /// `start` on. The message about a table with a `kind` points at the table.
    fn of(message: &'a str, text: &str, start: usize) -> Option<Self> {
        let quoted = |start| message.strip_prefix(start).map(|rest| rest.split('`').step_by(2).collect::<Vec<_>>());
        // As the toml crate says it of a variant's table.
        let listed = |rest: &'a str| {
            let (found, known) = rest.split_once(", available keys: ").unwrap_or((rest, ""));
            found.split(", ").take(1).chain(known.split(", ")).collect()
        };
        let key = quoted("unknown field `").or_else(|| message.strip_prefix("unexpected keys in table: ").map(listed));
        let (what, words) = key.map(|key| ("key", key)).or_else(|| Some(("name", quoted("unknown variant `")?)))?;
        let (&word, known) = words.split_first()?;
        let known = known.to_vec();
        let nearest = nearest(word, known.iter().copied());
        let names = if what == "name" { known } else { Vec::new() };
        let mut places = Vec::new();
        if let Ok(document) = DeTable::parse(text) {
            find(document.get_ref(), word, "", &mut places);
        }
        places.sort_unstable();
        let place = places.iter().find(|(place, _)| *place >= start).or(places.first()).cloned();
        let (start, table) = place.unwrap_or((start, String::new()));
        Some(Self { what, word, start, table, nearest, names })
    }
}

impl fmt::Display for Unknown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unknown {} `{}`", self.what, self.word)?;
        if !self.table.is_empty() {
            write!(f, " in [{}]", self.table)?;
        }
        match self.nearest {
            Some(nearest) => write!(f, ": did you mean `{nearest}`?"),
            None if self.names.is_empty() => Ok(()),
            None => write!(f, ", which is none of {}", self.names.join(", ")),
        }
    }
}

/// The name most similar to `word`, if any is similar; among equals, the first.
fn nearest<'a>(word: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let far = 1 + word.chars().count() / 3;
    names
        .map(|name| (strsim::osa_distance(word, name), name))
        .filter(|(distance, _)| *distance <= far)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

/// All places of `word` in a table and its tables, as a key or a text: the byte, and the path of
/// its table.
fn find(table: &DeTable<'_>, word: &str, path: &str, places: &mut Vec<(usize, String)>) {
    for (name, value) in table {
        if name.get_ref() == word || value.get_ref().as_str() == Some(word) {
            places.push((name.span().start, path.to_owned()));
        }
        find_within(value, word, &joined(path, name.get_ref()), places);
    }
}

fn find_within(value: &Spanned<DeValue<'_>>, word: &str, path: &str, places: &mut Vec<(usize, String)>) {
    match value.get_ref() {
        DeValue::Table(table) => find(table, word, path, places),
        DeValue::Array(values) => values.iter().for_each(|value| find_within(value, word, path, places)),
        _ => {}
    }
}

/// The path of the innermost key whose value, or an element of it, has this place in the text.
fn key_of(table: &DeTable<'_>, span: &Range<usize>, path: &str) -> Option<String> {
    table.iter().find_map(|(name, value)| key_within(value, span, &joined(path, name.get_ref())))
}

fn key_within(value: &Spanned<DeValue<'_>>, span: &Range<usize>, path: &str) -> Option<String> {
    let inner = match value.get_ref() {
        DeValue::Table(table) => key_of(table, span, path),
        DeValue::Array(values) => values.iter().find_map(|value| key_within(value, span, path)),
        _ => None,
    };
    inner.or_else(|| (value.span() == *span).then(|| path.to_owned()))
}

/// The path of a key in the table with this path, which is empty for the file's own.
fn joined(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

#[cfg(test)]
mod tests {
    use gs_core::{Loss, adam::Schedule};
    use gs_density::{LongAxisSplit, Policy, SizeThreshold, SplitPlacement};
    use toml::Table;

    use super::*;
    use crate::{
        fit::{
            FitSettings, InitialCount, Preset,
            init::{Guided, Init, Periphery, Random},
        },
        run::recovery::Recovery,
        train::TrainPreset,
        views::Resolution,
    };

    fn parse<T: DeserializeOwned>(text: &str) -> Result<T, String> {
        parse_settings(text, "settings.toml".as_ref()).map_err(|error| error.to_string())
    }

    #[test]
    fn values_of_the_wrong_form_say_what_is_expected() {
        let error = |text: &str| parse::<gs_core::RenderSettings>(text).unwrap_err();
        assert_eq!(error("background = [1, 1, 1, 0.5]"), "settings.toml:1: background: expected 3 values, found 4");
        assert_eq!(
            error("\nfull-depth = 1979-05-27"),
            "settings.toml:2: full-depth: no setting is a date: put a text in quotes"
        );
        let kind = error("\n\n[effects]\nblend = 3");
        assert!(kind.contains(":4: effects.blend: ") && kind.contains("a name in quotes"), "{kind}");
    }

    /// Misspells each key in turn, and expects it to be named, with its table and the right key.
    fn misspell_each<T: DeserializeOwned>(whole: &Table, path: &[&str]) -> usize {
        let table = path.iter().fold(whole, |table, key| table[*key].as_table().unwrap());
        let mut seen = 0;
        for (key, value) in table {
            let misspelt = format!("{key}h");
            let mut wrong = whole.clone();
            let place = path.iter().fold(&mut wrong, |table, key| table[*key].as_table_mut().unwrap());
            let value_kept = place.remove(key).unwrap();
            place.insert(misspelt.clone(), value_kept);
            let text = toml::to_string(&wrong).unwrap();
            let message = parse::<T>(&text).err().unwrap_or_else(|| panic!("`{misspelt}` passes:\n{text}"));
            if key == "kind" {
                assert!(message.contains("missing field `kind`"), "{message}");
            } else {
                let place = if path.is_empty() { String::new() } else { format!(" in [{}]", path.join(".")) };
                let named = format!("`{misspelt}`{place}: did you mean `{key}`?");
                assert!(message.contains(&named), "{named}: {message}\n{text}");
                let line = 1 + text.lines().position(|line| line.contains(&misspelt)).unwrap();
                assert!(message.starts_with(&format!("settings.toml:{line}: unknown ")), "{message}\n{text}");
            }
            seen += 1;
            if value.is_table() {
                seen += misspell_each::<T>(whole, &[path, &[key]].concat());
            }
        }
        seen
    }

    fn held<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(settings: &T) {
        let text = settings_to_toml(settings).unwrap();
        assert_eq!(&parse::<T>(&text).unwrap(), settings, "{text}");
        let seen = misspell_each::<T>(&text.parse().unwrap(), &[]);
        assert!(seen > 40, "{seen} keys");
    }

    /// Every policy, with what its settings may have or not.
    fn policies() -> Vec<Policy> {
        let mut policies: Vec<Policy> = Policy::NAMES.iter().map(|name| Policy::from_name(name).unwrap()).collect();
        for policy in &mut policies {
            if let Some(actions) = policy.actions_mut() {
                actions.prune.larger_than = Some(SizeThreshold::ExtentFraction(0.5));
                actions.prune.larger_after = 7;
                actions.growth_fraction = 0.5;
                actions.densify.split_placement = SplitPlacement::LongAxisSplit(LongAxisSplit::default());
            }
        }
        policies
    }

    #[test]
    fn each_key_of_a_fits_settings_is_known_and_no_other() {
        let inits =
            [Init::Random(Random::default()), Init::Periphery(Periphery::default()), Init::Gradient(Guided::default())];
        let initials = [InitialCount::Fixed(3), InitialCount::Fraction(0.5)];
        let schedules = [Schedule::Constant, Schedule::Cosine { to: 0.5 }, Schedule::Exponential { to: 0.25 }];
        for (index, policy) in policies().into_iter().enumerate() {
            let mut settings = Preset::ALL[index % Preset::ALL.len()].settings(9, (8, 8));
            settings.policy = policy;
            settings.init = inits[index % inits.len()];
            settings.initial = initials[index % initials.len()];
            settings.adam.mean = settings.adam.mean.with(|s| s.schedule = schedules[index % schedules.len()]);
            settings.recovery = Recovery::Never;
            settings.loss = Loss::PAPER;
            held(&settings);
        }
    }

    #[test]
    fn each_key_of_a_trainings_settings_is_known_and_no_other() {
        for (index, policy) in policies().into_iter().enumerate() {
            let mut settings = TrainPreset::ALL[index % TrainPreset::ALL.len()].settings(Some(100));
            settings.policy = policy;
            settings.extent = Some(2.0);
            settings.recovery = Recovery::Never;
            settings.resolution = Resolution::CoarseToFine { from: 2, full_after: 0.5 };
            held(&settings);
        }
    }

    #[test]
    fn a_key_that_is_known_elsewhere_is_named_where_it_is_not() {
        let text = "adam.mean.schedule.cosine.to = 0.5\n[render.accuracy]\nto = 1";
        let message = parse::<FitSettings>(text).unwrap_err();
        assert_eq!(message, "settings.toml:3: unknown key `to` in [render.accuracy]");
        let message = parse::<FitSettings>("[adam.mean]\nlearning-rate = 1\n[policy]\nkind = 'none'\npercent = 5");
        assert_eq!(message.unwrap_err(), "settings.toml:5: unknown key `percent` in [policy]");
        let message = parse::<FitSettings>("init.kind = 'radnom'").unwrap_err();
        assert_eq!(message, "settings.toml:1: unknown name `radnom` in [init]: did you mean `random`?");
        let message = parse::<FitSettings>("seed = 3\niterations = 'many'").unwrap_err();
        assert!(message.starts_with("settings.toml:2: iterations: invalid type"), "{message}");
        let message = parse::<FitSettings>("[adam.mean]\nbeta1 = 0.5\nlearning-rate = 'a'").unwrap_err();
        assert!(message.starts_with("settings.toml:3: adam.mean.learning-rate: invalid type"), "{message}");
        let message = parse::<gs_core::RenderSettings>("background = [0, 'a', 0]").unwrap_err();
        assert!(message.starts_with("settings.toml:1: background: invalid type"), "{message}");
        assert!(parse::<FitSettings>("seed = = 3").unwrap_err().starts_with("settings.toml:1: "));
    }
}
