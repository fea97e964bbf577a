//! The tables of `docs/src/interfaces.md` that restate code: topics, files that are types, and entities of recordings.
//!
//! A table stands between `<!-- table: WHAT -->` and `<!-- end -->`; WHAT is `topics`, `entities`, or type names, of
//! which the others are types of fields of the first. `tests/ring_planners/layouts.rs` writes the layouts of messages.

use std::fs;
use std::path::{Path, PathBuf};

use crate::names::{crates, sources};

/// How to write the tables anew.
const COMMAND: &str = "cargo test --workspace --test it write_the_tables_of_the_interfaces -- --ignored";

/// Around the name of a table, and after the table.
const MARKS: [&str; 3] = ["<!-- table: ", " -->\n", "<!-- end -->"];

/// What paths of entities begin with.
const ROOTS: [&str; 9] = ["belief/", "cameras/", "geo/", "log/", "los/", "maps/", "metrics/", "state/", "world/"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn page() -> PathBuf {
    root().join("docs/src/interfaces.md")
}

/// The page as it should be.
fn written() -> String {
    let text = fs::read_to_string(page()).unwrap();
    let mut parts = text.split(MARKS[0]);
    let mut written = parts.next().unwrap().to_owned();
    for part in parts {
        let (what, rest) = part.split_once(MARKS[1]).expect("the end of the mark");
        let (_, after) = rest.split_once(MARKS[2]).expect("the end of the table");
        let table = match what {
            "topics" => topics(),
            "entities" => entities(),
            types => fields(&types.split(' ').collect::<Vec<_>>()),
        };
        written += &[MARKS[0], what, MARKS[1], "\n", &table, "\n", MARKS[2], after].concat();
    }
    written
}

#[test]
fn the_interface_tables_match_the_code() {
    assert!(written().matches(MARKS[2]).count() > 5);
    let is_current = fs::read_to_string(page()).unwrap() == written();
    assert!(is_current, "{} is stale: `{COMMAND}` writes it anew", page().display());
}

#[test]
#[ignore = "writes the page anew"]
fn write_the_tables_of_the_interfaces() {
    fs::write(page(), written()).unwrap();
}

/// An item with its comment.
struct Documented {
    /// The line that declares it.
    line: String,
    /// Its comment, for a table.
    words: String,
    /// The attributes before it.
    attributes: String,
}

/// The items of `text` that are not comments or attributes themselves.
fn documented(text: &str) -> Vec<Documented> {
    let mut items = Vec::new();
    let [mut words, mut attributes] = [String::new(), String::new()];
    for line in text.lines().map(str::trim) {
        if let Some(comment) = line.strip_prefix("///") {
            words = format!("{words} {}", comment.trim()).trim().to_owned();
        } else if line.starts_with('#') {
            attributes += line;
        } else {
            let words = std::mem::take(&mut words).replace("[`", "`").replace("`]", "`").replace('|', "\\|");
            items.push(Documented { line: line.to_owned(), words, attributes: std::mem::take(&mut attributes) });
        }
    }
    items
}

/// The text from the line that begins with `begin`, without it, to the line `end`.
fn block<'a>(text: &'a str, begin: &str, end: &str) -> Option<&'a str> {
    let at = text.find(begin)?;
    let (_, body) = text[at..].split_once('\n')?;
    Some(&body[..body.find(end)?])
}

/// The fields or values of the type `name`, which is one of a kind.
fn body_of(name: &str) -> Vec<Documented> {
    let folders = crates(root()).into_iter().map(|folder| root().join(folder).join("src"));
    let texts = folders.flat_map(|folder| sources(&folder)).map(|path| fs::read_to_string(path).unwrap());
    let declarations = [format!("struct {name} {{"), format!("enum {name} {{")];
    let mut bodies =
        texts.filter_map(|text| declarations.iter().find_map(|line| Some(documented(block(&text, line, "\n}\n")?))));
    bodies.next().unwrap_or_else(|| panic!("{name}: expected a type with fields or values"))
}

