//! Makes the docstrings of the compiled module: those of its stub, `_native.pyi`, so that editors and
//! `help()` show the same text and it is written once. The macro `doc!("Class.member")` gives each.
//! Also makes the module call the functions of gs-libm that it contains.

use std::{env, error::Error, fmt::Write as _, fs, path::Path};

const STUB: &str = "python/gaussian_splats/_native.pyi";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed={STUB}");
    match env::var("CARGO_CFG_TARGET_OS")?.as_str() {
        // Without this, a library loaded before the module, as the C library is, has precedence.
        "linux" => println!("cargo::rustc-link-arg-cdylib=-Wl,-Bsymbolic"),
        // The functions of Python are those of the process that loads the module.
        "macos" => println!("cargo::rustc-link-arg-cdylib=-Wl,-undefined,dynamic_lookup"),
        _ => (),
    }
    let mut rules = String::new();
    for (name, text) in docstrings(&fs::read_to_string(STUB)?) {
        writeln!(rules, "({name:?}) => {{ {text:?} }};")?;
    }
    let path = Path::new(&env::var("OUT_DIR")?).join("docstrings.rs");
    Ok(fs::write(path, format!("macro_rules! doc {{\n{rules}}}\n"))?)
}

/// The docstrings of classes, methods, properties and functions by their names.
fn docstrings(stub: &str) -> Vec<(String, String)> {
    let (mut class, mut name, mut found) = ("", String::new(), Vec::new());
    let mut lines = stub.lines();
    while let Some(line) = lines.next() {
        let (code, is_indented) = (line.trim_start(), line.starts_with(' '));
        if let Some(head) = code.strip_prefix("class ") {
            class = identifier(head);
            name = class.to_owned();
        } else if let Some(head) = code.strip_prefix("def ") {
            name = if is_indented { format!("{class}.{}", identifier(head)) } else { identifier(head).to_owned() };
        } else if let Some(first) = code.strip_prefix("\"\"\"") {
            let indent = line.len() - code.len();
            let mut text = first.trim_start().to_owned();
            while !text.ends_with("\"\"\"") {
                let next = lines.next().expect("a docstring ends");
                text += "\n";
                text += next.get(indent..).unwrap_or_default();
            }
            found.push((name.clone(), text.trim_end_matches('"').trim_end().to_owned()));
        }
    }
    found
}

/// The identifier that a text begins with.
fn identifier(text: &str) -> &str {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default()
}
