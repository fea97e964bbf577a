//! The way home of a UAV that carries a battery, or has to land (decision D13).

use std::sync::Arc;

use nalgebra::Point3;
use skysink_common::airspace::{Airspace, Bends};
use skysink_common::base::Base;
use skysink_common::battery::{Battery, BatteryState};
use skysink_common::geometry::{Position, above, within};
use skysink_common::scenario::Scenario;
use smallvec::{SmallVec, smallvec};

/// Slack of the number of slots of a way home, so that rounding adds none.
const SLACK_SLOTS: f64 = 1e-9;

/// The way home: straight, or in straight pieces around zones. Each is flown in equal steps at the speed of least
/// energy per metre, or faster where time is short.
#[derive(Debug, Clone, PartialEq)]
pub struct Home {
    /// Where it ends.
    pub base: Base,
    /// `None`: energy without end.
    pub battery: Option<Battery>,
    /// Whether it has to end within the mission.
    pub must_land: bool,
    /// Slots of the mission.
    slots: u64,
    /// Farthest flight in a slot [m].
    reach_m: f64,
    /// Flight in a slot at the least energy per metre [m].
    thrifty_m: f64,
    start: Position,
    /// Whether slots end beside their waypoints.
    has_errors: bool,
    comm_radius_m: f64,
    /// Farthest flight in a slot in any direction [m].
    farthest_m: f64,
    /// The most energy that a level slot takes [J].
    most_j: f64,
    airspace: Arc<Airspace>,
    /// Where it ends: the places of the base, or on a grid the middles of its cells [m].
    ends: Arc<[Position]>,
}

/// A straight piece of the way home.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    end: Position,
    length_m: f64,
    slots: f64,
}

/// A way around zones.
type Pieces = SmallVec<[Piece; 4]>;

/// A way home.
#[derive(Debug, Clone, PartialEq)]
pub enum WayHome {
    /// Straight, in equal steps.
    Straight {
        /// Its slots.
        slots: f64,
        /// Its end [m].
        end: Position,
    },
    /// Around zones: the ends of its slots [m].
    Bent(Vec<Position>),
}

/// What becomes of a decision for a slot by the return rule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Returning {
    /// It is flown.
    Not,
    /// The UAV stays in the base and charges.
    Charges,
    /// The UAV flies to this waypoint of the way home [m] instead, or hovers in the base.
    Flies(Point3<f64>),
}

impl Home {
    /// That of a scenario; `None` if its UAV need not come back.
    #[must_use]
    pub fn of(scenario: &Scenario, airspace: &Arc<Airspace>) -> Option<Self> {
        let battery = Battery::of(scenario);
        let must_land = scenario.must_land();
        let base = scenario.landing_base().filter(|_| battery.is_some() || must_land)?;
        let reach_m = scenario.reach_m();
        // On a grid all moves take the same time.
        let thrifty_m = match battery {
            Some(battery) if !airspace.has_grid() => battery.thrifty_m(reach_m),
            _ => reach_m,
        };
        let ends = match airspace.has_grid() {
            false => base.places().collect(),
            true => airspace.cells().filter(|cell| base.contains(cell)).collect(),
        };
        let comm_radius_m = scenario.link.comm_radius_m;
        // The power falls up to one speed and rises beyond it.
        let most_j = battery.map_or(0.0, |battery| battery.slot_j(reach_m).max(battery.slot_j(0.0)));
        Some(Self {
            base,
            battery,
            must_land,
            slots: scenario.slots,
            reach_m,
            thrifty_m,
            start: scenario.start().xy(),
            has_errors: scenario.uav.position_error_m.is_some_and(|sigma_m| sigma_m > 0.0),
            comm_radius_m,
            farthest_m: scenario.farthest_m(),
            most_j,
            airspace: Arc::clone(airspace),
            ends,
        })
    }

    /// Where the way home from `ground` [m] ends, with `left` slots for it: in the nearest point of the base, or, where
    /// slots end beside their waypoints, or zones make it better, in the place well inside that the shortest way leads
    /// to.
    #[must_use]
    pub fn end_of(&self, ground: &Position, left: u64) -> Position {
        match &self.ends_from(ground)[..] {
            [only] => *only,
            ends => self.pieces(ground, left).last().map_or(ends[0], |piece| piece.end),
        }
    }

