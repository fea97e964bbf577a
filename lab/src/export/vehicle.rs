//! The items of a vehicle mission (MAVLink), split into parts if there are too many.
//!
//! Which waypoints there are is left to [`stops`], how long they take to [`duration`].

use std::fmt;
use std::ops::Range;

use nalgebra::Point3;
use skysink_common::airspace::Airspace;
use skysink_common::error::InputError;
use skysink_common::geodata::projection::GeodeticPosition;

use super::altitude::{AltitudeReference, Altitudes};
use super::duration::{MissionEffort, MissionLeg, effort};
use super::mission_options::VehicleMissionOptions;
use super::stops::{self, MERGE_M, VehicleStop, rounded};
use super::track::GeodeticTrack;

/// A speed is unchanged while the next ones are slower by at most this fraction of the maximum.
const SPEED_STEP: f64 = 0.1;

/// The same while they are faster by at most this fraction of themselves.
const SLOWER: f64 = 0.01;

/// An item of a vehicle mission.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(missing_docs, reason = "the names of the fields say it")]
pub enum VehicleItem {
    /// `MAV_CMD_NAV_TAKEOFF`: above home [m].
    TakeOff { home: GeodeticPosition, altitude_m: f64 },
    /// `MAV_CMD_DO_CHANGE_SPEED`: over ground [m/s].
    Speed { speed_mps: f64 },
    /// `MAV_CMD_NAV_WAYPOINT`: in the altitude reference of the mission [m], held for a time [s].
    Waypoint { place: GeodeticPosition, altitude_m: f64, hold_s: f64 },
    /// `MAV_CMD_NAV_RETURN_TO_LAUNCH`.
    Return,
}

/// An item with the codes of MAVLink.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MavlinkItem {
    /// `MAV_CMD`.
    pub command: u16,
    /// `MAV_FRAME`.
    pub frame: u8,
    /// Parameters 1 to 7; NaN lets the vehicle choose the heading.
    pub params: [f64; 7],
}

/// How far a mission may lead into a zone [m]: the rounding of a run.
const ZONE_SLACK_M: f64 = 0.01;

/// `MAV_FRAME_MISSION`, of items without a position.
const NO_POSITION: u8 = 2;

impl VehicleItem {
    /// Converts the item to the codes of MAVLink (`MAV_CMD` and `MAV_FRAME` of common.xml).
    #[must_use]
    pub fn mavlink(&self, reference: AltitudeReference) -> MavlinkItem {
        let at = |command, frame, hold_s, place: GeodeticPosition, altitude_m| MavlinkItem {
            command,
            frame,
            params: [hold_s, 0.0, 0.0, f64::NAN, place.lat_deg, place.lon_deg, altitude_m],
        };
        match *self {
            Self::TakeOff { home, altitude_m } => at(22, AltitudeReference::Relative.frame(), 0.0, home, altitude_m),
            Self::Waypoint { place, altitude_m, hold_s } => at(16, reference.frame(), hold_s, place, altitude_m),
            Self::Speed { speed_mps } => {
                MavlinkItem { command: 178, frame: NO_POSITION, params: [1.0, speed_mps, -1.0, 0.0, 0.0, 0.0, 0.0] }
            }
            Self::Return => MavlinkItem { command: 20, frame: NO_POSITION, params: [0.0; 7] },
        }
    }
}

/// A part of a mission, from take-off to landing.
#[derive(Debug)]
pub struct MissionPart {
    /// Its items, without home.
    pub items: Vec<VehicleItem>,
    /// The time and energy that it takes.
    pub effort: MissionEffort,
    /// How high above the ground a waypoint can be [m], as in [`VehicleMission`].
    pub highest_m: Option<f64>,
}

/// A mission of a vehicle.
#[derive(Debug)]
pub struct VehicleMission {
    /// Its parts.
    pub parts: Vec<MissionPart>,
    /// What the altitudes of waypoints are above.
    pub reference: AltitudeReference,
    /// The ground at home, as low as it can be [m]; `None` if the list does not tell it.
    pub home_ground_m: Option<f64>,
    /// How high above the ground a waypoint can be [m], if the altitudes are not above the ground below and the list tells it.
    pub highest_m: Option<f64>,
    /// The points of the track at which sensor nodes are served, with the altitude of the vehicle [m].
    pub services: Vec<(usize, f64)>,
    /// What was merged and omitted.
    pub summary: String,
}

/// A part under construction.
struct Planned<'a> {
    track: &'a GeodeticTrack<'a>,
    options: &'a VehicleMissionOptions,
    altitudes: &'a Altitudes,
    airspace: &'a Airspace,
}

