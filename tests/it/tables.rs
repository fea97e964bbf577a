//! The tables of the book that restate code: registries, topics, types, and entities of recordings.
//!
//! A table stands between `<!-- table: WHAT -->` and `<!-- end -->`; WHAT is one of [`TABLES`], or type names, of which
//! the others are types of fields of the first. `tests/it/ring_planners/layouts.rs` writes the layouts of messages.

mod registries;

use std::fs;
use std::path::{Path, PathBuf};

use crate::names::{crates, sources};

/// How to write the tables anew.
const COMMAND: &str = "cargo test --workspace --test it write_the_tables_of_the_book -- --ignored";

/// Writes a table.
type Writer = fn() -> String;

/// The tables that are not of types.
const TABLES: [(&str, Writer); 13] = [
    ("topics", topics),
    ("entities", entities),
    ("strategies", registries::strategies),
    ("sources of strategies", registries::sources_of_strategies),
    ("metrics", registries::metrics),
    ("figures", registries::figures),
    ("warnings", registries::warnings),
    ("formats", registries::formats),
    ("imported columns", registries::imported_columns),
    ("sensor columns", registries::sensor_columns),
    ("commands", registries::commands),
    ("scenarios", registries::scenarios),
    ("library", registries::library),
];

/// Around the name of a table, and after the table.
const MARKS: [&str; 3] = ["<!-- table: ", " -->\n", "<!-- end -->"];

/// What paths of entities begin with.
const ROOTS: [&str; 9] = ["belief/", "cameras/", "geo/", "log/", "los/", "maps/", "metrics/", "state/", "world/"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The pages with tables, and their texts.
fn pages() -> Vec<(PathBuf, String)> {
    let pages = fs::read_dir(root().join("docs/src")).unwrap().map(|entry| entry.unwrap().path());
    let pages = pages.filter(|page| page.extension().is_some_and(|end| end == "md"));
    let texts = pages.map(|page| (fs::read_to_string(&page).unwrap(), page)).map(|(text, page)| (page, text));
    texts.filter(|(_, text)| text.contains(MARKS[0])).collect()
}

/// The text of a page as it should be.
fn written(text: &str) -> String {
    let mut parts = text.split(MARKS[0]);
    let mut written = parts.next().unwrap().to_owned();
    for part in parts {
        let (what, rest) = part.split_once(MARKS[1]).expect("the end of the mark");
        let (_, after) = rest.split_once(MARKS[2]).expect("the end of the table");
        let table = TABLES.iter().find(|(name, _)| *name == what).map(|(_, table)| table());
        let table = table.unwrap_or_else(|| fields(&what.split(' ').collect::<Vec<_>>()));
        written += &[MARKS[0], what, MARKS[1], "\n", &table, "\n", MARKS[2], after].concat();
    }
    written
}

#[test]
fn the_tables_of_the_book_match_the_code() {
    let pages = pages();
    for (name, _) in TABLES {
        let mark = format!("{}{name}{}", MARKS[0], MARKS[1]);
        assert!(pages.iter().any(|(_, text)| text.contains(&mark)), "{name}: expected it on a page");
    }
    for (page, text) in pages {
        assert!(text == written(&text), "{} is stale: `{COMMAND}` writes it anew", page.display());
    }
}

#[test]
#[ignore = "writes the pages anew"]
fn write_the_tables_of_the_book() {
    for (page, text) in pages() {
        fs::write(page, written(&text)).unwrap();
    }
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
            let words = plain(&std::mem::take(&mut words)).replace('|', "\\|");
            items.push(Documented { line: line.to_owned(), words, attributes: std::mem::take(&mut attributes) });
        }
    }
    items
}

/// The text of a comment without links to items, ``[`name`]`` and ``[`name`](path)``.
fn plain(text: &str) -> String {
    let mut parts = text.split("[`");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |plain, part| match part.split_once("`]") {
        Some((name, rest)) => {
            let rest = rest.strip_prefix('(').and_then(|path| Some(path.split_once(')')?.1)).unwrap_or(rest);
            format!("{plain}`{name}`{rest}")
        }
        None => plain + "[`" + part,
    })
}

/// The text from the line that begins with `begin`, without it, to the line `end`.
fn block<'a>(text: &'a str, begin: &str, end: &str) -> Option<&'a str> {
    let at = text.find(begin)?;
    let (_, body) = text[at..].split_once('\n')?;
    Some(&body[..body.find(end)?])
}

/// The keys of a table of figures `name`, as fields; `None` if `text` does not declare it.
fn keys_of(text: &str, name: &str) -> Option<Vec<Documented>> {
    let body = block(text, &format!("struct {name} of "), "\n}\n")?;
    let key = |item: Documented| {
        let (key, _) = item.line.split_once(" = ")?;
        let (name, kind) = key.split_once(": ")?;
        let name = name.split_once(" (").map_or(name, |(name, _)| name);
        Some(Documented { line: format!("{name}: {kind}"), ..item })
    };
    Some(documented(body).into_iter().filter(|item| !item.words.is_empty()).filter_map(key).collect())
}

/// The fields or values of the type `name`, which is one of a kind.
fn body_of(name: &str) -> Vec<Documented> {
    let members = crates(root()).into_iter().map(|folder| root().join(folder));
    let folders = members.chain([root().to_owned()]).map(|folder| folder.join("src"));
    let texts = folders.flat_map(|folder| sources(&folder)).map(|path| fs::read_to_string(path).unwrap());
    let declarations = [format!("struct {name} {{"), format!("enum {name} {{")];
    let mut bodies = texts.filter_map(|text| {
        let declared = declarations.iter().find_map(|line| Some(documented(block(&text, line, "\n}\n")?)));
        declared.or_else(|| keys_of(&text, name))
    });
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
    for Documented { line, words, attributes } in body_of(name).into_iter().filter(|item| !item.words.is_empty()) {
        let line = line.trim_start_matches("pub(crate) ").trim_start_matches("pub ").trim_end_matches([',', ' ', '{']);
        let is_absent = attributes.contains("skip_serializing_if");
        let words = words.replace("`None`", if is_absent { "absent" } else { "null" });
        let words = if is_absent { words.replace("no value", "absent") } else { words };
        let Some((key, kind)) = line.split_once(": ") else {
            rows += &format!("| `{}` | {words} |\n", kebab_case(line));
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
