//! The imports in the source: files and folders lie above each other, so that each can be read before those that use
//! it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::names::{crates, sources};

/// Most files of a circle of imports.
const MOST_FILES: usize = 2;

/// A module by the names from its crate's root, without `crate`.
type Module = Vec<String>;

/// The modules that each module uses.
type Uses<T> = BTreeMap<T, BTreeSet<T>>;

/// The tokens of a source: words, `::` and other signs, without comments, strings and characters.
pub(crate) fn tokens(mut text: &str) -> Vec<&str> {
    let is_word = |letter: char| letter.is_alphanumeric() || letter == '_';
    let mut tokens = Vec::new();
    while let Some(first) = text.chars().next() {
        let after = |end: &str, begin: usize| text[begin..].find(end).map_or(text.len(), |at| begin + at + end.len());
        let mut is_token = !first.is_whitespace();
        let end = if text.starts_with("//") {
            is_token = false;
            after("\n", 0)
        } else if text.starts_with("r#\"") {
            is_token = false;
            after("\"#", 3)
        } else if first == '"' || text.starts_with("'\"'") || text.starts_with("'\\") {
            is_token = false;
            let letters = text.char_indices().skip(1);
            let mut unescaped = letters.scan(false, |is_escaped, (at, letter)| {
                let was_escaped = std::mem::replace(is_escaped, letter == '\\' && !*is_escaped);
                Some((at, letter == first && !was_escaped))
            });
            unescaped.find(|(_, is_end)| *is_end).map_or(text.len(), |(at, _)| at + 1)
        } else if is_word(first) {
            text.find(|letter| !is_word(letter)).unwrap_or(text.len())
        } else if text.starts_with("::") {
            2
        } else {
            first.len_utf8()
        };
        tokens.extend(is_token.then_some(&text[..end]));
        text = &text[end..];
    }
    tokens
}

/// The part of a source before its tests.
pub(crate) fn product(text: &str) -> &str {
    let is_test_module =
        |rest: &str| rest.lines().nth(1).is_some_and(|line| line.contains("mod ") && line.ends_with('{'));
    let tests = text.match_indices("#[cfg(test)]\n").find(|(at, _)| is_test_module(&text[*at..]));
    tests.map_or(text, |(at, _)| &text[..at])
}

/// Appends the paths that begin with `path` and go on at `at`, with all branches of braces; returns where they end.
fn branches<'a>(tokens: &[&'a str], mut at: usize, mut path: Vec<&'a str>, paths: &mut Vec<Vec<&'a str>>) -> usize {
    while tokens.get(at) == Some(&"::") {
        match tokens.get(at + 1) {
            Some(&"{") => {
                at += 2;
                while at < tokens.len() && tokens[at] != "}" {
                    let begin = [&path[..], &tokens[at..=at]].concat();
                    at = branches(tokens, at + 1, begin, paths);
                    // After the branch, a new name with `as` and the comma.
                    at += tokens[at..].iter().take_while(|token| ![",", "}"].contains(token)).count();
                    at += usize::from(tokens.get(at) == Some(&","));
                }
                return at + 1;
            }
            Some(name) => path.push(name),
            None => {}
        }
        at += 2;
    }
    paths.push(path);
    at
}

/// The paths in a source that begin with `crate`, `super`, `self` or the name of a child. Re-exports do not count.
fn paths<'a>(tokens: &[&'a str], children: &BTreeSet<&str>) -> Vec<Vec<&'a str>> {
    let mut paths = Vec::new();
    let mut at = 0;
    while at + 1 < tokens.len() {
        let is_begin = ["crate", "super", "self"].contains(&tokens[at]) || children.contains(tokens[at]);
        if tokens[at] == "use" && at > 0 && ["pub", ")"].contains(&tokens[at - 1]) {
            at += tokens[at..].iter().take_while(|token| **token != ";").count();
        } else if is_begin && tokens[at + 1] == "::" && (at == 0 || !["::", "."].contains(&tokens[at - 1])) {
            at = branches(tokens, at + 1, vec![tokens[at]], &mut paths);
        } else {
            at += 1;
        }
    }
    paths
}

