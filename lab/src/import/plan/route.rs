//! The flight of a mission: its items from above home to the landing, or to where the mission ends.

use std::collections::BTreeMap;

use skysink_common::geodata::projection::{Origin, Projection};

use super::altitude::{Readings, above_ground_m};
use super::commands::{ForeignItem, Maneuver, named};
use super::fence;
use super::foreign_plan::{ForeignPlan, PlanFile, PlanHome, PlanLeg};
use crate::export::Autopilot;

/// Speed over ground of ArduCopter without a speed in the mission, by `WPNAV_SPEED` [m/s].
const COPTER_MPS: f64 = 10.0;

/// Distance from home beyond which a place is another one [m].
const NEAR_M: f64 = 1.0;

/// Where the flight is, and what is set.
struct Route {
    autopilot: Autopilot,
    home: PlanHome,
    at: [f64; 2],
    altitude_m: Option<f64>,
    take_off_m: Option<f64>,
    has_taken_off: bool,
    /// Speed before an item sets one [m/s].
    default_mps: f64,
    speed_mps: f64,
    /// Whether an item has set a speed.
    is_speed_set: bool,
    /// Whether a leg flies at the default.
    is_default_used: bool,
    default_vertical_mps: [f64; 2],
    vertical_mps: [f64; 2],
    /// The item that delays the next command.
    delaying: Option<String>,
    readings: Readings,
    legs: Vec<PlanLeg>,
    /// How the flight ends, once it has.
    end: Option<String>,
    unused: BTreeMap<u16, usize>,
    notes: Vec<String>,
}

/// The flight of a file, with `speed_mps` [m/s] until an item sets a speed.
///
/// # Errors
/// If an item is refused, home is not known, or there is no leg.
pub fn follow(file: PlanFile, speed_mps: Option<f64>) -> Result<ForeignPlan, String> {
    let PlanFile { is_waypoints, autopilot, home, speed_mps: own_mps, items, fence, unused } = file;
    fence::check(&fence)?;
    let mut notes = Vec::new();
    let home = match home {
        Some(home) => home,
        None => {
            let (place, position) = first_place(&items)?;
            notes.push(format!("home is not set: taken as at {place}"));
            PlanHome { position, altitude_m: None }
        }
    };
    let motion = autopilot.motion();
    let default_mps = speed_mps.or(own_mps).unwrap_or(COPTER_MPS);
    let vertical_mps = [motion.climb_mps, motion.descent_mps];
    let mut route = Route {
        autopilot,
        home,
        at: home.position,
        altitude_m: None,
        take_off_m: None,
        has_taken_off: false,
        default_mps,
        speed_mps: default_mps,
        is_speed_set: false,
        is_default_used: false,
        default_vertical_mps: vertical_mps,
        vertical_mps,
        delaying: None,
        readings: Readings::default(),
        legs: Vec::new(),
        end: None,
        unused: BTreeMap::new(),
        notes,
    };
    items.iter().try_for_each(|item| route.fly(item))?;
    route.close();
    let Route { readings, legs, unused: by_command, is_default_used, mut notes, take_off_m, .. } = route;
    let Some(first) = legs.first() else {
        return Err("no item leads anywhere: expected at least one waypoint".to_owned());
    };
    let is_speed_taken = is_default_used && speed_mps.or(own_mps).is_none();
    notes.extend(is_speed_taken.then(|| no_speed_before(&first.place)));
    let by_command = by_command.iter().map(|(command, count)| format!("{count} × command {}", named(*command)));
    let unused: Vec<String> = unused.into_iter().chain(by_command).collect();
    notes.extend((!unused.is_empty()).then(|| format!("not used: {}", unused.join(", "))));
    Ok(ForeignPlan {
        home: home.position,
        start_m: take_off_m.unwrap_or(first.altitude_m),
        altitudes: readings.lines(home.altitude_m, is_waypoints),
        is_level: readings.are_level(),
        warnings: readings.warning(is_waypoints).into_iter().collect(),
        legs,
        fence,
        notes,
    })
}

fn no_speed_before(place: &str) -> String {
    format!(
        "no speed before {place}: taken as {COPTER_MPS} m/s, ArduCopter's WPNAV_SPEED by default; --speed sets another"
    )
}

/// The first item with a place.
fn first_place(items: &[ForeignItem]) -> Result<(&str, [f64; 2]), String> {
    for item in items.iter().filter(|item| !matches!(item.maneuver(), Ok(Maneuver::Nothing))) {
        if let Some(position) = item.position()? {
            return Ok((&item.place, position));
        }
    }
    Err("no item leads anywhere: expected at least one waypoint".to_owned())
}

