//! The waypoint file of ArduPilot's ground stations, `QGC WPL 110`. It has no fence, and no speed before an item sets
//! one.
//!
//! Format: MAVLink's developer guide, "Plain-Text File Format".

use skysink_common::error::quoted;
use skysink_common::geodata::SourceText;

use super::commands::ForeignItem;
use super::foreign_plan::{PlanFile, PlanHome};
use crate::export::Autopilot;

/// The first line.
const HEADER: &str = "QGC WPL 110";

/// The columns of an item.
const COLUMNS: [&str; 12] = [
    "index",
    "current",
    "frame",
    "command",
    "parameter 1",
    "parameter 2",
    "parameter 3",
    "parameter 4",
    "latitude",
    "longitude",
    "altitude",
    "autocontinue",
];

/// Reads the text of a file.
///
/// # Errors
/// If its first line, or an item, is not of the format.
pub fn parse(source: &SourceText<'_>) -> Result<PlanFile, String> {
    let mut lines = (1..).zip(source.text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let first = lines.next().map_or("", |(_, line)| line.trim());
    if first.split_whitespace().ne(HEADER.split_whitespace()) {
        return Err(format!("line 1: `{}`: expected `{HEADER}`", quoted(first)));
    }
    let mut items = lines.enumerate().map(|(index, (number, line))| item(index, number, line));
    let mut items: Vec<(ForeignItem, bool)> = items.by_ref().collect::<Result<_, _>>()?;
    let is_home = items.first().is_some_and(|(item, _)| item.command == 16);
    let home = is_home.then(|| items.remove(0).0);
    let waits: Vec<String> = items.iter().filter(|(_, goes_on)| !goes_on).map(|(item, _)| item.place.clone()).collect();
    let unused = (!waits.is_empty()).then(|| format!("the pause after {} (autocontinue 0)", waits.join(", ")));
    let home = match home {
        None => None,
        Some(home) => home.position()?.map(|position| PlanHome {
            position,
            altitude_m: Some(home.params[6]).filter(|altitude_m| home.frame == 0 && altitude_m.is_finite()),
        }),
    };
    Ok(PlanFile {
        is_waypoints: true,
        autopilot: Autopilot::Ardupilot,
        home,
        speed_mps: None,
        items: items.into_iter().map(|(item, _)| item).collect(),
        fence: Vec::new(),
        unused: unused.into_iter().collect(),
    })
}

/// The item of a line, and whether the mission goes on after it.
fn item(index: usize, number: usize, line: &str) -> Result<(ForeignItem, bool), String> {
    let place = format!("item {index}");
    let refuse = |message: &str| format!("{place} (line {number}): {message}");
    let texts: Vec<&str> = line.split_whitespace().collect();
    if texts.len() != COLUMNS.len() {
        return Err(refuse(&format!("{} columns: expected {}", texts.len(), COLUMNS.len())));
    }
    let value = |column: usize| -> Result<f64, String> {
        let value = texts[column].parse().ok().filter(|value: &f64| !value.is_infinite());
        let refuse = || refuse(&format!("{} = {}: expected a number", COLUMNS[column], quoted(texts[column])));
        value.ok_or_else(refuse)
    };
    let code = |column: usize, most: f64| {
        let code = value(column)?;
        let is_code = (0.0..=most).contains(&code) && code.fract() == 0.0;
        let refuse = || refuse(&format!("{} = {code}: expected a whole number up to {most}", COLUMNS[column]));
        is_code.then_some(code).ok_or_else(refuse)
    };
    if code(0, 1e5)? != index as f64 {
        return Err(refuse(&format!("index = {}: expected {index}, the items in order", quoted(texts[0]))));
    }
    let mut params = [0.0; 7];
    for (offset, param) in params.iter_mut().enumerate() {
        *param = value(4 + offset)?;
    }
    let frame = code(2, f64::from(u8::MAX))? as u8;
    let command = code(3, f64::from(u16::MAX))? as u16;
    let goes_on = value(11)? != 0.0;
    Ok((ForeignItem { place, command, frame, params, above_ground_m: None }, goes_on))
}
