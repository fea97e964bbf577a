//! Shared by the tests of missions.

use std::path::Path;

use skysink_common::scenario::{Overrides, Scenario};
use skysink_planner::settings;

/// The scenario of this text, with a strategy and its settings.
pub fn scenario_of(text: &str, strategy: &'static str) -> Scenario {
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    Scenario::parse(text, Path::new("test.toml"), overrides).and_then(settings::resolve).unwrap()
}
