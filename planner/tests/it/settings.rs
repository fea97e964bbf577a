//! `[planner]` of a scenario: what is accepted, and that what is written reads back as the same mission.

use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_planner::Planner;
use skysink_planner::horizon::HorizonKeys;
use skysink_planner::settings::{Knowledge, Rates, Settings, WaypointSolver, change, resolve};
use skysink_planner::strategies::horizon;
use skysink_planner::strategies::names;

fn city(text: &str) -> Result<Scenario, InputError> {
    let text = format!("name = \"x\"\n{text}");
    Scenario::parse(&text, Path::new("folder/city.toml"), Overrides::default()).and_then(resolve)
}

#[test]
fn planner_defaults_are_the_papers_values_and_visible() {
    let scenario = Scenario::letter(Overrides::default()).and_then(resolve).unwrap();
    let settings = Settings::of(&scenario).unwrap();
    assert_eq!((&scenario.planner.strategy[..], settings.waypoint_solver), ("uts", WaypointSolver::Geometric));
    assert_eq!((settings.knowledge, settings.rates), (Knowledge::Oracle, Rates::Known));
    assert_eq!(settings, Settings::of(&city("").unwrap()).unwrap());
    let keys = "[planner]\nstrategy = \"uts\"\nsca_iterations = 1\nwaypoint_solver = \"geometric\"\nknowledge = \"oracle\"\n\
                rates = \"known\"\nobjective = \"loss\"\n\n[planner.mes]\ndeadline_weight = 0.1\n\n[planner.max-weight]\nservice = \"upload\"\n\n[planner.drift-plus-penalty]\n\
                price_bits2_per_j = 300000.0\n\n[planner.horizon]\niterations = 6000\n\n[planner.offline]\nsteps = 1000000\n";
    assert!(scenario.to_toml().ends_with(keys), "{}", scenario.to_toml());
}

#[test]
fn knowledge_keys_read_back_and_change_the_hash() {
    let cases = [
        ("", (Knowledge::Oracle, Rates::Known)),
        ("knowledge = \"estimated\"\n", (Knowledge::Estimated, Rates::Known)),
        ("knowledge = \"estimated\"\nrates = \"learnt\"\n", (Knowledge::Estimated, Rates::Learnt)),
    ];
    let scenarios = cases.map(|(keys, seen)| {
        let scenario = city(&format!("[planner]\n{keys}")).unwrap();
        let settings = Settings::of(&scenario).unwrap();
        assert_eq!((settings.knowledge, settings.rates), seen);
        let has_state = Planner::new(&scenario, &[]).unwrap().has_state();
        assert_eq!(has_state, seen.0 != Knowledge::Oracle, "uts has no other state");
        let again =
            Scenario::parse(&scenario.to_toml(), &scenario.path, Overrides::default()).and_then(resolve).unwrap();
        assert_eq!((&again, again.hash()), (&scenario, scenario.hash()));
        scenario
    });
    assert_eq!(scenarios.each_ref().map(|scenario| scenario.hash() == scenarios[0].hash()), [true, false, false]);
}