/// Which modules of a crate use which, by the files below its folder `src`.
fn uses(src: &Path) -> Uses<Module> {
    let mut texts: BTreeMap<Module, String> = BTreeMap::new();
    for path in sources(src) {
        let below = path.strip_prefix(src).unwrap().with_extension("");
        let mut module: Module = below.iter().map(|part| part.to_str().unwrap().to_owned()).collect();
        let last = module.last().unwrap().as_str();
        if module[0] == "bin" || last == "tests" {
            continue;
        }
        if last == "mod" || ["lib", "main"].contains(&last) && module.len() == 1 {
            module.pop();
        }
        texts.entry(module).or_default().push_str(product(&fs::read_to_string(path).unwrap()));
    }
    let uses_of = |(module, text): (&Module, &String)| {
        let is_child = |other: &&Module| other.len() == module.len() + 1 && other.starts_with(module);
        let children = texts.keys().filter(is_child).map(|child| child[module.len()].as_str()).collect();
        let target = |path: Vec<&str>| {
            let mut target = module.clone();
            for name in path {
                match name {
                    "crate" => target.clear(),
                    "super" => drop(target.pop()),
                    "self" => {}
                    name => target.push(name.to_owned()),
                }
            }
            while !texts.contains_key(&target) {
                target.pop()?; // an item of the module before it
            }
            Some(target).filter(|target| target != module)
        };
        let targets = paths(&tokens(text), &children).into_iter().filter_map(target).collect();
        (module.clone(), targets)
    };
    texts.iter().map(uses_of).collect()
}

/// The sets of two and more that use each other, directly or through others.
fn circles<T: Ord + Clone>(uses: &Uses<T>) -> BTreeSet<BTreeSet<T>> {
    let reached = |from: &T| {
        let mut reached = BTreeSet::new();
        let mut open = vec![from];
        while let Some(next) = open.pop() {
            open.extend(uses.get(next).into_iter().flatten().filter(|target| reached.insert((*target).clone())));
        }
        reached
    };
    let reached: Uses<T> = uses.keys().map(|from| (from.clone(), reached(from))).collect();
    let circle = |(from, targets): (&T, &BTreeSet<T>)| -> BTreeSet<T> {
        targets.iter().filter(|target| reached.get(target).is_some_and(|back| back.contains(from))).cloned().collect()
    };
    reached.iter().map(circle).filter(|circle| circle.len() > 1).collect()
}

/// The same by folder: the first names of modules.
fn by_folder(uses: &Uses<Module>) -> Uses<String> {
    let mut folders: Uses<String> = BTreeMap::new();
    for (module, targets) in uses {
        let Some(folder) = module.first() else { continue };
        let others = targets.iter().filter_map(|target| target.first()).filter(|other| *other != folder);
        folders.entry(folder.clone()).or_default().extend(others.cloned());
    }
    folders
}

#[test]
fn no_files_or_folders_have_circular_imports() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in crates(root).into_iter().chain([String::new()]) {
        let uses = uses(&root.join(&name).join("src"));
        let mut circles_of_files = circles(&uses);
        circles_of_files.retain(|circle| circle.len() > MOST_FILES);
        assert!(circles_of_files.is_empty(), "{name}: {circles_of_files:#?}");
        let circles_of_folders = circles(&by_folder(&uses));
        assert!(circles_of_folders.is_empty(), "{name}: {circles_of_folders:#?}");
    }
}

#[test]
fn paths_are_found_in_imports_and_expressions_but_not_in_comments_and_strings() {
    let source = "use crate::a::{self, b::{C, d}};\nuse super::{e as f, g};\npub use child::H;\npub(super) fn i() {\n    \
                  child::j('\"', \"super::k\"); // super::l\n    let super_::m = self.child::<N>();\n}\n\
                  #[cfg(test)]\nmod tests {\n    use super::o;\n}\n";
    let found = paths(&tokens(product(source)), &BTreeSet::from(["child"]));
    let found: Vec<String> = found.iter().map(|path| path.join("::")).collect();
    let expected = ["crate::a::self", "crate::a::b::C", "crate::a::b::d", "super::e", "super::g", "child::j"];
    assert_eq!(found, expected);
}

#[test]
fn an_indirect_circle_is_found() {
    let uses = [(1, vec![2]), (2, vec![3]), (3, vec![1, 4]), (4, vec![])];
    let uses = uses.map(|(from, targets)| (from, BTreeSet::from_iter(targets)));
    assert_eq!(circles(&BTreeMap::from(uses)), BTreeSet::from([BTreeSet::from([1, 2, 3])]));
}
