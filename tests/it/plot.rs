//! `skysink plot`: figures and tables with the numbers of a sweep, and what is refused.

use std::collections::BTreeMap;
use std::fs;

use crate::support::{Place, csv_rows};
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
fn a_figure_and_its_tables_hold_the_numbers_of_the_summary() {
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
        let mean = format!("{:.0}", numbers[0]);
        assert!(markdown.contains(&format!("{mean} ± ")) && latex.contains(&format!("{mean} $\\pm$ ")), "{markdown}");
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
    let printed = place.run_ok(&[&["plot", "flown"], &request[..]].concat()).stdout;
    assert!(before == bytes(), "the same again");
    assert!(
        printed.contains(&format!("{stem}.pdf")) && printed.contains("per-slot") && printed.contains(" ± "),
        "{printed}"
    );
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
fn words_stand_side_by_side_with_bars_and_no_curve() {
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
fn a_page_for_print_has_its_width_and_the_text_of_print() {
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
    let without = place.run_ok(&[&["plot", "flown"], &request[..]].concat());
    assert!(without.stdout.contains("data loss rate η, mean [95 % CI]"), "{without:?}");
    let svg = place.read(&format!("{stem}.svg"));
    assert!(svg.contains("viewBox=\"0 0 1600 ") && !svg.contains("&lt;") && svg.matches("seeds 1 to 3").count() == 1);
}

#[test]
fn a_request_that_does_not_fit_the_sweep_is_refused_in_a_line_and_nothing_is_written() {
    let place = swept();
    let by_side = ["--x", "area.side_m", "--where", "link.gain=static"];
    let with = |more: &[&'static str]| [&by_side[..], more].concat();
    for (request, says) in [
        (
            vec!["--x", "area.side_m"],
            "link.gain has several values: expected one of each, such as --where link.gain=static",
        ),
        (
            vec!["--x", "area.side"],
            "--x area.side: expected a key of the sweep: area.side_m, link.gain; did you mean `area.side_m`?",
        ),
        (with(&["--where", "slots=3"]), "--where slots: expected a key of the sweep"),
        (with(&["--where", "area.side_m=40"]), "--where area.side_m: it is the key of the x axis"),
        (with(&["--where", "link.gain=per-slot"]), "--where link.gain: it is given twice: expected one value"),
        (
            vec!["--x", "area.side_m", "--where", "link.gain=dynamic"],
            "link.gain=dynamic: expected a value of the sweep: static, per-slot",
        ),
        (with(&["--strategies", "uts,exact"]), "--strategies exact: expected a strategy of the sweep: uts, gfs, rfs"),
        (with(&["--difference-to", "exact"]), "--difference-to exact: expected a strategy of the sweep"),
        (with(&["--strategies", "utz"]), "expected a strategy of the sweep: uts, gfs, rfs; did you mean `uts`?"),
        (with(&["--y", "loss_bound"]), "--y loss_bound: uts has no value"),
    ] {
        let ended = place.run(&[&["plot", "flown"], &request[..]].concat());
        assert_eq!((ended.code, ended.stderr.lines().count()), (Some(2), 1), "{request:?}: {ended:?}");
        assert!(ended.stderr.starts_with("skysink: sweep flown: ") && ended.stderr.contains(says), "{ended:?}");
    }
    for (request, says) in [
        (with(&["--title", "日"]), "--title 日: '日' is not in the embedded font: expected Latin, Greek"),
        (with(&["--y", "loss"]), "[possible values: loss_rate, eta_letter, "),
        (with(&["--y", "los_rate"]), "'loss_rate'"),
        (with(&["--width", "88"]), "expected a width from 50mm to 1000mm"),
        (with(&["--log-y", "--difference-to", "uts"]), "cannot be used with"),
    ] {
        let ended = place.run(&[&["plot", "flown"], &request[..]].concat()).assert_code(2);
        assert!(ended.stderr.contains(says), "{request:?}: {ended:?}");
    }
    place.run_refused(&["plot", "nothing", "--x", "slots"], "expected the folder of a sweep");
    assert!(!place.path("flown/plots").exists());
}

#[test]
fn what_is_incomplete_is_left_out_and_said_so() {
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
    assert_eq!(said, "skysink: 51 of 54 missions are present; omitted: area.side_m = 60\n");
    let none = place.run(&["plot", "flown", "--x", "link.gain", "--where", "area.side_m=60", "--strategies", "gfs"]);
    assert_eq!(none.code, Some(0), "per-slot is whole: {none:?}");
    place.write("flown/journal.csv", "");
    place.run_refused(&[&["plot", "flown"], &request[..]].concat(), "0 of 54 missions are present");
}
