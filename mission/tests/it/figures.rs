//! The table of figures: keys of the summary, columns of sweeps, rows of the printed report, and what a replay takes
//! from where.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;

use serde_json::{Map, Value};
use skysink_common::figure::{FigureKind, FigureSource, Printed};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_mission::figures::Summary;
use skysink_mission::meter::MissionMeter;
use skysink_mission::metrics::Metric;
use skysink_mission::origin::RunMode;
use skysink_mission::tally::Tally;
use skysink_planner::settings;

/// Two UAVs with batteries over sensor nodes that have batteries, a duty cycle, weights and bits that expire.
const EVERYTHING: &str = "\
name = 'x'
slots = 40
[sensors]
sampling_bps = [50.0, 900.0]
expiry_s = 12.0
deadline_s = 9.0
energy.capacity_j = 2.0
energy.sleep_w = 0.01
energy.tx_w = 20.0
[link]
duty_cycle = 2e-5
duty_window_s = 40.0
setup_s = 0.01
[uav]
count = 2
battery.capacity_j = 2e4
[base]
charge_w = 500.0
";

fn scenario(text: &str) -> Scenario {
    let overrides = Overrides { strategy: Some("max-weight"), ..Overrides::default() };
    Scenario::parse(text, Path::new("x.toml"), overrides).and_then(settings::resolve).unwrap()
}

/// 30 sensor nodes in rows, with weights where bits expire.
fn sensors(scenario: &Scenario) -> SensorList {
    let weight = |id: u32| if scenario.sensors.expiry_s.is_some() { 1 + id % 2 } else { 1 };
    let row = |id: u32| format!("{},{},{}\n", 10 + id % 6 * 16, 10 + id / 6 * 20, weight(id));
    let text = format!("x_m,y_m,weight\n{}", (0..30).map(row).collect::<String>());
    SensorList::parse(&text, Path::new("l.csv"), scenario).unwrap()
}

fn flown(scenario: &Scenario) -> Summary {
    let list = sensors(scenario);
    let mut tally = Tally::new(scenario, &list, &RunMode::default());
    Mission::new(scenario, &list).unwrap().drive(&mut [&mut tally], &Stop::default()).unwrap();
    tally.summary(Duration::from_secs(1), 7)
}

fn keys(summary: &Summary) -> Map<String, Value> {
    let Value::Object(keys) = serde_json::to_value(summary).unwrap() else { panic!("an object") };
    keys
}

/// Another value of the same type.
fn other(value: &Value) -> Value {
    match value {
        Value::Null => 3.into(),
        Value::Bool(is) => (!is).into(),
        Value::Number(number) if number.is_u64() => (number.as_u64().unwrap() + 1).into(),
        Value::Number(number) => (number.as_f64().unwrap() + 0.5).into(),
        Value::String(text) => format!("{text}0").into(),
        Value::Array(_) => Value::Array(Vec::new()),
        Value::Object(keys) => {
            let is_fixed = |key: &str, value: &Value| key == "pace" || value.is_null();
            let changed = |(key, value): (&String, &Value)| {
                (key.clone(), if is_fixed(key, value) { value.clone() } else { other(value) })
            };
            keys.iter().map(changed).collect::<Map<_, _>>().into()
        }
    }
}

/// A summary in which every key has another value.
fn forged(summary: &Summary) -> Summary {
    let keys = keys(summary).into_iter().map(|(key, value)| (key, other(&value)));
    serde_json::from_value(Value::Object(keys.collect())).unwrap()
}

#[test]
fn the_keys_of_the_summary_are_those_of_the_table_in_its_order() {
    let text = serde_json::to_string_pretty(&flown(&scenario(EVERYTHING))).unwrap();
    let keys: Vec<&str> =
        text.lines().filter_map(|line| line.strip_prefix("  \"")).filter_map(|line| line.split('"').next()).collect();
    let absent = ["completed_s", "score", "objective", "search"];
    let figures = Summary::FIGURES.iter().filter(|figure| figure.of_key.is_some()).map(|figure| figure.name);
    assert!(keys.iter().copied().eq(figures.filter(|name| !absent.contains(name))), "{text}");
}

