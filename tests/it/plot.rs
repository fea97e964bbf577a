//! `skysink plot`: figures and tables with the numbers of a sweep, maps of runs, and what is refused.

use std::collections::BTreeMap;
use std::fs;

use crate::support::{Place, csv_rows};
use expect_test::expect_file;
use serde_json::Value;

/// A place with a flown sweep of the smoke scenario, `flown`.
fn swept() -> Place {
    let place = Place::new();
    place.scenario("smoke");
    let axes = "\"area.side_m\" = [90, 40.0, 60.0]\n\"link.gain\" = [\"static\", \"per-slot\"]\n";
    let head = "scenario = \"smoke.toml\"\nstrategies = [\"uts\", \"gfs\", \"rfs\"]\nseeds = 3\n[axes]\n";
    place.write("sweep.toml", &format!("{head}{axes}"));
    place.run_ok(&["sweep", "sweep.toml", "--out", "flown"]);
    place
}

/// What `skysink plot flown` prints for machines.
fn plot(place: &Place, arguments: &[&str]) -> Value {
    let ended = place.run_ok(&[&["plot", "flown", "--json"], arguments].concat());
    serde_json::from_str(&ended.stdout).unwrap()
}

#[test]
fn a_figure_and_its_tables_have_the_numbers_of_the_summary() {
    let place = swept();
    let request = ["--x", "area.side_m", "--where", "link.gain=per-slot", "--y", "bits_per_waypoint"];
    let drawn = plot(&place, &request);
    let points = drawn["points"].as_array().unwrap();
    let sides: Vec<f64> = points.iter().step_by(3).map(|point| point["x"].as_f64().unwrap()).collect();
    assert_eq!(sides, [40.0, 60.0, 90.0], "by size");
    let summary = csv_rows(&place.read("flown/summary.csv"));
    let stem = "flown/plots/bits_per_waypoint-area.side_m-link.gain-per-slot";
    let [svg, latex, markdown] = ["svg", "tex", "md"].map(|extension| place.read(&format!("{stem}.{extension}")));
    for point in points {
        let is_point = |row: &&BTreeMap<String, String>| {
            row["area.side_m"].parse().ok() == point["x"].as_f64()
                && point["strategy"] == row["strategy"].as_str()
                && (row["link.gain"].as_str(), row["metric"].as_str()) == ("per-slot", "bits_per_waypoint")
        };
        let row = summary.iter().find(is_point).unwrap();
        let numbers = ["mean", "ci95_low", "ci95_high"].map(|key| row[key].parse::<f64>().unwrap());
        assert_eq!(numbers.map(Some), [&point["mean"], &point["ci95"][0], &point["ci95"][1]].map(Value::as_f64));
        assert_eq!(point["n"], 3);
        let [mean, low, high] = numbers.map(|number| format!("{number:.0}"));
        assert!(markdown.contains(&format!("{mean} [{low}, {high}]")), "{markdown}");
        assert!(latex.contains(&format!("{mean} {{[}}{low}, {high}]")), "{latex}");
    }
    assert!(markdown.contains("| area.side_m | uts | gfs | rfs |"), "{markdown}");
    assert!(latex.contains("  area.side\\_m & uts & gfs & rfs \\\\\n"), "{latex}");
    for words in ["bits delivered per waypoint [bit]", "area.side_m", "uts", "gfs", "rfs"] {
        assert!(svg.contains(&format!(">\n{words}\n</text>")), "{words} is text");
    }
    assert!(
        svg.contains("<desc>seeds 1 to 3 · bands: 95 % CI of the mean · skysink ")
            && svg.contains("link.gain = per-slot")
    );
    let bytes = || {
        ["svg", "pdf", "png", "tex", "md"]
            .map(|extension| fs::read(place.path(&format!("{stem}.{extension}"))).unwrap())
    };
    let before = bytes();
    place.run_ok(&[&["plot", "flown"], &request[..]].concat());
    assert!(before == bytes(), "the same again");
}