    /// Where a way home from `ground` [m] may end. One that was begun can go on: its end stays among them.
    fn ends_from(&self, ground: &Position) -> SmallVec<[Position; 2]> {
        if self.airspace.has_grid() {
            return smallvec![self.place_from(ground)];
        }
        let nearest = self.base.nearest(ground);
        if self.airspace.is_open() && !self.has_errors || self.base.contains(ground) {
            return smallvec![nearest];
        }
        if self.has_errors || !self.airspace.is_free(ground, &nearest) {
            return smallvec![self.place_from(ground)];
        }
        // Around a zone a way may have been begun to a place well inside, before the nearest point came into sight.
        smallvec![nearest, self.place_from(ground)]
    }

    /// Places well inside of the base [m].
    #[must_use]
    pub fn places(&self) -> &[Position] {
        &self.ends
    }

    /// The place well inside of the base that the shortest way from `ground` leads to [m].
    fn place_from(&self, ground: &Position) -> Position {
        if let [only] = &self.ends[..] {
            return *only;
        }
        let away_m = self.ends.iter().map(|end| (self.airspace.distance_m(ground, end), end));
        away_m.min_by(|(a_m, _), (b_m, _)| a_m.total_cmp(b_m)).map_or(*ground, |(_, end)| *end)
    }

    /// The way home from `ground` [m] after `slot`: its bends, and its end. Empty in the base, and if no way leads
    /// home.
    #[must_use]
    pub fn way_from(&self, slot: u64, ground: &Position) -> Bends {
        let end = self.end_of(ground, self.left_after(slot));
        if end == *ground { Bends::new() } else { self.airspace.way(ground, &end) }
    }

    /// The pieces of the way home from `ground` [m], with `left` slots for it, that takes the least energy; they take
    /// more than `left` if it is too far. Empty if no way leads home.
    fn pieces(&self, ground: &Position, left: u64) -> Pieces {
        match &self.ends_from(ground)[..] {
            [only] => self.pieces_to(ground, only, left),
            ends => {
                let ways = ends.iter().map(|end| self.pieces_to(ground, end, left)).filter(|pieces| !pieces.is_empty());
                let cost = |pieces: &Pieces| {
                    let slots = slots_of(pieces);
                    (slots > left as f64, self.way_j(pieces), slots)
                };
                let least = ways.min_by(|a, b| cost(a).partial_cmp(&cost(b)).expect("energy is finite"));
                least.unwrap_or_default()
            }
        }
    }

    /// The pieces of the way from `ground` to `end` [m]. The first have the slots that are not needed for full speed.
    fn pieces_to(&self, ground: &Position, end: &Position, left: u64) -> Pieces {
        let way = self.airspace.way(ground, end);
        let slots = |length_m: f64, slot_m: f64| (length_m / slot_m - SLACK_SLOTS).ceil().max(0.0);
        let begins = std::iter::once(ground).chain(&way);
        let fastest = |(begin, end): (&Position, &Position)| {
            let length_m = (end - begin).norm();
            Piece { end: *end, length_m, slots: slots(length_m, self.reach_m) }
        };
        let mut pieces: Pieces = begins.zip(&way).map(fastest).collect();
        let mut spare = left as f64 - slots_of(&pieces);
        for piece in &mut pieces {
            let more = (slots(piece.length_m, self.thrifty_m) - piece.slots).min(spare).max(0.0);
            piece.slots += more;
            spare -= more;
        }
        pieces
    }

    /// Energy of a way [J].
    fn way_j(&self, pieces: &[Piece]) -> f64 {
        let flown = pieces.iter().filter(|piece| piece.slots > 0.0);
        self.battery
            .map_or(0.0, |battery| flown.map(|piece| piece.slots * battery.slot_j(piece.length_m / piece.slots)).sum())
    }

    /// Whether a full battery may fly from the base or from the start into range of an SN at `sensor` [m] and home, at
    /// the least energy per metre.
    #[must_use]
    pub fn may_serve(&self, sensor: &Position) -> bool {
        let from_base_m = self.base.away_m(sensor);
        let from_start_m = (sensor - self.start).norm();
        let way_m = from_base_m + from_base_m.min(from_start_m) - 2.0 * self.comm_radius_m;
        self.battery.is_none_or(|battery| {
            let way_j = way_m * battery.slot_j(self.thrifty_m) / self.thrifty_m;
            battery.capacity_j - way_j >= battery.reserve_j
        })
    }

