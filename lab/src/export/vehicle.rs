//! Plans the vehicle mission of a flight, in parts if it has too many items.
//!
//! Which waypoints there are is left to [`stops`], their altitudes to [`Altitudes`], the time that they take to
//! [`effort`].

use std::fmt;

use nalgebra::Point3;
use skysink_common::airspace::Airspace;
use skysink_common::battery::Battery;
use skysink_common::error::InputError;

use super::altitude::{AltitudeReference, Altitudes};
use super::duration::{MissionEffort, MissionLeg, TimedPosition, effort, timeline};
use super::items::VehicleItem;
use super::mission_options::VehicleMissionOptions;
use super::stops::{self, MERGE_M, VehicleStop, rounded};
use super::track::GeodeticTrack;

/// A leg of a mission: its ends [m]; z is the altitude above the ground below.
pub type Leg = [Point3<f64>; 2];

/// A speed stays set for a leg that is slower by at most this fraction of the maximum speed.
const MAX_SLOWER: f64 = 0.1;

/// A speed stays set for a leg that is faster by at most this fraction of its own speed.
const MAX_FASTER: f64 = 0.01;

/// How far a mission may lead into a zone [m]: the rounding of a run.
const ZONE_SLACK_M: f64 = 0.01;

/// A mission of a vehicle.
#[derive(Debug)]
pub struct VehicleMission {
    pub parts: Vec<MissionPart>,
    /// What the altitudes of waypoints are above.
    pub reference: AltitudeReference,
    /// The ground at home [m], as it was given or as low as it can be; `None` if nothing tells it.
    pub home_ground_m: Option<f64>,
    /// The altitude above home that clears the ground on all straight ways home as the model flies, and all roofs [m];
    /// `None` if nothing tells the ground, and the model flies above all roofs.
    pub return_m: Option<f64>,
    /// The waypoints of the flight.
    pub flown: Vec<VehicleStop>,
    /// The waypoints of the mission: those of the flight that `--min-bits` keeps, and the bends of new ways between
    /// them.
    pub stops: Vec<VehicleStop>,
}

/// A part of a mission, from take-off to landing.
#[derive(Debug)]
pub struct MissionPart {
    /// Its items, without home.
    pub items: Vec<VehicleItem>,
    /// Home at the altitude of the take-off and the waypoints [m]; z is the altitude above the ground below, as the
    /// model flies.
    pub path: Vec<Point3<f64>>,
    /// The time and energy that it takes.
    pub effort: MissionEffort,
    /// When the vehicle is where, by that estimate.
    pub timeline: Vec<TimedPosition>,
    /// How high above the ground a waypoint can be [m]; `None` if altitudes are above the ground, or the list does not
    /// tell it.
    pub highest_m: Option<f64>,
}

impl MissionPart {
    /// The legs from home through all waypoints.
    pub fn legs(&self) -> impl Iterator<Item = Leg> {
        self.path.array_windows().copied()
    }
}

/// The vehicle mission of a track. Each part takes off, flies around zones to its first waypoint and home from its last
/// one, and lands.
///
/// # Errors
/// If no waypoint is left, an altitude is not known, the mission leads below the ground or through a zone, or a part
/// takes longer or more energy than the UAV has.
pub fn plan(track: &GeodeticTrack<'_>, options: &VehicleMissionOptions) -> Result<VehicleMission, InputError> {
    let scenario = &track.run.scenario;
    let altitudes = Altitudes::of(track, options.altitude, options.home_ground, options.autopilot)?;
    let planner = MissionPlanner { track, options, altitudes, airspace: scenario.airspace() };
    let flown = stops::merge(track);
    let stops = stops::with_bits(&flown, options.min_bits, planner.home(), &planner.airspace);
    if stops.is_empty() {
        let message = format_args!("--min-bits {}: no waypoint collects so many: expected fewer", options.min_bits);
        return Err(InputError::new("scenario", &scenario.path, message));
    }
    let parts = planner.split(&stops)?;
    parts.iter().try_for_each(|waypoints| planner.check_path(waypoints))?;
    let positions = parts.iter().flatten().map(|waypoint| waypoint.position.xy());
    let over_ground_m = planner.altitudes.return_m(&planner.home(), positions);
    let over_roofs_m = planner.altitudes.over_roofs_m(&planner.home(), &track.zones, options.margin_m());
    let return_m = over_ground_m.into_iter().chain(over_roofs_m).reduce(f64::max);
    let parts: Vec<_> = parts.iter().map(|waypoints| planner.part(waypoints)).collect::<Result<_, _>>()?;
    if !options.ignore_endurance {
        check_effort(track, &parts)?;
    }
    let Altitudes { reference, home_ground_m, .. } = planner.altitudes;
    Ok(VehicleMission { parts, reference, home_ground_m, return_m, flown, stops })
}