#[test]
fn differences_are_paired_by_seed() {
    let place = swept();
    let request =
        ["--x", "area.side_m", "--where", "link.gain=static", "--strategies", "rfs", "--difference-to", "uts"];
    let drawn = plot(&place, &[&request[..], &["--y", "jain"]].concat());
    let results = csv_rows(&place.read("flown/results.csv"));
    let values = |strategy: &str, side: f64| -> Vec<f64> {
        let flown = results.iter().filter(|row| {
            (row["strategy"].as_str(), row["link.gain"].as_str(), row["area.side_m"].parse().ok())
                == (strategy, "static", Some(side))
        });
        flown.map(|row| row["jain"].parse().unwrap()).collect()
    };
    let points = drawn["points"].as_array().unwrap();
    assert_eq!(points.len(), 3 * 2, "rfs, and the reference as the line at 0");
    for point in points {
        let side = point["x"].as_f64().unwrap();
        let pairs = values(point["strategy"].as_str().unwrap(), side).into_iter().zip(values("uts", side));
        let differences: Vec<f64> = pairs.map(|(value, reference)| value - reference).collect();
        let mean = differences.iter().sum::<f64>() / 3.0;
        assert!((point["mean"].as_f64().unwrap() - mean).abs() < 1e-15, "{point}");
        assert_eq!(point["ci95"].is_null(), point["strategy"] == "uts", "{point}");
    }
    let svg = place.read("flown/plots/jain-area.side_m-link.gain-static-difference-to-uts.svg");
    assert!(svg.contains("fairness index − that of uts"));
}

#[test]
fn text_values_are_categories_with_error_bars_and_no_curve() {
    let place = swept();
    let drawn = plot(&place, &["--x", "link.gain", "--where", "area.side_m=9e1"]);
    let words: Vec<_> = drawn["points"].as_array().unwrap().iter().step_by(3).map(|point| point["x"].clone()).collect();
    assert_eq!(words, ["static", "per-slot"], "in the order of the sweep");
    let svg = place.read("flown/plots/loss_rate-link.gain-area.side_m-90.svg");
    assert!(svg.contains(">\nper-slot\n</text>"));
    assert_eq!(svg.matches("fill-opacity").count(), 6, "an interval for each strategy and word");
    assert_eq!(svg.matches("stroke-dasharray").count(), 3, "a line for each strategy, in the legend");
}

#[test]
fn a_figure_for_print_has_the_given_width_and_its_text_size() {
    let place = swept();
    let request = ["--x", "area.side_m", "--where", "link.gain=static", "--out", "paper"];
    plot(&place, &[&request[..], &["--width", "88mm", "--title", "η < 1 & more", "--footer"]].concat());
    let stem = "paper/loss_rate-area.side_m-link.gain-static";
    let svg = place.read(&format!("{stem}.svg"));
    // 88 mm are 249.45 pt; 28 units of text are 8 pt.
    assert!(svg.contains("viewBox=\"0 0 873 ") && svg.contains("width=\"249.429pt\""), "{}", &svg[..300]);
    assert!(svg.contains("font-size=\"28\"") && svg.contains("η &lt; 1 &amp; more"));
    assert!(svg.contains(">\nseeds 1 to 3 · bands: 95 % CI of the mean · skysink "), "the footer");
    let png = fs::read(place.path(&format!("{stem}.png"))).unwrap();
    assert_eq!(u32::from_be_bytes(png[16..20].try_into().unwrap()), 1600);
    let pdf = fs::read(place.path(&format!("{stem}.pdf"))).unwrap();
    let pdf = String::from_utf8_lossy(&pdf);
    assert!(pdf.contains("/MediaBox[0 0 249.4"));
    assert!(pdf.contains("/ToUnicode") && pdf.contains("DejaVuSans"), "text with its font");
    place.run_ok(&[&["plot", "flown"], &request[..]].concat());
    let svg = place.read(&format!("{stem}.svg"));
    assert!(svg.contains("viewBox=\"0 0 1600 ") && !svg.contains("&lt;") && svg.matches("seeds 1 to 3").count() == 1);
}

