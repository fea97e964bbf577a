//! Values of options that several commands take.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use skysink_planner::strategies::{Registered, STRATEGIES};

/// A strategy by its name in scenario files.
pub fn strategy() -> impl TypedValueParser<Value = &'static str> {
    PossibleValuesParser::new(STRATEGIES.map(|strategy| PossibleValue::new(strategy.name).help(strategy.about)))
        .map(|name| Registered::find(&name).expect("one of the possible values").name)
}
