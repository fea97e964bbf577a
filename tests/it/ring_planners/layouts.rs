//! The layouts of the messages in `docs/src/interfaces.md`, written from the header for C++.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;

use super::ROOT;

/// What stands before and after the layouts on the page.
const MARKS: [&str; 2] = [
    "<!-- layouts: written by cargo test --workspace --test it write_the_layouts -- --ignored -->\n",
    "<!-- end of the layouts -->\n",
];

/// The page with the layouts of this header.
fn page(header: &str) -> String {
    let page = fs::read_to_string(path()).expect("the page can be read");
    let [begin, end] = MARKS.map(|mark| page.find(mark).expect("the page has both marks"));
    format!("{}{}{}", &page[..begin + MARKS[0].len()], layouts(header), &page[end..])
}

fn path() -> String {
    format!("{ROOT}/docs/src/interfaces.md")
}

/// Writes the layouts of this header to the page.
pub fn refresh(header: &str) {
    fs::write(path(), page(header)).expect("the page can be written");
}

/// Fails if the layouts of the page are not those of this header.
pub fn are_those_of(header: &str) {
    let remedy = "`cargo test --workspace --test it write_the_layouts -- --ignored` writes them anew";
    assert!(fs::read_to_string(path()).unwrap() == page(header), "{} has other layouts: {remedy}", path());
}

/// The constants of the header in Markdown, then its types, each with a table of its fields or values.
fn layouts(header: &str) -> String {
    let mut constants = String::new();
    let mut text = String::new();
    let mut known = Sizes::default();
    let mut about = String::new();
    let mut lines = header.lines();
    while let Some(line) = lines.next() {
        if let Some(comment) = comment(line) {
            add(&mut about, comment);
            continue;
        }
        if let Some(constant) = line.strip_prefix("constexpr static const ") {
            let (name, value) = known.add_constant(constant);
            let _ = writeln!(constants, "| `{name}` | {value} | {about} |");
        } else if let Some(name) = line.strip_prefix("enum class ") {
            let name = name.split(' ').next().expect("a name");
            let about = wrapped(&format!("**{name}**: {about}"));
            let _ = write!(text, "\n{about}\n\n| value | | |\n|---|---|---|\n{}", values(&mut lines));
        } else if let Some(name) = line.strip_prefix("struct ") {
            let name = name.split(' ').next().expect("a name");
            let (rows, size) = fields(&mut lines, &known);
            let about = wrapped(&format!("**{name}** ({size}): {about}"));
            let _ = write!(text, "\n{about}\n\n| offset | field | |\n|---|---|---|\n{rows}");
            known.types.insert(name.to_owned(), (name.to_owned(), size));
        }
        about.clear();
    }
    format!("\n| constant | value | |\n|---|---|---|\n{constants}{text}\n")
}

/// The paragraph in lines of at most 120 characters.
fn wrapped(paragraph: &str) -> String {
    let mut text = String::new();
    let mut length = 0;
    for word in paragraph.split(' ') {
        let count = word.chars().count();
        let is_first = text.is_empty();
        if !is_first && length + 1 + count > 120 {
            text.push('\n');
            length = 0;
        } else if !is_first {
            text.push(' ');
            length += 1;
        }
        text.push_str(word);
        length += count;
    }
    text
}

/// The rows of an enum with its body in `lines`.
fn values<'a>(lines: &mut impl Iterator<Item = &'a str>) -> String {
    let mut rows = String::new();
    let mut about = String::new();
    let mut value = 0;
    for line in lines.take_while(|line| *line != "};") {
        match comment(line) {
            Some(comment) => add(&mut about, comment),
            None => {
                let name = line.trim().trim_end_matches(',');
                let _ = writeln!(rows, "| {value} | `{name}` | {about} |");
                value += 1;
                about.clear();
            }
        }
    }
    rows
}

/// The rows of a struct with its body in `lines`, and its length [byte].
fn fields<'a>(lines: &mut impl Iterator<Item = &'a str>, known: &Sizes) -> (String, usize) {
    let mut rows = String::new();
    let mut about = String::new();
    let mut offset = 0;
    for line in lines.take_while(|line| *line != "};") {
        let line = line.trim();
        match comment(line) {
            _ if line.starts_with("static ") => {}
            Some(comment) => add(&mut about, comment),
            None => {
                let (kind, name) = line.trim_end_matches(';').split_once(' ').expect("a type and a name");
                let (name, kind, size) = known.field(kind, name);
                let _ = writeln!(rows, "| {offset} | `{name}: {kind}` | {about} |");
                offset += size;
                about.clear();
            }
        }
    }
    (rows, offset)
}

/// The text of a comment, without the links of rustdoc.
fn comment(line: &str) -> Option<String> {
    let text = line.trim().strip_prefix("///")?.trim();
    Some(text.replace("[`", "`").replace("`]", "`").replace('|', "\\|"))
}

fn add(about: &mut String, comment: String) {
    let gap = if about.is_empty() { "" } else { " " };
    *about += &format!("{gap}{comment}");
}

/// The types that were met, with their names in Rust and their lengths, and the constants.
struct Sizes {
    types: BTreeMap<String, (String, usize)>,
    constants: BTreeMap<String, String>,
}

impl Default for Sizes {
    fn default() -> Self {
        let whole = [("uint8_t", "u8", 1), ("uint32_t", "u32", 4), ("int32_t", "i32", 4), ("uint64_t", "u64", 8)];
        let plain = [&whole[..], &[("float", "f32", 4), ("double", "f64", 8)]].concat();
        let types = plain.into_iter().map(|(cpp, rust, size)| (cpp.to_owned(), (rust.to_owned(), size)));
        Self { types: types.collect(), constants: BTreeMap::new() }
    }
}

impl Sizes {
    /// Adds the constant of the line `TYPE NAME = VALUE;`, and returns name and value.
    fn add_constant(&mut self, line: &str) -> (String, String) {
        let (name, value) = line.trim_end_matches(';').split_once(" = ").expect("a name and a value");
        let name = name.rsplit(' ').next().expect("a type and a name");
        let value = if value == "UINT32_MAX" { "0xFFFFFFFF" } else { value };
        let value = self.constants.get(value).map_or(value, String::as_str).to_owned();
        self.constants.insert(name.to_owned(), value.clone());
        (name.to_owned(), value)
    }

    /// The name of the field `declarator` in C++, such as `ids[64]`, its type in Rust, and its length.
    fn field(&self, kind: &str, declarator: &str) -> (String, String, usize) {
        let mut parts = declarator.split('[').map(|part| part.trim_end_matches(']'));
        let name = parts.next().expect("a name").to_owned();
        let (mut kind, mut size) = self.types.get(kind).unwrap_or_else(|| panic!("{kind}: an unknown type")).clone();
        for length in parts.rev() {
            let length = self.constants.get(length).map_or(length, String::as_str);
            kind = format!("[{kind}; {length}]");
            size *= length.parse::<usize>().expect("a length");
        }
        (name, kind, size)
    }
}
