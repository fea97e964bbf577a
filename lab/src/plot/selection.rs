//! Selects the missions of a sweep that a plot shows, and checks that none is missing.

use std::iter::zip;

use skysink_common::error::did_you_mean;
use skysink_common::scenario::Setting;
use toml::Value;

use super::{PlotRequest, refuse};
use crate::error::LabError;
use crate::sweep::folder::FlownSweep;
use crate::sweep::plan::Definition;
use crate::sweep::results::{number, text};

/// The selected missions.
#[derive(Debug)]
pub struct Selection {
    /// Values of the x axis: numbers ascending, others in the order of the sweep.
    pub xs: Vec<Value>,
    /// The point of the grid for each value.
    pub points: Vec<usize>,
    /// The strategies, by their index in the sweep.
    pub strategies: Vec<usize>,
    /// A note on missing missions of the sweep.
    pub missing: Option<String>,
}

impl Selection {
    /// Selects the points of the request that have all their missions.
    ///
    /// # Errors
    /// If the request does not fit the sweep, several points of the grid have the same value on the x axis, or no point
    /// has all its missions.
    pub fn new(request: &PlotRequest, flown: &FlownSweep) -> Result<Self, LabError> {
        let definition = &flown.definition;
        let strategies = strategies(request, definition).map_err(|message| refuse(&request.sweep, message))?;
        let all = points(request, definition).map_err(|message| refuse(&request.sweep, message))?;
        let is_whole = |point: usize| {
            let flown = |&strategy: &usize| flown.values(point, strategy, request.metric).len();
            strategies.iter().all(|strategy| flown(strategy) == definition.seeds.len())
        };
        let (whole, partial): (Vec<_>, Vec<_>) = all.into_iter().partition(|(_, point)| is_whole(*point));
        let missing = missing(request, flown, &partial);
        if whole.is_empty() {
            let flown = missing.unwrap_or_default();
            let message = format!("{flown}: no complete value is left: run the rest first, or plot fewer strategies");
            return Err(refuse(&request.sweep, message));
        }
        for &strategy in &strategies {
            let has_none = |&(_, point): &(Value, usize)| {
                flown.values(point, strategy, request.metric).values().any(|value| value.is_nan())
            };
            if whole.iter().any(has_none) {
                let name = &definition.strategies[strategy];
                let metric = request.metric.name();
                let expected = "expected a metric of all plotted strategies, or other --strategies";
                return Err(refuse(&request.sweep, format!("--y {metric}: {name} has no value: {expected}")));
            }
        }
        let (xs, points) = whole.into_iter().unzip();
        Ok(Self { xs, points, strategies, missing })
    }
}

/// The indices of the selected strategies, including the reference, without duplicates.
fn strategies(request: &PlotRequest, definition: &Definition) -> Result<Vec<usize>, String> {
    let find = |option: &str, strategy: &String| {
        let names = &definition.strategies;
        let expected = || {
            let meant = did_you_mean(strategy, names.iter().map(String::as_str));
            let hint = meant.map(|meant| format!("; did you mean `{meant}`?")).unwrap_or_default();
            format!("{option} {strategy}: expected a strategy of the sweep: {}{hint}", names.join(", "))
        };
        names.iter().position(|name| name == strategy).ok_or_else(expected)
    };
    let mut chosen = match &request.strategies[..] {
        [] => (0..definition.strategies.len()).collect(),
        named => named.iter().map(|strategy| find("--strategies", strategy)).collect::<Result<Vec<_>, _>>()?,
    };
    chosen.extend(request.reference.as_ref().map(|reference| find("--difference-to", reference)).transpose()?);
    let mut seen = Vec::new();
    chosen.retain(|strategy| {
        !seen.contains(strategy) && {
            seen.push(*strategy);
            true
        }
    });
    Ok(chosen)
}

