//! Where the keys of a study file are, so that errors name their lines.

use std::collections::BTreeMap;

use toml::de::{DeTable, DeValue};

/// The lines of keys, counted from 1, by their paths such as `settings.policy.percent`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct KeyLines(BTreeMap<String, usize>);

impl KeyLines {
    /// The lines of all keys of a file. Entries of arrays have their index as key: `arm.0.name`.
    /// Empty where the text is not TOML.
    pub(crate) fn of(text: &str) -> Self {
        let mut lines = Self::default();
        if let Ok(document) = DeTable::parse(text) {
            lines.add_table(text, document.get_ref(), "");
        }
        lines
    }

    fn add_table(&mut self, text: &str, table: &DeTable<'_>, path: &str) {
        for (key, value) in table {
            let path = joined(path, key.get_ref());
            self.0.insert(path.clone(), 1 + text[..key.span().start].matches('\n').count());
            self.add_value(text, value.get_ref(), &path);
        }
    }

    fn add_value(&mut self, text: &str, value: &DeValue<'_>, path: &str) {
        match value {
            DeValue::Table(table) => self.add_table(text, table, path),
            DeValue::Array(values) => {
                for (index, value) in values.iter().enumerate() {
                    self.add_value(text, value.get_ref(), &joined(path, &index.to_string()));
                }
            }
            _ => {}
        }
    }

    /// The line of a key.
    pub(crate) fn get(&self, path: &str) -> Option<usize> {
        self.0.get(path).copied()
    }

    /// The keys below `path`, which is cut off.
    pub(crate) fn below(&self, path: &str) -> Self {
        let start = format!("{path}.");
        let below = self.0.iter().filter_map(|(key, &line)| Some((key.strip_prefix(&start)?.to_owned(), line)));
        Self(below.collect())
    }

    /// Adds the keys of `other` that are not there yet.
    pub(crate) fn extend(&mut self, other: &Self) {
        for (key, line) in &other.0 {
            self.0.entry(key.clone()).or_insert(*line);
        }
    }
}

/// A path with one key more.
pub(crate) fn joined(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_has_its_line() {
        let text = "a = 1\n[b]\nc.d = 2\n[[arm]]\nname = 'x'\nsettings = { e = { f = 3 } }\n[[arm]]\nname = 'y'\n";
        let lines = KeyLines::of(text);
        let found =
            ["a", "b", "b.c.d", "arm.0.name", "arm.0.settings.e.f", "arm.1.name", "g"].map(|key| lines.get(key));
        assert_eq!(found, [Some(1), Some(2), Some(3), Some(5), Some(6), Some(8), None]);
        let mut arm = lines.below("arm.1");
        arm.extend(&lines.below("arm.0"));
        assert_eq!((arm.get("name"), arm.get("settings.e.f")), (Some(8), Some(6)));
        assert_eq!(KeyLines::of("a = "), KeyLines::default());
    }
}
