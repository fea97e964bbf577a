//! The way home of a UAV that carries a battery, or has to land (decision D13).

use std::sync::Arc;

use nalgebra::Point3;
use skysink_common::airspace::Airspace;
use skysink_common::base::{Base, BaseSite};
use skysink_common::battery::{Battery, BatteryState};
use skysink_common::geometry::{Position, above, within};
use skysink_common::message::{FlightReport, Mode};
use skysink_common::scenario::Scenario;
use smallvec::{SmallVec, smallvec};

use super::motion::Motion;
use super::route::Route;

/// The route to the base: straight, or in straight parts around zones. Each is flown in equal steps at the speed of
/// least energy per metre, or faster where time is short.
#[derive(Debug, Clone, PartialEq)]
pub struct WayHome {
    /// Where it ends.
    pub base: Base,
    /// What is left of it.
    pub battery: Battery,
    /// Whether it has to end within the mission.
    pub must_land: bool,
    /// Slots of the mission.
    slots: u64,
    start: Position,
    /// Whether slots end beside their waypoints.
    has_errors: bool,
    comm_radius_m: f64,
    /// Farthest flight in a slot in any direction [m].
    farthest_m: f64,
    /// The most energy that a level slot takes [J].
    most_j: f64,
    motion: Motion,
    airspace: Arc<Airspace>,
    /// Places well inside of the base [m].
    pub(super) places: Arc<[Position]>,
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

impl WayHome {
    /// The way home of a scenario; `None` if its UAV need not come back.
    #[must_use]
    pub fn of(scenario: &Scenario, airspace: &Arc<Airspace>) -> Option<Self> {
        let battery = Battery::of(scenario);
        let must_land = scenario.must_land();
        let base = scenario.landing_base().filter(|_| !battery.is_endless() || must_land)?;
        let motion = Motion::of(scenario, airspace);
        // The power falls up to one speed and rises beyond it.
        let most_j = battery.slot_j(motion.reach_m()).max(battery.slot_j(0.0));
        Some(Self {
            places: motion.places_in(&base),
            base,
            battery,
            must_land,
            slots: scenario.slots,
            start: scenario.start().xy(),
            has_errors: scenario.uav.position_error_m.is_some_and(|sigma_m| sigma_m > 0.0),
            comm_radius_m: scenario.link.comm_radius_m,
            farthest_m: scenario.farthest_m(),
            most_j,
            motion,
            airspace: Arc::clone(airspace),
        })
    }

    /// Where a way home from `ground` [m] may end: in the nearest point of the base, or, where slots end beside their
    /// waypoints, or zones make it better, in the place well inside that the shortest path leads to. One that was begun
    /// can go on: its end stays among them.
    fn ends_from(&self, ground: &Position) -> SmallVec<[Position; 2]> {
        if self.motion.is_by_cells() {
            return smallvec![self.place_from(ground)];
        }
        let nearest = self.base.nearest(ground); // the place itself in the base
        if self.airspace.is_open() && !self.has_errors || nearest == *ground {
            return smallvec![nearest];
        }
        if self.has_errors || !self.airspace.is_free(ground, &nearest) {
            return smallvec![self.place_from(ground)];
        }
        // Around a zone a way may have been begun to a place well inside, before the nearest point came into sight.
        smallvec![nearest, self.place_from(ground)]
    }

    /// The place well inside of the base that the shortest path from `ground` leads to [m].
    fn place_from(&self, ground: &Position) -> Position {
        if let [only] = &self.places[..] {
            return *only;
        }
        let away_m = self.places.iter().map(|place| (self.airspace.distance_m(ground, place), place));
        away_m.min_by(|(a_m, _), (b_m, _)| a_m.total_cmp(b_m)).map_or(*ground, |(_, place)| *place)
    }

    /// The way home from `ground` [m] after `slot`: the route of least energy, in the slots that are left; it takes
    /// more if it is too far. `None` if there is none.
    pub fn route(&self, slot: u64, ground: &Position) -> Option<Route> {
        self.route_within(ground, self.left_after(slot))
    }

