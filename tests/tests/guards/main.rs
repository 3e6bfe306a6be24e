//! The guards of the arithmetic ([`Guard`]): `docs/guards.md` says of each what it costs and what needs it. Where guards can be switched off, as
//! in the build of `cargo xtask guards`, what needs a guard must fail without it.

mod checks;
mod noticed;

use std::{collections::HashSet, path::Path};

use gs_core::guards::Guard;

use self::{checks::Check, noticed::NOTICED};

/// The rows of the table of guards: the name, and the whole row.
fn rows(table: &str) -> Vec<(&str, &str)> {
    let row = |line| {
        let (name, _) = str::strip_prefix(line, "| `")?.split_once("` |")?;
        Some((name, line))
    };
    table.lines().filter_map(row).collect()
}

#[test]
fn the_table_has_a_row_for_each_guard_with_what_notices_it() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/guards.md");
    let table = std::fs::read_to_string(&path).unwrap();
    let rows = rows(&table);
    let named: Vec<&str> = rows.iter().map(|(name, _)| *name).collect();
    let guards: Vec<&str> = Guard::ALL.iter().map(|guard| guard.name()).collect();
    assert_eq!(named, guards, "{}", path.display());
    for noticed in NOTICED {
        let (name, by) = (noticed.guard.name(), format!("`{}`", noticed.by.name()));
        let (_, row) = rows.iter().find(|(row, _)| *row == name).unwrap();
        assert!(row.contains(&by), "{}, {name}: {by} is missing", path.display());
    }
    let noticed: HashSet<Guard> = NOTICED.iter().map(|noticed| noticed.guard).collect();
    let unnoticed: Vec<_> = Guard::ALL.iter().filter(|guard| !noticed.contains(guard)).collect();
    assert!(unnoticed.is_empty(), "nothing notices {unnoticed:?}");
}

#[test]
fn checks_pass_with_all_guards() {
    for check in Check::ALL {
        check.run(&noticed::cpu()).unwrap_or_else(|failure| panic!("{check:?}: {failure}"));
    }
}

#[cfg(guards = "can-be-off")]
#[test]
fn what_needs_a_guard_fails_without_it() {
    let mut wrong = Vec::new();
    for noticed in NOTICED {
        for &on in noticed.on {
            let outcome = |off: Option<Guard>| {
                Guard::switch_off(off);
                let outcome = std::panic::catch_unwind(|| noticed.by.run(on));
                Guard::switch_off(None);
                // The sound arithmetic of the ordinary build panics nowhere; without a guard, that it does is a way to notice.
                outcome.unwrap_or_else(|_| Err("a panic".to_owned()))
            };
            let what = format!("{}, {on:?}, {}", noticed.guard.name(), noticed.by.name());
            match (outcome(None), outcome(Some(noticed.guard))) {
                (Err(failure), _) => wrong.push(format!("{what}: fails with all guards: {failure}")),
                (Ok(()), Ok(())) => wrong.push(format!("{what}: passes without the guard")),
                (Ok(()), Err(failure)) => eprintln!("{what}: {failure}"),
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}
