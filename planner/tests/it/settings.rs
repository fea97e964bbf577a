//! `[planner]` of a scenario: what is accepted, and that what is written reads back as the same mission.

use std::path::Path;

use expect_test::expect_file;
use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_planner::Planner;
use skysink_planner::plan::keys::HorizonKeys;
use skysink_planner::settings::{Knowledge, Rates, Settings, WaypointSolver, change, resolve};
use skysink_planner::strategies::horizon;

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
                price_bits2_per_j = 300000.0\n\n[planner.horizon]\niterations = 6000\n\n[planner.best-of]\n\
                iterations = 6000\nsimulated_slots = 50\nwindow = 100\n\n[planner.offline]\nsteps = 1000000\n\n[planner.sca]\niterations = 20\n";
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

/// Each text of the file is refused with the line below it.
#[test]
fn a_refusal_names_the_file_the_key_the_value_and_what_was_expected() {
    let file = expect_file!["refusals.txt"];
    let data = file.data();
    let refused = data.trim_end().split("\n\n").map(|block| {
        let text: String = block.split_inclusive('\n').filter(|line| !line.starts_with("scenario ")).collect();
        format!("{text}{}\n", city(&text).unwrap_err())
    });
    file.assert_eq(&refused.collect::<Vec<_>>().join("\n"));
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