/// The vehicle mission of a track. Each part takes off, flies to its first waypoint and home from its last one around zones, and
/// lands.
///
/// # Errors
/// If no waypoint is left, an altitude is not known, or a part takes longer or more energy than the UAV has.
pub fn plan(track: &GeodeticTrack<'_>, options: &VehicleMissionOptions) -> Result<VehicleMission, InputError> {
    let scenario = &track.run.scenario;
    let altitudes = Altitudes::of(track, options.altitude)?;
    let airspace = scenario.airspace();
    let merged = stops::merge(track);
    let home = track.points[0].position;
    let count = merged.len();
    let bits = |stops: &[VehicleStop]| stops.iter().map(|stop| stop.bits).sum::<u64>();
    let all_bits = bits(&merged);
    let mut stops = stops::with_bits(merged, options.min_bits, home, &airspace);
    if stops.is_empty() {
        let message = format_args!("--min-bits {}: no pass carries so many: expected fewer", options.min_bits);
        return Err(InputError::new("run", &scenario.path, message));
    }
    let planned = Planned { track, options, altitudes: &altitudes, airspace: &airspace };
    let mut services = Vec::new();
    let mut parts = Vec::new();
    for part in planned.split(&mut stops)? {
        parts.push(planned.part(&planned.round(&stops[part]), &mut services)?);
    }
    let omitted = (options.min_bits > 0).then(|| Omitted {
        stops: count - stops.iter().filter(|stop| stop.is_pass()).count(),
        of: count,
        bits: all_bits - bits(&stops),
        of_bits: all_bits,
    });
    let summary = summary(track, &stops, &parts, omitted.as_ref());
    let home_ground_m = altitudes.home_ground_m();
    let highest_m = parts.iter().filter_map(|part| part.highest_m).reduce(f64::max);
    let mission = VehicleMission { parts, reference: altitudes.reference, home_ground_m, highest_m, services, summary };
    mission.check(track, options)?;
    Ok(mission)
}

