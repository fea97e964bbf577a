//! `skysink figures`: every kind of figure, with the numbers of the sweeps behind it.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::support::{Place, lines, signal_and_wait, until};
use rustix::process::Signal;

/// Draws some figures from a few missions, with a short search so that it does not take long.
fn draw(place: &Place, parts: &str, runs: &str) -> String {
    let arguments = ["figures", "--only", parts, "--runs", runs, "--horizon-iterations", "5", "--out", parts];
    place.run_ok(&arguments).stdout
}

#[test]
fn a_study_draws_its_figures_and_writes_their_tables() {
    let place = Place::new();
    let printed = draw(&place, "area", "2");
    for quantity in ["fig2a-loss-area", "bits-area"] {
        for link in ["letter", "narrow"] {
            let stem = format!("area/{quantity}-{link}");
            assert!(printed.contains(&stem), "{printed}");
            let svg = place.read(&format!("{stem}.svg"));
            let strategies =
                ["rfs", "gfs", "uts", "uts-wide", "exact", "tour", "round-robin", "max-age-first", "horizon"];
            for word in strategies.into_iter().chain(["<desc>seeds 1 to 2 ", env!("CARGO_PKG_VERSION")]) {
                assert!(svg.contains(word), "{stem}: {word}");
            }
            let is_loss = quantity.contains("loss");
            assert_eq!(place.path(&format!("{stem}-difference.svg")).exists(), is_loss, "{stem}");
            assert_eq!([svg.contains("best-known"), svg.contains("lower bound")], [is_loss; 2], "{stem}");
            assert!(fs::metadata(place.path(&format!("{stem}.png"))).unwrap().len() > 10_000, "{stem}");
        }
    }
    // The tables hold the means of the sweeps' summaries.
    let tables = place.read("area/tables.md");
    let summary = place.read("area/data/area/summary.csv");
    let line = |start: &str| summary.lines().find(|line| line.starts_with(start)).unwrap().to_owned();
    let mean: f64 = line("500,5000000,300,uts,loss_rate,").split(',').nth(6).unwrap().parse().unwrap();
    let row = tables.lines().find(|line| line.starts_with("| 300 |")).unwrap();
    let cell = row.split(" | ").nth(3).unwrap();
    assert!(cell.starts_with(&format!("{mean:.4} [")), "{cell} against {mean}");
    assert_eq!(tables.matches("seeds 1 to 2").count(), 1, "said once of the same seeds");
    // Nobody is better than the best known, and the bound is below it.
    let losses = |row: &str| -> Vec<f64> {
        let cells = row.trim_matches(['|', ' ']).split(" | ").skip(1);
        cells.map(|cell| cell.split(' ').next().unwrap().parse().unwrap()).collect()
    };
    let tables_of = |title: &str| -> Vec<&str> {
        let of_title = tables.split("\n**").filter(|table| table.starts_with(title));
        of_title
            .flat_map(str::lines)
            .filter(|line| line.starts_with("| ") && line[2..].starts_with(|first: char| first.is_ascii_digit()))
            .collect()
    };
    let rows = tables_of("Data loss against the area ·");
    assert_eq!(rows.len(), 10);
    for row in &rows {
        let [strategies @ .., best, bound] = &losses(row)[..] else { panic!("{row}") };
        assert!(strategies.len() == 9 && strategies.iter().all(|loss| best <= loss) && bound <= best, "{row}");
    }
    // The difference of two means over the same fields is the mean difference, within the rounding of three numbers.
    let differences = tables_of("Data loss against the area, difference by field ·");
    assert_eq!(differences.len(), 10);
    for (row, difference) in rows.iter().zip(differences) {
        let (means, differences) = (losses(row), losses(difference));
        assert_eq!((means.len(), differences.len(), differences[2]), (11, 10, 0.0), "all but the bound, from uts");
        let is_near = |(mean, difference): (&f64, &f64)| (mean - means[2] - difference).abs() < 1.6e-4;
        assert!(means.iter().zip(&differences).all(is_near), "{row}: {difference}");
    }
    // Drawn again from the same missions, the same bytes.
    let before = fs::read(place.path("area/fig2a-loss-area-narrow.png")).unwrap();
    draw(&place, "area", "2");
    assert!(fs::read(place.path("area/fig2a-loss-area-narrow.png")).unwrap() == before);
    assert_eq!(place.read("area/tables.md"), tables);
}

#[test]
fn what_the_queues_are_known_by_has_a_figure() {
    let place = Place::new();
    draw(&place, "knowledge", "1");
    let svg = place.read("knowledge/loss-knowledge.svg");
    for words in ["exact sees all queues", "horizon sees all queues", "horizon estimates", "horizon learns rates, too"]
    {
        assert!(svg.contains(words), "{words}");
    }
}