    /// Slots for the way home after `slot`.
    #[must_use]
    pub fn left_after(&self, slot: u64) -> u64 {
        if self.must_land { self.slots.saturating_sub(slot) } else { u64::MAX }
    }

    /// Whether a UAV with `energy_j` [J] at `ground` [m] after `slot` comes home in time and with its reserve.
    #[must_use]
    pub fn is_in_reach(&self, slot: u64, energy_j: f64, ground: &Position) -> bool {
        self.margin_j(slot, energy_j, ground) >= 0.0
    }

    /// The energy [J] beyond the way home and the reserve of a UAV with `energy_j` at `ground` [m] after `slot`;
    /// −∞ if it comes home too late.
    #[must_use]
    pub fn margin_j(&self, slot: u64, energy_j: f64, ground: &Position) -> f64 {
        let left = self.left_after(slot);
        let (slots, way_j) = self.way_within(ground, left);
        if slots > left as f64 {
            return f64::NEG_INFINITY;
        }
        self.battery.map_or(f64::INFINITY, |battery| energy_j - way_j - battery.reserve_j)
    }

    /// Slots after `slot` beyond those of the way home from `ground` [m] at full speed, below 0 if it comes home too late;
    /// `None` if it need not be home in time, or no way leads there.
    #[must_use]
    pub fn spare_slots(&self, slot: u64, ground: &Position) -> Option<i64> {
        let (slots, _) = self.way_within(ground, 0);
        let is_bound = self.must_land && slots.is_finite();
        is_bound.then(|| i64::try_from(self.left_after(slot)).unwrap_or(i64::MAX) - slots as i64)
    }

    /// Slots and energy [J] of the way home from `ground` [m] at the least energy per metre; infinite slots if there is
    /// none.
    #[must_use]
    pub fn thrifty_way(&self, ground: &Position) -> (f64, f64) {
        self.way_within(ground, u64::MAX)
    }

    /// Slots and energy [J] of the way home from `ground` [m], with `left` slots for it.
    fn way_within(&self, ground: &Position, left: u64) -> (f64, f64) {
        let pieces = self.pieces(ground, left);
        if pieces.is_empty() {
            return (f64::INFINITY, 0.0);
        }
        (slots_of(&pieces), self.way_j(&pieces))
    }

    /// The way home from `ground` [m], of which `slot` is the first slot.
    #[must_use]
    pub fn slot_ends(&self, slot: u64, ground: &Position) -> WayHome {
        let pieces = self.pieces(ground, self.left_after(slot.saturating_sub(1)));
        let Some(last) = pieces.last() else { return WayHome::Straight { slots: f64::INFINITY, end: *ground } };
        if pieces.len() == 1 {
            return WayHome::Straight { slots: last.slots, end: last.end };
        }
        let mut ends = Vec::new();
        let mut from = *ground;
        for piece in &pieces {
            let step = |step: u64| from + (piece.end - from) * (step as f64 / piece.slots);
            ends.extend((1..piece.slots as u64).map(step));
            ends.extend((piece.slots > 0.0).then_some(piece.end));
            from = piece.end;
        }
        WayHome::Bent(ends)
    }

    /// The next waypoint of the way home from `ground` [m] in `slot`; `ground` itself in the base.
    #[must_use]
    pub fn next_waypoint(&self, slot: u64, ground: &Position) -> Position {
        let pieces = self.pieces(ground, self.left_after(slot.saturating_sub(1)));
        let last = pieces.last().map_or(*ground, |piece| piece.end);
        match pieces.iter().find(|piece| piece.slots > 0.0) {
            Some(piece) if piece.slots > 1.0 => ground + (piece.end - ground) / piece.slots,
            Some(piece) => piece.end,
            None => last,
        }
    }

