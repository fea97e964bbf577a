//! The items of a vehicle mission (MAVLink): merges slots into legs and holds, and splits long missions.

use nalgebra::{Point3, Vector3};
use skysink_common::geodata::projection::GeodeticPosition;

use super::track::{GeodeticTrack, TrackPoint};

/// Minimum number of items of a mission: home, take-off, speed, waypoint, return.
pub const MIN_ITEMS: usize = 5;

/// Items that the next waypoint of a part needs: itself, home and the return.
const NEXT_ITEMS: usize = 3;

/// Tolerance for merging positions [m].
const MERGE_M: f64 = 0.05;

/// A speed is unchanged while the next ones are within this fraction of the maximum.
const SPEED_STEP: f64 = 0.1;

/// An item of a vehicle mission.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(missing_docs, reason = "the names of the fields say it")]
pub enum VehicleItem {
    /// `MAV_CMD_NAV_TAKEOFF`: above home [m].
    TakeOff { home: GeodeticPosition, altitude_m: f64 },
    /// `MAV_CMD_DO_CHANGE_SPEED`: over ground [m/s].
    Speed { speed_mps: f64 },
    /// `MAV_CMD_NAV_WAYPOINT`: above home [m], held for a time [s].
    Waypoint { place: GeodeticPosition, altitude_m: f64, hold_s: f64 },
    /// `MAV_CMD_NAV_RETURN_TO_LAUNCH`.
    Return,
}

/// An item with the codes of MAVLink.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MavlinkItem {
    /// `MAV_CMD`.
    pub command: u16,
    /// `MAV_FRAME`: 3 for altitudes above home, 2 for no position.
    pub frame: u8,
    /// Parameters 1 to 7; NaN lets the vehicle choose the heading.
    pub params: [f64; 7],
}

impl VehicleItem {
    /// Converts the item to the codes of MAVLink (`MAV_CMD` and `MAV_FRAME` of common.xml).
    #[must_use]
    pub fn mavlink(&self) -> MavlinkItem {
        let at = |command, hold_s, place: GeodeticPosition, altitude_m| MavlinkItem {
            command,
            frame: 3,
            params: [hold_s, 0.0, 0.0, f64::NAN, place.lat_deg, place.lon_deg, altitude_m],
        };
        match *self {
            Self::TakeOff { home, altitude_m } => at(22, 0.0, home, altitude_m),
            Self::Waypoint { place, altitude_m, hold_s } => at(16, hold_s, place, altitude_m),
            Self::Speed { speed_mps } => {
                MavlinkItem { command: 178, frame: 2, params: [1.0, speed_mps, -1.0, 0.0, 0.0, 0.0, 0.0] }
            }
            Self::Return => MavlinkItem { command: 20, frame: 2, params: [0.0; 7] },
        }
    }
}

/// A vehicle mission, split into parts if it has too many items.
#[derive(Debug)]
pub struct VehicleMission {
    /// The items of each part, without home.
    pub parts: Vec<Vec<VehicleItem>>,
    /// A summary of what was merged.
    pub summary: String,
}

/// Merges the slots of a track, and splits the mission into parts of at most `most_items` items, including home.
///
/// A slot is merged into the previous hold if the UAV stays within 5 cm. It is merged into the previous leg if it
/// continues straight on at the same speed and no sensor node is served in between. Each part takes off and returns.
#[must_use]
pub fn plan(track: &GeodeticTrack<'_>, most_items: usize) -> VehicleMission {
    let stops = merge(track);
    let step_mps = SPEED_STEP * track.run.scenario.uav.max_speed_mps;
    let home = &track.points[0];
    let take_off = VehicleItem::TakeOff { home: home.place, altitude_m: home.position.z };
    let mut parts = Vec::new();
    let mut part = vec![take_off];
    let mut set_mps = None;
    for stop in &stops {
        let is_new = |set_mps: Option<f64>| {
            stop.speed_mps.filter(|speed_mps| set_mps.is_none_or(|set_mps| (speed_mps - set_mps).abs() > step_mps))
        };
        if part.len() + NEXT_ITEMS + usize::from(is_new(set_mps).is_some()) > most_items {
            part.push(VehicleItem::Return);
            parts.push(std::mem::replace(&mut part, vec![take_off]));
            set_mps = None;
        }
        if let Some(speed_mps) = is_new(set_mps) {
            part.push(VehicleItem::Speed { speed_mps });
            set_mps = Some(speed_mps);
        }
        let TrackPoint { place, position, .. } = stop.point;
        part.push(VehicleItem::Waypoint { place, altitude_m: position.z, hold_s: stop.hold_s });
    }
    part.push(VehicleItem::Return);
    parts.push(part);
    let summary = summary(track, &stops, &parts);
    VehicleMission { parts, summary }
}