/// The name in JSON and TOML of a value of an enum.
fn kebab_case(name: &str) -> String {
    let mut text = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !text.is_empty() {
            text.push('-');
        }
        text.extend(letter.to_lowercase());
    }
    text
}

/// The table of the fields of the first type; those of the others stand below the fields of these types.
fn fields(types: &[&str]) -> String {
    format!("| key | |\n|---|---|\n{}", rows(types[0], "", types))
}

fn rows(name: &str, prefix: &str, types: &[&str]) -> String {
    let mut rows = String::new();
    for Documented { line, words, attributes } in body_of(name) {
        let line = line.trim_start_matches("pub(crate) ").trim_start_matches("pub ").trim_end_matches(',');
        let is_absent = attributes.contains("skip_serializing_if");
        let words = words.replace("`None`", if is_absent { "absent" } else { "null" });
        let Some((key, kind)) = line.split_once(": ") else {
            if !line.is_empty() {
                rows += &format!("| `{}` | {words} |\n", kebab_case(line));
            }
            continue;
        };
        let is_part = |part: &&&str| kind.split(['<', '>', '[', ']']).any(|word| word == **part);
        let part = types.iter().find(is_part);
        if attributes.contains("flatten") {
            rows += &self::rows(part.unwrap_or_else(|| panic!("{kind}: expected it in {types:?}")), prefix, types);
        } else if !attributes.contains("serde(skip)") {
            rows += &format!("| `{prefix}{key}` | {words} |\n");
            let each = if kind.starts_with("Vec") { "[]" } else { "" };
            rows += &part.map_or_else(String::new, |part| self::rows(part, &format!("{prefix}{key}{each}."), types));
        }
    }
    rows
}

/// The table of topics.
fn topics() -> String {
    let text = fs::read_to_string(root().join("ring/src/topics.rs")).unwrap();
    let entries = documented(block(&text, "topics! {", "\n}\n").expect("the table"));
    let mut table = "| service | payload | user header | writer → readers | |\n|---|---|---|---|---|\n".to_owned();
    let mut lines = entries.into_iter();
    while let Some(Documented { line, words, .. }) = lines.next() {
        let Some((name, kind)) = line.strip_suffix("> {").and_then(|line| line.split_once(": ")) else { continue };
        let (_, types) = kind.split_once('<').expect("two types");
        let (payload, header) = types.split_once(", ").expect("two types");
        let mut roles = |key: &str| roles(lines.next().and_then(|item| Some(item.line.strip_prefix(key)?.to_owned())));
        let writer = roles("writer: ");
        let readers = roles("readers: ");
        table += &format!("| `skysink/{name}` | `{payload}` | `{header}` | {writer} → {readers} | {words} |\n");
    }
    table
}

/// The executables of the roles in a value of a row.
fn roles(value: Option<String>) -> String {
    let value = value.expect("the writer, then the readers");
    let names = value.trim_matches(['&', '[', ']', ',']).split(", ").map(kebab_case);
    names.collect::<Vec<_>>().join(", ").replace("launcher", "skysink")
}

/// The table of the entities of recordings.
fn entities() -> String {
    let files = sources(&root().join("viewer/src"));
    let text: String = files.iter().map(|path| fs::read_to_string(path).unwrap()).collect();
    let mut entities = Vec::new();
    for Documented { line, words, .. } in documented(&text).into_iter().filter(|item| item.line.contains("const ")) {
        let is_entity = |text: &&str| ROOTS.iter().any(|root| text.starts_with(root)) || text.starts_with("status");
        let paths = line.split('"').skip(1).step_by(2).filter(is_entity);
        entities.extend(paths.map(|path| (path.to_owned(), words.clone())));
    }
    entities.sort();
    let rows: String = entities.iter().map(|(path, words)| format!("| `/{path}` | {words} |\n")).collect();
    format!("| entity | |\n|---|---|\n{rows}")
}
