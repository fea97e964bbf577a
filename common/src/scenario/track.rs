//! A flight that is fixed: the waypoints of a track, interpolated at the ends of the slots, or of the scenario itself.

use std::path::PathBuf;

use nalgebra::Point3;
use toml::Value;

use super::mission::Scenario;
use super::uav::Climb;
use crate::error::{InputError, line_of, quoted, read_text};
use crate::interpolation::interpolate;
use crate::slack::ALTITUDE_SLACK;

/// Most slots of a mission with a track: each has its waypoint in the scenario of the run.
pub const MOST_TRACK_SLOTS: u64 = 1_000_000;

/// Slack of the end of a track, relative to that of the mission.
const END_SLACK: f64 = 1e-9;

/// The keys of a fixed flight.
const KEYS: [&str; 2] = ["uav.track", "uav.waypoints_m"];

/// A file of a track, and the line from which the waypoint of each slot follows.
pub(super) struct TrackFile {
    path: PathBuf,
    lines: Vec<u64>,
}

/// A place of a flight at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedPoint {
    /// Time since the start [s].
    pub time_s: f64,
    /// The place [m].
    pub at: Point3<f64>,
}

/// The rows of a track, and the line of each.
struct TrackRows {
    points: Vec<TimedPoint>,
    lines: Vec<u64>,
}

/// Replaces the file `uav.track`, or its text that is `held` instead, by `uav.waypoints_m`, and starts where it starts
/// if there is no other start.
///
/// # Errors
/// If the file has an invalid row, or ends before the mission.
pub(super) fn read_file(scenario: &mut Scenario, held: Option<String>) -> Result<Option<TrackFile>, InputError> {
    let Some(file) = scenario.uav.track.take() else { return Ok(None) };
    if scenario.slots > MOST_TRACK_SLOTS {
        let expected = format!("none with more than {MOST_TRACK_SLOTS} slots");
        let value = Value::String(file.to_string_lossy().into_owned());
        return Err(scenario.refusal("uav.track", &value, &expected));
    }
    let path = scenario.beside(&file);
    let text = held.map_or_else(|| read_text("track", &path), Ok)?;
    let rows = rows(&text, scenario).map_err(|message| InputError::new("track", &path, message))?;
    let TrackRows { points, lines } = rows;
    let end_s = scenario.slots as f64 * scenario.slot_s;
    let last = points[points.len() - 1];
    if last.time_s < end_s * (1.0 - END_SLACK) {
        let expected = format!("a last row at the end of the mission, {end_s} s, or later");
        let message =
            format_args!("line {}: it ends at {} s: expected {expected}", lines[lines.len() - 1], last.time_s);
        return Err(InputError::new("track", &path, message));
    }
    let ends = slot_ends(&points, scenario.slot_s, scenario.slots);
    let (_, start) = ends[0];
    if scenario.uav.starts_m.is_none() {
        scenario.uav.start_m.get_or_insert([start.x, start.y]);
    }
    scenario.uav.waypoints_m = Some(ends[1..].iter().map(|(_, at)| (*at).into()).collect());
    let lines = ends[1..].iter().map(|(row, _)| lines[*row]).collect();
    Ok(Some(TrackFile { path, lines }))
}

/// The place at the start, and where each of the `slots` of `slot_s` [s] ends, between points at ascending times;
/// before the first and after the last of them it is there. Each with the index of the point that it leads to.
///
/// # Panics
/// Without points.
#[must_use]
pub fn slot_ends(points: &[TimedPoint], slot_s: f64, slots: u64) -> Vec<(usize, Point3<f64>)> {
    let mut next = 0;
    let end = |slot: u64| {
        let time_s = slot as f64 * slot_s;
        while next + 1 < points.len() && points[next].time_s < time_s {
            next += 1;
        }
        (next, at(&points[next.saturating_sub(1)], &points[next], time_s))
    };
    (0..=slots).map(end).collect()
}

