//! Checks the missions of a fleet against each other in time, by their estimated durations.
//!
//! Vehicles count while they are in the air, from arming to the end of the landing. Parts of the same number start
//! together; a delay is the same for all parts of a UAV.

use skysink_common::error::InputError;
use skysink_common::geometry::Position;
use skysink_common::interpolation::interpolate;
use skysink_common::scenario::Scenario;

use super::duration::TimedPosition;
use super::vehicle::VehicleMission;

/// Delays of starts are multiples of this [s].
const STEP_S: f64 = 5.0;

/// How near two vehicles come to each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// Their numbers.
    pub uavs: [usize; 2],
    /// Horizontal distance [m].
    pub distance_m: f64,
    /// Time since the first start of the fleet [s].
    pub time_s: f64,
    /// Where the first one is [m].
    pub at: Position,
}

/// What the summary says about the distances of a fleet; nothing for a single UAV. With `stagger` the UAVs start one
/// after the other where that keeps them apart.
///
/// # Errors
/// If UAVs would come nearer to each other than `uav.separation_m` and are not to be staggered, or `stagger` has
/// nothing to do.
pub fn lines(scenario: &Scenario, missions: &[VehicleMission], stagger: bool) -> Result<Vec<String>, InputError> {
    let refuse = |what: String| Err(InputError::new("scenario", &scenario.path, what));
    if missions.len() < 2 {
        return if stagger { refuse("--stagger: expected several UAVs".to_owned()) } else { Ok(Vec::new()) };
    }
    let at_once = vec![0.0; missions.len()];
    let nearest = nearest(missions, &at_once);
    let mut lines = vec![format!(
        "warning: {} missions that do not know of each other, and are not in time with the plan: keep them apart \
         yourself",
        missions.len()
    )];
    let Some(separation_m) = scenario.uav.separation_m else {
        if stagger {
            return refuse("--stagger: expected uav.separation_m, how far the UAVs stay apart".to_owned());
        }
        let near = stay_apart(nearest, "if all start at once");
        lines.push(format!("warning: {near}: without uav.separation_m nothing keeps them apart"));
        return Ok(lines);
    };
    lines.extend(on_the_ground(scenario));
    let is_too_near = |approach: &Approach| approach.distance_m < separation_m;
    let Some(Approach { uavs, distance_m, time_s, at }) = nearest.filter(is_too_near) else {
        lines.push(stay_apart(nearest, "if all start at once"));
        return Ok(lines);
    };
    let delays_s = delays_s(missions, separation_m);
    let delayed = (0..).zip(&delays_s).filter(|(_, delay_s)| **delay_s > 0.0);
    let starts: Vec<String> = delayed.map(|(uav, delay_s)| format!("UAV {uav} after {delay_s} s")).collect();
    let starts = starts.join(", ");
    if stagger {
        lines.push(format!("start {starts}"));
        lines.push(stay_apart(self::nearest(missions, &delays_s), "with these starts"));
        return Ok(lines);
    }
    let [first, second] = uavs;
    refuse(format!(
        "by the estimated times UAV {first} and UAV {second} come within {distance_m:.1} m of each other {time_s:.0} s \
         after they start, at ({:.1} m, {:.1} m), less than uav.separation_m = {separation_m}: pass --stagger, to \
         start {starts}",
        at.x, at.y
    ))
}

/// That vehicles on the ground are not counted, where all start from one place.
fn on_the_ground(scenario: &Scenario) -> Option<String> {
    let mut starts = scenario.starts().map(|start| start.xy());
    let first = starts.next();
    let is_shared = starts.all(|start| Some(start) == first);
    is_shared.then(|| "warning: all UAVs start and land at one place: those on the ground are not counted".to_owned())
}

/// How near UAVs come to each other, and under which `condition`.
fn stay_apart(nearest: Option<Approach>, condition: &str) -> String {
    let Some(Approach { uavs: [first, second], distance_m, time_s, .. }) = nearest else {
        return format!("by the estimated times no two UAVs are in the air at once {condition}");
    };
    format!(
        "by the estimated times UAVs stay {distance_m:.1} m apart {condition} (UAV {first} and UAV {second} at \
         {time_s:.0} s)"
    )
}