impl Route {
    /// Follows an item.
    fn fly(&mut self, item: &ForeignItem) -> Result<(), String> {
        let maneuver = item.maneuver()?;
        if let Some(end) = &self.end {
            if maneuver != Maneuver::Nothing && maneuver != Maneuver::DelayNext {
                let expected = "expected a mission of one flight";
                return Err(item.refusal(&format!("command {} after {end}: {expected}", named(item.command))));
            }
            self.count(item);
            return Ok(());
        }
        let is_speed = matches!(maneuver, Maneuver::Speed { .. } | Maneuver::DefaultSpeed);
        if let Some(delaying) = self.delaying.as_ref().filter(|_| is_speed) {
            let expected = "expected a speed that changes at a waypoint";
            return Err(item.refusal(&format!("a speed that {delaying} delays: {expected}")));
        }
        match maneuver {
            Maneuver::TakeOff => self.take_off(item)?,
            Maneuver::Fly { hold_s } => self.to(item, hold_s)?,
            Maneuver::FlySpline { hold_s } => {
                let note = "splines are flown straight";
                if !self.notes.iter().any(|said| said == note) {
                    self.notes.push(note.to_owned());
                }
                self.to(item, hold_s)?;
            }
            Maneuver::Stay => {
                self.to(item, 0.0)?;
                self.notes.push(format!("{} stays there without end: the flight ends as it arrives", item.place));
                self.end = Some(format!("{}, which stays there", item.place));
            }
            Maneuver::Return => {
                let home = self.home.position;
                self.leg(item, home, self.altitude_m, 0.0)?;
                self.end = Some(format!("{}, which returns", item.place));
            }
            Maneuver::Land => {
                let to = item.position()?.unwrap_or(self.at);
                self.leg(item, to, self.altitude_m, 0.0)?;
                self.end = Some(format!("{}, which lands", item.place));
            }
            Maneuver::Hold { hold_s } => match self.legs.last_mut() {
                Some(leg) => leg.hold_s += hold_s,
                None if self.has_taken_off => self.leg(item, self.at, self.altitude_m, hold_s)?,
                None => self.notes.push(format!("{} waits before the take-off: not part of the flight", item.place)),
            },
            Maneuver::Speed { speed_mps } => {
                self.speed_mps = speed_mps;
                self.is_speed_set = true;
            }
            Maneuver::Climb { climb_mps } => self.vertical_mps[0] = climb_mps,
            Maneuver::Descent { descent_mps } => self.vertical_mps[1] = descent_mps,
            Maneuver::DefaultSpeed => {
                self.speed_mps = self.default_mps;
                self.is_speed_set = false;
                self.vertical_mps = self.default_vertical_mps;
            }
            Maneuver::DelayNext | Maneuver::Nothing => self.count(item),
        }
        self.delaying = match maneuver {
            Maneuver::DelayNext => Some(item.place.clone()),
            _ => None,
        };
        Ok(())
    }

    fn count(&mut self, item: &ForeignItem) {
        *self.unused.entry(item.command).or_default() += 1;
    }

    /// Takes off from home. PX4 then flies to the place of the item; ArduPilot only climbs.
    fn take_off(&mut self, item: &ForeignItem) -> Result<(), String> {
        if !self.legs.is_empty() {
            return Err(item.refusal("a take-off in flight: expected a mission of one flight"));
        }
        self.has_taken_off = true;
        let has_altitude = item.params[6] > 0.0;
        let altitude_m =
            if has_altitude { above_ground_m(item, self.home.altitude_m, &mut self.readings)? } else { None };
        self.altitude_m = altitude_m;
        self.take_off_m = altitude_m;
        let Some(to) = item.position()?.filter(|to| distance_m(self.home.position, *to) > NEAR_M) else {
            return Ok(());
        };
        if self.autopilot == Autopilot::Px4 {
            return self.leg(item, to, altitude_m, 0.0);
        }
        let away_m = distance_m(self.home.position, to);
        let place = &item.place;
        self.notes.push(format!("{place}: ArduPilot takes off from home, {away_m:.0} m from the item's place"));
        Ok(())
    }

    /// Flies to the place and the altitude of an item.
    fn to(&mut self, item: &ForeignItem, hold_s: f64) -> Result<(), String> {
        let position = item.position()?;
        let stays_level = position.is_none() && item.params[6] == 0.0;
        let own_m = if stays_level { None } else { above_ground_m(item, self.home.altitude_m, &mut self.readings)? };
        self.leg(item, position.unwrap_or(self.at), own_m.or(self.altitude_m), hold_s)
    }

    fn leg(&mut self, item: &ForeignItem, to: [f64; 2], altitude_m: Option<f64>, hold_s: f64) -> Result<(), String> {
        let altitude_m = altitude_m.ok_or_else(|| item.refusal("no altitude yet: expected one above 0 m"))?;
        let Self { speed_mps, vertical_mps, .. } = *self;
        self.legs.push(PlanLeg { place: item.place.clone(), to, altitude_m, speed_mps, vertical_mps, hold_s });
        self.is_default_used |= !self.is_speed_set;
        self.at = to;
        self.altitude_m = Some(altitude_m);
        Ok(())
    }

    /// Says how a mission ends that neither returns nor lands.
    fn close(&mut self) {
        if let (None, Some(last)) = (&self.end, self.legs.last()) {
            let note = format!("the mission neither returns nor lands: the flight ends at {}", last.place);
            self.notes.push(note);
        }
    }
}

/// Distance between two positions [m]; infinite beyond the horizon.
fn distance_m(from: [f64; 2], to: [f64; 2]) -> f64 {
    let projection = Projection::at(Origin { lat_deg: from[0], lon_deg: from[1] });
    projection.project(to[0], to[1]).map_or(f64::INFINITY, |at| at.coords.norm())
}
