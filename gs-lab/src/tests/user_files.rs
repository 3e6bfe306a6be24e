//! Files that users write: each key is misspelt in turn, and every misspelling is refused, with its
//! place and the right key.

use crate::{Error, Places, Plan, Study};
use gs_core::view::CameraPath;
use gs_train::parse_json;
use toml::{Table, Value};

/// All tables that differ from `whole` in one misspelt key, at any depth, each with that key.
fn misspelt(whole: &Table) -> Vec<(String, Table)> {
    let mut all = Vec::new();
    for (key, value) in whole {
        let (mut renamed, wrong) = (whole.clone(), format!("{key}h"));
        renamed.remove(key);
        renamed.insert(wrong.clone(), value.clone());
        all.push((wrong, renamed));
        let inside = match value {
            Value::Table(table) => misspelt(table).into_iter().map(|(key, table)| (key, table.into())).collect(),
            Value::Array(values) => misspelt_in(values),
            _ => Vec::new(),
        };
        all.extend(inside.into_iter().map(|(wrong, value)| {
            let mut changed = whole.clone();
            changed.insert(key.clone(), value);
            (wrong, changed)
        }));
    }
    all
}

/// The misspelt variants of the tables of an array.
fn misspelt_in(values: &[Value]) -> Vec<(String, Value)> {
    let mut all = Vec::new();
    for (index, table) in values.iter().enumerate().filter_map(|(index, value)| Some((index, value.as_table()?))) {
        all.extend(misspelt(table).into_iter().map(|(wrong, table)| {
            let mut changed = values.to_vec();
            changed[index] = table.into();
            (wrong, changed.into())
        }));
    }
    all
}

/// The line of a misspelt key, counted from 1, and what an error says about it.
fn named(text: &str, wrong: &str) -> (usize, String) {
    let line = 1 + text.lines().position(|line| line.contains(wrong)).unwrap();
    (line, format!("did you mean `{}`?", wrong.strip_suffix('h').unwrap()))
}

#[test]
fn every_key_of_a_study_is_known_and_no_other() {
    let whole = "name = 'x'\nquestion = 'y'\nimages = ['paper']\nbudgets = [10]\nseeds = [0]\nmatch = ['time']\n\
        baseline = 'a'\npreset = 'paper'\niterations = 50\n\
        [settings]\nrounds = { every = 5, from = 5, until = 25 }\nadam.mean.learning-rate = 0.5\n\
        [[arm]]\nname = 'a'\nabout = 'z'\npreset = 'paper'\niterations = 60\npolicy = 'percentile'\n\
        settings.policy.actions.densify.shrink = 2.0\n[[arm]]\nname = 'b'\nsettings.loss = { l1-dssim = { lambda = 0.2 } }\n";
    let plan = |text: &str| Plan::new(Study::from_toml(text, "x.toml")?, &Places::default(), "test");
    plan(whole).unwrap();
    let all = misspelt(&whole.parse().unwrap());
    assert_eq!(all.len(), 33);
    for (wrong, table) in all {
        let text = toml::to_string(&table).unwrap();
        let (place, nearest) = named(&text, &wrong);
        let error = plan(&text).map(|plan| plan.runs.len()).unwrap_err();
        let message = error.to_string();
        assert!(message.contains(&format!("`{wrong}`")) && message.contains(&nearest), "{wrong}: {message}\n{text}");
        match error {
            Error::Form { line, .. } => assert_eq!(line, place, "{message}\n{text}"),
            // Settings are checked for each arm. The error names the table of a key that is in one.
            Error::Arm { .. } => {
                let is_nested = !["roundsh", "adamh", "policyh", "lossh"].contains(&wrong.as_str());
                assert!(message.contains("`: settings: unknown "), "{message}");
                assert_eq!(message.contains(" in ["), is_nested, "{message}");
            }
            _ => panic!("{message}"),
        }
    }
}

#[test]
fn every_key_of_a_camera_path_is_known_and_no_other() {
    let whole = "width = 8\nheight = 6\nfov = 60.0\nup = [0.0, -1.0, 0.0]\nframes = 9\nends = 'closed'\n\
        [[keys]]\nposition = [0.0, 0.0, -4.0]\ntarget = [0.0, 0.0, 0.0]\n";
    let text = |table: &Table| serde_json::to_string_pretty(table).unwrap();
    let read = |text: &str| parse_json::<CameraPath>(text, "path.json".as_ref());
    let whole: Table = whole.parse().unwrap();
    read(&text(&whole)).unwrap();
    let all = misspelt(&whole);
    assert_eq!(all.len(), 9);
    for (wrong, table) in all {
        let text = text(&table);
        let (line, nearest) = named(&text, &wrong);
        let message = read(&text).unwrap_err().to_string();
        assert_eq!(message, format!("path.json:{line}: unknown key `{wrong}`: {nearest}"));
    }
}