#[test]
fn a_refusal_names_the_file_the_key_the_value_and_what_was_expected() {
    let cases = [
        (
            "rates = \"learnt\"",
            "planner.rates = \"learnt\": expected \"known\", or planner.knowledge = \"estimated\", with which rates may be \
             learnt",
        ),
        ("sca_iterations = 0", "planner.sca_iterations = 0: expected 1 to 1000"),
        ("sca_iterations = -1", "planner.sca_iterations = -1: expected 1 to 1000"),
        (
            "sca_iterations = 1.0",
            "planner.sca_iterations = 1.0: expected a whole number, without decimal point or exponent",
        ),
        ("horizon.iterations = 2000000000", "planner.horizon.iterations = 2000000000: expected 0 to 1000000000"),
        ("offline.steps = 1000000000001", "planner.offline.steps = 1000000000001: expected 0 to 1000000000000"),
        ("horizon.budget_ms = 0.0", "planner.horizon.budget_ms = 0.0: expected milliseconds above 0, at most 3600000"),
        ("horizon.budget_ms = nan", "planner.horizon.budget_ms = nan: expected milliseconds above 0, at most 3600000"),
        ("horizon.window = 0", "planner.horizon.window = 0: expected 1 to 1000000"),
        (
            "horizon.without = \"tours\"",
            "planner.horizon.without = \"tours\": expected one of `nothing`, `rollouts`, `offers`, `annealing`, `groups`",
        ),
        ("horizon_iterations = 5", "planner.horizon_iterations = 5: expected planner.horizon.iterations instead"),
        ("horizon_budget_ms = 5.0", "planner.horizon_budget_ms = 5.0: expected planner.horizon.budget_ms instead"),
        ("offline_steps = 5", "planner.offline_steps = 5: expected planner.offline.steps instead"),
        (
            "horizon.steps = \"a\\nb\"",
            "planner.horizon.steps = \"a\\nb\": expected one of `iterations`, `window`, `without`, `budget_ms`",
        ),
        ("horizon = 3", "planner.horizon = 3: expected a table"),
        ("mes.deadline_weight = 1.5", "planner.mes.deadline_weight = 1.5: expected a weight from 0 to 1"),
        ("mes.deadline_weight = \"0\"", "planner.mes.deadline_weight = \"0\": expected a number"),
        ("mes.weight = 1.0", "planner.mes.weight = 1.0: expected `deadline_weight`"),
        (
            "drift-plus-penalty.price_bits2_per_j = -1.0",
            "planner.drift-plus-penalty.price_bits2_per_j = -1.0: expected bit²/J, 0 to 1e18",
        ),
        ("max-weight.service = \"rate\"", "planner.max-weight.service = \"rate\": expected `upload` or `capacity`"),
        ("drift-plus-penalty = 1", "planner.drift-plus-penalty = 1: expected a table"),
        ("waypoint_solver = 3", "planner.waypoint_solver = 3: expected a string"),
    ];
    for (key, expected) in cases {
        let refusal = city(&format!("[planner]\n{key}\n")).unwrap_err().to_string();
        assert_eq!(refusal, format!("scenario folder/city.toml: {expected}"));
    }
}

#[test]
fn an_unknown_strategy_or_key_is_refused_with_the_known_ones() {
    let refusal = |key: &str| city(&format!("[planner]\n{key}\n")).unwrap_err().to_string();
    let strategy = refusal("strategy = \"best\"");
    assert!(
        strategy.starts_with("scenario folder/city.toml: planner.strategy = \"best\": expected one of "),
        "{strategy}"
    );
    assert!(names().iter().all(|known| strategy.contains(&format!("`{}`", known))), "{strategy}");
    let key = refusal("tour.length = 3");
    assert!(key.starts_with("scenario folder/city.toml: planner.tour = { length = 3 }: expected one of "), "{key}");
    assert!(key.contains("`strategy`, `sca_iterations`") && key.contains("`horizon`"), "{key}");
}

#[test]
fn a_planner_needs_checked_keys() {
    let overrides = Overrides { strategy: Some("best"), ..Overrides::default() };
    let unknown = Scenario::letter(overrides).unwrap();
    assert!(Planner::new(&unknown, &[]).is_err());
    let learnt = change(city("").unwrap(), |settings| settings.rates = Rates::Learnt);
    assert!(learnt.unwrap_err().to_string().contains("planner.rates"));
    let mut longer = city("").unwrap();
    horizon::STRATEGY.set_keys(&mut longer, HorizonKeys::of(u32::MAX));
    let refusal = longer.planner_keys::<HorizonKeys>("planner.horizon").unwrap_err().to_string();
    assert!(refusal.ends_with("planner.horizon.iterations = 4294967295: expected 0 to 1000000000"), "{refusal}");
}
