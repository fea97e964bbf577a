//! Scenarios and sensor lists: what is accepted, and that what is written reads back as the same mission.

use std::path::Path;

use expect_test::expect_file;
use proptest::prelude::*;
use skysink_common::channel::{Channel, GainMode, LosCurve};
use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario, SensorKeys};
use skysink_common::sensors::{Sensor, SensorList};

fn parse(text: &str) -> Result<Scenario, InputError> {
    Scenario::parse(text, Path::new("folder/city.toml"), Overrides::default())
}

fn refusal(text: &str) -> String {
    parse(text).unwrap_err().to_string()
}

#[test]
fn defaults_are_the_papers_values() {
    let letter = Scenario::letter(Overrides::default()).unwrap();
    let mut short = parse("name = \"letter\"\n").unwrap();
    short.path = letter.path.clone();
    short.planner = letter.planner.clone(); // the planner fills in its own defaults
    assert_eq!(short, letter);
    assert_eq!((letter.slots, letter.slot_s, letter.reach_m()), (600, 1.0, 30.0));
    assert_eq!((letter.link.resource_blocks, letter.link.gain), (4, Some(GainMode::Static)));
    assert!((letter.link.noise_w() - 1e-13).abs() < 1e-27); // −100 dBm
    assert_eq!(letter.sensors.sampling_bps.ends(), [100.0; 2]);
}

#[test]
fn a_resolved_scenario_is_the_same_scenario() {
    let text = "name = \"odd\"\nslots = 7\nslot_s = 0.1\n[area]\nwidth_m = 80.5\nheight_m = 60.25\n[link]\ncomm_s = 0.03\n\
                gain_db = -51.5\ngain = \"per-slot\"\nnoise_dbm = -97.3\n[planner]\nstrategy = \"gfs\"\n";
    let scenario = parse(text).unwrap();
    assert_eq!(parse(&scenario.to_toml()).unwrap(), scenario);
    assert_eq!(scenario.link.gain_range_db(), [-51.5, -51.5]);
    assert_eq!((scenario.start().x, scenario.start().y), (40.25, 30.125));
}

#[test]
fn whole_numbers_may_have_an_exponent_or_a_point() {
    let text = |slots: &str, bits: &str| format!("name = 'x'\nslots = {slots}\nsensors.capacity_bits = {bits}\n");
    let written = parse(&text("2e2", "[2e4, 30000.0]")).unwrap();
    assert_eq!(written.to_toml(), parse(&text("200", "[20000, 30000]")).unwrap().to_toml());
    assert!(refusal(&text("1.5", "30000")).ends_with("slots = 1.5: expected a whole number"));
}

#[test]
fn planner_keys_are_preserved_and_hashed() {
    let text = "name = \"x\"\n[planner]\nstrategy = \"my-own\"\nsteps = 5\n[planner.my-own]\ndepth = 3\n";
    let scenario = parse(text).unwrap();
    assert_eq!(scenario.planner.strategy, "my-own");
    assert_eq!(scenario.planner.others["my-own"]["depth"].as_integer(), Some(3));
    assert_eq!(parse(&scenario.to_toml()).unwrap(), scenario);
    assert_ne!(scenario.hash(), parse(&text.replace("depth = 3", "depth = 4")).unwrap().hash());
    assert_eq!(parse("name = \"x\"\n").unwrap().planner.strategy, "uts");
}

