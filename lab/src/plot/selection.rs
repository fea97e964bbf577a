//! Selects the missions of a sweep that a plot shows, and checks that none is missing.

use std::collections::BTreeSet;
use std::iter::zip;

use skysink_common::error::did_you_mean;
use skysink_common::scenario::Setting;
use skysink_planner::strategies::look_ahead;
use toml::Value;

use super::request::PlotRequest;
use crate::sweep::definition::Definition;
use crate::sweep::folder::FlownSweep;
use crate::sweep::results::{number, text};
use skysink_mission::metrics::Metric;

/// The selected missions.
#[derive(Debug)]
pub struct Selection {
    /// Values of the x axis: numbers ascending, others in the order of the sweep.
    pub xs: Vec<Value>,
    /// The curves of the strategies, in the order of the legend.
    pub curves: Vec<SelectedCurve>,
    /// With bounds, the index of `offline` in the sweep.
    pub offline: Option<usize>,
    /// A note on missing missions of the sweep.
    pub missing: Option<String>,
}

/// The missions of a curve.
#[derive(Debug)]
pub struct SelectedCurve {
    /// Label in the legend.
    pub label: String,
    /// The strategy, by its index in the sweep.
    pub strategy: usize,
    /// The value of the key of `--by`, if there is one.
    pub by: Option<Value>,
    /// Label of the curve that differences refer to, if they are drawn.
    pub reference: Option<String>,
    /// The point of the grid for each value of the x axis.
    pub points: Vec<usize>,
}

/// The points of the grid with one value of the key of `--by`, with their values on the x axis.
type CurveGroup = (Option<Value>, Vec<(Value, usize)>);

impl Selection {
    /// Selects the points of the request that have all their missions.
    ///
    /// # Errors
    /// If the request does not fit the sweep, several points of the grid have the same value on the x axis, or no point
    /// has all its missions.
    pub fn new(request: &PlotRequest, flown: &FlownSweep) -> Result<Self, String> {
        let definition = &flown.definition;
        let metric = request.metric();
        let names = labels(request, definition)?;
        let strategies = strategies(request, definition, &names)?;
        let offline = offline_of(request, definition)?;
        let mut groups = groups(request, definition)?;
        let reference = reference(request, &groups)?;
        // The best known loss is the least of all strategies.
        let needed = if offline.is_some() { (0..definition.strategies.len()).collect() } else { strategies.clone() };
        let is_whole = |place: usize| {
            let count = |point, strategy| flown.values(point, strategy, metric).len();
            let is_flown = |point| needed.iter().all(|&strategy| count(point, strategy) == definition.seeds.len());
            groups.iter().all(|(_, points)| is_flown(points[place].1))
        };
        let all: Vec<Value> = groups[0].1.iter().map(|(value, _)| value.clone()).collect();
        let whole: Vec<bool> = (0..all.len()).map(is_whole).collect();
        let of_whole = |is: bool| zip(&all, &whole).filter(move |(_, whole)| **whole == is).map(|(value, _)| value);
        let missing = missing(request, flown, &of_whole(false).collect::<Vec<_>>());
        let xs: Vec<Value> = of_whole(true).cloned().collect();
        if xs.is_empty() {
            let flown = missing.unwrap_or_default();
            return Err(format!("{flown}: no complete value is left: run the rest first, or plot fewer strategies"));
        }
        for (_, points) in &mut groups {
            let mut place = 0..;
            points.retain(|_| place.next().is_some_and(|place: usize| whole[place]));
        }
        let curve = |strategy: usize, (by, points): &CurveGroup| {
            let label = |by: &Option<Value>| {
                let name = &names[strategy];
                by.as_ref().map_or(name.clone(), |value| format!("{name}, {}", text(value)))
            };
            let reference = match (&reference, &request.difference_to) {
                (Some(value), _) => Some(label(&Some(value.clone()))),
                (None, Some(named)) => place(named, definition, &names).map(|strategy| names[strategy].clone()),
                (None, None) => None,
            };
            let points = points.iter().map(|(_, point)| *point).collect();
            SelectedCurve { label: label(by), strategy, by: by.clone(), reference, points }
        };
        let curves: Vec<SelectedCurve> =
            strategies.iter().flat_map(|&strategy| groups.iter().map(move |group| curve(strategy, group))).collect();
        for SelectedCurve { strategy, points, .. } in &curves {
            let has_none = |&point: &usize| flown.values(point, *strategy, metric).values().any(|value| value.is_nan());
            if points.iter().any(has_none) {
                let name = &definition.strategies[*strategy];
                let expected = "expected a metric of all plotted strategies, or other --strategies";
                return Err(format!("--y {}: {name} has no value: {expected}", metric.name()));
            }
        }
        Ok(Self { xs, curves, offline, missing })
    }
}

/// With bounds, the index of `offline` in the sweep.
fn offline_of(request: &PlotRequest, definition: &Definition) -> Result<Option<usize>, String> {
    if !request.bounds {
        return Ok(None);
    }
    if request.metric() != Metric::LossRate {
        return Err(format!("--bounds: {} has none: expected --y loss_rate", request.metric().name()));
    }
    let offline = definition.strategies.iter().position(|name| name == look_ahead::OFFLINE.name);
    offline.map(Some).ok_or_else(|| "--bounds: expected a sweep with the strategy offline".to_owned())
}

