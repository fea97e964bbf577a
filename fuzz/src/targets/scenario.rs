//! The scenario reader.

use std::path::Path;

use skysink_common::scenario::{Overrides, Scenario};
use skysink_planner::settings;

/// A text is refused in one line, or is a scenario that reads back as itself.
///
/// # Panics
/// If it is neither.
pub fn scenario(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let parse = |text: &str| {
        Scenario::parse(text, Path::new("folder/city.toml"), Overrides::default()).and_then(settings::resolve)
    };
    match parse(text) {
        Err(error) => super::assert_one_line(&error),
        Ok(scenario) => {
            let written = scenario.to_toml();
            let again = parse(&written).unwrap_or_else(|error| panic!("{error}\n{written}"));
            assert_eq!(again, scenario);
            assert_eq!((again.to_toml(), again.hash()), (written, scenario.hash()));
            let flown = parse(&scenario.to_toml_with_list("sensors.csv")).expect("the run's own copy is a scenario");
            assert_eq!(flown.hash(), scenario.hash());
        }
    }
}
