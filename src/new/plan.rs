//! `skysink new --plan`: a fixed flight, its start and zones from the plan of another program.

use std::path::Path;

use skysink_common::airspace::Polygon;
use skysink_common::error::InputError;
use skysink_common::geodata::projection::Projection;
use skysink_common::geodata::{Zone, ZoneKind, Zones};
use skysink_common::geometry::Position;
use skysink_common::scenario::{MOST_TRACK_SLOTS, Scenario, TimedPoint, slot_ends};
use skysink_common::sensors::SensorList;
use skysink_common::slack::SLOTS_SLACK;
use skysink_lab::import::plan::{ForeignPlan, PLAN, PlannedPoint};

use super::additions::Additions;
use super::presets::Lines;

/// The file of the fixed flight.
const TRACK: &str = "track.csv";

/// The lines of the flight.
const TRACK_LINE: &str = "track = \"track.csv\"               # the plan's flight; strategies only schedule\n";

/// The place of home in messages.
pub const HOME: &str = "home";

/// Slack of a speed that is rounded up to whole millimetres per second [mm/s].
const SPEED_SLACK_MMPS: f64 = 1e-6;

/// How often the legs that have to end with a slot are looked for, before all do.
const MOST_ATTEMPTS: usize = 50;

/// A flight that is longer by less is as long [s].
const LEAST_LONGER_S: f64 = 0.05;

/// Shortest slot with a radio by name [s].
const LEAST_SLOT_S: f64 = 1.0;

/// Ground that rises by more than this is no plane [m].
const FLAT_M: f64 = 2.0;

/// The plan of a file.
pub struct PlannedFlight<'a> {
    path: &'a Path,
    plan: ForeignPlan,
}

/// The flight in the area, and how it is cut into slots.
struct SlottedFlight {
    points: Vec<PlannedPoint>,
    slots: u64,
    /// Where slots end [m], the start included.
    ends: Vec<Position>,
    /// How much longer the flight is because legs end with slots [s].
    longer_s: f64,
}

impl SlottedFlight {
    /// How long the plan flies [s].
    fn flown_s(&self) -> f64 {
        self.points[self.points.len() - 1].point.time_s
    }

    /// The legs that end within a slot whose straight way is `crossed`.
    fn legs_cut(&self, slot_s: f64, crossed: impl Fn(&Position, &Position) -> bool) -> Vec<usize> {
        let mut legs = Vec::new();
        let mut next = 0;
        for (slot, pair) in self.ends.windows(2).enumerate() {
            let end_s = (slot + 1) as f64 * slot_s;
            let begin = next;
            while next < self.points.len() && self.points[next].point.time_s < end_s {
                next += 1;
            }
            if next > begin && crossed(&pair[0], &pair[1]) {
                legs.extend(self.points[begin..next].iter().filter_map(|point| point.leg));
            }
        }
        legs
    }
}

impl<'a> PlannedFlight<'a> {
    /// Reads the file `path`, with `speed_mps` [m/s] until an item sets a speed.
    ///
    /// # Errors
    /// If it is refused.
    pub fn read(path: &'a Path, speed_mps: Option<f64>) -> Result<Self, InputError> {
        Ok(Self { path, plan: ForeignPlan::read(path, speed_mps)? })
    }

