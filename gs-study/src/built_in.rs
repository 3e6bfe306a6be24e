//! The studies that come with the program.

use crate::{error::Error, study::Study};

/// Their names, and their files.
pub const BUILT_IN: [(&str, &str); 3] = [
    ("paper", include_str!("../studies/paper.toml")),
    ("absolute-vs-percentile", include_str!("../studies/absolute-vs-percentile.toml")),
    ("all-policies", include_str!("../studies/all-policies.toml")),
];

/// The study of that name.
///
/// # Errors
/// [`Error::Unknown`], listing the names.
pub fn built_in(name: &str) -> Result<Study, Error> {
    let known = || BUILT_IN.map(|(known, _)| known).join(", ");
    match BUILT_IN.iter().find(|(known, _)| *known == name) {
        Some((name, text)) => Study::from_toml(text, name),
        None => Err(Error::Unknown { name: name.to_owned(), known: known() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{plan::Plan, target::Places};

    #[test]
    fn every_one_is_possible_and_called_as_its_file() {
        for (name, _) in BUILT_IN {
            let study = built_in(name).unwrap();
            assert_eq!(study.name, name);
            assert!(study.seeds.len() >= 5 && !study.question.is_empty());
            // On images that are here, whatever the study asks for.
            let study = Study { images: vec!["paper".to_owned()], ..study };
            let plan = Plan::new(study, &Places::default(), "test").unwrap();
            assert!(plan.runs.len() >= 10);
        }
        let message = built_in("all-policy").unwrap_err().to_string();
        assert!(message.contains("all-policy: is neither a file") && message.contains("all-policies"), "{message}");
    }
}
