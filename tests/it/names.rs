//! The names in the source: a reader who meets a public type finds one.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Folders of the root package that hold source.
const FOLDERS: [&str; 3] = ["src", "tests", "examples"];

/// The crates of the workspace, by their folders.
pub(crate) fn crates(root: &Path) -> Vec<String> {
    let manifest: toml::Table = fs::read_to_string(root.join("Cargo.toml")).unwrap().parse().unwrap();
    manifest["workspace"]["members"].clone().try_into().unwrap()
}

/// The Rust files below `folder`.
pub(crate) fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let below = |path: PathBuf| match path.extension() {
        _ if path.is_dir() => sources(&path),
        Some(extension) if extension == "rs" => vec![path],
        _ => Vec::new(),
    };
    entries.flat_map(below).collect()
}

/// The public type that a line declares, visible outside the crate or within it.
fn declared(line: &str) -> Option<&str> {
    let public = line.trim_start().strip_prefix("pub")?;
    let public = public.strip_prefix('(').map_or(Some(public), |rest| Some(rest.split_once(')')?.1))?;
    let kinds = [" struct ", " enum ", " trait ", " union "];
    let name = kinds.into_iter().find_map(|kind| public.strip_prefix(kind))?;
    let name = name.split(|letter: char| !letter.is_alphanumeric() && letter != '_').next();
    name.filter(|name| !name.is_empty()) // the type of a macro
}

#[test]
fn public_type_names_are_unique_in_the_workspace() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut places: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    let folders = FOLDERS.map(str::to_owned).into_iter().chain(crates(root));
    for path in folders.flat_map(|folder| sources(&root.join(folder))) {
        let text = fs::read_to_string(&path).unwrap();
        for name in text.lines().filter_map(declared) {
            places.entry(name.to_owned()).or_default().push(path.clone());
        }
    }
    assert!(places.len() > 200, "{}", places.len());
    places.retain(|_, paths| paths.len() > 1);
    assert!(places.is_empty(), "{places:#?}");
}