#[test]
fn every_figure_is_defined_and_every_shown_one_is_named() {
    let mut names = BTreeSet::new();
    for figure in Summary::FIGURES {
        assert!(names.insert(figure.name), "{}: there are two", figure.name);
        assert!(figure.definition.trim().ends_with('.'), "{}: {}", figure.name, figure.definition);
        let is_shown = matches!(figure.report, Printed::Number(_) | Printed::Text(_));
        let is_named = !figure.label.is_empty() || !figure.heading.is_empty();
        assert!(is_named || !is_shown, "{}: expected a heading", figure.name);
        assert!(!figure.label.is_empty() || figure.of_column.is_none(), "{}: expected a label", figure.name);
        assert!(figure.kind != FigureKind::Other || figure.of_column.is_none(), "{}: expected a number", figure.name);
    }
    assert_eq!(Metric::all().map(Metric::name).collect::<BTreeSet<_>>().len(), Metric::ALL.len());
}

#[test]
fn a_replay_takes_each_figure_from_what_it_knows() {
    let run = flown(&scenario(EVERYTHING));
    for known in [FigureSource::Trace, FigureSource::Answers, FigureSource::Links] {
        let mut replayed = forged(&run);
        let written = keys(&replayed);
        replayed.recompute(run.clone(), known);
        let [replayed, again] = [keys(&replayed), keys(&run)];
        for figure in Summary::FIGURES.iter().filter(|figure| again.contains_key(figure.name)) {
            let name = figure.name;
            let mut expected = if figure.source <= known { again[name].clone() } else { written[name].clone() };
            if name == "fleet" {
                expected["contended"] = written[name]["contended"].clone(); // only the run knows
            }
            assert!(written[name] != again[name] || again[name] == Value::Array(Vec::new()), "{name} is not forged");
            assert_eq!(replayed[name], expected, "{name} of {known:?}");
        }
    }
}

#[test]
fn columns_that_are_keys_have_the_values_of_the_summary() {
    for text in [EVERYTHING, "name = 'x'\nslots = 40\n"] {
        let scenario = scenario(text);
        let list = sensors(&scenario);
        let mut meter = MissionMeter::new(&scenario, &list);
        let mut mission = Mission::new(&scenario, &list).unwrap();
        mission.drive(&mut [&mut meter], &Stop::default()).unwrap();
        let values = meter.values(mission.plant(), None, None);
        let summary = meter.tally().summary(Duration::ZERO, 0);
        for metric in Metric::all().filter(|metric| metric.name() != "objective") {
            let Some(of_key) = metric.figure().of_key else { continue };
            let expected = of_key(&summary);
            let value = values[metric as usize];
            assert!(
                value == expected || (value.is_nan() && expected.is_nan()),
                "{}: {value}, {expected}",
                metric.name()
            );
        }
        // The loss is no objective of ages, and so no key; its column is the cost.
        assert_eq!((summary.objective, values[Metric::Objective as usize]), (None, meter.tally().sums.lost_bits()));
    }
}

#[test]
fn a_resumed_run_counts_anew_what_only_it_knows() {
    let scenario = scenario(EVERYTHING);
    let list = sensors(&scenario);
    let mut tally = Tally::new(&scenario, &list, &RunMode::default());
    Mission::new(&scenario, &list).unwrap().drive(&mut [&mut tally], &Stop::default()).unwrap();
    [tally.counts.solver_fallbacks, tally.counts.refused] = [5, 7];
    tally.resume();
    assert_eq!((tally.counts.solver_fallbacks, tally.counts.refused), (0, 7));
}

#[test]
fn the_printed_report_has_the_rows_of_the_table() {
    let summary = flown(&scenario("name = 'x'\nslots = 40\n"));
    let rows: Vec<String> = Summary::FIGURES
        .iter()
        .flat_map(|figure| figure.rows(&summary))
        .map(|row| format!("{}: {}", row.heading, row.value))
        .collect();
    assert_eq!(rows[0], format!("data loss rate η: {:.6}", summary.loss_rate));
    assert!(rows.contains(&"slots held: 0".to_owned()) && rows.iter().all(|row| !row.contains("weighted")), "{rows:?}");
}