/// What the parts of a mission are made with.
struct MissionPlanner<'a> {
    track: &'a GeodeticTrack<'a>,
    options: &'a VehicleMissionOptions,
    altitudes: Altitudes,
    airspace: Airspace,
}

impl MissionPlanner<'_> {
    /// Where every part begins and ends [m]: the start of the run.
    fn home(&self) -> Point3<f64> {
        self.track.points[0].position
    }

    fn max_speed_mps(&self) -> f64 {
        self.track.run.scenario.uav.max_speed_mps
    }

    /// The waypoints of each part: as many of the `stops` as fit into its items, with the ways from home and back. The
    /// leg to the first one of a later part begins at home, and is flown at the maximum speed.
    fn split(&self, stops: &[VehicleStop]) -> Result<Vec<Vec<VehicleStop>>, InputError> {
        let most = self.options.most_items();
        let mut parts = Vec::new();
        let mut rest = stops.to_vec();
        while !rest.is_empty() {
            if !parts.is_empty() {
                rest[0].speed_mps = Some(rounded(self.max_speed_mps()));
            }
            let mut waypoints = self.way(&self.home(), &rest[0].position);
            waypoints.pop(); // the first stop
            let mut set_mps = None;
            let mut items = 2 + self.count_items(&waypoints, &mut set_mps); // with home and take-off
            let mut back = Vec::new();
            let mut count = 0;
            for stop in &rest {
                items += self.count_items(std::slice::from_ref(stop), &mut set_mps);
                let way = self.way(&stop.position, &self.home());
                if items + self.count_items(&way, &mut set_mps.clone()) + 1 > most {
                    break;
                }
                back = way;
                count += 1;
            }
            if count == 0 {
                let expected = "expected more, because a single waypoint has so many with the way around zones";
                let message = format_args!("--most-items {most}: {expected}");
                return Err(InputError::new("scenario", &self.track.run.scenario.path, message));
            }
            waypoints.extend(rest.drain(..count));
            waypoints.extend(back);
            parts.push(waypoints);
        }
        Ok(parts)
    }

    /// The waypoints after `from` on the way around zones to `to`, the last one there; none if it is there.
    fn way(&self, from: &Point3<f64>, to: &Point3<f64>) -> Vec<VehicleStop> {
        if (to.xy() - from.xy()).norm() <= MERGE_M {
            return Vec::new();
        }
        let speed_mps = rounded(self.max_speed_mps());
        let way = self.airspace.way(&from.xy(), &to.xy());
        // No way leads to a start in a zone.
        let way = if way.is_empty() { vec![to.xy()] } else { way.to_vec() };
        way.into_iter().map(|at| VehicleStop::on_way(Point3::new(at.x, at.y, from.z), speed_mps)).collect()
    }

    /// Number of items of these waypoints and their speeds.
    fn count_items(&self, waypoints: &[VehicleStop], set_mps: &mut Option<f64>) -> usize {
        waypoints.iter().map(|waypoint| 1 + usize::from(self.new_speed(set_mps, waypoint).is_some())).sum()
    }

    /// The speed to set before the leg to `waypoint` [m/s], if the one that is set is too different.
    fn new_speed(&self, set_mps: &mut Option<f64>, waypoint: &VehicleStop) -> Option<f64> {
        let speed_mps = waypoint.speed_mps?;
        let slowest_mps = (1.0 - MAX_FASTER) * speed_mps;
        let fastest_mps = speed_mps + MAX_SLOWER * self.max_speed_mps();
        if set_mps.is_some_and(|set_mps| (slowest_mps..=fastest_mps).contains(&set_mps)) {
            return None;
        }
        *set_mps = Some(speed_mps);
        *set_mps
    }

    /// Refuses a part that a vehicle must not fly: to or below the ground, or through a zone.
    fn check_path(&self, waypoints: &[VehicleStop]) -> Result<(), InputError> {
        let refuse = |what: fmt::Arguments<'_>| {
            let message = format_args!("the mission would lead {what}: expected a run that a vehicle may fly");
            Err(InputError::new("scenario", &self.track.run.scenario.path, message))
        };
        let mut before = self.home();
        for VehicleStop { position, .. } in waypoints {
            let [x_m, y_m, z_m] = (*position).into();
            if z_m <= 0.0 {
                return refuse(format_args!("to ({x_m:.1} m, {y_m:.1} m) at {z_m:.1} m above the ground"));
            }
            if self.airspace.entry(&before.xy(), &position.xy(), [before.z, z_m], ZONE_SLACK_M).is_some() {
                return refuse(format_args!(
                    "through a zone, a building or the boundary, on the way to ({x_m:.1} m, {y_m:.1} m)"
                ));
            }
            before = *position;
        }
        Ok(())
    }

    /// The part with these waypoints.
    fn part(&self, waypoints: &[VehicleStop]) -> Result<MissionPart, InputError> {
        let positions: Vec<Point3<f64>> = waypoints.iter().map(|waypoint| waypoint.position).collect();
        let altitudes_m = self.altitudes.along(&self.home(), &positions);
        let take_off_m = altitudes_m[0];
        let altitudes_m = &altitudes_m[1..];
        let mut items = vec![VehicleItem::TakeOff { home: self.track.points[0].place, altitude_m: take_off_m }];
        let mut legs = Vec::with_capacity(waypoints.len());
        let mut set_mps = None;
        for (waypoint, &altitude_m) in waypoints.iter().zip(altitudes_m) {
            let at = waypoint.position.xy();
            items.extend(self.new_speed(&mut set_mps, waypoint).map(|speed_mps| VehicleItem::Speed { speed_mps }));
            let hold_s = self.options.hold_s(waypoint.hold_s);
            items.push(VehicleItem::Waypoint { place: self.track.place(&at)?, altitude_m, hold_s });
            let to = Point3::new(at.x, at.y, self.altitudes.above_home_m(altitude_m));
            legs.push(MissionLeg { to, speed_mps: set_mps.unwrap_or(self.max_speed_mps()), hold_s });
        }
        items.push(VehicleItem::Return);
        let motion = self.options.motion(&self.track.run.scenario);
        let battery = Battery::finite(&self.track.run.scenario);
        let home = self.home();
        let effort = effort(&motion, home.xy(), take_off_m, &legs, battery.as_ref());
        let timeline = timeline(&motion, home.xy(), take_off_m, &legs);
        let above_ground_m = positions.iter().zip(altitudes_m);
        let above_ground_m = above_ground_m.filter_map(|(at, &up_m)| self.altitudes.above_ground_m(&at.xy(), up_m));
        let highest_m = above_ground_m.reduce(f64::max);
        let path = std::iter::once(home).chain(positions).collect();
        Ok(MissionPart { items, path, effort, timeline, highest_m })
    }
}