fn summary(track: &GeodeticTrack<'_>, stops: &[VehicleStop<'_>], parts: &[Vec<VehicleItem>]) -> String {
    let slots = track.points.len() - 1;
    let waypoints = stops.len();
    let services = track.services().count();
    let serving = stops.iter().filter(|stop| stop.is_service).count();
    let speeds = parts.iter().flatten().filter(|item| matches!(item, VehicleItem::Speed { .. })).count();
    let items: usize = parts.iter().map(|part| part.len() + 1).sum(); // and home
    let files = if parts.len() == 1 { "1 file".to_owned() } else { format!("{} files", parts.len()) };
    format!(
        "{slots} slots ({services} serving) → {waypoints} waypoints ({serving} serving), {speeds} changes of speed → \
         {items} items → {files}"
    )
}

/// A waypoint under construction.
#[derive(Debug)]
struct VehicleStop<'a> {
    point: TrackPoint<'a>,
    hold_s: f64,
    /// Ground speed on the leg to it [m/s]; `None` for a vertical leg or one of length 0.
    speed_mps: Option<f64>,
    is_service: bool,
    /// The start of the leg to it [m], its first step [m], and its number of slots.
    from: Point3<f64>,
    step: Vector3<f64>,
    slots: u32,
}

impl VehicleStop<'_> {
    /// Whether the leg continues straight to `position` in the next slot, at the same speed and without service here.
    fn leads_to(&self, position: &Point3<f64>) -> bool {
        self.hold_s == 0.0 && (self.from + self.step * f64::from(self.slots + 1) - position).norm() <= MERGE_M
    }
}