    /// The file.
    pub fn path(&self) -> &'a Path {
        self.path
    }

    /// Latitude and longitude of the start [°].
    pub fn home(&self) -> [f64; 2] {
        self.plan.home
    }

    /// Latitude and longitude of the end of each leg [°], with its place in the file.
    pub fn places(&self) -> impl Iterator<Item = (&str, [f64; 2])> {
        self.plan.legs.iter().map(|leg| (&*leg.place, leg.to))
    }

    /// The fence as zones.
    pub fn fence(&self) -> Zones {
        Zones { zones: self.plan.fence.clone(), ignored: None, system: None }
    }

    fn refuse(&self, message: &str) -> InputError {
        InputError::new(PLAN, self.path, message)
    }

    /// The flight in the area of `draft` with the sensor nodes `list`, its `lines`, and those of `[uav]`.
    ///
    /// # Errors
    /// If a leg leaves the fence or enters a zone of it, there are too many slots, or several altitudes and a radio of
    /// one.
    pub fn additions(
        &self,
        draft: &Scenario,
        list: &SensorList,
        lines: &mut Lines,
        uav: &mut String,
    ) -> Result<Additions, InputError> {
        let has_radio = draft.link.preset.is_some();
        let slot_s = if has_radio { slot_s(draft) } else { draft.slot_s };
        let flight = self.flight(draft, slot_s)?;
        let mut additions = Additions::default();
        let altitudes_m = self.plan.altitudes_m();
        let [lowest_m, highest_m] = altitudes_m;
        let track = text(&flight, slot_s, lowest_m < highest_m);
        additions.overrides.track = Some(track.clone());
        additions.files.push((TRACK, track));
        let [x_m, y_m] = [flight.ends[0].x, flight.ends[0].y];
        *uav = format!("{TRACK_LINE}start_m = [{x_m:?}, {y_m:?}]\n");
        self.plan.altitudes.iter().for_each(|line| *uav += &format!("# {line}\n"));
        if lowest_m < highest_m {
            if has_radio {
                let expected = "expected one altitude with --radio, whose rates are of one";
                return Err(self.refuse(&format!("altitudes from {lowest_m} to {highest_m} m: {expected}")));
            }
            *uav += &self.climb(altitudes_m, lines);
        }
        let start_m = flight.points[0].point.at.z;
        lines.set_plan();
        lines.set("slots", &format!("slots = {}", flight.slots), "Number of slots, T: the length of the flight");
        lines.set("slot_s", &format!("slot_s = {slot_s:?}"), "Length of a slot, τ [s]");
        if has_radio {
            lines.omit(&["link.comm_radius_m"]);
            lines.set("link.comm_s", &format!("comm_s = {slot_s:?}"), "Time for communication in a slot: all of it");
        }
        lines.set("uav.altitude_m", &format!("altitude_m = {start_m:?}"), "Altitude, H [m], of the plan");
        let speed_mps = self.speed_mps(&flight, slot_s);
        lines.set(
            "uav.max_speed_mps",
            &format!("max_speed_mps = {speed_mps:?}"),
            "Maximum speed, V [m/s], of the plan",
        );
        let flight_s = flight.slots as f64 * slot_s;
        let endurance_s = draft.uav.endurance_s.max(flight_s);
        lines.set("uav.endurance_s", &format!("endurance_s = {endurance_s:?}"), "Endurance, T_e [s]");
        additions.notes.push(self.summary(&flight));
        additions.notes.extend(self.plan.altitudes.iter().chain(&self.plan.notes).map(|note| format!("plan: {note}")));
        additions.warnings.extend(self.plan.warnings.iter().cloned());
        additions.warnings.extend(self.hills(list));
        Ok(additions)
    }

    /// The flight in the area of `draft`, checked against the fence. Where a slot would cut a corner of it, the leg
    /// ends with the slot.
    fn flight(&self, draft: &Scenario, slot_s: f64) -> Result<SlottedFlight, InputError> {
        let projection = Projection::at(draft.area.origin().expect("the area encloses the plan"));
        let in_area = |[lat_deg, lon_deg]: [f64; 2]| {
            let at = projection.project(lat_deg, lon_deg).expect("the area encloses the plan");
            at.map(|along_m| (along_m * 1e3).round() / 1e3)
        };
        let home = in_area(self.plan.home);
        let places: Vec<Position> = self.plan.legs.iter().map(|leg| in_area(leg.to)).collect();
        let fence = self.polygons(&projection)?;
        let slack_m = draft.area.border_slack_m();
        let crossed = |from: &Position, to: &Position| {
            let is_crossed = |(polygon, _): &&(Polygon, &str)| polygon.entry(from, to, slack_m, false).is_some();
            fence.iter().find(is_crossed).map(|(_, place)| place)
        };
        let mut from = home;
        let mut before = HOME;
        for (leg, to) in self.plan.legs.iter().zip(&places) {
            if let Some(zone) = crossed(&from, to) {
                let expected = "expected a flight within its fence";
                return Err(self.refuse(&format!("{}: the leg from {before} crosses {zone}: {expected}", leg.place)));
            }
            from = *to;
            before = &leg.place;
        }
        let mut ends_slot = vec![false; places.len()];
        let mut flight = self.cut(self.plan.walk(home, &places, slot_s, |_| false), slot_s)?;
        let exact_s = flight.flown_s();
        for attempt in 1.. {
            let cuts = flight.legs_cut(slot_s, |from, to| crossed(from, to).is_some());
            if cuts.iter().all(|leg| ends_slot[*leg]) {
                break;
            }
            cuts.into_iter().for_each(|leg| ends_slot[leg] = true);
            let all = attempt > MOST_ATTEMPTS;
            flight = self.cut(self.plan.walk(home, &places, slot_s, |leg| all || ends_slot[leg]), slot_s)?;
            if all {
                break;
            }
        }
        Ok(SlottedFlight { longer_s: flight.flown_s() - exact_s, ..flight })
    }

    /// Cuts a flight into slots, the last of which may end after it.
    fn cut(&self, points: Vec<PlannedPoint>, slot_s: f64) -> Result<SlottedFlight, InputError> {
        let slots = (points[points.len() - 1].point.time_s / slot_s - SLOTS_SLACK).ceil().max(1.0);
        if slots > MOST_TRACK_SLOTS as f64 {
            let expected = format!("expected at most {MOST_TRACK_SLOTS}");
            return Err(self.refuse(&format!("a flight of {slots} slots of {slot_s} s: {expected}")));
        }
        let timed: Vec<TimedPoint> = points.iter().map(|point| point.point).collect();
        let ends = slot_ends(&timed, slot_s, slots as u64).into_iter().map(|(_, at)| at.xy()).collect();
        Ok(SlottedFlight { points, slots: slots as u64, ends, longer_s: 0.0 })
    }

    /// The polygons of the fence in the area, with their places in the file.
    fn polygons(&self, projection: &Projection) -> Result<Vec<(Polygon, &str)>, InputError> {
        let polygon = |zone: &Zone| {
            let corners_m = zone.corners_m(projection, self.path)?;
            let is_border = zone.kind == ZoneKind::Boundary;
            Ok(Polygon::of(&corners_m, is_border).expect("its corners were checked"))
        };
        self.plan.fence.iter().map(|zone| Ok((polygon(zone)?, &*zone.place))).collect()
    }

    /// The lines of a flight between two altitudes [m], and of links that depend on them.
    fn climb(&self, [lowest_m, highest_m]: [f64; 2], lines: &mut Lines) -> String {
        lines.set("uav.altitude", "altitude = \"free\"", "The altitude changes along the track");
        lines.set("link.model", "model = \"probabilistic-los\"", "The altitude matters in it");
        lines.omit(&["link.gain_db", "link.gain"]);
        let climb_mps = self.plan.legs.iter().flat_map(|leg| leg.vertical_mps).fold(0.0, f64::max);
        format!("min_altitude_m = {lowest_m:?}\nmax_altitude_m = {highest_m:?}\nmax_climb_mps = {climb_mps:?}\n")
    }

    /// The maximum speed of a flight [m/s].
    fn speed_mps(&self, flight: &SlottedFlight, slot_s: f64) -> f64 {
        let of_legs = self.plan.legs.iter().map(|leg| leg.speed_mps);
        let of_slots = flight.ends.windows(2).map(|pair| (pair[1] - pair[0]).norm() / slot_s);
        let speed_mps = of_legs.chain(of_slots).fold(0.0, f64::max);
        (speed_mps * 1e3 - SPEED_SLACK_MMPS).ceil() / 1e3
    }

    /// The flight in a line.
    fn summary(&self, flight: &SlottedFlight) -> String {
        let legs = self.plan.legs.len();
        let way_m: f64 = flight.points.windows(2).map(|pair| (pair[1].point.at - pair[0].point.at).xy().norm()).sum();
        let hold_s: f64 = self.plan.legs.iter().map(|leg| leg.hold_s).sum();
        let flown_s = flight.flown_s();
        let hold_s = (hold_s * 10.0).round() / 10.0;
        let longer = match flight.longer_s {
            longer_s if longer_s < LEAST_LONGER_S => String::new(),
            longer_s => {
                format!(", {longer_s:.1} s of them as legs end with slots where they would cut a corner of the fence")
            }
        };
        format!("flight: {legs} legs, {way_m:.0} m, {flown_s:.0} s, {hold_s} s of holds{longer}")
    }

    /// The ground that makes the height of the flight above it differ from the plan's; `None` if it is flat.
    fn hills(&self, list: &SensorList) -> Option<String> {
        let ground_m = || list.ground_m().iter().copied();
        let [lowest_m, highest_m] =
            [ground_m().fold(f64::INFINITY, f64::min), ground_m().fold(f64::NEG_INFINITY, f64::max)];
        (self.plan.is_level && highest_m - lowest_m > FLAT_M).then(|| {
            format!(
                "the ground of the sensor nodes rises from {lowest_m} to {highest_m} m, and the plan's altitudes are \
                 not above the ground: the scenario flies as high above each of them as above home"
            )
        })
    }
}

/// The length of a slot that holds the contact of a radio twice [s].
fn slot_s(draft: &Scenario) -> f64 {
    (2.0 * draft.link.setup_s.unwrap_or(0.0)).ceil().max(LEAST_SLOT_S)
}

/// The text of the track: each place of the flight with its time, and the last one at the end of the last slot.
fn text(flight: &SlottedFlight, slot_s: f64, has_climb: bool) -> String {
    let mut text = if has_climb { "t_s,x_m,y_m,z_m\n" } else { "t_s,x_m,y_m\n" }.to_owned();
    let mut add = |TimedPoint { time_s, at }: TimedPoint| {
        text += &format!("{time_s},{},{}", at.x, at.y);
        text += &if has_climb { format!(",{}\n", at.z) } else { "\n".to_owned() };
    };
    flight.points.iter().for_each(|point| add(point.point));
    let last = flight.points[flight.points.len() - 1].point;
    let end_s = flight.slots as f64 * slot_s;
    if end_s > last.time_s {
        add(TimedPoint { time_s: end_s, ..last });
    }
    text
}