/// Delays of the starts [s], each as short as those before it allow, with which the UAVs stay `separation_m` [m] apart.
fn delays_s(missions: &[VehicleMission], separation_m: f64) -> Vec<f64> {
    let mut delays_s: Vec<f64> = Vec::new();
    for uav in 0..missions.len() {
        let is_apart = |delay_s: &f64| {
            let lower = delays_s.iter().enumerate();
            let mut approaches =
                lower.filter_map(|(other, &other_s)| approach(missions, [other, uav], [other_s, *delay_s]));
            approaches.all(|approach| approach.distance_m >= separation_m)
        };
        // Ends at the latest when all others have landed.
        let delay_s = (0_u32..).map(|step| f64::from(step) * STEP_S).find(is_apart);
        delays_s.push(delay_s.expect("a number above the ends of all others"));
    }
    delays_s
}

/// The nearest approach of two UAVs with these delays of their starts [s]; `None` if no two are in the air at once.
pub fn nearest(missions: &[VehicleMission], delays_s: &[f64]) -> Option<Approach> {
    let pairs = (0..missions.len()).flat_map(|second| (0..second).map(move |first| [first, second]));
    let approaches = pairs.filter_map(|uavs| approach(missions, uavs, uavs.map(|uav| delays_s[uav])));
    approaches.min_by(|a, b| a.distance_m.total_cmp(&b.distance_m))
}

/// The nearest approach of two UAVs over all parts.
fn approach(missions: &[VehicleMission], uavs: [usize; 2], delays_s: [f64; 2]) -> Option<Approach> {
    let [first, second] = uavs.map(|uav| &missions[uav].parts);
    let nearest = first
        .iter()
        .zip(second)
        .filter_map(|(first, second)| nearest_of_parts([&first.timeline, &second.timeline], delays_s));
    let (distance_m, time_s, at) = nearest.min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Approach { uavs, distance_m, time_s, at })
}

/// Distance [m], time [s] and place [m] of the first of the nearest approach; `None` if they are never both in the air.
///
/// Between two times of either both move on straight lines, so that their distance is least at an end or where
/// `(r + s d) · d = 0`, with the vector r from one to the other and its change d.
fn nearest_of_parts(parts: [&[TimedPosition]; 2], delays_s: [f64; 2]) -> Option<(f64, f64, Position)> {
    let ends = |index: usize| {
        let [begin, .., end] = parts[index] else { return None };
        Some([begin.time_s + delays_s[index], end.time_s + delays_s[index]])
    };
    let [first, second] = [ends(0)?, ends(1)?];
    let [begin_s, end_s] = [first[0].max(second[0]), first[1].min(second[1])];
    if begin_s >= end_s {
        return None;
    }
    let nodes = (0..2).flat_map(|index| parts[index].iter().map(move |node| node.time_s + delays_s[index]));
    let mut times_s: Vec<f64> = nodes.filter(|time_s| (begin_s..=end_s).contains(time_s)).collect();
    times_s.sort_by(f64::total_cmp);
    let places = |time_s: f64| [0, 1].map(|index| place_at(parts[index], time_s - delays_s[index]));
    let nearest = times_s.windows(2).map(|pair| {
        let [before, after] = [places(pair[0]), places(pair[1])];
        let away = before[1] - before[0];
        let change = (after[1] - after[0]) - away;
        let fraction = -away.dot(&change) / change.norm_squared();
        let fraction = if fraction.is_nan() { 0.0 } else { fraction.clamp(0.0, 1.0) };
        let time_s = interpolate(pair[0], pair[1], fraction);
        ((away + change * fraction).norm(), time_s, interpolate(before[0], after[0], fraction))
    });
    nearest.min_by(|a, b| a.0.total_cmp(&b.0))
}

/// The place at a time [s] after arming [m].
fn place_at(nodes: &[TimedPosition], time_s: f64) -> Position {
    let after = nodes.partition_point(|node| node.time_s < time_s).clamp(1, nodes.len() - 1);
    let [before, after] = [&nodes[after - 1], &nodes[after]];
    let duration_s = after.time_s - before.time_s;
    let fraction = if duration_s > 0.0 { ((time_s - before.time_s) / duration_s).clamp(0.0, 1.0) } else { 1.0 };
    interpolate(before.at, after.at, fraction)
}