/// The place at `time_s`, between two points; that of the nearer one beyond them.
fn at(from: &TimedPoint, to: &TimedPoint, time_s: f64) -> Point3<f64> {
    if time_s >= to.time_s {
        return to.at;
    }
    if time_s <= from.time_s {
        return from.at;
    }
    interpolate(from.at, to.at, (time_s - from.time_s) / (to.time_s - from.time_s))
}

/// The rows of the text of a track, at least one, at ascending times.
fn rows(text: &str, scenario: &Scenario) -> Result<TrackRows, String> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|error| format!("line 1: {error}"))?.clone();
    let column = |name: &str| header.iter().position(|column| column == name);
    let names = || quoted(&header.iter().collect::<Vec<_>>().join(","));
    let known = ["t_s", "slot", "x_m", "y_m", "z_m"].map(column);
    let is_known = known.iter().flatten().count() == header.len();
    let columns = match known {
        [Some(time), None, Some(x), Some(y), z] if is_known => Some((time, 1.0, [x, y], z)),
        [None, Some(slot), Some(x), Some(y), z] if is_known => Some((slot, scenario.slot_s, [x, y], z)),
        _ => None,
    };
    let expected = "t_s,x_m,y_m or slot,x_m,y_m, and optionally z_m";
    let (time, unit_s, ground, z) =
        columns.ok_or_else(|| format!("line 1: header `{}`: expected {expected}", names()))?;
    let mut rows = TrackRows { points: Vec::new(), lines: Vec::new() };
    for record in reader.records() {
        let record =
            record.map_err(|error| format!("line {}: expected UTF-8 text", line_of(text, error.position())))?;
        let line = line_of(text, record.position());
        let refuse = |column: usize, expected: &str| {
            let value = quoted(record.get(column).unwrap_or_default());
            format!("line {line}: {} = {value}: expected {expected}", &header[column])
        };
        let number = |column: usize| {
            let number =
                record.get(column).and_then(|text| text.parse::<f64>().ok()).filter(|number| number.is_finite());
            number.ok_or_else(|| refuse(column, "a finite number"))
        };
        let time_s = number(time)? * unit_s;
        if rows.points.last().is_some_and(|last| last.time_s >= time_s) {
            return Err(refuse(time, "ascending times"));
        }
        let z_m = z.map_or(Ok(scenario.uav.altitude_m), number)?;
        rows.points.push(TimedPoint { time_s, at: Point3::new(number(ground[0])?, number(ground[1])?, z_m) });
        rows.lines.push(line);
    }
    if rows.points.is_empty() {
        return Err("line 1: no rows: expected at least one".to_owned());
    }
    Ok(rows)
}