    /// The way home that is flown with `left` slots for it.
    pub fn route_within(&self, ground: &Position, left: u64) -> Option<Route> {
        match &self.ends_from(ground)[..] {
            [only] => self.motion.thrifty(ground, only, left),
            ends => {
                let routes = ends.iter().filter_map(|end| self.motion.thrifty(ground, end, left));
                let cost = |route: &Route| (u64::from(route.slots()) > left, route.energy_j(), route.slots());
                routes.min_by(|a, b| cost(a).partial_cmp(&cost(b)).expect("energy is finite"))
            }
        }
    }

    /// Whether a full battery may fly from the base or from the start into range of an SN at `sensor` [m] and home, at
    /// the least energy per metre.
    pub fn may_serve(&self, sensor: &Position) -> bool {
        let from_base_m = self.base.away_m(sensor);
        let from_start_m = (sensor - self.start).norm();
        let path_m = from_base_m + from_base_m.min(from_start_m) - 2.0 * self.comm_radius_m;
        let thrifty_m = self.motion.thrifty_m();
        let path_j = path_m * self.battery.slot_j(thrifty_m) / thrifty_m;
        self.battery.capacity_j - path_j >= self.battery.reserve_j
    }

    /// Slots for the way home after `slot`.
    pub fn left_after(&self, slot: u64) -> u64 {
        if self.must_land { self.slots.saturating_sub(slot) } else { u64::MAX }
    }

    /// Whether a UAV with `energy_j` [J] at `ground` [m] after `slot` comes home in time and with its reserve.
    pub fn is_in_reach(&self, slot: u64, energy_j: f64, ground: &Position) -> bool {
        self.margin_j(slot, energy_j, ground) >= 0.0
    }

    /// The energy [J] beyond the way home and the reserve of a UAV with `energy_j` at `ground` [m] after `slot`;
    /// −∞ if it comes home too late.
    pub fn margin_j(&self, slot: u64, energy_j: f64, ground: &Position) -> f64 {
        let left = self.left_after(slot);
        let in_time = self.route_within(ground, left).filter(|route| u64::from(route.slots()) <= left);
        in_time.map_or(f64::NEG_INFINITY, |route| self.margin_after_j(energy_j, &route))
    }

    /// The energy [J] of `energy_j` beyond the way home `route` and the reserve.
    pub(crate) fn margin_after_j(&self, energy_j: f64, route: &Route) -> f64 {
        match self.battery.is_endless() {
            true => f64::INFINITY,
            false => energy_j - route.energy_j() - self.battery.reserve_j,
        }
    }

    /// Slots after `slot` beyond those of the way home from `ground` [m] at full speed, below 0 if it comes home too
    /// late; `None` if it need not be home in time, or no path leads there.
    pub fn spare_slots(&self, slot: u64, ground: &Position) -> Option<i64> {
        let route = self.route_within(ground, 0).filter(|_| self.must_land)?;
        Some(i64::try_from(self.left_after(slot)).unwrap_or(i64::MAX) - i64::from(route.slots()))
    }

    /// The next waypoint of the way home from `ground` [m] in `slot`; `ground` itself in the base.
    pub fn next_waypoint(&self, slot: u64, ground: &Position) -> Position {
        self.waypoint_of(self.route(slot.saturating_sub(1), ground), slot, ground)
    }

    /// The next waypoint on the way home of a UAV with `energy_j` [J] whose time is over: at full speed, if the energy
    /// lasts for that.
    pub fn landing_waypoint(&self, slot: u64, energy_j: f64, ground: &Position) -> Position {
        let in_time = self.route(slot.saturating_sub(1), ground).filter(|route| route.energy_j() <= energy_j);
        self.waypoint_of(in_time.or_else(|| self.route_within(ground, u64::MAX)), slot, ground)
    }