#[test]
fn sampling_rates_and_initial_queues_are_drawn_between_their_ends() {
    let text = "name = \"x\"\n[sensors]\ncount = 10000\nsampling_bps = [50, 150.0]\ncapacity_bits = 1000000\n\
                initial_queue_mean_bits = [0.0, 20000.0]\n";
    let scenario = parse(text).unwrap();
    assert_eq!(parse(&scenario.to_toml()).unwrap(), scenario);
    assert!(scenario.to_toml().contains("\nsampling_bps = [50.0, 150.0]\n"), "{}", scenario.to_toml());
    let SensorKeys { sampling_bps, initial_queue_mean_bits, .. } = scenario.sensors;
    assert_eq!((sampling_bps.mean(), initial_queue_mean_bits.mean()), (100.0, 10_000.0));
    let list = SensorList::of(&scenario).unwrap();
    let mean = |value: &dyn Fn(usize) -> f64| (0..10_000).map(value).sum::<f64>() / 10_000.0;
    let sensors = list.sensors();
    assert!(sensors.iter().all(|sensor| (50.0..150.0).contains(&sensor.sampling_bps)));
    // Five standard errors: uniform over 100 bit/s has deviation 28.9, over 20 000 bit 5 774 (the Poisson's 100 is
    // little).
    let rate = |id: usize| sensors[id].sampling_bps;
    let queue = |id: usize| f64::from(sensors[id].queue_bits);
    assert!((mean(&rate) - 100.0).abs() < 1.45);
    assert!((mean(&queue) - 10_000.0).abs() < 290.0);
    // Rates, queues and positions are uncorrelated; a correlation has deviation 0.01.
    let together = |a: &dyn Fn(usize) -> f64, b: &dyn Fn(usize) -> f64| {
        let mean_a = mean(a);
        let mean_b = mean(b);
        let covariance = |a: &dyn Fn(usize) -> f64, b: &dyn Fn(usize) -> f64, mean_a: f64, mean_b: f64| {
            mean(&|id| (a(id) - mean_a) * (b(id) - mean_b))
        };
        let deviations = (covariance(a, a, mean_a, mean_a) * covariance(b, b, mean_b, mean_b)).sqrt();
        covariance(a, b, mean_a, mean_b) / deviations
    };
    assert!(together(&rate, &queue).abs() < 0.05);
    assert!(together(&rate, &|id| sensors[id].position.x).abs() < 0.05);
    assert!(together(&queue, &|id| sensors[id].gain_db).abs() < 0.05);
}

#[test]
fn drawing_rates_does_not_change_other_draws() {
    let plain = SensorList::of(&Scenario::letter(Overrides::default()).unwrap()).unwrap();
    let drawn = parse("name = \"x\"\n[sensors]\nsampling_bps = [50.0, 150.0]\n").unwrap();
    let drawn = SensorList::of(&drawn).unwrap();
    let wide = parse("name = \"x\"\n[sensors]\ninitial_queue_mean_bits = [0.0, 20000.0]\n").unwrap();
    let wide = SensorList::of(&wide).unwrap();
    for ((plain, drawn), wide) in plain.sensors().iter().zip(drawn.sensors()).zip(wide.sensors()) {
        assert_eq!(Sensor { sampling_bps: plain.sampling_bps, ..*drawn }, *plain);
        assert_eq!(Sensor { queue_bits: plain.queue_bits, ..*wide }, *plain);
    }
    // Golden: a change here is value-breaking.
    assert_eq!(
        drawn.sensors()[..2].iter().map(|sensor| sensor.sampling_bps).collect::<Vec<_>>(),
        [117.11838110034147, 116.93695663898046]
    );
    assert_eq!(wide.queues_bits()[..3], [2936, 19557, 2384]);
    // The list has priority; missing values are drawn by row.
    let scenario = parse("name = \"x\"\n[sensors]\nsampling_bps = [50.0, 150.0]\n").unwrap();
    let list = SensorList::parse("x_m,y_m,sampling_bps\n1,2,7\n", Path::new("l.csv"), &scenario).unwrap();
    assert_eq!(list.sensors()[0].sampling_bps, 7.0);
    let list = SensorList::parse("x_m,y_m\n1,2\n3,4\n", Path::new("l.csv"), &scenario).unwrap();
    assert_eq!(list.sensors()[1].sampling_bps, drawn.sensors()[1].sampling_bps);
}

#[test]
fn the_path_of_a_list_is_relative_to_the_scenario() {
    let scenario = parse("name = \"x\"\n[sensors]\nfile = \"sub/list.csv\"\n").unwrap();
    assert_eq!(scenario.sensor_file(), Some("folder/sub/list.csv".into()));
}