fn merge<'a>(track: &GeodeticTrack<'a>) -> Vec<VehicleStop<'a>> {
    let scenario = &track.run.scenario;
    let mut stops: Vec<VehicleStop<'a>> = Vec::new();
    for pair in track.points.windows(2) {
        let before = &pair[0];
        let point = pair[1];
        let is_service = !point.served().is_empty();
        let comm_s = if is_service { scenario.link.comm_s } else { 0.0 };
        let step = point.position - before.position;
        match stops.last_mut() {
            Some(stop) if (point.position - stop.point.position).norm() <= MERGE_M => {
                stop.hold_s += scenario.slot_s;
                stop.is_service |= is_service;
            }
            Some(stop) if stop.leads_to(&point.position) => {
                *stop = VehicleStop { point, hold_s: comm_s, is_service, slots: stop.slots + 1, ..*stop };
            }
            _ => {
                let stays = stops.is_empty() && step.norm() <= MERGE_M;
                stops.push(VehicleStop {
                    point,
                    hold_s: if stays { scenario.slot_s } else { comm_s },
                    speed_mps: Some(step.xy().norm() / scenario.slot_s).filter(|_| step.xy().norm() > MERGE_M),
                    is_service,
                    from: before.position,
                    step,
                    slots: 1,
                });
            }
        }
    }
    stops
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use proptest::prelude::*;
    use skysink_common::message::Mode;
    use skysink_common::scenario::{Origin, Overrides, Scenario};
    use skysink_common::sensors::SensorList;
    use skysink_common::slot_record::{ByUav, UAV};
    use skysink_mission::replay::RecordedRun;
    use skysink_mission::trace::RecordedSlot;

    use super::*;

    /// A run from the origin, with a step along x [m] and whether somebody is served in each slot. V_max is 30 m/s.
    fn run(steps: &[(f64, bool)]) -> RecordedRun {
        let text = "name = \"a\"\n[area]\nside_m = 1e4\n[uav]\nstart_m = [0.0, 0.0]\n[link]\ncomm_s = 0.25";
        let scenario = Scenario::parse(text, Path::new("a"), Overrides::default()).unwrap();
        let list = SensorList::of(&scenario).unwrap();
        let mut x_m = 0.0;
        let mut slot = |(index, &(step_m, serves)): (usize, &(f64, bool))| {
            x_m += step_m;
            ByUav::from_buf([RecordedSlot {
                slot: index as u64 + 1,
                uav: UAV,
                position: Point3::new(x_m, 0.0, 20.0),
                scheduled: if serves { vec![3] } else { vec![] },
                delivered_bits: 0,
                lost_bits: 0,
                queued_bits: 0,
                mode: Mode::Serve,
                refused: 0,
                energy_j: f64::INFINITY,
            }])
        };
        let slots = steps.iter().enumerate().map(&mut slot).collect();
        RecordedRun { scenario, list, strategy: "uts".to_owned(), slots, uploads_bits: Vec::new() }
    }

    fn track(run: &RecordedRun) -> GeodeticTrack<'_> {
        GeodeticTrack::new(run, UAV, Origin { lat_deg: 0.0, lon_deg: 0.0 }).unwrap()
    }

    #[test]
    fn straight_legs_and_holds_are_merged() {
        // On the equator x is a sin λ: 60 m are 60/6378137 · 180°/π = 0.000538989°.
        let run = run(&[(30.0, false), (30.0, false), (0.0, true), (10.0, true), (0.0, true), (9.0, false)]);
        let mission = plan(&track(&run), 100);
        let waypoint = |lon_deg: f64, hold_s| {
            let place = GeodeticPosition { lat_deg: 0.0, lon_deg };
            VehicleItem::Waypoint { place, altitude_m: 20.0, hold_s }
        };
        let expected = [
            VehicleItem::TakeOff { home: GeodeticPosition { lat_deg: 0.0, lon_deg: 0.0 }, altitude_m: 20.0 },
            VehicleItem::Speed { speed_mps: 30.0 },
            waypoint(0.000538989, 1.0), // two legs in one, and a slot of hovering
            VehicleItem::Speed { speed_mps: 10.0 },
            waypoint(0.000628821, 1.25), // τ_c at the end of the leg, and a slot
            waypoint(0.000709669, 0.0),  // 9 m/s are within a tenth of 30 m/s
            VehicleItem::Return,
        ];
        assert_eq!(mission.parts, [expected]);
        assert_eq!(
            mission.summary,
            "6 slots (3 serving) → 3 waypoints (2 serving), 2 changes of speed → 8 items → 1 file"
        );
    }

    proptest! {
        #[test]
        fn whoever_is_served_is_served_in_the_mission_in_order(
            steps in prop::collection::vec((prop::sample::select(vec![0.0, 0.03, 7.0, 20.0]), prop::bool::ANY), 1..80),
            most_items in MIN_ITEMS..60,
        ) {
            let run = run(&steps);
            let track = track(&run);
            let mission = plan(&track, most_items);
            let mut waypoints = Vec::new();
            for part in &mission.parts {
                prop_assert!(part.len() < most_items, "{part:?}"); // and home
                let is_whole = matches!(part[..], [VehicleItem::TakeOff { .. }, .., VehicleItem::Return]);
                prop_assert!(is_whole, "{part:?}");
                let place = |item: &VehicleItem| match item {
                    VehicleItem::Waypoint { place, .. } => Some(*place),
                    _ => None,
                };
                waypoints.extend(part.iter().filter_map(place));
            }
            let mut waypoints = waypoints.iter().peekable();
            for (point, slot) in track.services() {
                // 0.1 m on the equator is 9e-7°.
                let is_here = |place: &GeodeticPosition| (place.lon_deg - point.place.lon_deg).abs() < 9e-7;
                while waypoints.next_if(|place| !is_here(place)).is_some() {}
                prop_assert!(waypoints.peek().is_some(), "slot {slot}");
            }
        }
    }
}
