//! `skysink figures`: every kind of figure, with the numbers of the sweeps behind it.

mod support;

use std::fs;

use support::Place;

/// Draws some figures from a few missions, with a short search so that it does not take long.
fn draw(place: &Place, parts: &str, runs: &str) -> String {
    let arguments = ["figures", "--only", parts, "--runs", runs, "--horizon-iterations", "5", "--out", parts];
    place.run_well(&arguments).stdout
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
            for word in strategies.into_iter().chain(["seeds 1 to 2", env!("CARGO_PKG_VERSION")]) {
                assert!(svg.contains(word), "{stem}: {word}");
            }
            let is_loss = quantity.contains("loss");
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
    assert!(cell.starts_with(&format!("{mean:.4} ±")), "{cell} against {mean}");
    // Nobody is better than the best known, and the bound is below it.
    let losses = |row: &str| -> Vec<f64> {
        let cells = row.trim_matches(['|', ' ']).split(" | ").skip(1);
        cells.map(|cell| cell.split(" ± ").next().unwrap().parse().unwrap()).collect()
    };
    let rows: Vec<_> = tables
        .lines()
        .take_while(|line| !line.contains("Bits"))
        .filter(|line| line.starts_with("| ") && line.contains("±"))
        .collect();
    assert_eq!(rows.len(), 10);
    for row in rows {
        let [strategies @ .., best, bound] = &losses(row)[..] else { panic!("{row}") };
        assert!(strategies.len() == 9 && strategies.iter().all(|loss| best <= loss) && bound <= best, "{row}");
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

#[test]
fn a_part_that_is_none_is_refused() {
    let place = Place::new();
    let ended = place.run(&["figures", "--only", "speed"]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.stderr.contains("area, sparse, rate, time, knowledge, altitude, maps"), "{ended:?}");
}
