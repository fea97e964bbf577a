//! `INVARIANTS.md`: what it names exists.

use std::fs;
use std::path::Path;

/// Whether a source declares a function, type or field of this name.
fn declares(text: &str, name: &str) -> bool {
    ["fn", "struct", "enum", "trait"].iter().any(|kind| {
        let declaration = format!("{kind} {name}");
        let is_whole = |rest: &str| !rest.starts_with(|letter: char| letter.is_alphanumeric() || letter == '_');
        text.match_indices(&declaration).any(|(at, _)| is_whole(&text[at + declaration.len()..]))
    })
}

#[test]
fn each_invariant_has_its_code_and_its_tests() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(root.join("INVARIANTS.md")).unwrap();
    let mut count = 0;
    for row in page.lines().filter(|line| line.starts_with("| ") && line.contains("](")) {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").collect();
        assert_eq!(cells.len(), 3, "{row}");
        assert!(cells[2].contains('`'), "no test: {row}");
        // A link to a file, then names in it.
        for link in cells[1..].iter().flat_map(|cell| cell.split("](").skip(1)) {
            let (file, names) = link.split_once(')').unwrap();
            let text = fs::read_to_string(root.join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
            for name in names.split('`').skip(1).step_by(2) {
                assert!(declares(&text, name), "{file} has no {name}");
                count += 1;
            }
        }
    }
    assert!(count > 50, "{count} names");
}