/// Checks that a UAV can fly the waypoints of a fixed flight; `file` is where they were read from.
///
/// # Errors
/// If there are too few, or one is out of reach, outside of the area or its boundary, or behind a zone.
pub(super) fn check(scenario: &Scenario, file: Option<&TrackFile>) -> Result<(), InputError> {
    let Some(waypoints_m) = &scenario.uav.waypoints_m else { return Ok(()) };
    let key = KEYS[usize::from(file.is_none())];
    let value = Value::String(match file {
        Some(file) => file.path.to_string_lossy().into_owned(),
        None => format!("{} waypoints", waypoints_m.len()),
    });
    let uav = &scenario.uav;
    let others = [
        (uav.uavs() > 1, "one UAV (uav.count)"),
        (uav.grid_m().is_some(), "uav.moves = \"free\""),
        (uav.battery.is_some() || scenario.must_land(), "no way home (uav.battery, uav.must_land)"),
        (uav.position_error_m.is_some(), "no uav.position_error_m"),
    ];
    if let Some((_, expected)) = others.iter().find(|(is_other, _)| *is_other) {
        return Err(scenario.refusal(key, &value, &format!("with a fixed flight {expected}")));
    }
    if (waypoints_m.len() as u64) < scenario.slots {
        return Err(scenario.refusal(key, &value, &format!("one for each of the {} slots", scenario.slots)));
    }
    let airspace = scenario.airspace_without_ways();
    let slack_m = scenario.area.border_slack_m();
    let mut from = scenario.start();
    for (index, &[x_m, y_m, z_m]) in waypoints_m.iter().take(scenario.slots as usize).enumerate() {
        let to = Point3::new(x_m, y_m, z_m);
        let leg_m = (to.xy() - from.xy()).norm();
        let [lowest_m, highest_m] = scenario.altitudes_m(from.z);
        let is_high = (lowest_m * (1.0 - ALTITUDE_SLACK)..=highest_m * (1.0 + ALTITUDE_SLACK)).contains(&z_m);
        let expected = if !scenario.area.contains(&to.xy(), slack_m) {
            format!("a place in the area, [0, {}] × [0, {}]", scenario.area.width_m(), scenario.area.height_m())
        } else if !scenario.reaches(&from.xy(), &to.xy()) {
            format!("a place that a slot reaches from ({:.3}, {:.3}): it is {leg_m:.3} m away", from.x, from.y)
        } else if !is_high {
            match uav.climb() {
                None => format!("the altitude uav.altitude_m = {} m", uav.altitude_m),
                Some(Climb { .. }) => format!("an altitude from {lowest_m} to {highest_m} m, which a slot reaches"),
            }
        } else if airspace.entry(&from.xy(), &to.xy(), [from.z, z_m], slack_m).is_some() {
            format!("a straight way from ({:.3}, {:.3}) within the boundary and around zones", from.x, from.y)
        } else {
            from = to;
            continue;
        };
        let slot = index + 1;
        let found = format!("({x_m:.3}, {y_m:.3}, {z_m:.3}) m at the end of slot {slot}");
        return Err(match file {
            Some(TrackFile { path, lines }) => {
                InputError::new("track", path, format_args!("line {}: {found}: expected {expected}", lines[index]))
            }
            None => scenario.refusal(&format!("{key}[{index}]"), &Value::String(found), &expected),
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Overrides;
    use std::path::Path;

    /// Four slots of 2 s at 5 m/s over 100 m × 100 m with this track.
    fn parsed(track: &str, keys: &str) -> Result<Scenario, String> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("t.csv"), track).unwrap();
        let text = format!("name = 'a'\nslots = 4\nslot_s = 2.0\n[uav]\nmax_speed_mps = 5.0\ntrack = 't.csv'\n{keys}");
        let parsed = Scenario::parse(&text, &folder.path().join("a.toml"), Overrides::default());
        parsed.map_err(|error| error.to_string().replace(&*folder.path().to_string_lossy(), ""))
    }

    #[test]
    fn waypoints_are_interpolated_at_the_ends_of_slots() {
        // 4 m/s east from 1 s to 6 s, then north.
        let scenario = parsed("t_s,x_m,y_m\n1,10,50\n6,30,50\n9,30,62\n", "").unwrap();
        let expected = [[14.0, 50.0, 20.0], [22.0, 50.0, 20.0], [30.0, 50.0, 20.0], [30.0, 58.0, 20.0]];
        assert_eq!(scenario.uav.waypoints_m.as_deref(), Some(&expected[..]));
        assert_eq!((scenario.uav.start_m, &scenario.uav.track), (Some([10.0, 50.0]), &None));
        let by_slot = parsed("slot,y_m,x_m,z_m\n0,50,10,20\n4,50,42,20\n", "").unwrap();
        assert_eq!(by_slot.uav.waypoints_m.as_ref().unwrap()[2], [34.0, 50.0, 20.0]);
        // The copy of a run has the waypoints, and needs no file; a shorter mission flies the first of them.
        let again = Scenario::parse(&scenario.to_toml(), Path::new("b.toml"), Overrides::default()).unwrap();
        assert_eq!(again.hash(), scenario.hash());
        let shorter = Overrides { slots: Some(3), ..Overrides::default() };
        assert!(Scenario::parse(&scenario.to_toml(), Path::new("b.toml"), shorter).is_ok());
    }

    #[test]
    fn a_text_that_is_held_replaces_the_file() {
        let text = "name = 'a'\nslots = 2\n[uav]\ntrack = 'none.csv'\n";
        let track = Some("t_s,x_m,y_m\n0,10,50\n2,30,50\n".to_owned());
        let overrides = Overrides { track, ..Overrides::default() };
        let scenario = Scenario::parse(text, Path::new("a.toml"), overrides).unwrap();
        assert_eq!(scenario.uav.waypoints_m.as_deref(), Some(&[[20.0, 50.0, 20.0], [30.0, 50.0, 20.0]][..]));
    }

    #[test]
    fn tracks_that_cannot_be_flown_are_refused_with_their_line() {
        let fence = "[area]\nboundary_m = [[0, 0], [100, 0], [100, 55], [0, 55]]\n";
        let climbs = "altitude = 'free'\n[link]\nmodel = 'probabilistic-los'\n";
        for (track, keys, expected) in [
            ("", "", "line 1: header ``: expected t_s,x_m,y_m or slot,x_m,y_m, and optionally z_m"),
            ("t_s,slot,x_m,y_m\n", "", "line 1: header `t_s,slot,x_m,y_m`: expected"),
            ("t_s,x_m,y_m,v\n", "", "line 1: header `t_s,x_m,y_m,v`: expected"),
            ("t_s,x_m,y_m\n", "", "line 1: no rows: expected at least one"),
            ("t_s,x_m,y_m\n0,1,x\n", "", "line 2: y_m = x: expected a finite number"),
            ("t_s,x_m,y_m\n0,1,1\n0,1,1\n", "", "line 3: t_s = 0: expected ascending times"),
            (
                "t_s,x_m,y_m\n0,1,1\n7,1,1\n",
                "",
                "line 3: it ends at 7 s: expected a last row at the end of the mission, 8 s",
            ),
            (
                "t_s,x_m,y_m\n0,50,50\n4,60,50\n8,81,50\n",
                "",
                "line 4: (70.500, 50.000, 20.000) m at the end of slot 3: expected a place that a slot reaches from \
                 (60.000, 50.000): it is 10.500 m away",
            ),
            (
                "t_s,x_m,y_m\n0,95,50\n8,103,50\n",
                "",
                "line 3: (101.000, 50.000, 20.000) m at the end of slot 3: expected a place in",
            ),
            (
                "t_s,x_m,y_m\n0,50,50\n8,50,58\n",
                fence,
                "line 3: (50.000, 56.000, 20.000) m at the end of slot 3: expected a straight",
            ),
            ("t_s,x_m,y_m,z_m\n0,50,50,20\n8,50,50,24\n", "", "expected the altitude uav.altitude_m = 20 m"),
            (
                "t_s,x_m,y_m,z_m\n0,50,50,20\n8,50,50,80\n",
                climbs,
                "expected an altitude from 20 to 30 m, which a slot reaches",
            ),
            ("t_s,x_m,y_m\n0,50,50\n8,50,50\n", "count = 2\n", "expected with a fixed flight one UAV (uav.count)"),
            ("t_s,x_m,y_m\n0,50,50\n8,50,50\n", "must_land = true\n", "expected with a fixed flight no way home"),
            (
                "t_s,x_m,y_m\n0,50,50\n8,50,50\n",
                "position_error_m = 1.0\n",
                "expected with a fixed flight no uav.position",
            ),
            ("t_s,x_m,y_m\n0,50,50\n8,50,50\n", "waypoints_m = []\n", "expected either track or waypoints_m"),
        ] {
            let refused = parsed(track, keys).expect_err(track);
            assert!(refused.contains(expected), "{track}{keys}{refused}");
            assert!(refused.contains("t.csv") && refused.lines().count() == 1, "{refused}");
        }
        let climbs = "[uav]\nwaypoints_m = [[50, 50, 20], [50, 90, 20]]\n";
        for (slots, expected) in
            [(2, "uav.waypoints_m[1] = "), (3, "uav.waypoints_m = \"2 waypoints\": expected one for each")]
        {
            let text = format!("name = 'a'\nslots = {slots}\n{climbs}");
            let refused = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap_err().to_string();
            assert!(refused.contains(expected), "{refused}");
        }
    }
}
