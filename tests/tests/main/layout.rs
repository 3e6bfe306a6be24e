//! Files that import each other in a circle can only be understood together, so circles have few files.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

/// Most files in a circle.
const MOST: usize = 4;

/// Texts of files by their paths, such as `crate::a`; or what is imported, by the paths that it has where it is.
type Map = BTreeMap<String, String>;

#[test]
fn few_files_import_each_other_in_a_circle() {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let manifest = fs::read_to_string(workspace.join("Cargo.toml")).unwrap();
    let members = manifest.lines().find_map(|line| line.strip_prefix("members = ")).unwrap();
    let members: Vec<&str> = members.split('"').skip(1).step_by(2).collect();
    assert!(members.contains(&"gs-train"), "{members:?}");
    for member in members {
        let mut texts = Map::new();
        read(&workspace.join(member).join("src"), "crate", &mut texts);
        assert!(!texts.is_empty(), "{member} has no files");
        let larger = circles(&texts);
        assert!(larger.is_empty(), "{member} has circles of more than {MOST} files: {larger:#?}");
    }
}

#[test]
fn a_circle_of_five_files_is_found() {
    let files = [
        ("crate", "mod a;\npub use self::d::{D, e::E};"),
        ("crate::a", "use crate::{\n    b::{B as Bs, d},\n    e,\n};"),
        ("crate::b", "// use crate::f::F;\nfn b() {\n    crate::c::C::new();\n}"),
        ("crate::c", "use crate::D;\n\n#[cfg(test)]\nmod tests {\n    use crate::f::F;\n}"),
        ("crate::d", "mod e;\n\npub(crate) fn d() -> e::E {}"),
        ("crate::d::e", "use std::f;\nuse super::super::a as first;\n\ntype F = first::A;"),
        ("crate::f", "use crate::{E, a::A};"),
    ];
    let texts = files.map(|(place, text)| (place.to_owned(), text.to_owned())).into();
    assert_eq!(circles(&texts), [["crate::a", "crate::b", "crate::c", "crate::d", "crate::d::e"].into()].into());
}

/// Reads the files of a folder, except for those of tests.
fn read(folder: &Path, place: &str, texts: &mut Map) {
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        let name = path.file_stem().unwrap().to_str().unwrap();
        let inner = if ["lib", "main", "mod"].contains(&name) { place.to_owned() } else { format!("{place}::{name}") };
        if path.is_dir() && name != "tests" {
            read(&path, &inner, texts);
        } else if path.extension().is_some_and(|extension| extension == "rs") && name != "tests" {
            texts.insert(inner, fs::read_to_string(&path).unwrap());
        }
    }
}

/// The files of each circle of more than `MOST`.
fn circles(texts: &Map) -> BTreeSet<BTreeSet<&str>> {
    let mut imports = Map::new();
    let uses: Vec<_> = texts.iter().map(|(place, text)| (&**place, parse(place, text, &mut imports))).collect();
    let used = |uses: &[String]| uses.iter().filter_map(|path| declared_in(path, texts, &imports, 0)).collect();
    let mut reached: BTreeMap<_, BTreeSet<_>> = uses.iter().map(|(place, uses)| (*place, used(uses))).collect();
    // Each time twice as far.
    for _ in 0..texts.len().ilog2() + 1 {
        for (place, to) in reached.clone() {
            reached.insert(place, to.iter().flat_map(|to| &reached[to]).chain(&to).copied().collect());
        }
    }
    let circle = |place: &&str| reached[place].iter().copied().filter(|to| reached[to].contains(place)).collect();
    reached.keys().map(circle).filter(|circle: &BTreeSet<&str>| circle.len() > MOST).collect()
}

/// The file that declares what a path names; `None` for a file itself.
fn declared_in<'a>(path: &str, texts: &'a Map, imports: &Map, depth: u32) -> Option<&'a str> {
    let ends = path.rmatch_indices("::").map(|(end, _)| end);
    let (place, _) = [path.len()].into_iter().chain(ends).find_map(|end| texts.get_key_value(&path[..end]))?;
    let name = path[place.len()..].split("::").nth(1)?;
    let rest = &path[place.len() + 2 + name.len()..];
    match imports.get(&format!("{place}::{name}")).filter(|_| depth < 9) {
        Some(import) => declared_in(&(import.to_owned() + rest), texts, imports, depth + 1),
        None => Some(place),
    }
}

/// What a file uses rather than hands on. Adds what it imports.
fn parse(place: &str, text: &str, imports: &mut Map) -> Vec<String> {
    let lines = text.lines().take_while(|line| *line != "mod tests {").flat_map(|line| line.split("//").take(1));
    let mut uses = Vec::new();
    for statement in lines.collect::<Vec<_>>().join("\n").split(';') {
        let (before, tree) = statement.rsplit_once("use ").unwrap_or((statement, ""));
        let (mut starts, hands_on) = (Vec::<&str>::new(), before.ends_with("pub ") || before.ends_with(") "));
        for part in tree.split_inclusive(['{', ',', '}']) {
            let path = (starts.concat() + part.trim_end_matches(['{', ',', '}']).trim()).replace("::self", "");
            let (path, name) = path.split_once(" as ").unwrap_or((&path, path.rsplit("::").next().unwrap()));
            if let Some(start) = part.strip_suffix('{') {
                starts.push(start.trim());
            } else if !name.is_empty() {
                imports.insert(format!("{place}::{name}"), from_root(place, path));
                uses.extend((!hands_on).then(|| from_root(place, path)));
            }
            starts.truncate(starts.len().saturating_sub(usize::from(part.ends_with('}'))));
        }
        let words = before.split(|c: char| !c.is_alphanumeric() && !"_:".contains(c));
        uses.extend(words.filter(|word| word.contains("::")).map(|word| from_root(place, word.trim_matches(':'))));
    }
    uses
}

/// A path from the root of the crate; one that leads out of the crate, as if it were in the file.
fn from_root(place: &str, path: &str) -> String {
    let path = if path.starts_with("crate::") { path.to_owned() } else { format!("{place}::{path}") };
    let mut path = path.replace("::self::", "::");
    while let Some((before, after)) = path.split_once("::super::") {
        path = format!("{}::{after}", before.rsplit_once("::").map_or("", |(before, _)| before));
    }
    path
}