    fn waypoint_of(&self, route: Option<Route>, slot: u64, ground: &Position) -> Position {
        self.motion.slot_end(slot, ground, &route.map_or(*ground, |route| route.first()))
    }

    /// What becomes of the decision to fly from `from` to `to` [m] in `slot`; `is_idle` if it serves nobody there.
    pub fn rule(&self, slot: u64, state: &BatteryState, [from, to]: [&Point3<f64>; 2], is_idle: bool) -> Returning {
        if is_idle && to == from && !self.battery.is_endless() && self.base.contains(&from.xy()) {
            return Returning::Charges;
        }
        // A waypoint that cannot be flown to is a hover.
        let is_flown = within(&from.xy(), &to.xy(), self.farthest_m);
        let to = if is_flown { to } else { from };
        let comes_home = |to: &Point3<f64>| {
            let (slots, end) = self.motion.committed(slot, &from.xy(), &to.xy());
            let mut energy_j = self.flown_j(state, from, to);
            if slots > 1 && !self.battery.is_endless() {
                energy_j -= (slots - 1) as f64 * (state.energy_j - energy_j);
            }
            self.is_in_reach(slot + slots - 1, energy_j, &end)
        };
        if comes_home(to) {
            return Returning::Not;
        }
        let next = above(&self.next_waypoint(slot, &from.xy()), from.z);
        if self.base.contains(&from.xy()) && !comes_home(&next) { Returning::Charges } else { Returning::Flies(next) }
    }

    /// Energy [J] after the flight of a slot.
    pub fn flown_j(&self, state: &BatteryState, from: &Point3<f64>, to: &Point3<f64>) -> f64 {
        self.battery.flown_j(state.energy_j, from, to)
    }

    /// The battery of a UAV at `ground` [m]: of several bases that with the charger there.
    #[inline]
    pub fn battery_at(&self, ground: &Position) -> Battery {
        self.base.charger_at(ground).map_or(self.battery, |charger| self.battery.at(charger))
    }

    /// Whether a UAV in the base, at `ground` [m], stays there in `slot` to charge: it has begun to, is not full, and
    /// has less energy than the rest of the mission takes at top speed.
    pub fn charges_on(&self, slot: u64, state: &BatteryState, ground: &Position) -> bool {
        state.is_charging && self.is_low(&self.battery_at(ground), slot, state.energy_j)
    }

    /// Whether `battery` is charged, and has less than the rest of the mission takes from `slot` on.
    fn is_low(&self, battery: &Battery, slot: u64, energy_j: f64) -> bool {
        let rest = (self.slots + 1).saturating_sub(slot);
        let enough_j = battery.reserve_j + rest as f64 * self.most_j;
        battery.is_charged() && rest > 0 && energy_j < battery.capacity_j.min(enough_j)
    }

    /// Slots from `slot` on in which a UAV that arrives in the base at `ground` [m] with `energy_j` [J] charges.
    pub fn charging_slots(&self, slot: u64, energy_j: f64, ground: &Position) -> u64 {
        let battery = self.battery_at(ground);
        let mut low = 0;
        let mut high = (self.slots + 1).saturating_sub(slot);
        while low < high {
            let middle = low + (high - low) / 2;
            let charged_j = battery.charged_for_j(energy_j, middle as f64);
            if self.is_low(&battery, slot + middle, charged_j) { low = middle + 1 } else { high = middle }
        }
        // Until the next move may begin.
        let moves = self.motion.move_slots();
        let before = slot.saturating_sub(1);
        if low == 0 { 0 } else { (before + low).next_multiple_of(moves) - before }
    }