    /// What becomes of the decision to fly from `from` to `to` [m] in `slot`; `is_idle` if it serves nobody there.
    #[must_use]
    pub fn rule(&self, slot: u64, state: &BatteryState, [from, to]: [&Point3<f64>; 2], is_idle: bool) -> Returning {
        if is_idle && to == from && self.may_land(&from.xy()) {
            return Returning::Charges;
        }
        // A waypoint that cannot be flown to is a hover.
        let is_flown = within(&from.xy(), &to.xy(), self.farthest_m);
        let to = if is_flown { to } else { from };
        let comes_home = |to: &Point3<f64>| {
            let (slots, end) = self.airspace.committed(slot, &from.xy(), &to.xy());
            let mut energy_j = self.flown_j(state, from, to);
            if slots > 1 && self.battery.is_some() {
                energy_j -= (slots - 1) as f64 * (state.energy_j - energy_j);
            }
            self.is_in_reach(slot + slots - 1, energy_j, &end)
        };
        if comes_home(to) {
            return Returning::Not;
        }
        let next = self.next_waypoint(slot, &from.xy());
        let next = match self.airspace.has_grid() {
            true => self.airspace.slot_end(slot, &from.xy(), &next, self.reach_m),
            false => next,
        };
        let next = above(&next, from.z);
        if self.base.contains(&from.xy()) && !comes_home(&next) { Returning::Charges } else { Returning::Flies(next) }
    }

    /// Energy [J] after the flight of a slot.
    #[must_use]
    pub fn flown_j(&self, state: &BatteryState, from: &Point3<f64>, to: &Point3<f64>) -> f64 {
        self.battery.map_or(state.energy_j, |battery| battery.flown_j(state.energy_j, from, to))
    }

    /// Whether a UAV that stays at `ground` [m] and serves nobody has landed.
    fn may_land(&self, ground: &Position) -> bool {
        self.battery.is_some() && self.base.contains(ground)
    }

    /// Whether a UAV in the base stays there in `slot` to charge: it has begun to, is not full, and has less energy
    /// than the rest of the mission takes at top speed.
    #[must_use]
    pub fn charges_on(&self, slot: u64, state: &BatteryState) -> bool {
        let Some(battery) = self.battery.filter(|battery| state.is_charging && battery.is_charged()) else {
            return false;
        };
        let rest = (self.slots + 1).saturating_sub(slot);
        let enough_j = battery.reserve_j + rest as f64 * self.most_j;
        rest > 0 && state.energy_j < battery.capacity_j.min(enough_j)
    }

    /// Slots from `slot` on in which a UAV that arrives in the base with `energy_j` [J] charges.
    #[must_use]
    pub fn charging_slots(&self, slot: u64, energy_j: f64) -> u64 {
        let Some(battery) = self.battery else { return 0 };
        let state =
            |slots: u64| BatteryState { energy_j: battery.charged_for_j(energy_j, slots as f64), is_charging: true };
        let mut low = 0;
        let mut high = (self.slots + 1).saturating_sub(slot);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.charges_on(slot + middle, &state(middle)) { low = middle + 1 } else { high = middle }
        }
        low
    }
}