/// The selected points of the grid, with their values on the x axis.
fn points(request: &PlotRequest, definition: &Definition) -> Result<Vec<(Value, usize)>, String> {
    let x = key(&request.x, "--x", definition)?;
    let mut fixed: Vec<Option<&Value>> = vec![None; definition.keys.len()];
    for Setting { key: name, value, .. } in &request.conditions {
        let place = key(name, "--where", definition)?;
        let existing = values(definition, place);
        if place == x {
            return Err(format!("--where {name}: it is the key of the x axis: expected another"));
        }
        if fixed[place].is_some() {
            return Err(format!("--where {name}: it is given twice: expected one value"));
        }
        if !existing.iter().any(|other| is_same(other, value)) {
            let expected = format!("expected a value of the sweep: {}", listed(&existing));
            return Err(format!("--where {name}={}: {expected}", text(value)));
        }
        fixed[place] = Some(value);
    }
    let is_free = |&place: &usize| place != x && fixed[place].is_none() && values(definition, place).len() > 1;
    let free: Vec<usize> = (0..fixed.len()).filter(is_free).collect();
    if let Some(&first) = free.first() {
        let names: Vec<&str> = free.iter().map(|&place| definition.keys[place].as_str()).collect();
        let [name, value] = [names[0], &text(values(definition, first)[0])];
        let have = if names.len() == 1 { "has several values" } else { "have several values" };
        return Err(format!("{} {have}: expected one of each, such as --where {name}={value}", names.join(", ")));
    }
    let is_drawn =
        |point: &[Value]| zip(point, &fixed).all(|(value, fixed)| fixed.is_none_or(|fixed| is_same(value, fixed)));
    let drawn = definition.points.iter().enumerate().filter(|(_, point)| is_drawn(point));
    let mut drawn: Vec<(Value, usize)> = drawn.map(|(index, point)| (point[x].clone(), index)).collect();
    if let Some(numbers) = drawn.iter().map(|(value, _)| number(value)).collect::<Option<Vec<f64>>>() {
        let mut order: Vec<_> = zip(numbers, drawn).collect();
        order.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        drawn = order.into_iter().map(|(_, point)| point).collect();
    }
    Ok(drawn)
}

/// The index of a key of the sweep.
fn key(name: &str, option: &str, definition: &Definition) -> Result<usize, String> {
    let keys = || definition.keys.iter().map(String::as_str);
    definition.keys.iter().position(|key| key == name).ok_or_else(|| {
        if definition.keys.is_empty() {
            return format!("{option} {name}: the sweep has no axes: expected one with keys under [axes]");
        }
        let meant = did_you_mean(name, keys()).map_or_else(String::new, |meant| format!("; did you mean `{meant}`?"));
        format!("{option} {name}: expected a key of the sweep: {}{meant}", keys().collect::<Vec<_>>().join(", "))
    })
}

/// The distinct values of a key, in the order of the sweep.
fn values(definition: &Definition, place: usize) -> Vec<&Value> {
    let mut values: Vec<&Value> = Vec::new();
    for point in &definition.points {
        if !values.iter().any(|value| is_same(value, &point[place])) {
            values.push(&point[place]);
        }
    }
    values
}

/// Whether two values are equal; integers and floats are compared as numbers.
fn is_same(one: &Value, other: &Value) -> bool {
    match (one, other) {
        (Value::Array(one), Value::Array(other)) => {
            one.len() == other.len() && zip(one, other).all(|(one, other)| is_same(one, other))
        }
        _ => match (number(one), number(other)) {
            (Some(one), Some(other)) => one == other,
            _ => one == other,
        },
    }
}

fn listed(values: &[&Value]) -> String {
    values.iter().map(|value| text(value)).collect::<Vec<_>>().join(", ")
}

/// Describes how many missions are missing, and which values are therefore omitted.
fn missing(request: &PlotRequest, flown: &FlownSweep, partial: &[(Value, usize)]) -> Option<String> {
    let definition = &flown.definition;
    let all = definition.points.len() * definition.strategies.len() * definition.seeds.len();
    let present = flown.rows.len();
    let omitted: Vec<&Value> = partial.iter().map(|(value, _)| value).collect();
    let what = match omitted.len() {
        0 => "the plot is complete".to_owned(),
        _ => format!("omitted: {} = {}", request.x, listed(&omitted)),
    };
    (present < all).then(|| format!("{present} of {all} missions are present; {what}"))
}