#[test]
fn overrides_enter_the_resolved_scenario_and_its_hash() {
    let overrides = Overrides { seed: Some(9), strategy: Some("rfs"), ..Overrides::default() };
    let plain = Scenario::letter(Overrides::default()).unwrap();
    let other = Scenario::letter(overrides).unwrap();
    assert!(other.to_toml().contains("seed = 9") && other.to_toml().contains("strategy = \"rfs\""));
    assert_ne!(plain.hash(), other.hash());
    // The copy in a run folder names a list instead of a count: the same mission.
    assert_eq!(parse(&plain.to_toml_with_list("sensors.csv")).unwrap().hash(), plain.hash());
}

/// Each text of the file is refused with the line below it.
#[test]
fn a_refusal_names_the_file_the_key_the_value_and_what_was_expected() {
    let file = expect_file!["refusals.txt"];
    let data = file.data();
    let refused = data.trim_end().split("\n\n").map(|block| {
        let text: String = block.split_inclusive('\n').filter(|line| !line.starts_with("scenario ")).collect();
        format!("{text}{}\n", refusal(&text))
    });
    file.assert_eq(&refused.collect::<Vec<_>>().join("\n"));
}

#[test]
fn the_probabilistic_model_has_its_own_keys_and_defaults() {
    let scenario = parse("name = \"x\"\n[uav]\naltitude = \"free\"\n[link]\nmodel = \"probabilistic-los\"\n").unwrap();
    let los = Channel::of(&scenario.link).line_of_sight().unwrap().clone();
    let climb = scenario.uav.climb().unwrap();
    assert_eq!(los.curve(), Some(&LosCurve::Sigmoid { a: 9.61, b: 0.16 }), "urban");
    // p β0/(σ² Γ) = 0.05 · 10^−6/(10^−13 · 10^0.82), and μ = 0.01
    assert!((los.los_snr / (5e5 / 10f64.powf(0.82)) - 1.0).abs() < 1e-12);
    assert!((los.nlos_snr / los.los_snr - 0.01).abs() < 1e-15);
    assert_eq!((climb.min_altitude_m, climb.max_altitude_m, climb.max_climb_mps), (20.0, 120.0, 5.0));
    assert_eq!(scenario.altitudes_m(22.0), [20.0, 27.0]);
    assert_eq!(parse(&scenario.to_toml()).unwrap(), scenario);
    for key in ["environment = \"urban\"", "snr_gap_db = 8.2", "min_altitude_m = 20.0"] {
        assert!(scenario.to_toml().contains(key), "{key}");
    }
    let list = SensorList::parse("x_m,y_m,gain_db\n1,2,-51\n", Path::new("l.csv"), &scenario).unwrap();
    assert_eq!(list.sensors()[0].gain_db, -60.0, "one reference gain for all");
}

#[test]
fn noise_is_given_as_power_or_density_and_fading_by_its_factor() {
    // -167 dBm/Hz · 5 kHz = 10^−19.7 W/Hz · 5e3 Hz
    let scenario = parse("name = \"x\"\n[link]\nnoise_dbm_per_hz = -167\nbandwidth_hz = 5e3\n").unwrap();
    assert!((scenario.link.noise_w() / (10f64.powf(-19.7) * 5e3) - 1.0).abs() < 1e-12);
    assert_eq!((scenario.link.noise_dbm, scenario.link.k_db), (None, None));
    let faded = parse("name = \"x\"\n[link]\nfading = \"rician\"\n").unwrap();
    assert_eq!(faded.link.k_db, Some(10.0));
    let rayleigh = parse("name = \"x\"\n[link]\nfading = \"rician\"\nk_db = -inf\n").unwrap();
    for scenario in [&scenario, &faded, &rayleigh] {
        assert_eq!(&parse(&scenario.to_toml()).unwrap(), scenario);
    }
    let letter = parse("name = \"x\"\n").unwrap().to_toml();
    for key in ["noise_dbm_per_hz", "fading", "k_db", "los_correlation_m"] {
        assert!(!letter.contains(key), "{key}");
    }
}

#[test]
fn a_drawn_list_is_stable() {
    let scenario = Scenario::letter(Overrides::default()).unwrap();
    let list = SensorList::of(&scenario).unwrap();
    assert_eq!(list.sensors().len(), 200);
    let csv = list.to_csv();
    let first: Vec<_> = csv.lines().take(3).collect();
    assert_eq!(first, GOLDEN);
}