/// Checks that the UAV has the time and the energy for each part.
fn check_effort(track: &GeodeticTrack<'_>, parts: &[MissionPart]) -> Result<(), InputError> {
    let scenario = &track.run.scenario;
    let endurance_s = scenario.endurance_s_of(track.uav).unwrap_or(scenario.uav.endurance_s);
    let battery = Battery::finite(scenario);
    let usable_j = battery.map_or(f64::INFINITY, |battery| battery.initial_j - battery.reserve_j);
    for (part, number) in parts.iter().zip(1..) {
        let MissionEffort { duration_s, energy_j } = part.effort;
        let refuse = |what: fmt::Arguments<'_>| {
            let expected = "expected a shorter flight, such as with --min-bits or --most-items, or --ignore-endurance";
            let of = parts.len();
            let message = format_args!("part {number} of {of} of the mission takes {what}: {expected}");
            Err(InputError::new("scenario", &scenario.path, message))
        };
        if duration_s > endurance_s {
            return refuse(format_args!(
                "{duration_s:.0} s from take-off to landing, more than the endurance, {endurance_s} s"
            ));
        }
        if energy_j > usable_j {
            return refuse(format_args!(
                "{energy_j:.0} J, more than the battery has without its reserve, {usable_j:.0} J"
            ));
        }
    }
    Ok(())
}
