//! What the source looks like, as far as no tool checks it: the length of lines and functions, and one variable in each
//! `let`.

use std::fs;
use std::path::{Path, PathBuf};

use crate::imports::{product, tokens};
use crate::names::{crates, sources};

/// Longest line of the product [characters]; rows of tables in comments may be longer.
const LONGEST_LINE: usize = 120;

/// Most lines of a function of the product.
const MOST_LINES: usize = 60;

/// Most functions with more.
const MOST_LONG: usize = 6;

/// Most statements of the workspace that take a tuple apart that they make, as `let (a, b) = (x, y);` does.
const MOST_TUPLES: usize = 5;

/// The sources of the workspace below these folders of its crates, with their texts.
fn files(folders: &[&str]) -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let own = [String::new()].into_iter().chain(crates(root));
    let below = |folder: String| folders.iter().map(move |below| root.join(&folder).join(below));
    let paths = own.flat_map(below).filter(|folder| folder.is_dir()).flat_map(|folder| sources(&folder));
    let mut files: Vec<(PathBuf, String)> =
        paths.map(|path| (path.clone(), fs::read_to_string(&path).unwrap())).collect();
    files.sort();
    files.dedup();
    assert!(files.len() > 300, "{} files", files.len());
    files
}

/// The sources of the product, without their tests.
fn product_files() -> Vec<(PathBuf, String)> {
    let is_test = |path: &Path| path.iter().any(|part| part == "tests" || part == "tests.rs");
    let files = files(&["src"]).into_iter().filter(|(path, _)| !is_test(path));
    files.map(|(path, text)| (path, product(&text).to_owned())).collect()
}

/// The name and the lines of each function with a body.
fn functions(text: &str) -> Vec<(&str, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    let function = |begin: usize| {
        let line = lines[begin];
        let indent = &line[..line.len() - line.trim_start().len()];
        let mut words = line.split([' ', '(', '<']).filter(|word| !word.is_empty());
        let qualifiers = ["pub", "crate)", "super)", "const", "async", "unsafe", "extern", "\"C\""];
        let name = match words.find(|word| !qualifiers.contains(word)) {
            Some("fn") => words.next()?,
            _ => return None,
        };
        let head = lines[begin..].iter().position(|line| line.ends_with(['{', ';', '}']))?;
        if !lines[begin + head].ends_with('{') {
            return None;
        }
        let is_end = |line: &&str| line.strip_prefix(indent) == Some("}");
        Some((name, lines[begin..].iter().position(is_end)? + 1))
    };
    (0..lines.len()).filter_map(function).collect()
}

/// How many statements take a tuple apart that they make.
fn tuple_lets(text: &str) -> usize {
    let tokens = tokens(text);
    // The end of the parentheses that begin at a token, and whether they hold a tuple.
    let parentheses = |begin: usize| {
        let mut depth = 0;
        let mut is_tuple = false;
        for (at, token) in tokens.iter().enumerate().skip(begin) {
            match *token {
                "(" | "[" | "{" => depth += 1,
                ")" | "]" | "}" => depth -= 1,
                "," if depth == 1 => is_tuple = true,
                _ => {}
            }
            if depth == 0 {
                return Some((at, is_tuple));
            }
        }
        None
    };
    let takes_apart = |begin: &usize| {
        let is_let = tokens[*begin] == "let" && tokens.get(begin + 1) == Some(&"(");
        let (end, is_tuple) = is_let.then(|| parentheses(begin + 1)).flatten()?;
        let equals = tokens[end..].iter().position(|token| *token == "=" || *token == ";")? + end;
        let is_made = tokens[equals] == "=" && tokens.get(equals + 1) == Some(&"(");
        let (end, makes_tuple) = is_made.then(|| parentheses(equals + 1)).flatten()?;
        (is_tuple && makes_tuple && tokens.get(end + 1) == Some(&";")).then_some(())
    };
    (0..tokens.len()).filter(|begin| takes_apart(begin).is_some()).count()
}

#[test]
fn lines_of_the_product_are_short() {
    let is_table = |line: &str| ["//! |", "/// |"].iter().any(|begin| line.trim_start().starts_with(begin));
    let is_long = |line: &str| line.chars().count() > LONGEST_LINE && !is_table(line);
    for (path, text) in product_files() {
        let long: Vec<&str> = text.lines().filter(|line| is_long(line)).collect();
        assert!(long.is_empty(), "{}: longer than {LONGEST_LINE} characters: {long:#?}", path.display());
    }
}

#[test]
fn functions_of_the_product_fit_on_a_screen() {
    let files = product_files();
    let all: Vec<(&PathBuf, &str, usize)> = files
        .iter()
        .flat_map(|(path, text)| functions(text).into_iter().map(move |(name, lines)| (path, name, lines)))
        .collect();
    assert!(all.len() > 2_000, "{} functions", all.len());
    let long: Vec<_> = all.iter().filter(|(_, _, lines)| *lines > MOST_LINES).collect();
    assert!(long.len() <= MOST_LONG, "more than {MOST_LONG} functions of over {MOST_LINES} lines: {long:#?}");
    let text = "pub(crate) const fn short() -> u8 {\n    7\n}\n\ntrait Kind {\n    fn named(&self);\n    fn one(&self) {}\n\n    \
                fn of(\n        first: u8,\n    ) -> u8 {\n        first\n    }\n}\n";
    assert_eq!(functions(text), [("short", 3), ("of", 5)]);
}

#[test]
fn a_let_names_one_variable() {
    let found: Vec<(PathBuf, usize)> = files(&["src", "tests", "examples", "benches"])
        .into_iter()
        .map(|(path, text)| (path, tuple_lets(&text)))
        .filter(|(_, count)| *count > 0)
        .collect();
    let count: usize = found.iter().map(|(_, count)| count).sum();
    assert!(count <= MOST_TUPLES, "more than {MOST_TUPLES} tuples that are made and taken apart: {found:#?}");
    for (text, count) in [
        ("let (a, b) = (x, f(y, 2)); let (mut c, _): (u8, u8) = (1, 2);", 2),
        ("let (sin, cos) = (turn + TAU).sin_cos(); let (a, b) = pair; let a = (x, y); let [a, b] = [x, y];", 0),
        ("let (Some(a), Some(b)) = (x, y) else { return }; if let (1, 2) = (x, y) { f(); }", 0),
        ("// let (a, b) = (x, y);\nlet text = \"let (a, b) = (x, y);\";", 0),
    ] {
        assert_eq!(tuple_lets(text), count, "{text}");
    }
}
