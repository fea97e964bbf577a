//! `reproduce/run`: tables and figures of the book, with few fields.

use std::fs;
use std::path::Path;

use crate::support::{Output, Place, output};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// What a page of the book has before its tables are computed.
const PAGE: &str = "<!-- reproduce bits -->\n\n<!-- end -->\n\n<!-- reproduce plot -->\n![](plot.png)\n<!-- end -->\n";

/// A place with the script and all that it imports, the paper's sweeps over two fields, and a page.
fn book() -> Place {
    let place = Place::new();
    for folder in ["docs/src", "scenarios/sweeps", "reproduce"] {
        fs::create_dir_all(place.path(folder)).unwrap();
    }
    let root = Path::new(ROOT);
    for file in fs::read_dir(root.join("reproduce")).unwrap().map(|file| file.unwrap()) {
        if file.file_type().unwrap().is_file() {
            fs::copy(file.path(), place.path("reproduce").join(file.file_name())).unwrap();
        }
    }
    fs::copy(root.join("scenarios/letter.toml"), place.path("scenarios/letter.toml")).unwrap();
    for name in ["scenarios/sweeps/letter.toml", "scenarios/sweeps/loss-area.toml"] {
        let sweep = fs::read_to_string(root.join(name)).unwrap();
        let lines = sweep.lines().map(|line| if line.starts_with("seeds = ") { "seeds = 2" } else { line });
        place.write(name, &lines.collect::<Vec<_>>().join("\n"));
    }
    place.write("docs/src/results.md", PAGE);
    place
}

/// Runs the script with these words.
fn reproduce(place: &Place, words: &[&str]) -> Output {
    let executables = Path::new(env!("CARGO_BIN_EXE_skysink")).parent().unwrap();
    let path = format!("{}:{}", executables.display(), std::env::var("PATH").unwrap());
    output(place.command("python3", &[&["reproduce/run"], words].concat()).env("PATH", path))
}

#[test]
fn tables_and_figures_are_written_into_the_book_and_compared_with_it() {
    let place = book();
    reproduce(&place, &["--write", "bits", "plot"]).assert_success();
    let page = place.read("docs/src/results.md");
    assert!(page.contains("\n| 5 kHz, 200 m | ") && page.contains("for 2 kHz: `reproduce/run bits`"), "{page}");
    assert!(fs::metadata(place.path("docs/src/plot.png")).unwrap().len() > 10_000);
    reproduce(&place, &["--check", "bits", "plot"]).assert_success();
    place.write("docs/src/results.md", &page.replace("| 2 kHz, 100 m |", "| 3 kHz, 100 m |"));
    place.write("docs/src/plot.png", "");
    let differs = reproduce(&place, &["--check", "bits", "plot"]).assert_code(1);
    assert!(differs.stdout.contains("\n-| 3 kHz, 100 m |") && differs.stdout.contains("\n+| 2 kHz, 100 m |"));
    assert!(differs.stdout.contains("docs/src/plot.png differs from runs/reproduce/plot.png"));
}

#[test]
fn an_unknown_table_is_refused() {
    let place = book();
    let ended = reproduce(&place, &["bits", "speed"]).assert_code(2);
    assert!(ended.stderr.contains("speed: expected all or one of area bits"), "{ended:?}");
    assert!(!place.path("runs").exists());
}