/// A change here is value-breaking.
const GOLDEN: [&str; 3] = [
    "x_m,y_m,queue_bits,gain_db,sampling_bps",
    "23.552759232624066,82.97170553216704,9929,-52.483535711451864,100",
    "18.395975481743854,61.90525892498139,10153,-54.44661010255869,100",
];

#[test]
fn a_drawn_field_has_the_distributions_of_its_scenario() {
    let scenario = parse("name = \"x\"\n[sensors]\ncount = 10000\n").unwrap();
    let list = SensorList::of(&scenario).unwrap();
    let mean = |value: &dyn Fn(usize) -> f64| (0..10_000).map(value).sum::<f64>() / 10_000.0;
    let sensors = list.sensors();
    // Five standard errors: uniform on 100 m has deviation 28.9 m, uniform on 5 dB 1.44 dB, Poisson(10 000) 100 bit.
    assert!((mean(&|id| sensors[id].position.x) - 50.0).abs() < 1.45);
    assert!((mean(&|id| sensors[id].position.y) - 50.0).abs() < 1.45);
    assert!((mean(&|id| sensors[id].gain_db) + 52.5).abs() < 0.073);
    assert!((mean(&|id| f64::from(sensors[id].queue_bits)) - 10_000.0).abs() < 5.0);
    let deviation = mean(&|id| (f64::from(sensors[id].queue_bits) - 10_000.0).powi(2)).sqrt();
    assert!((deviation - 100.0).abs() < 5.0, "{deviation}");
    assert!(sensors.iter().all(|sensor| (-55.0..=-50.0).contains(&sensor.gain_db)));
}

#[test]
fn initial_queues_are_capped_at_the_buffer() {
    let scenario = parse("name = \"x\"\n[sensors]\ncapacity_bits = 9000\n").unwrap();
    assert!(SensorList::of(&scenario).unwrap().queues_bits().iter().all(|&queue| queue == 9000));
    let empty = parse("name = \"x\"\n[sensors]\ninitial_queue_mean_bits = 0.0\n").unwrap();
    assert!(SensorList::of(&empty).unwrap().queues_bits().iter().all(|&queue| queue == 0));
}

#[test]
fn missing_columns_are_filled_from_the_seed_and_the_scenario() {
    let scenario = parse("name = \"x\"\n[sensors]\nsampling_bps = 70.0\n").unwrap();
    let drawn = SensorList::of(&scenario).unwrap();
    let list = SensorList::parse("gain_db,y_m,x_m\n-51.0,2,1\n-52.0,4,3\n", Path::new("l.csv"), &scenario).unwrap();
    assert_eq!(list.sensors()[1].position, [3.0, 4.0].into());
    assert_eq!((list.sensors()[1].gain_db, list.sensors()[1].sampling_bps), (-52.0, 70.0));
    assert_eq!(list.queues_bits(), drawn.queues_bits()[..2]);
}

#[test]
fn batteries_are_those_of_the_list_or_else_of_the_scenario() {
    let parse_list = |keys: &str, csv: &str| {
        let scenario = parse(&format!("name = \"x\"\n[sensors]\nfile = \"l.csv\"\n{keys}")).unwrap();
        SensorList::parse(csv, Path::new("l.csv"), &scenario)
    };
    let energy = "[sensors.energy]\nharvest_w = 0.5\n";
    let list = parse_list(energy, "x_m,y_m,capacity_j\n1,2,30\n3,4,40\n").unwrap();
    let batteries = list.columns().iter().map(|column| (column.name, &column.values[..]));
    assert!(batteries.eq([("capacity_j", &[30.0, 40.0][..]), ("harvest_w", &[0.5, 0.5])]));
    assert!(list.to_csv().starts_with("x_m,y_m,queue_bits,gain_db,sampling_bps,capacity_j,harvest_w\n"));
    assert_eq!(parse_list(energy, &list.to_csv()).unwrap(), list, "as in a run folder");
    let plain = parse_list("[sensors.energy]\ncapacity_j = 7.0\n", "x_m,y_m,harvest_w\n1,2,0\n").unwrap();
    assert!(!plain.to_csv().contains("harvest_w"), "the scenario tells them");
    for (keys, csv, expected) in [
        (
            energy,
            "x_m,y_m\n1,2\n",
            "header `x_m,y_m`: expected a column capacity_j, or sensors.energy.capacity_j in the scenario",
        ),
        (energy, "x_m,y_m,capacity_j\n1,2,0\n", "line 2: capacity_j = 0: expected joules above 0, at most 1e9"),
        (
            energy,
            "x_m,y_m,capacity_j,harvest_w\n1,2,1,-1\n",
            "line 2: harvest_w = -1: expected a finite number, 0 or above",
        ),
        (energy, "x_m,y_m,capacity_j,capacity_bits\n1,2,1,4294967296\n", "expected whole bits, 1 to 4294967295"),
        (
            "",
            "x_m,y_m,capacity_j\n1,2,1\n",
            "column `capacity_j`: expected it only with [sensors.energy] in the scenario",
        ),
    ] {
        let error = parse_list(keys, csv).unwrap_err().to_string();
        assert!(error.ends_with(expected), "{error}");
    }
}