#[test]
fn plots_are_printed_and_invalid_ones_refused_without_files() {
    swept().assert_transcript(&expect_file!["transcripts/plot.txt"]);
}

#[test]
fn incomplete_points_are_left_out_with_a_note() {
    let place = swept();
    let request = ["--x", "area.side_m", "--where", "link.gain=static"];
    // The journal without the missions of gfs at 60 m, static: point 4, strategy 1.
    let journal = place.read("flown/journal.csv");
    let kept: String = journal.split_inclusive('\n').filter(|line| !line.starts_with("4,1,")).collect();
    place.write("flown/journal.csv", &kept);
    let missing = |drawn: &Value| drawn["missing"].as_str().unwrap().to_owned();
    let drawn = plot(&place, &request);
    assert_eq!(missing(&drawn), "51 of 54 missions are present; omitted: area.side_m = 60");
    assert_eq!(drawn["points"].as_array().unwrap().len(), 2 * 3);
    let others = plot(&place, &[&request[..], &["--strategies", "rfs,uts"]].concat());
    assert_eq!(missing(&others), "51 of 54 missions are present; the plot is complete");
    assert_eq!(others["points"].as_array().unwrap().len(), 3 * 2);
    let said = place.run_ok(&[&["plot", "flown"], &request[..]].concat()).stderr;
    assert!(said.ends_with("skysink: 51 of 54 missions are present; omitted: area.side_m = 60\n"), "{said}");
    assert!(said.starts_with("skysink: warning: 3 seeds are few: the 95 % interval"), "{said}");
    let none = place.run(&["plot", "flown", "--x", "link.gain", "--where", "area.side_m=60", "--strategies", "gfs"]);
    assert_eq!(none.code, Some(0), "per-slot is whole: {none:?}");
    place.write("flown/journal.csv", "");
    place.run_refused(&[&["plot", "flown"], &request[..]].concat(), "0 of 54 missions are present");
}

#[test]
fn a_key_can_have_a_curve_per_value() {
    let place = swept();
    let by_side = ["--x", "area.side_m"];
    let both = plot(&place, &[&by_side[..], &["--by", "link.gain", "--strategies", "gfs,uts"]].concat());
    assert_eq!(both["by"], "link.gain");
    let of = |drawn: &Value, strategy: &str, by: Value| -> Vec<Value> {
        let points = drawn["points"].as_array().unwrap().iter();
        let is_of = |point: &&Value| point["strategy"] == strategy && point["by"] == by;
        points
            .filter(is_of)
            .map(|point| [&point["x"], &point["mean"], &point["ci95"]].into_iter().cloned().collect())
            .collect()
    };
    for gain in ["static", "per-slot"] {
        let alone = plot(&place, &[&by_side[..], &["--where", &format!("link.gain={gain}")]].concat());
        for strategy in ["uts", "gfs"] {
            let curve = of(&both, strategy, gain.into());
            assert_eq!(curve.len(), 3);
            assert_eq!(curve, of(&alone, strategy, Value::Null), "{strategy}, {gain}");
        }
    }
    let svg = place.read("flown/plots/loss_rate-area.side_m-by-link.gain.svg");
    let labels = ["gfs, static", "gfs, per-slot", "uts, static", "uts, per-slot"];
    let places = labels.map(|label| svg.find(&format!(">\n{label}\n</text>")).unwrap());
    assert!(places.is_sorted());

    let differences = plot(&place, &[&by_side[..], &["--by", "link.gain", "--difference-to", "static"]].concat());
    let number = |value: &Value, index: usize| value[index].as_f64().unwrap();
    for strategy in ["uts", "gfs"] {
        let [fixed, drawn] = ["static", "per-slot"].map(|gain| of(&both, strategy, gain.into()));
        let difference = of(&differences, strategy, "per-slot".into());
        for ((fixed, drawn), difference) in fixed.iter().zip(&drawn).zip(&difference) {
            assert!((number(drawn, 1) - number(fixed, 1) - number(difference, 1)).abs() < 1e-12, "{strategy}");
        }
        assert!(of(&differences, strategy, "static".into()).iter().all(|point| number(point, 1) == 0.0));
    }
}

