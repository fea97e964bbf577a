//! `skysink figures`: every figure from one command, with the numbers of the sweeps behind it.

mod support;

use std::fs;

use support::Place;

/// Few missions and a short search, so that it does not take long.
const FIGURES: [&str; 7] = ["figures", "--runs", "2", "--horizon-iterations", "20", "--out", "figures"];

#[test]
fn one_command_draws_every_figure_and_writes_its_tables() {
    let place = Place::new();
    let printed = place.run_well(&FIGURES).stdout;
    for quantity in ["fig2a-loss-area", "bits-area", "fig2b-loss-rate", "fig2c-time"] {
        for link in ["letter", "narrow"] {
            let stem = format!("figures/{quantity}-{link}");
            assert!(printed.contains(&stem), "{printed}");
            let svg = place.read(&format!("{stem}.svg"));
            let strategies =
                ["rfs", "gfs", "uts", "uts-wide", "exact", "tour", "round-robin", "max-age-first", "horizon"];
            for word in strategies.into_iter().chain(["seeds 1 to 2", env!("CARGO_PKG_VERSION")]) {
                assert!(svg.contains(word), "{stem}: {word}");
            }
            assert_eq!(svg.contains("best-known"), quantity.contains("loss"), "{stem}");
            assert!(fs::metadata(place.path(&format!("{stem}.png"))).unwrap().len() > 10_000, "{stem}");
        }
    }
    let svg = place.read("figures/loss-sparse-letter.svg");
    assert!(svg.contains("best-known") && svg.contains("lower bound") && svg.contains("horizon"));
    let svg = place.read("figures/loss-knowledge.svg");
    assert!(["sees all queues", "estimates", "learns rates"].iter().all(|words| svg.contains(words)));
    for environment in ["suburban", "urban", "dense-urban", "high-rise"] {
        for quantity in ["loss", "bits"] {
            let svg = place.read(&format!("figures/altitude-{quantity}-{environment}.svg"));
            assert!(
                svg.contains("fixed altitude") && svg.contains("horizon, free from there"),
                "{quantity}, {environment}"
            );
        }
    }
    for map in ["map-letter", "map-sparse"] {
        assert!(place.read(&format!("figures/{map}.svg")).contains("queue fill at the end"), "{map}");
    }
    // The tables hold the means of the sweeps' summaries.
    let tables = place.read("figures/tables.md");
    let summary = place.read("figures/data/area/summary.csv");
    let line = |start: &str| summary.lines().find(|line| line.starts_with(start)).unwrap().to_owned();
    let mean: f64 = line("500,5000000,300,uts,loss_rate,").split(',').nth(6).unwrap().parse().unwrap();
    let row = tables.lines().find(|line| line.starts_with("| 300 |")).unwrap();
    let cell = row.split(" | ").nth(3).unwrap();
    assert!(cell.starts_with(&format!("{mean:.4} ±")), "{cell} against {mean}");

    // Drawn again from the same missions, the same bytes; only the times are those of this machine and hour.
    let before = fs::read(place.path("figures/fig2b-loss-rate-narrow.png")).unwrap();
    place.run_well(&FIGURES);
    assert!(fs::read(place.path("figures/fig2b-loss-rate-narrow.png")).unwrap() == before);
    assert_eq!(place.read("figures/tables.md"), tables);
}
