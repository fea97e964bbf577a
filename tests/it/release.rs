//! What others cite: the files for citation say the version, the date and the address that the project has.

use std::fs;
use std::path::Path;

use serde_json::Value;

fn read(name: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(name)).unwrap()
}

/// The value of a key of `CITATION.cff`, at the top level.
fn cited(key: &str) -> Option<String> {
    let text = read("CITATION.cff");
    text.lines().find_map(|line| Some(line.strip_prefix(key)?.strip_prefix(": ")?.to_owned()))
}

#[test]
fn the_files_for_citation_agree_with_cargo_toml_and_the_changelog() {
    let manifest: toml::Table = read("Cargo.toml").parse().unwrap();
    let package = manifest["workspace"]["package"].as_table().unwrap();
    let version = package["version"].as_str().unwrap();
    let codemeta: Value = serde_json::from_str(&read("codemeta.json")).unwrap();
    let zenodo: Value = serde_json::from_str(&read(".zenodo.json")).unwrap();

    assert_eq!(cited("version").as_deref(), Some(version));
    assert_eq!(codemeta["version"], version);
    assert_eq!(zenodo["version"], version);

    let date = cited("date-released").unwrap();
    assert_eq!(codemeta["datePublished"], *date);
    assert_eq!(zenodo["publication_date"], *date);
    let section = format!("\n## [{version}] - {date}\n");
    assert!(read("CHANGELOG.md").contains(&section), "CHANGELOG.md: expected a section{section}");
    let bibtex = format!("  version = {{{version}}},\n  date    = {{{date}}}\n");
    assert!(read("docs/src/cite.md").contains(&bibtex), "cite.md: expected{bibtex}");

    let repository = package.get("repository").and_then(|url| url.as_str());
    assert_eq!(cited("repository-code").as_deref(), repository);
    assert_eq!(codemeta.get("codeRepository").and_then(Value::as_str), repository);
}
