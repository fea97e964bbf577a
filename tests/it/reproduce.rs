//! The tables and figures of the book are those that `reproduce/run` computes.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The blocks of a page, each with its name: what is between the lines `reproduce NAME` and `end`.
fn blocks(page: &str) -> Vec<(&str, &str)> {
    let begun = page.split("<!-- reproduce ").skip(1);
    begun.map(|rest| rest.split_once("<!-- end -->").unwrap().0.split_once(" -->\n").unwrap()).collect()
}

#[test]
fn every_reproduced_block_of_the_book_has_an_entry_and_conversely() {
    let folder = Path::new(ROOT).join("docs/src");
    let pages = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let pages = pages.filter(|path| path.extension().is_some_and(|extension| extension == "md"));
    let pages: Vec<String> = pages.map(|path| read(&path)).collect();
    let blocks: Vec<(&str, &str)> = pages.iter().flat_map(|page| blocks(page)).collect();
    for (name, text) in &blocks {
        let picture = format!("]({name}.png)");
        let command = format!("`reproduce/run {name}`");
        assert!(text.contains(&picture) || text.contains(&command), "{name}: neither its picture nor its command");
    }
    let in_book: BTreeSet<String> = blocks.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(in_book.len(), blocks.len(), "a name occurs twice: {blocks:?}");
    let entries = ["entries.py", "timings.py"].map(|file| read(&Path::new(ROOT).join("reproduce").join(file))).concat();
    let names = entries.split("\n@entry(\"").skip(1).map(|rest| rest.split_once('"').unwrap().0.to_owned());
    assert_eq!(in_book, names.collect());
}