/// Slots of a way.
fn slots_of(pieces: &[Piece]) -> f64 {
    pieces.iter().map(|piece| piece.slots).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    fn made(scenario: &Scenario) -> Option<Home> {
        Home::of(scenario, &Arc::new(scenario.airspace()))
    }

    /// The way home to (50, 50) in a mission of 20 slots.
    fn home(keys: &str) -> Home {
        let text =
            format!("name = 'a'\nslots = 20\n[area]\nside_m = 2000.0\n[base]\nposition_m = [50.0, 50.0]\n{keys}");
        made(&Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap()).unwrap()
    }

    #[test]
    fn a_uav_without_battery_or_landing_has_no_return_path() {
        let text = "name = 'a'\n[base]\ncharge_w = 9.0\n";
        assert_eq!(made(&Scenario::parse(text, Path::new("a.toml"), Overrides::default()).unwrap()), None);
    }

    #[test]
    fn a_uav_that_has_to_land_is_home_after_the_last_slot() {
        let home = home("[uav]\nmust_land = true\n");
        // 91 m east of the base's rim at 30 m a slot: 4 slots, of 22.75 m if 4 are left.
        let ground = Position::new(142.0, 50.0);
        assert!(home.is_in_reach(16, f64::INFINITY, &ground) && !home.is_in_reach(17, f64::INFINITY, &ground));
        let mut at = ground;
        for slot in 17..=20 {
            let next = home.next_waypoint(slot, &at);
            assert!((at.x - next.x - 22.75).abs() < 1e-9, "{next}");
            at = next;
        }
        assert!(home.base.contains(&at));
        assert_eq!(home.next_waypoint(9, &Position::new(50.5, 50.0)), Position::new(50.5, 50.0), "in the base");
    }

    #[test]
    fn the_return_takes_at_most_its_energy_allowance() {
        let home = home("[uav.battery]\ncapacity_j = 20000.0\nreserve = 0.05\n");
        let battery = home.battery.unwrap();
        for distance_m in [0.4, 17.0, 18.3, 300.0, 1_111.0] {
            let ground = Position::new(51.0 + distance_m, 50.0);
            // The least energy with which the UAV is allowed to be there.
            let (mut low_j, mut high_j) = (0.0, 40_000.0);
            for _ in 0..100 {
                let middle_j = (low_j + high_j) / 2.0;
                if home.is_in_reach(1, middle_j, &ground) { high_j = middle_j } else { low_j = middle_j }
            }
            let mut energy_j = high_j;
            let mut at = ground;
            while !home.base.contains(&at) {
                let next = home.next_waypoint(1, &at);
                energy_j -= battery.slot_j((next - at).norm());
                at = next;
                assert!(home.is_in_reach(1, energy_j + 1e-6, &at), "{distance_m} m: {at}");
            }
            assert!((energy_j - 1_000.0).abs() < 1e-6, "{distance_m} m: {energy_j} J");
        }
    }

    #[test]
    fn the_return_around_a_zone_takes_at_most_its_energy_allowance() {
        let text = "name = 'a'\nslots = 20\n[area]\nwidth_m = 40.0\nheight_m = 33.2\n[[area.no_fly]]\n\
                    polygon_m = [[27.667, 14.581], [37.063, 13.439], [40.523, 21.487], [33.165, 25.19], [27.927, 22.044]]\n\
                    [base]\nareas_m = [[[32.153, 10.294], [29.242, 13.331], [27.107, 10.361], [26.933, 7.581], \
                    [28.563, 5.377], [31.502, 6.505], [34.081, 6.393], [33.692, 9.845]]]\n[uav]\nmax_speed_mps = 10.0\n\
                    must_land = true\n[uav.battery]\ncapacity_j = 800.0\nreserve = 0.0\n";
        let home = made(&Scenario::parse(text, Path::new("a.toml"), Overrides::default()).unwrap()).unwrap();
        let battery = home.battery.unwrap();
        let places = (0..=160).flat_map(|x| (0..=132).map(move |y| Position::new(f64::from(x), f64::from(y)) / 4.0));
        let mut bent = 0;
        for ground in places.filter(|place| home.airspace.contains(place)) {
            bent += usize::from(home.way_from(1, &ground).len() > 1);
            for slot in [1, 14, 16, 18] {
                let (slots, mut energy_j) = home.way_within(&ground, home.left_after(slot));
                if slots > home.left_after(slot) as f64 {
                    continue;
                }
                let mut at = ground;
                for after in slot + 1.. {
                    if home.base.contains(&at) {
                        break;
                    }
                    let next = home.next_waypoint(after, &at);
                    energy_j -= battery.slot_j((next - at).norm());
                    at = next;
                    assert!(home.is_in_reach(after, energy_j + 1e-6, &at), "from {ground} after {slot}: {at}");
                }
            }
        }
        assert!(bent > 1_000, "{bent} ways around the zone");
    }

    #[test]
    fn charging_ends_when_the_battery_is_full_or_sufficient() {
        let home = home("charge_w = 100.0\n[uav.battery]\ncapacity_j = 5000.0\n");
        let state = |energy_j, is_charging| BatteryState { energy_j, is_charging };
        assert!(home.charges_on(1, &state(4_999.0, true)) && !home.charges_on(1, &state(5_000.0, true)));
        assert!(!home.charges_on(1, &state(600.0, false)), "not begun");
        // After 17 slots of 100 J, 1 700 J: three slots of 356 J and the reserve are less.
        assert_eq!(
            [home.charging_slots(1, 0.0), home.charging_slots(20, 900.0), home.charging_slots(21, 0.0)],
            [17, 0, 0]
        );
        for energy_j in [0.0, 700.0, 3_000.0, 4_950.0] {
            let mut state = state(energy_j, true);
            let mut slots = 0;
            while home.charges_on(1 + slots, &state) {
                state.energy_j = home.battery.unwrap().charged_j(state.energy_j);
                slots += 1;
            }
            assert_eq!(home.charging_slots(1, energy_j), slots, "{energy_j} J");
        }
        // 356 W at 30 m/s: one slot and the reserve of 500 J are less than 900 J, ten slots more.
        assert!(!home.charges_on(20, &state(900.0, true)) && home.charges_on(11, &state(900.0, true)));
    }
}
