//! Puts ECMAScript modules into one script, in the order of their imports.
//!
//! It knows the forms that the page and wasm-bindgen use: an import of names on a line of its own,
//! `export` before a declaration, and one list of exports. Everything else that starts with
//! `import` or `export` is an error. The result is a classic script: a page that is opened from disk
//! cannot start a worker from a module.

use std::{collections::BTreeSet, fs, path::Path};

use crate::Result;

/// The script of a module in a folder and of all that it imports.
pub(crate) fn bundled(folder: &Path, entry: &str) -> Result<String> {
    let mut script = String::from("const modules = {};\n");
    let mut done = BTreeSet::new();
    add(folder, entry, &mut done, &mut script)?;
    Ok(script)
}

fn add(folder: &Path, name: &str, done: &mut BTreeSet<String>, script: &mut String) -> Result {
    if !done.insert(name.to_owned()) {
        return Ok(());
    }
    // In a page of one file, its parts are elsewhere.
    let file = if name == "parts.js" { "parts-inside.js" } else { name };
    let text = fs::read_to_string(folder.join(file))?.replace("import.meta.url", "location.href");
    let unknown = |line: &str| format!("{file}: this form is not bundled: {line}");
    let (mut body, mut exports) = (String::new(), Vec::new());
    for line in text.lines() {
        if let Some(import) = line.strip_prefix("import ").filter(|_| line.ends_with(';')) {
            let (names, from) = import.split_once(" from ").ok_or_else(|| unknown(line))?;
            let from = from.trim_end_matches(';').trim_matches(['"', '\'']).trim_start_matches("./");
            add(folder, from, done, script)?;
            body += &format!("const {} = modules[\"{from}\"];\n", imported(names));
        } else if let Some(list) = line.strip_prefix("export {") {
            let list = list.trim_end().strip_suffix("};").ok_or_else(|| unknown(line))?;
            exports.extend(list.split(',').map(|item| match item.trim().split_once(" as ") {
                Some((inside, outside)) => format!("{outside}: {inside}"),
                None => item.trim().to_owned(),
            }));
        } else if let Some(declaration) = line.strip_prefix("export ") {
            exports.push(declared(declaration).ok_or_else(|| unknown(line))?.to_owned());
            body += declaration;
            body.push('\n');
        } else if line.starts_with("import") && !line.starts_with("import.") {
            return Err(unknown(line).into());
        } else {
            body += line;
            body.push('\n');
        }
    }
    exports.retain(|name| !name.is_empty());
    *script += &format!("modules[\"{name}\"] = (() => {{\n{body}return {{ {} }};\n}})();\n", exports.join(", "));
    Ok(())
}

/// A pattern for the names of an import: `init, { A, B as C }`.
fn imported(names: &str) -> String {
    let names = names.replace(" as ", ": ");
    match names.split_once('{') {
        Some((default, rest)) => match default.trim().trim_end_matches(',') {
            "" => format!("{{{rest}"),
            default => format!("{{ default: {default}, {rest}"),
        },
        None => format!("{{ default: {} }}", names.trim()),
    }
}

/// The name that a declaration declares.
fn declared(declaration: &str) -> Option<&str> {
    let rest = ["class ", "function ", "async function ", "const ", "let "]
        .iter()
        .find_map(|kind| declaration.strip_prefix(kind))?;
    rest.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == '$')).next().filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_are_put_in_the_order_of_their_imports() {
        let folder = env!("CARGO_MANIFEST_DIR").to_owned() + "/tests/modules";
        let script = bundled(folder.as_ref(), "a.js").unwrap();
        let expected = fs::read_to_string(folder + "/expected.txt").unwrap();
        assert_eq!(script, expected);
    }

    #[test]
    fn names_of_imports_become_patterns() {
        assert_eq!(imported("{ A, B as C }"), "{ A, B: C }");
        assert_eq!(imported("init, { A }"), "{ default: init,  A }");
        assert_eq!(imported("init"), "{ default: init }");
    }
}
