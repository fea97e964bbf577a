//! `docs/figures.sh`: the sweeps and missions behind the paper's figures, with few fields and short searches.

use std::fs;
use std::path::Path;

use crate::support::{Place, csv_rows, output};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// The keys of a sweep that take long, with the values of the tests.
const SHORTER: [(&str, &str); 3] =
    [("seeds", "2"), ("\"planner.horizon.iterations\"", "[5]"), ("\"planner.offline.steps\"", "[1000]")];

/// A place with the script, and the scenarios with shorter sweeps.
fn book() -> Place {
    let place = Place::new();
    for folder in ["docs/src", "scenarios/sweeps"] {
        fs::create_dir_all(place.path(folder)).unwrap();
    }
    let root = Path::new(ROOT);
    for name in ["docs/figures.sh", "scenarios/letter.toml", "scenarios/plos-dense-urban.toml"] {
        fs::copy(root.join(name), place.path(name)).unwrap();
    }
    for sweep in fs::read_dir(root.join("scenarios/sweeps")).unwrap() {
        let sweep = sweep.unwrap();
        let text = fs::read_to_string(sweep.path()).unwrap();
        let shorter = |line: &str| {
            let key = line.split(" = ").next().unwrap();
            let shorter = SHORTER.into_iter().find(|(name, _)| *name == key);
            shorter.map_or_else(|| line.to_owned(), |(_, value)| format!("{key} = {value}")) + "\n"
        };
        let name = format!("scenarios/sweeps/{}", sweep.file_name().to_str().unwrap());
        place.write(&name, &text.lines().map(shorter).collect::<String>());
    }
    place
}

/// Runs the script for these parts.
fn draw(place: &Place, parts: &[&str]) {
    let executables = Path::new(env!("CARGO_BIN_EXE_skysink")).parent().unwrap();
    let path = format!("{}:{}", executables.display(), std::env::var("PATH").unwrap());
    let mut script = place.command("bash", &[&["docs/figures.sh"], parts].concat());
    output(script.env("PATH", path)).assert_success();
}

/// The picture of the script with this name, as text.
fn picture(place: &Place, name: &str) -> String {
    let folder = place.path(&format!("runs/figures/pictures/{name}"));
    let files = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let svg = files.into_iter().find(|path| path.extension().is_some_and(|extension| extension == "svg"));
    fs::read_to_string(svg.unwrap()).unwrap()
}

#[test]
fn the_loss_over_the_area_has_its_pictures_and_the_book_one_of_them() {
    let place = book();
    draw(&place, &["area"]);
    for radio in ["", "-narrow"] {
        let one_slot = picture(&place, &format!("loss-area{radio}"));
        let ahead = picture(&place, &format!("loss-area-ahead{radio}"));
        for strategy in ["rfs", "gfs", "uts", "uts-wide", "exact"] {
            let label = format!(">\n{strategy}\n</text>");
            assert!(one_slot.contains(&label) && !ahead.contains(&label), "{strategy}: 20 fields are too few for it");
        }
        for curve in ["tour", "round-robin", "max-age-first", "horizon", "best-known", "lower bound"] {
            let label = format!(">\n{curve}\n</text>");
            assert!(!one_slot.contains(&label) && ahead.contains(&label), "{curve}");
        }
        let differences = picture(&place, &format!("loss-area-difference{radio}"));
        assert!(differences.contains(">\nexact\n</text>") && differences.contains(">\ntour\n</text>"));
    }
    assert!(fs::metadata(place.path("docs/src/loss-area.png")).unwrap().len() > 10_000);
}

#[test]
fn the_loss_grows_with_the_time_of_the_mission() {
    let place = book();
    draw(&place, &["time"]);
    assert!(picture(&place, "loss-time").contains("mission time [slots of 1 s]"));
    // A mission of t slots is the first t slots of a longer one, as long as the strategy does not know when it ends: no
    // bit that is lost in the shorter one is saved in the longer one.
    let results = csv_rows(&place.read("runs/figures/loss-time/results.csv"));
    let rows = results.iter().filter(|row| {
        (row["link.bandwidth_hz"].as_str(), row["strategy"].as_str(), row["seed"].as_str()) == ("5000", "rfs", "1")
    });
    let number = |text: &String| text.parse::<f64>().unwrap();
    let lost: Vec<f64> = rows.map(|row| number(&row["slots"]) * number(&row["loss_rate"])).collect();
    assert_eq!(lost.len(), 6);
    assert!(lost.is_sorted() && lost[0] == 0.0 && lost[5] > 0.0, "{lost:?}");
}

#[test]
fn knowledge_altitudes_and_trajectories_have_pictures() {
    let place = book();
    draw(&place, &["knowledge", "altitude", "maps"]);
    for (name, curves) in [
        ("knowledge", ["exact, oracle", "horizon, estimated"]),
        ("learnt-rates", ["exact, known", "horizon, learnt"]),
        ("altitude-suburban", ["uts-wide, fixed", "uts-wide, free"]),
        ("altitude-bits-high-rise", ["uts-wide, fixed", "uts-wide, free"]),
        ("map-letter", ["queue fill at the end", "Trajectories over 500 slots · 100 m × 100 m"]),
    ] {
        let svg = picture(&place, name);
        assert!(curves.iter().all(|words| svg.contains(&format!(">\n{words}\n</text>"))), "{name}");
    }
    assert!(picture(&place, "map-sparse").contains("horizon: η = "));
    for name in ["altitude", "map-sparse"] {
        assert!(place.path(&format!("docs/src/{name}.png")).is_file(), "{name}");
    }
}

#[test]
fn an_unknown_part_is_refused() {
    let place = book();
    let ended = output(place.command("bash", &["docs/figures.sh", "area", "speed"]));
    let expected = "expected one of area rate time planning sparse knowledge altitude maps example";
    assert!(ended.code == Some(2) && ended.stderr.contains(expected), "{ended:?}");
    assert!(!place.path("runs").exists());
}