/// The selected points by the values of the key of `--by`; one group without it.
fn groups(request: &PlotRequest, definition: &Definition) -> Result<Vec<CurveGroup>, String> {
    let conditions: Vec<(&str, &Value)> =
        request.conditions.iter().map(|Setting { key, value, .. }| (key.as_str(), value)).collect();
    let Some(by) = &request.by else { return Ok(vec![(None, points(&request.x, &conditions, definition)?)]) };
    let place = key(by, "--by", definition)?;
    if *by == request.x {
        return Err(format!("--by {by}: it is the key of the x axis: expected another"));
    }
    if request.conditions.iter().any(|condition| condition.key == *by) {
        return Err(format!("--where {by}: it has a curve for each value: expected another key"));
    }
    let group = |value: &Value| {
        let conditions = [&conditions[..], &[(by, value)]].concat();
        Ok((Some(value.clone()), points(&request.x, &conditions, definition)?))
    };
    values(definition, place).into_iter().map(group).collect()
}

/// With `--by`, the value of its key that differences refer to, if they are drawn.
fn reference(request: &PlotRequest, groups: &[CurveGroup]) -> Result<Option<Value>, String> {
    let (Some(by), Some(reference)) = (&request.by, &request.difference_to) else { return Ok(None) };
    let values: Vec<&Value> = groups.iter().filter_map(|(value, _)| value.as_ref()).collect();
    let is_named = |value: &&&Value| {
        text(value) == *reference || number(value).is_some_and(|value| reference.parse() == Ok(value))
    };
    let found = values.iter().find(is_named).map(|value| Some((*value).clone()));
    found.ok_or_else(|| {
        format!("--difference-to {reference}: expected a value of {by} in the sweep: {}", listed(&values))
    })
}

/// The place of a strategy in the sweep, by its name or its label.
fn place(named: &str, definition: &Definition, labels: &[String]) -> Option<usize> {
    let by_name = definition.strategies.iter().position(|name| name == named);
    by_name.or_else(|| labels.iter().position(|label| label == named))
}

/// The labels of all strategies of the sweep, no two the same: those of the request, the class of a Python strategy, or
/// the name.
fn labels(request: &PlotRequest, definition: &Definition) -> Result<Vec<String>, String> {
    let names = &definition.strategies;
    let short =
        |name: &String| name.strip_prefix("python:").and_then(|rest| rest.rsplit(':').next()).map(str::to_owned);
    let mut labels: Vec<String> = names.iter().map(|name| short(name).unwrap_or_else(|| name.clone())).collect();
    for index in 0..names.len() {
        let is_again = (0..names.len()).any(|other| other != index && short(&names[other]) == short(&names[index]));
        if is_again || names.contains(&labels[index]) {
            labels[index].clone_from(&names[index]);
        }
    }
    for (named, label) in &request.labels {
        let expected = || format!("--label {named}: expected a strategy of the sweep: {}", names.join(", "));
        let index = place(named, definition, &labels).ok_or_else(expected)?;
        labels[index].clone_from(label);
    }
    let again = (0..labels.len()).find(|&index| labels[..index].contains(&labels[index]));
    again.map_or(Ok(labels.clone()), |index| {
        Err(format!("--label: two strategies are called {}: expected another label", labels[index]))
    })
}

/// The indices of the selected strategies, including the reference, without duplicates.
fn strategies(request: &PlotRequest, definition: &Definition, labels: &[String]) -> Result<Vec<usize>, String> {
    let find = |option: &str, strategy: &String| {
        let names = &definition.strategies;
        let expected = || {
            let meant = did_you_mean(strategy, names.iter().map(String::as_str));
            let hint = meant.map(|meant| format!("; did you mean `{meant}`?")).unwrap_or_default();
            format!("{option} {strategy}: expected a strategy of the sweep: {}{hint}", names.join(", "))
        };
        place(strategy, definition, labels).ok_or_else(expected)
    };
    let mut chosen = match &request.strategies[..] {
        [] => (0..definition.strategies.len()).collect(),
        named => named.iter().map(|strategy| find("--strategies", strategy)).collect::<Result<Vec<_>, _>>()?,
    };
    let reference = request.difference_to.as_ref().filter(|_| request.by.is_none());
    chosen.extend(reference.map(|reference| find("--difference-to", reference)).transpose()?);
    let mut seen = BTreeSet::new();
    chosen.retain(|strategy| seen.insert(*strategy));
    Ok(chosen)
}

/// The points of the grid on which keys have these values, with the value of the key `x` of each.
fn points(x: &str, conditions: &[(&str, &Value)], definition: &Definition) -> Result<Vec<(Value, usize)>, String> {
    let x = key(x, "--x", definition)?;
    let mut fixed: Vec<Option<&Value>> = vec![None; definition.keys.len()];
    for &(name, value) in conditions {
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
        _ => number(one).zip(number(other)).map_or_else(|| one == other, |(one, other)| one == other),
    }
}

fn listed(values: &[&Value]) -> String {
    values.iter().map(|value| text(value)).collect::<Vec<_>>().join(", ")
}

/// Describes how many missions are missing, and which values are therefore `omitted`.
fn missing(request: &PlotRequest, flown: &FlownSweep, omitted: &[&Value]) -> Option<String> {
    let definition = &flown.definition;
    let all = definition.points.len() * definition.strategies.len() * definition.seeds.len();
    let present = flown.rows.len();
    let what = match omitted.len() {
        0 => "the plot is complete".to_owned(),
        _ => format!("omitted: {} = {}", request.x, listed(omitted)),
    };
    (present < all).then(|| format!("{present} of {all} missions are present; {what}"))
}