#[test]
fn the_loss_grows_with_the_time_of_the_mission() {
    let place = Place::new();
    draw(&place, "mission-time", "1");
    assert!(place.read("mission-time/fig2c-loss-time-letter.svg").contains("mission time [slots of 1 s]"));
    // A mission of t slots is the first t slots of a longer one, as long as the strategy does not know when it ends: no
    // bit that is lost in the shorter one is saved in the longer one.
    let results = place.read("mission-time/data/mission-time/results.csv");
    let lost: Vec<f64> = results
        .lines()
        .filter(|line| line.starts_with("120,5000,") && line.split(',').nth(3) == Some("rfs"))
        .map(|line| {
            let field = |place: usize| line.split(',').nth(place).unwrap().parse::<f64>().unwrap();
            field(2) * field(5) // slots · η
        })
        .collect();
    assert_eq!(lost.len(), 6);
    assert!(lost.is_sorted() && lost[0] == 0.0 && lost[5] > 0.0, "{lost:?}");
}

#[test]
fn altitudes_and_trajectories_have_figures() {
    let place = Place::new();
    draw(&place, "altitude", "1");
    draw(&place, "maps", "1");
    for environment in ["suburban", "urban", "dense-urban", "high-rise"] {
        for quantity in ["loss", "bits"] {
            let svg = place.read(&format!("altitude/altitude-{quantity}-{environment}.svg"));
            let curves = ["fixed altitude", "free altitude, from there"];
            assert!(curves.iter().all(|curve| svg.contains(curve)), "{quantity}, {environment}");
        }
    }
    for map in ["map-letter", "map-sparse"] {
        let svg = place.read(&format!("maps/{map}.svg"));
        assert!(svg.contains("queue fill at the end") && svg.contains("horizon: η = "), "{map}");
    }
}

/// What depends on the missions alone in a folder of figures, by its path there.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inner) = folders.pop() {
        for entry in fs::read_dir(inner).into_iter().flatten().flatten() {
            let name = entry.file_name().into_string().unwrap();
            // A journal is in the order of the flights; a file with a dot is under way.
            let is_result = !["journal.csv", "timings.csv"].contains(&name.as_str()) && !name.starts_with('.');
            if entry.file_type().unwrap().is_dir() {
                folders.push(entry.path());
            } else if is_result && let Ok(bytes) = fs::read(entry.path()) {
                files.insert(entry.path().strip_prefix(folder).unwrap().to_owned(), bytes);
            }
        }
    }
    files
}

#[test]
fn figures_that_are_interrupted_end_with_the_same_bytes_and_never_show_half_a_file() {
    let place = Place::new();
    let figures = ["figures", "--only", "altitude", "--runs", "1", "--horizon-iterations", "5", "--out"];
    let whole = place.run_ok(&[&figures[..], &["whole"]].concat());
    assert!(whole.stdout.contains("whole/tables.md"), "{whole:?}");
    let expected = files(&place.path("whole"));
    let studies = ["altitude-fixed", "altitude-free"];
    let flown = |folder: &str| -> usize {
        studies.iter().map(|study| lines(&place.path(&format!("{folder}/data/{study}/journal.csv")))).sum()
    };
    let missions = flown("whole");
    let drawn = |part: usize| place.path("cut").join(format!("altitude-loss-{}.svg", ["suburban", "urban"][part]));
    for interruption in 0..6 {
        let cut = place.skysink(&[&figures[..], &["cut"]].concat()).spawn().unwrap();
        until("moment", || match interruption {
            0..4 => (flown("cut") > missions * interruption / 4).then_some(()),
            _ => drawn(interruption - 4).exists().then_some(()),
        });
        let signal = if interruption % 2 == 0 { Signal::INT } else { Signal::KILL };
        let ended = signal_and_wait(signal, cut);
        assert!(ended.signal == Some(9) || ended.code == Some(130), "{ended:?}");
        let says = "stopped by signal 2: the finished missions are in cut; run the command again to continue";
        assert!(ended.signal == Some(9) || ended.stderr.contains(says), "{ended:?}");
        for (name, bytes) in files(&place.path("cut")) {
            assert!(expected[&name] == bytes, "{} after interruption {interruption}", name.display());
        }
    }
    place.run_ok(&[&figures[..], &["cut"]].concat());
    assert!(files(&place.path("cut")) == expected);
}

#[test]
fn a_part_that_is_none_is_refused() {
    let place = Place::new();
    let ended = place.run(&["figures", "--only", "speed"]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.stderr.contains("area, sparse, rate, time, mission-time, knowledge, altitude, maps"), "{ended:?}");
}