    /// For each of several bases the slots from `slot` on before it has a pad for the UAV number `uav` (decision D34).
    /// Those that have begun a swap come first, then those of lower numbers: the ones that are there as their last
    /// `flights` say stay until they are charged; those that have yet to come are not known. Empty if no site makes it
    /// wait.
    pub fn pad_waits(&self, slot: u64, uav: usize, flights: &[FlightReport]) -> Vec<u64> {
        let is_in = |flight: &FlightReport, number: usize| {
            flight.flown_mode() == Mode::Charge && self.base.site_at(&flight.position().xy()) == Some(number)
        };
        let wait = |(number, site): (usize, &BaseSite)| {
            if flights.get(uav).is_some_and(|own| own.swapped_slots > 0 && is_in(own, number)) {
                return 0;
            }
            let there = || flights.iter().enumerate().filter(|(_, other)| is_in(other, number));
            let swapping = there().filter(|(other, flight)| *other != uav && flight.swapped_slots > 0);
            let lower = there().filter(|(other, flight)| *other < uav && flight.swapped_slots == 0);
            let mut pads = vec![0; site.charger.pads as usize];
            for (_, other) in swapping.chain(lower) {
                let stay = self.charging_slots(slot, other.energy_j, &other.position().xy());
                let stay = stay.saturating_sub(u64::from(other.swapped_slots).min(stay.saturating_sub(1)));
                *pads.iter_mut().min().expect("a site has a pad") += stay;
            }
            pads.into_iter().min().unwrap_or_default()
        };
        let waits: Vec<u64> = self.base.sites().iter().enumerate().map(wait).collect();
        if waits.iter().all(|wait| *wait == 0) { Vec::new() } else { waits }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    fn made(scenario: &Scenario) -> Option<WayHome> {
        WayHome::of(scenario, &Arc::new(scenario.airspace()))
    }

    /// The way home to (50, 50) in a mission of 20 slots.
    fn home(keys: &str) -> WayHome {
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
        let battery = home.battery;
        for distance_m in [0.4, 17.0, 18.3, 300.0, 1_111.0] {
            let ground = Position::new(51.0 + distance_m, 50.0);
            // The least energy with which the UAV is allowed to be there.
            let mut low_j = 0.0;
            let mut high_j = 40_000.0;
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
        let battery = home.battery;
        let places = (0..=160).flat_map(|x| (0..=132).map(move |y| Position::new(f64::from(x), f64::from(y)) / 4.0));
        let mut bent = 0;
        for ground in places.filter(|place| home.airspace.contains(place)) {
            bent += usize::from(home.route(1, &ground).is_some_and(|route| route.parts.len() > 1));
            for slot in [1, 14, 16, 18] {
                let Some(route) = home.route(slot, &ground) else { continue };
                if u64::from(route.slots()) > home.left_after(slot) {
                    continue;
                }
                let mut energy_j = route.energy_j();
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

    /// Two sites, of which the western charges 100 W on one pad and the eastern swaps in 7 slots on two.
    fn two_sites() -> WayHome {
        let sites = "[area]\nside_m = 2000.0\n[uav.battery]\ncapacity_j = 5000.0\n\
                     [[base.site]]\nposition_m = [50, 50]\nradius_m = 10.0\ncharge_w = 100.0\npads = 1\n\
                     [[base.site]]\nposition_m = [450, 50]\nradius_m = 30.0\nswap_s = 7.0\npads = 2\n";
        let text = format!("name = 'a'\nslots = 200\n{sites}");
        made(&Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap()).unwrap()
    }

    #[test]
    fn the_way_home_leads_to_the_site_of_least_energy() {
        let home = two_sites();
        // The rims are at x = 60 and 420: the middle between them is 240.
        for (x_m, end_m) in [(239.0, 60.0), (241.0, 420.0)] {
            let ground = Position::new(x_m, 50.0);
            let route = home.route(1, &ground).unwrap();
            assert!((route.end() - Position::new(end_m, 50.0)).norm() < 1e-9, "{}", route.end());
            let battery = home.battery;
            let away_m = (end_m - x_m).abs();
            let slots = (away_m / home.motion.thrifty_m()).ceil(); // 9, of nearly 20 m
            let expected_j = slots * battery.slot_j(away_m / slots);
            assert!((route.energy_j() - expected_j).abs() < 1e-9, "{} J, not {expected_j}", route.energy_j());
        }
    }

    #[test]
    fn a_stay_depends_on_the_charger_of_the_site() {
        let home = two_sites();
        let [west, east] = [[50.0, 50.0], [450.0, 50.0]].map(Position::from);
        // 3000 J at 100 J a slot, or a swap of 7 slots whatever there is.
        assert_eq!([&west, &east].map(|site| home.charging_slots(1, 2_000.0, site)), [30, 7]);
        assert_eq!([&west, &east].map(|site| home.charging_slots(1, 4_900.0, site)), [1, 7]);
        assert_eq!(home.charging_slots(1, 5_000.0, &east), 0);
    }

    #[test]
    fn a_uav_waits_for_a_pad_as_long_as_swaps_and_lower_numbers_take() {
        let home = two_sites();
        let stay = |x_m: f64, energy_j: f64, swapped_slots: u32| FlightReport {
            energy_j,
            swapped_slots,
            ..FlightReport::at([x_m, 50.0, 20.0], Mode::Charge)
        };
        let flights = [
            stay(50.0, 4_000.0, 0), // 10 slots
            stay(55.0, 4_500.0, 0), // after them 5 more
            stay(450.0, 900.0, 3),  // 4 of 7 are left
            stay(440.0, 900.0, 1),  // 6 of 7
            FlightReport { energy_j: 900.0, ..FlightReport::at([450.0, 50.0, 20.0], Mode::Return) },
            stay(450.0, 900.0, 0),
        ];
        for (uav, waits) in
            [(0, vec![0, 4]), (1, vec![10, 4]), (2, vec![15, 0]), (3, vec![15, 0]), (4, vec![15, 4]), (5, vec![15, 4])]
        {
            assert_eq!(home.pad_waits(1, uav, &flights), waits, "UAV {uav}");
        }
        // By hand: of two pads the swaps of UAVs 1 and 2 take 4 and 6 slots more. The charge of UAV 0 has yet to begin,
        // so it waits for 4; those in a swap wait for nobody, and UAV 3 comes after UAV 0: 4 + 7 and 6.
        let flights = [stay(450.0, 900.0, 0), stay(440.0, 900.0, 3), stay(445.0, 900.0, 1), stay(450.0, 900.0, 0)];
        for (uav, waits) in [(0, vec![0, 4]), (1, vec![]), (2, vec![]), (3, vec![0, 6])] {
            assert_eq!(home.pad_waits(1, uav, &flights), waits, "UAV {uav}");
        }
    }

    #[test]
    fn charging_ends_when_the_battery_is_full_or_sufficient() {
        let home = home("charge_w = 100.0\n[uav.battery]\ncapacity_j = 5000.0\n");
        let state = |energy_j, is_charging| BatteryState { energy_j, is_charging };
        let place = Position::new(50.0, 50.0);
        let charges_on = |slot, state: &BatteryState| home.charges_on(slot, state, &place);
        let charging_slots = |slot, energy_j| home.charging_slots(slot, energy_j, &place);
        assert!(charges_on(1, &state(4_999.0, true)) && !charges_on(1, &state(5_000.0, true)));
        assert!(!charges_on(1, &state(600.0, false)), "not begun");
        // After 17 slots of 100 J, 1 700 J: three slots of 356 J and the reserve are less.
        assert_eq!([charging_slots(1, 0.0), charging_slots(20, 900.0), charging_slots(21, 0.0)], [17, 0, 0]);
        for energy_j in [0.0, 700.0, 3_000.0, 4_950.0] {
            let mut state = state(energy_j, true);
            let mut slots = 0;
            while charges_on(1 + slots, &state) {
                state.energy_j = home.battery.charged_j(state.energy_j);
                slots += 1;
            }
            assert_eq!(charging_slots(1, energy_j), slots, "{energy_j} J");
        }
        // 356 W at 30 m/s: one slot and the reserve of 500 J are less than 900 J, ten slots more.
        assert!(!charges_on(20, &state(900.0, true)) && charges_on(11, &state(900.0, true)));
    }
}