#[test]
fn buffers_are_drawn_between_their_ends_as_whole_bits_and_written_if_they_differ() {
    let of = |keys: &str| parse(&format!("name = \"x\"\n[sensors]\ncount = 10000\n{keys}")).unwrap();
    let one = of("capacity_bits = 30000\n");
    assert!(one.to_toml().contains("\ncapacity_bits = 30000\n"), "{}", one.to_toml());
    let plain = SensorList::of(&one).unwrap();
    assert!(plain.to_csv().starts_with("x_m,y_m,queue_bits,gain_db,sampling_bps\n"), "no further column");
    let wide = of("capacity_bits = [5000, 15000]\n");
    assert!(wide.to_toml().contains("\ncapacity_bits = [5000, 15000]\n"), "{}", wide.to_toml());
    assert_eq!(parse(&wide.to_toml()).unwrap(), wide);
    let list = SensorList::of(&wide).unwrap();
    for (drawn, plain) in list.sensors().iter().zip(plain.sensors()) {
        assert!((5_000..=15_000).contains(&drawn.capacity_bits));
        let queue_bits = plain.queue_bits.min(drawn.capacity_bits);
        assert_eq!(Sensor { capacity_bits: 30_000, queue_bits: plain.queue_bits, ..*drawn }, *plain);
        assert_eq!(drawn.queue_bits, queue_bits, "capped at its own buffer");
    }
    // Five standard errors: uniform over 10 000 bit has deviation 2 887.
    let mean = list.sensors().iter().map(|sensor| f64::from(sensor.capacity_bits)).sum::<f64>() / 10_000.0;
    assert!((mean - 10_000.0).abs() < 145.0, "{mean}");
    let few = SensorList::of(&of("capacity_bits = [1, 2]\ninitial_queue_mean_bits = 0.0\n")).unwrap();
    let ones = few.sensors().iter().filter(|sensor| sensor.capacity_bits == 1).count();
    assert!((4_750..=5_250).contains(&ones), "{ones} of 10 000 have 1 bit: both ends are as likely");
    assert_eq!(SensorList::parse(&list.to_csv(), Path::new("l.csv"), &one).unwrap(), list);
}