#[test]
fn the_best_known_loss_and_the_bounds_are_curves_with_the_numbers_of_the_summary() {
    let place = Place::new();
    place.scenario("smoke");
    let head = "scenario = \"smoke.toml\"\nstrategies = [\"uts\", \"horizon\", \"offline\"]\nseeds = 2\n[axes]\n";
    let axes = "\"planner.horizon.iterations\" = [5]\n\"planner.offline.steps\" = [100]\n\"slots\" = [200]\n\
                \"sensors.sampling_bps\" = [300.0, 900.0]\n";
    place.write("sweep.toml", &format!("{head}{axes}"));
    place.run_ok(&["sweep", "sweep.toml", "--out", "flown"]);
    let request = ["--x", "sensors.sampling_bps", "--bounds", "--strategies", "uts,horizon"];
    let drawn = plot(&place, &request);
    let points = drawn["points"].as_array().unwrap();
    let curves: Vec<&str> = points.iter().take(4).map(|point| point["strategy"].as_str().unwrap()).collect();
    assert_eq!(curves, ["uts", "horizon", "best-known", "lower bound"]);
    let summary = csv_rows(&place.read("flown/summary.csv"));
    for at in points.chunks(4) {
        let means: Vec<f64> = at.iter().map(|point| point["mean"].as_f64().unwrap()).collect();
        let [uts, horizon, best, bound] = means[..] else { panic!("{at:?}") };
        assert!(bound <= best && best <= uts.min(horizon) && uts > 0.0, "{means:?}");
        let of_summary = |strategy: &str, metric: &str| {
            let is_row = |row: &&BTreeMap<String, String>| {
                let rate: f64 = row["sensors.sampling_bps"].parse().unwrap();
                Some(rate) == at[0]["x"].as_f64() && row["strategy"] == strategy && row["metric"] == metric
            };
            summary.iter().find(is_row).unwrap()["mean"].parse::<f64>().unwrap()
        };
        assert_eq!([best, bound], [of_summary("best-known", "loss_rate"), of_summary("offline", "loss_bound")]);
    }
    let differences = plot(&place, &[&request[..], &["--difference-to", "uts"]].concat());
    let points = differences["points"].as_array().unwrap();
    let curves: Vec<&str> = points.iter().take(3).map(|point| point["strategy"].as_str().unwrap()).collect();
    assert_eq!((curves, points.len()), (vec!["uts", "horizon", "best-known"], 6), "a bound has no difference by field");
}

#[test]
fn the_trajectories_of_runs_are_mapped_side_by_side() {
    let place = Place::new();
    let scenario = place.scenario("smoke");
    for (strategy, seed) in [("uts", "1"), ("gfs", "1"), ("gfs", "2")] {
        let run = format!("runs/{strategy}-{seed}");
        place.run_ok(&["simulate", &scenario, "--strategy", strategy, "--seed", seed, "--out", &run]);
    }
    place.assert_transcript(&expect_file!["transcripts/plot-runs.txt"]);
    let svg = place.read("runs/plots/map-uts-1-gfs-1.svg");
    for (run, strategy) in [("uts-1", "uts"), ("gfs-1", "gfs")] {
        let loss = place.summary(&format!("runs/{run}"))["loss_rate"].as_f64().unwrap();
        assert!(svg.contains(&format!(">\n{strategy}: η = {loss:.3}\n</text>")), "{strategy}");
    }
    assert!(svg.contains("queue fill at the end") && svg.contains("<desc>smoke, seed 1 · skysink "));
    // Runs of one strategy are told apart by their folders.
    let svg = place.read("paper/map-gfs-1-gfs-2.svg");
    assert!(svg.contains(">\nTwo seeds\n</text>") && svg.contains(">\ngfs-2: η = "), "{svg}");
    assert!(svg.contains("viewBox=\"0 0 873 ") && svg.contains(">\nsmoke, seed 1; smoke, seed 2 · skysink "));
}