impl Planned<'_> {
    /// The stops of each part: as many as fit into its items. The way to the first one of a later part begins at home, and is
    /// flown at the highest speed.
    fn split(&self, stops: &mut [VehicleStop]) -> Result<Vec<Range<usize>>, InputError> {
        let most = self.options.most_items();
        let home = self.track.points[0].position;
        let mut parts = Vec::new();
        let mut begin = 0;
        while begin < stops.len() {
            if begin > 0 {
                stops[begin].speed_mps = Some(rounded(self.track.run.scenario.uav.max_speed_mps));
            }
            let mut set_mps = None;
            let out = self.way(&home, &stops[begin].position);
            let mut items = 2 + self.items_of(&out[..out.len().saturating_sub(1)], &mut set_mps); // with home and take-off
            let mut end = begin;
            for stop in &stops[begin..] {
                items += self.items_of(std::slice::from_ref(stop), &mut set_mps);
                let back = self.items_of(&self.way(&stop.position, &home), &mut set_mps.clone());
                if items + back + 1 > most {
                    break;
                }
                end += 1;
            }
            if end == begin {
                let expected = "expected more, because a single waypoint has so many with the way around zones";
                let message = format_args!("--most-items {most}: {expected}");
                return Err(InputError::new("scenario", &self.track.run.scenario.path, message));
            }
            parts.push(begin..end);
            begin = end;
        }
        Ok(parts)
    }

    /// The waypoints of a part: those on the way from home, its stops, and those on the way home.
    fn round(&self, stops: &[VehicleStop]) -> Vec<VehicleStop> {
        let home = self.track.points[0].position;
        let ends = stops.first().zip(stops.last());
        let (mut out, back) = ends.map_or_else(Default::default, |(first, last)| {
            (self.way(&home, &first.position), self.way(&last.position, &home))
        });
        out.pop(); // the first stop
        [out, stops.to_vec(), back].concat()
    }

    /// The waypoints after `from` on the way around zones to `to`, the last one there; none if it is there.
    fn way(&self, from: &Point3<f64>, to: &Point3<f64>) -> Vec<VehicleStop> {
        if (to.xy() - from.xy()).norm() <= MERGE_M {
            return Vec::new();
        }
        let speed_mps = rounded(self.track.run.scenario.uav.max_speed_mps);
        let way = self.airspace.way(&from.xy(), &to.xy());
        // No way leads to a start in a zone.
        let way = if way.is_empty() { vec![to.xy()] } else { way.to_vec() };
        way.into_iter().map(|at| VehicleStop::on_way(Point3::new(at.x, at.y, from.z), speed_mps)).collect()
    }

    /// Number of items of these waypoints and their speeds.
    fn items_of(&self, nodes: &[VehicleStop], set_mps: &mut Option<f64>) -> usize {
        nodes.iter().map(|node| 1 + usize::from(self.change(set_mps, node).is_some())).sum()
    }

    /// The speed to set before the leg to `node` [m/s], if the one set is too different.
    fn change(&self, set_mps: &mut Option<f64>, node: &VehicleStop) -> Option<f64> {
        let step_mps = SPEED_STEP * self.track.run.scenario.uav.max_speed_mps;
        let keeps =
            |set_mps: f64, speed_mps: f64| set_mps >= (1.0 - SLOWER) * speed_mps && set_mps <= speed_mps + step_mps;
        let is_new = |speed_mps: &f64| set_mps.is_none_or(|set_mps: f64| !keeps(set_mps, *speed_mps));
        let speed_mps = node.speed_mps.filter(is_new)?;
        *set_mps = Some(speed_mps);
        Some(speed_mps)
    }

    /// Refuses a part that a vehicle must not fly: on or below the ground, or through a zone.
    fn check(&self, nodes: &[VehicleStop]) -> Result<(), InputError> {
        let scenario = &self.track.run.scenario;
        let refuse = |what: fmt::Arguments<'_>| {
            let message = format_args!("the mission would lead {what}: expected a run that a vehicle may fly");
            Err(InputError::new("scenario", &scenario.path, message))
        };
        if self.options.is_map {
            return Ok(());
        }
        let home = self.track.points[0].position;
        for (before, node) in std::iter::once(&home).chain(nodes.iter().map(|node| &node.position)).zip(nodes) {
            let [x_m, y_m, z_m] = node.position.into();
            if z_m <= 0.0 {
                return refuse(format_args!("to ({x_m:.1} m, {y_m:.1} m) at {z_m:.1} m above the ground"));
            }
            if self.airspace.entry(&before.xy(), &node.position.xy(), [before.z, z_m], ZONE_SLACK_M).is_some() {
                return refuse(format_args!(
                    "through a zone, a building or the boundary, on the way to ({x_m:.1} m, {y_m:.1} m)"
                ));
            }
        }
        Ok(())
    }

    /// The items of a part.
    fn part(&self, nodes: &[VehicleStop], services: &mut Vec<(usize, f64)>) -> Result<MissionPart, InputError> {
        self.check(nodes)?;
        let scenario = &self.track.run.scenario;
        let home = &self.track.points[0];
        let positions: Vec<Point3<f64>> = nodes.iter().map(|node| node.position).collect();
        let [take_off_m, altitudes_m @ ..] = &self.altitudes.along(home.position, &positions)[..] else {
            unreachable!("an altitude for the take-off");
        };
        let mut items = vec![VehicleItem::TakeOff { home: home.place, altitude_m: *take_off_m }];
        let mut legs = Vec::with_capacity(nodes.len());
        let mut set_mps = None;
        for (node, &altitude_m) in nodes.iter().zip(altitudes_m) {
            items.extend(self.change(&mut set_mps, node).map(|speed_mps| VehicleItem::Speed { speed_mps }));
            let hold_s = self.options.autopilot().hold_s(node.hold_s);
            items.push(VehicleItem::Waypoint { place: self.track.place(&node.position.xy())?, altitude_m, hold_s });
            let to = Point3::new(node.position.x, node.position.y, self.altitudes.above_home_m(altitude_m));
            legs.push(MissionLeg { to, speed_mps: set_mps.unwrap_or(scenario.uav.max_speed_mps), hold_s });
            services.extend(node.services.iter().map(|&service| (service, altitude_m)));
        }
        items.push(VehicleItem::Return);
        let weight_n = scenario.uav.battery.map_or(0.0, |battery| battery.weight_n);
        let motion = self.options.motion(scenario);
        let effort = effort(&motion, home.position.xy(), *take_off_m, &legs, &scenario.uav.propulsion, weight_n);
        let above_m = positions.iter().zip(altitudes_m);
        let above_m = above_m.filter_map(|(at, &altitude_m)| self.altitudes.above_ground_m(at, altitude_m));
        Ok(MissionPart { items, effort, highest_m: above_m.reduce(f64::max) })
    }
}