#[test]
fn buffers_and_weights_of_a_list_have_priority_and_others_are_refused() {
    let scenario = parse("name = \"x\"\n").unwrap();
    let read = |rows: &str| SensorList::parse(&format!("x_m,y_m,{rows}"), Path::new("l.csv"), &scenario);
    let list = read("capacity_bits,weight\n1,2,500,2.5\n3,4,70000,1\n").unwrap();
    let found: Vec<_> = list.sensors().iter().map(|sensor| (sensor.capacity_bits, sensor.weight)).collect();
    assert_eq!(found, [(500, 2.5), (70_000, 1.0)]);
    assert_eq!(list.queues_bits()[0], 500, "drawn about 10 000 bit, capped at the own buffer");
    assert!(list.to_csv().starts_with("x_m,y_m,queue_bits,gain_db,sampling_bps,capacity_bits,weight\n"));
    assert_eq!(SensorList::parse(&list.to_csv(), Path::new("l.csv"), &scenario).unwrap(), list);
    assert!(!read("weight\n1,2,1\n").unwrap().to_csv().contains("weight"), "weights of 1 are not written");
    let equal = read("capacity_bits\n1,2,500\n3,4,500\n").unwrap();
    assert!(equal.to_csv().contains("capacity_bits"), "equal buffers are, unless they are the scenario's");
    assert_eq!(SensorList::parse(&equal.to_csv(), Path::new("l.csv"), &scenario).unwrap(), equal);
    assert!(!read("capacity_bits\n1,2,30000\n").unwrap().to_csv().contains("capacity_bits"));
    let refused = |rows: &str, message: &str| {
        let error = read(rows).unwrap_err().to_string();
        assert_eq!(error, format!("sensor list l.csv: line 2: {message}"));
    };
    for weight in ["0", "-1", "NaN", "inf", "1e300", "1e-7", "much"] {
        refused(
            &format!("weight\n1,2,{weight}\n"),
            &format!("weight = {weight}: expected a weight from 0.000001 to 1000000"),
        );
    }
    for buffer in ["0", "-1", "NaN", "inf", "1e300", "0.5", "4294967296"] {
        let expected = "expected whole bits, 1 to 4294967295";
        refused(&format!("capacity_bits\n1,2,{buffer}\n"), &format!("capacity_bits = {buffer}: {expected}"));
    }
    refused("queue_bits,capacity_bits\n1,2,60,50\n", "queue_bits = 60: expected whole bits, 0 to the buffer's 50");
}

#[test]
fn a_list_whose_bits_overflow_the_counters_is_refused() {
    let scenario = parse("name = \"x\"\nslots = 1\n").unwrap();
    let rows = |count| format!("x_m,y_m,sampling_bps\n{}", "1,2,9e15\n".repeat(count));
    assert!(SensorList::parse(&rows(1000), Path::new("l.csv"), &scenario).is_ok());
    let error = SensorList::parse(&rows(1001), Path::new("l.csv"), &scenario).unwrap_err().to_string();
    let expected = "at most 9e18 bits over the mission from all sensor nodes";
    assert_eq!(error, format!("sensor list l.csv: line 1002: sampling_bps = 9000000000000000: expected {expected}"));
}

#[test]
fn list_errors_are_one_line_for_any_content() {
    let scenario = parse("name = \"x\"\n").unwrap();
    let error = SensorList::parse("x_m,y_m\n\"1\n2\",3\n", Path::new("l.csv"), &scenario).unwrap_err();
    assert_eq!(error.to_string(), "sensor list l.csv: line 2: x_m = 1\\n2: expected a position in the area, 0 to 100");
}

proptest! {
    #[test]
    fn a_written_list_reads_back_exactly(
        rows in prop::collection::vec(
            (0.0f64..=100.0, 0.0f64..=100.0, 0u32..=30_000, -300.0f64..=0.0, 0.0f64..1e6),
            1..20,
        ),
    ) {
        let scenario = parse("name = \"x\"\n").unwrap();
        let text: String = rows.iter().map(|(x, y, q, g, s)| format!("{x},{y},{q},{g},{s}\n")).collect();
        let text = format!("x_m,y_m,queue_bits,gain_db,sampling_bps\n{text}");
        let list = SensorList::parse(&text, Path::new("l.csv"), &scenario).unwrap();
        for (sensor, (x, y, q, g, s)) in list.sensors().iter().zip(rows) {
            prop_assert_eq!((sensor.position, sensor.queue_bits), ([x, y].into(), q));
            prop_assert_eq!((sensor.gain_db, sensor.sampling_bps), (g, s));
        }
        prop_assert_eq!(SensorList::parse(&list.to_csv(), Path::new("l.csv"), &scenario).unwrap(), list);
    }

    #[test]
    fn no_text_makes_the_readers_panic(text in "\\PC{0,200}", tail in "[-0-9a-z_.,=\"\\[\\]\n ]{0,200}") {
        let scenario = parse("name = \"x\"\n").unwrap();
        for text in [&text, &tail, &format!("name = \"x\"\n{tail}"), &format!("x_m,y_m\n{tail}")] {
            let _ = parse(text);
            let _ = SensorList::parse(text, Path::new("l.csv"), &scenario);
        }
    }
}
