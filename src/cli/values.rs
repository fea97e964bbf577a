//! Value parsers that several commands share.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use skysink_planner::strategies::{Registered, STRATEGIES};

/// Parses the name of a strategy, as in scenario files.
pub fn strategy() -> impl TypedValueParser<Value = &'static str> {
    PossibleValuesParser::new(STRATEGIES.map(|strategy| PossibleValue::new(strategy.name).help(strategy.about)))
        .map(|name| Registered::find(&name).expect("one of the possible values").name)
}