impl VehicleMission {
    /// What is good to know about it: altitudes, home, and the time that each part takes; a line for each.
    #[must_use]
    pub fn description(&self, track: &GeodeticTrack<'_>, options: &VehicleMissionOptions) -> Vec<String> {
        let home = track.points[0].place;
        let above = match self.reference {
            AltitudeReference::Relative if self.home_ground_m.is_none() => "home (the ground is taken to be flat)",
            AltitudeReference::Relative => "home",
            AltitudeReference::Terrain => "the ground below (the autopilot needs terrain data)",
            AltitudeReference::Msl => "the level that ground_m is above",
        };
        let altitudes_m = self.parts.iter().flat_map(|part| &part.items).filter_map(|item| match item {
            VehicleItem::Waypoint { altitude_m, .. } => Some(*altitude_m),
            _ => None,
        });
        let [lowest_m, highest_m] = altitudes_m.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], altitude_m| {
            [low.min(altitude_m), high.max(altitude_m)]
        });
        let range =
            if lowest_m == highest_m { format!("{lowest_m} m") } else { format!("{lowest_m:.1} to {highest_m:.1} m") };
        let motion = options.motion(&track.run.scenario);
        let jerk = motion.horizontal.jerk_mps3.map_or(String::new(), |jerk_mps3| format!(" and {jerk_mps3} m/s³"));
        let times: Vec<String> = self.parts.iter().map(|part| format!("{:.0} s", part.effort.duration_s)).collect();
        let planned_s = track.run.slots.len() as f64 * track.run.scenario.slot_s;
        let ground_m = track.run.list.ground_m().iter().copied().reduce(f64::max);
        let return_line = ground_m.zip(self.home_ground_m).map(|(highest_m, home_m)| {
            let above_m = (highest_m - home_m + track.points[0].position.z).ceil();
            let high =
                self.highest_m.map_or(String::new(), |highest_m| format!("up to {highest_m:.0} m above the ground; "));
            format!("{high}set the return altitude (RTL_ALT, RTL_RETURN_ALT) to {above_m} m above home or more")
        });
        let lines = [
            format!("home {} {} (latitude, longitude), {range} above {above}", home.lat_deg, home.lon_deg),
            format!(
                "estimated from take-off to landing: {} with {} m/s²{jerk} (planned: {planned_s} s)",
                times.join(", "),
                motion.horizontal.acceleration_mps2
            ),
        ];
        lines.into_iter().chain(return_line).collect()
    }

    /// Checks that the UAV has the time and the energy for each part.
    fn check(&self, track: &GeodeticTrack<'_>, options: &VehicleMissionOptions) -> Result<(), InputError> {
        let scenario = &track.run.scenario;
        let own_s = scenario.uav.endurances_s.as_ref().and_then(|own| own.get(track.uav).copied());
        let endurance_s = own_s.unwrap_or(scenario.uav.endurance_s);
        let battery = scenario.uav.battery;
        let usable_j =
            battery.map_or(f64::INFINITY, |battery| battery.capacity_j * (battery.initial - battery.reserve));
        for (part, number) in self.parts.iter().zip(1..) {
            let MissionEffort { duration_s, energy_j } = part.effort;
            let refuse = |what: fmt::Arguments<'_>| {
                let of = self.parts.len();
                let expected =
                    "expected a shorter flight, such as with --min-bits or --most-items, or --ignore-endurance";
                let message = format_args!("part {number} of {of} of the mission takes {what}: {expected}");
                Err(InputError::new("scenario", &scenario.path, message))
            };
            if !options.ignore_endurance && duration_s > endurance_s {
                return refuse(format_args!(
                    "{duration_s:.0} s from take-off to landing, more than the endurance, {endurance_s} s"
                ));
            }
            if !options.ignore_endurance && energy_j > usable_j {
                return refuse(format_args!(
                    "{energy_j:.0} J, more than the battery has without its reserve, {usable_j:.0} J"
                ));
            }
        }
        Ok(())
    }
}

/// What `--min-bits` has omitted.
struct Omitted {
    stops: usize,
    of: usize,
    bits: u64,
    of_bits: u64,
}

fn summary(
    track: &GeodeticTrack<'_>,
    stops: &[VehicleStop],
    parts: &[MissionPart],
    omitted: Option<&Omitted>,
) -> String {
    let slots = track.points.len() - 1;
    let waypoints = stops.len();
    let services = track.services().count();
    let serving = stops.iter().filter(|stop| !stop.services.is_empty()).count();
    let items_of = |part: &MissionPart| part.items.len() + 1; // and home
    let speeds =
        parts.iter().flat_map(|part| &part.items).filter(|item| matches!(item, VehicleItem::Speed { .. })).count();
    let items: usize = parts.iter().map(items_of).sum();
    let files = if parts.len() == 1 { "1 file".to_owned() } else { format!("{} files", parts.len()) };
    let mut text = format!(
        "{slots} slots ({services} serving) → {waypoints} waypoints ({serving} serving), {speeds} changes of speed → \
         {items} items → {files}"
    );
    if let Some(Omitted { stops, of, bits, of_bits }) = omitted {
        let percent = 100.0 * *bits as f64 / (*of_bits).max(1) as f64;
        text += &format!("\n{stops} of {of} waypoints omitted, with {bits} of {of_bits} bits ({percent:.2} %)");
    }
    text
}
