//! One slot of flight: fly to the waypoint, then serve the scheduled sensor nodes in range.

use std::sync::Arc;

use nalgebra::{Point3, Vector2};
use skysink_common::channel::{Channel, Draw, DrawnChannel, LinkBudget, LinkService};
use skysink_common::geometry::{Position, within};
use skysink_common::message::{
    FlightReport, HeardLink, HoldReason, LinkReport, MAX_SERVED, Mode, Plan, SensorNode, SolverOutcome,
};
use skysink_common::random::{Purpose, Streams, normal_pair};
use skysink_common::scenario::Scenario;

use crate::contacts::SlotContacts;
use crate::orders::ReportedFlight;
use crate::vehicle::Vehicle;

/// A UAV over its field.
#[derive(Debug, Clone)]
pub struct Flight {
    /// Its number.
    uav: usize,
    /// The last slot that it flies in.
    last: u64,
    channel: DrawnChannel,
    link: LinkBudget,
    /// Where the slot began, if the links count that were seen from there.
    seen_from: Option<Point3<f64>>,
    contacts: SlotContacts,
    streams: Streams,
    comm_radius_m: f64,
    resource_blocks: usize,
    /// Whether a vehicle has reported that it is down.
    is_reported_down: bool,
    /// Standard deviation of the end of a slot in x and in y [m]; `None` if it ends at the waypoint.
    position_error_m: Option<f64>,
    pub(crate) vehicle: Vehicle,
    positions: Arc<[Position]>,
    gains: Arc<[f64]>,
}

impl Flight {
    /// The first UAV at its start, over the published sensor nodes.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: &[SensorNode]) -> Self {
        let positions = sensors.iter().map(|sensor| Position::new(sensor.x_m, sensor.y_m)).collect();
        Self::over(scenario, positions, sensors.iter().map(|sensor| sensor.gain).collect())
    }

    fn over(scenario: &Scenario, positions: Arc<[Position]>, gains: Arc<[f64]>) -> Self {
        Self {
            uav: 0,
            last: u64::MAX,
            streams: Streams::new(scenario.seed),
            channel: DrawnChannel::new(Channel::of(&scenario.link), Streams::new(scenario.seed)),
            link: scenario.link.clone(),
            seen_from: None,
            contacts: SlotContacts::default(),
            comm_radius_m: scenario.link.comm_radius_m,
            resource_blocks: scenario.link.resource_blocks,
            is_reported_down: false,
            position_error_m: scenario.uav.position_error_m,
            vehicle: Vehicle::new(scenario),
            positions,
            gains,
        }
    }

    /// A UAV of another kind, with the keys of `scenario`, over the same field.
    pub(crate) fn of_kind(&self, scenario: &Scenario) -> Self {
        Self::over(scenario, Arc::clone(&self.positions), Arc::clone(&self.gains))
    }

    /// The UAV number `uav` at its start, over the same field.
    pub(crate) fn of_uav(&self, uav: usize, start: Point3<f64>, last: u64) -> Self {
        let mut other = Self { uav, last, ..self.clone() };
        other.vehicle.position = start;
        other
    }

    /// This UAV, whose links, of the distribution `law`, and ends of slots are drawn from another `seed`.
    pub(crate) fn redrawn(&self, law: &Channel, seed: u64) -> Self {
        let streams = Streams::new(seed);
        Self { streams, channel: DrawnChannel::new(law.clone(), streams), ..self.clone() }
    }

    /// Whether a slot that flies by `plan` would end within `separation_m` [m] of another UAV's `end`, outside of the
    /// base (decision D23).
    pub(crate) fn is_too_near(&self, plan: &Plan, end: &Position, separation_m: f64) -> bool {
        let is_in_base = |at: &Position| self.vehicle.is_base(at);
        let to = plan.waypoint().xy();
        (to - end).norm() < separation_m && !is_in_base(&to) && !is_in_base(end)
    }

    /// Why a vehicle that is where it was last observed must not follow `plan`; [`HoldReason::None`] if it may.
    pub(crate) fn refusal(&self, plan: &Plan) -> HoldReason {
        if plan.mode != Mode::Charge as u32 {
            self.vehicle.refusal(plan.waypoint())
        } else if self.vehicle.is_base(&self.vehicle.position.xy()) {
            HoldReason::None
        } else {
            HoldReason::Base
        }
    }

    /// Whether its own endurance has ended before `slot`.
    pub(crate) fn is_over(&self, slot: u64) -> bool {
        slot > self.last
    }

    /// The report of a slot whose waypoint is refused for `reason`: the UAV holds its position.
    pub(crate) fn refuse(&mut self, reason: HoldReason) -> FlightReport {
        self.vehicle.move_to(self.vehicle.position);
        self.hold(reason, 1)
    }

    /// Whether a slot by `plan` is one in the base, which charges.
    pub(crate) fn charges(&self, slot: u64, plan: Option<&Plan>) -> bool {
        !self.vehicle.is_down() && (self.is_over(slot) || plan.is_some_and(|plan| plan.mode == Mode::Charge as u32))
    }

    /// Whether a vehicle from outside has reported to be down.
    pub(crate) fn is_reported_down(&self) -> bool {
        self.is_reported_down
    }

    /// The report of a slot in which it has landed, and waits for a pad (decision D34): that takes no energy, and ends
    /// a swap of the battery.
    pub(crate) fn await_pad(&mut self) -> FlightReport {
        self.vehicle.swapped_slots = 0;
        FlightReport { hold: HoldReason::Pad as u32, refused: 1, ..self.report(Mode::Charge) }
    }

    /// The report of slot 0: the UAV at its start.
    pub fn start(&self) -> FlightReport {
        self.report(Mode::Hold)
    }

    /// Moves the UAV to the end of a recorded flight of this mission.
    pub fn restore(&mut self, report: &FlightReport) {
        self.vehicle.position = report.position();
        self.vehicle.energy_j = report.energy_j;
        self.vehicle.swapped_slots = report.swapped_slots;
        self.is_reported_down = report.mode == Mode::Down as u32;
        self.contacts.restore(report);
    }

    /// Lets the sensor nodes that `report` serves share the time of the slot ([`SlotContacts::share_time`]).
    pub(crate) fn share_time(&mut self, report: &mut FlightReport) {
        self.contacts.share_time(&self.link, report);
    }

    /// Flies `slot`, from 1. Without a plan, or with an impossible waypoint, the UAV holds and serves no sensor node. A
    /// sensor node that is unknown, out of range (UTS eq. 5), scheduled twice, or beyond the n resource blocks (UTS
    /// eq. 6) is not served. All refusals are counted. A UAV charges only in the base, where it serves no sensor node,
    /// and one whose energy ends in the slot is down from its end on. After the end of its own endurance it stays where
    /// it is, whatever it is told: in the base, or holding.
    #[must_use]
    pub fn step(&mut self, slot: u64, plan: Option<&Plan>) -> FlightReport {
        self.begin();
        if self.vehicle.is_down() {
            return self.report(Mode::Down);
        }
        if self.is_over(slot) {
            let refused = u32::from(plan.is_some_and(|plan| plan.mode != Mode::Charge as u32));
            let is_home = self.vehicle.charge();
            return if is_home { self.report(Mode::Charge) } else { self.hold(HoldReason::Base, refused) };
        }
        let Some(plan) = plan else {
            self.vehicle.move_to(self.vehicle.position);
            return self.hold(HoldReason::NoPlan, 0);
        };
        let mode = Mode::from_repr(plan.mode).unwrap_or_default();
        if mode == Mode::Charge {
            return if self.vehicle.charge() { self.report(mode) } else { self.hold(HoldReason::Base, 1) };
        }
        let hold = self.vehicle.fly_to(plan.waypoint(), self.position_error_m(slot, plan));
        if hold != HoldReason::None {
            return self.hold(hold, 1);
        }
        let mut report = self.report(Mode::Fly);
        if self.vehicle.is_down() {
            report.mode = Mode::Down as u32;
            return report;
        }
        self.serve(slot, plan, &mut report);
        if matches!(mode, Mode::Transit | Mode::Return) {
            report.mode = plan.mode;
        } else if report.served > 0 {
            report.mode = Mode::Serve as u32;
        }
        report
    }

    /// Keeps where a slot begins, if the links that were seen from there count (decision D32).
    fn begin(&mut self) {
        let is_observed = self.link.service == Some(LinkService::Observed);
        self.seen_from = is_observed.then_some(self.vehicle.position);
    }

    /// The report of a slot that the UAV has held its position in, or in which it went down.
    fn hold(&self, reason: HoldReason, refused: u32) -> FlightReport {
        let mode = if self.vehicle.is_down() { Mode::Down } else { Mode::Hold };
        FlightReport { hold: reason as u32, refused, ..self.report(mode) }
    }

    /// Repeats `slot` as another flight-sim has `reported` it: wherever it ended, with its mode, its energy and as many
    /// requests. The links are those of the scenario's channel.
    #[must_use]
    pub fn repeat(&mut self, slot: u64, reported: &ReportedFlight) -> FlightReport {
        self.begin();
        let ReportedFlight { mode, position, refused, energy_j, ref served } = *reported;
        let served = &served[..served.len().min(MAX_SERVED)];
        let requests = (served.len() as u32).saturating_add(refused); // at most MAX_SERVED of them are served
        if mode == Mode::Charge && requests > 0 && !self.is_over(slot) && self.vehicle.pad_site().is_some() {
            self.vehicle.position = position;
            self.vehicle.correct_energy(energy_j);
            return self.await_pad();
        }
        if mode == Mode::Charge && !self.vehicle.is_down() {
            let _ = self.vehicle.charge();
            self.vehicle.position = position;
        } else if !self.vehicle.is_down() {
            self.vehicle.move_to(position);
        }
        self.vehicle.correct_energy(energy_j);
        let mut repeated = self.report(mode);
        let known = served.iter().filter(|&&sensor| (sensor as usize) < self.positions.len());
        for (link, &sensor) in repeated.links.iter_mut().zip(known) {
            *link = self.link_report(slot, sensor);
            repeated.served += 1;
        }
        repeated.refused = requests - repeated.served;
        if repeated.mode == Mode::Hold as u32 {
            let reason = if repeated.refused > 0 { HoldReason::Waypoint } else { HoldReason::NoPlan };
            repeated.hold = reason as u32;
        }
        repeated
    }

    /// Takes in where a vehicle is at the end of `slot`, as its `report` says it, wherever that lies, and fills in the
    /// links of the report: those of the `plan` to sensor nodes in range of there, with the scenario's channel. There
    /// are none without a plan, or in a mode in which no sensor node is served. Without an energy in the report, a
    /// battery of the scenario has that of the model. A vehicle that has reported to be down stays down (decision D12).
    /// One that has charged may have waited for a pad instead, if it `awaits_pad`.
    pub fn observe(&mut self, slot: u64, plan: Option<&Plan>, awaits_pad: bool, report: &mut FlightReport) {
        self.begin();
        if self.is_reported_down {
            *report = FlightReport { mode: Mode::Down as u32, hold: HoldReason::None as u32, refused: 0, ..*report };
        }
        self.is_reported_down = report.mode == Mode::Down as u32;
        let mode = Mode::from_repr(report.mode).unwrap_or_default();
        if mode == Mode::Charge && awaits_pad {
            let FlightReport { hold, refused, .. } = self.await_pad();
            (report.hold, report.refused) = (hold, refused);
            self.vehicle.position = report.position();
        } else if mode == Mode::Charge {
            let _ = self.vehicle.charge();
            self.vehicle.position = report.position();
        } else {
            self.vehicle.move_to(report.position());
        }
        report.swapped_slots = self.vehicle.swapped_slots;
        if report.energy_j.is_finite() {
            self.vehicle.correct_energy(report.energy_j);
        }
        report.energy_j = self.vehicle.energy_j;
        report.served = 0;
        if let Some(plan) = plan.filter(|_| !matches!(mode, Mode::Hold | Mode::Charge | Mode::Down)) {
            let refused = report.refused;
            self.serve(slot, plan, report);
            report.refused = report.refused.saturating_add(refused);
        }
    }

    /// How far beside the waypoint the slot ends [m]; `None` if it ends there, as where a recorded flight ended.
    fn position_error_m(&self, slot: u64, plan: &Plan) -> Option<Vector2<f64>> {
        let sigma_m = self.position_error_m.filter(|_| plan.solver != SolverOutcome::Recorded as u32)?;
        let draw = normal_pair(&mut self.streams.stream(Purpose::PositionError, slot, self.uav as u32));
        Some(Vector2::from(draw) * sigma_m)
    }

    /// Fills in the links of the scheduled sensor nodes that can be served.
    fn serve(&self, slot: u64, plan: &Plan, report: &mut FlightReport) {
        let scheduled = plan.scheduled();
        let mut served = 0;
        for (block, &sensor) in scheduled.iter().enumerate() {
            let is_refused = block >= self.resource_blocks || scheduled[..block].contains(&sensor);
            if is_refused || !self.is_in_range(sensor) {
                continue;
            }
            report.links[served] = self.link_report(slot, sensor);
            served += 1;
        }
        report.links[..served].sort_unstable_by_key(|link| link.sensor);
        report.served = u32::try_from(served).expect("at most MAX_SERVED");
        report.refused = plan.served - report.served; // includes a count beyond the length of the message
    }

    fn is_in_range(&self, sensor: u32) -> bool {
        let uav = self.vehicle.position.xy();
        self.positions.get(sensor as usize).is_some_and(|position| within(&uav, position, self.comm_radius_m))
    }

    fn link_report(&self, slot: u64, sensor: u32) -> LinkReport {
        let index = sensor as usize;
        let sensor_at = &self.positions[index];
        let uav_at = &self.vehicle.position;
        let of_place = |uav_at: &Point3<f64>| self.channel.law().uplink(self.gains[index], sensor_at, uav_at);
        let uplink = of_place(uav_at);
        let from = self.seen_from.as_ref().unwrap_or(uav_at);
        let seen = if self.seen_from.is_some() { of_place(from) } else { uplink };
        let Draw { line_of_sight, rate_bps } = self.channel.draw(&seen, sensor_at, from, slot, sensor);
        LinkReport {
            sensor,
            line_of_sight: u32::from(line_of_sight),
            distance_m: uplink.d2_m2.sqrt(),
            elevation_deg: uplink.elevation_deg(),
            rate_bps,
            capacity_bits: self.channel.law().capacity_bits(rate_bps),
        }
    }

    /// Adds what this UAV hears at the end of `slot`, where `report` says that it is (decision D32): of each sensor
    /// node within `link.beacon_radius_m` the SNR there, which with the links observed before a slot is that of the
    /// next one. Nothing if it is down, or without that key.
    pub(crate) fn hear(&self, slot: u64, report: &FlightReport, links: &mut Vec<HeardLink>) {
        let radius_m = self.link.beacon_radius_m.filter(|_| report.flown_mode() != Mode::Down);
        let Some(radius_m) = radius_m else { return };
        let drawn_slot = slot + u64::from(self.link.service == Some(LinkService::Observed));
        let at = report.position();
        for (sensor, (position, &gain)) in (0..).zip(self.positions.iter().zip(&*self.gains)) {
            if !within(&at.xy(), position, radius_m) {
                continue;
            }
            let uplink = self.channel.law().uplink(gain, position, &at);
            let snr_db = self.channel.snr_db(&uplink, position, &at, drawn_slot, sensor) as f32;
            if snr_db.is_finite() {
                links.push(HeardLink { uav: self.uav as u32, sensor, snr_db });
            }
        }
    }

    fn report(&self, mode: Mode) -> FlightReport {
        FlightReport {
            energy_j: self.vehicle.energy_j,
            swapped_slots: if mode == Mode::Charge { self.vehicle.swapped_slots } else { 0 },
            ..FlightReport::at(self.vehicle.position, mode)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use skysink_common::channel::{ChannelModel, Uplink};
    use skysink_common::message::MAX_SERVED;
    use skysink_common::scenario::Overrides;

    /// The paper's UAV at (50, 50) with n = 4, over SNs at x = 50, 55, 60, 60 + 1 µm, 52, 51, all at y = 50.
    fn flight() -> Flight {
        let sensor = |x_m: f64| SensorNode { x_m, y_m: 50.0, gain: 1e-5, ..SensorNode::default() };
        let sensors = [50.0, 55.0, 60.0, 60.000_001, 52.0, 51.0].map(sensor);
        Flight::new(&Scenario::letter(Overrides::default()).unwrap(), &sensors)
    }

    fn plan(ids: &[u32]) -> Plan {
        let mut plan = Plan::fly_to([50.0, 50.0, 20.0], Mode::Serve);
        plan.schedule(ids);
        plan
    }

    fn served(report: &FlightReport) -> Vec<u32> {
        report.served_links().iter().map(|link| link.sensor).collect()
    }

    #[test]
    fn a_reported_flight_is_replayed_exactly() {
        let mut flight = flight();
        let reported = ReportedFlight {
            position: [-3.0, 50.5, 21.0].into(),
            mode: Mode::Hold,
            served: vec![3, 0],
            refused: 2,
            energy_j: f64::INFINITY,
        };
        let repeated = flight.repeat(1, &reported);
        assert_eq!((repeated.position(), served(&repeated)), (reported.position, vec![3, 0]));
        assert_eq!(
            (repeated.mode, repeated.refused, repeated.hold),
            (Mode::Hold as u32, 2, HoldReason::Waypoint as u32)
        );
        assert!((repeated.links[0].distance_m - 63.0).abs() < 0.01, "from where the UAV was: {repeated:?}");
        let next = flight.step(2, Some(&plan(&[0])));
        assert_eq!((next.mode, next.x_m), (Mode::Hold as u32, -3.0), "53 m are beyond the reach of a slot");
    }

    #[test]
    fn a_repeated_flight_has_the_reported_energy_even_if_it_is_zero() {
        for (battery, expected_j) in [("[uav.battery]\ncapacity_j = 1e5\n", 0.0), ("", f64::INFINITY)] {
            let text = format!("name = 'a'\n{battery}");
            let scenario = Scenario::parse(&text, std::path::Path::new("a"), Overrides::default()).unwrap();
            let mut flight = Flight::new(&scenario, &[]);
            let position = plan(&[]).waypoint();
            let reported = ReportedFlight { position, mode: Mode::Serve, served: vec![], refused: 0, energy_j: 0.0 };
            assert_eq!(flight.repeat(1, &reported).energy_j, expected_j);
        }
    }

    #[test]
    fn only_sensor_nodes_in_range_are_served() {
        let report = flight().step(1, Some(&plan(&[2, 0, 3])));
        assert_eq!(served(&report), [0, 2]);
        assert_eq!(report.refused, 1);
    }

    #[test]
    fn repeated_unknown_and_too_many_sensor_nodes_are_refused() {
        assert_eq!(served(&flight().step(1, Some(&plan(&[1, 1, 0])))), [0, 1]);
        assert_eq!(served(&flight().step(1, Some(&plan(&[6, u32::MAX, 0])))), [0]);
        let report = flight().step(1, Some(&plan(&[0, 1, 2, 4, 5])));
        assert_eq!((served(&report), report.refused), (vec![0, 1, 2, 4], 1)); // beyond n = 4, the first 4 stay
    }

    #[test]
    fn an_excessive_count_is_refused_without_reading_beyond_the_message() {
        let mut plan = plan(&[0, 1]);
        plan.served = 1000;
        let report = flight().step(1, Some(&plan));
        assert_eq!((served(&report), report.refused), (vec![0, 1], 998));
    }

    #[test]
    fn the_mode_follows_from_the_served_links() {
        let mode = |ids: &[u32], mode| {
            let report = flight().step(1, Some(&Plan { mode, ..plan(ids) }));
            Mode::from_repr(report.mode).unwrap()
        };
        for planned in [Mode::Serve, Mode::Fly, Mode::Hold].map(|mode| mode as u32).into_iter().chain([77]) {
            assert_eq!([&[0][..], &[], &[3]].map(|ids| mode(ids, planned)), [Mode::Serve, Mode::Fly, Mode::Fly]);
        }
        assert_eq!([&[0][..], &[]].map(|ids| mode(ids, Mode::Transit as u32)), [Mode::Transit; 2], "decision D8");
    }

    #[test]
    fn without_a_plan_the_uav_holds_and_serves_no_sensor_node() {
        let report = flight().step(1, None);
        assert_eq!((report.mode, report.hold), (Mode::Hold as u32, HoldReason::NoPlan as u32));
        assert_eq!((report.served, report.refused), (0, 0));
    }

    #[test]
    fn an_impossible_waypoint_is_one_refusal_and_serves_no_sensor_node() {
        let mut plan = plan(&[0]);
        plan.z_m = f64::NAN;
        let report = flight().step(1, Some(&plan));
        assert_eq!((report.mode, report.hold), (Mode::Hold as u32, HoldReason::Waypoint as u32));
        assert_eq!((report.served, report.refused), (0, 1));
    }

    #[test]
    fn a_link_reports_its_geometry_and_whole_bits() {
        let report = flight().step(1, Some(&plan(&[1])));
        let link = report.served_links()[0];
        // d = 5 m, H = 20 m: θ = atan(20/5) = 75.9638°; γ = 1e-5 · 0.05/1e-13 = 5e6, x = 425
        assert_eq!(link.distance_m, 5.0);
        assert!((link.elevation_deg - 75.963_756_532).abs() < 1e-9);
        let rate_bps = 5e6 * (1.0 + 5e6 / 425.0f64).log2();
        assert!((link.rate_bps - rate_bps).abs() < 1e-6);
        assert_eq!(link.capacity_bits, (rate_bps * 0.1) as u64);
    }

    #[test]
    fn a_redrawn_gain_depends_only_on_the_slot() {
        let scenario = "name = \"fading\"\n[link]\ngain = \"per-slot\"\n";
        let scenario = Scenario::parse(scenario, std::path::Path::new("fading.toml"), Overrides::default()).unwrap();
        let sensor = SensorNode { x_m: 50.0, y_m: 50.0, gain: 1e-5, ..SensorNode::default() };
        let rate = |slots: &[u64]| {
            let mut flight = Flight::new(&scenario, &[sensor]);
            slots.iter().map(|&slot| flight.step(slot, Some(&plan(&[0]))).links[0].rate_bps).next_back().unwrap()
        };
        assert_eq!(rate(&[1, 2, 3]), rate(&[3]));
        assert_ne!(rate(&[3]), rate(&[4]));
    }

    /// A UAV with a position error of σ = 3 m, at (5 km, 5 km) in an area of 10 km, with a reach of 3 km.
    fn imprecise() -> Flight {
        let text = "name = \"x\"\n[area]\nside_m = 10000.0\n[uav]\nmax_speed_mps = 3000.0\nposition_error_m = 3.0\n";
        let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        Flight::new(&scenario, &[])
    }

    /// The distribution function of the standard normal distribution, within 1e-7 (Abramowitz and Stegun, 7.1.26).
    fn normal(x: f64) -> f64 {
        let t = 1.0 / (1.0 + 0.327_591_1 * x.abs() / 2f64.sqrt());
        let powers = [0.254_829_592, -0.284_496_736, 1.421_413_741, -1.453_152_027, 1.061_405_429];
        let erfc = t * powers.iter().rev().fold(0.0, |sum, power| sum * t + power) * (-x * x / 2.0).exp();
        if x > 0.0 { 1.0 - erfc / 2.0 } else { erfc / 2.0 }
    }

    #[test]
    fn position_errors_are_normal() {
        let mut flight = imprecise();
        let waypoint = Plan::fly_to([5_000.0, 5_000.0, 20.0], Mode::Fly);
        let count = 100_000;
        let mut ends: [Vec<f64>; 2] = [Vec::new(), Vec::new()];
        for slot in 1..=count {
            let report = flight.step(slot, Some(&waypoint));
            ends[0].push((report.x_m - 5_000.0) / 3.0);
            ends[1].push((report.y_m - 5_000.0) / 3.0);
        }
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / count as f64;
        let error = 1.0 / (count as f64).sqrt();
        let [x, y] = &mut ends;
        assert!(mean(&mut x.iter().zip(&*y).map(|(x, y)| x * y)).abs() < 4.0 * error, "x and y are independent");
        for ends in [x, y] {
            assert!(mean(&mut ends.iter().copied()).abs() < 4.0 * error);
            assert!((mean(&mut ends.iter().map(|end| end * end)) - 1.0).abs() < 4.0 * 2f64.sqrt() * error);
            assert!(mean(&mut ends.windows(2).map(|pair| pair[0] * pair[1])).abs() < 4.0 * error, "slots, too");
            ends.sort_by(f64::total_cmp);
            let apart = |(rank, end): (usize, &f64)| (normal(*end) - (rank as f64 + 0.5) / count as f64).abs();
            let farthest = ends.iter().enumerate().map(apart).fold(0.0, f64::max);
            assert!(farthest < 1.95 * error, "Kolmogorov-Smirnov at 0.1 %: {}", farthest / error);
        }
    }

    #[test]
    fn position_errors_depend_only_on_the_slot_and_do_not_apply_to_replays() {
        let plan = Plan::fly_to([5_020.0, 4_980.0, 20.0], Mode::Fly);
        let mut flight = imprecise();
        let ends: Vec<FlightReport> = (1..=9).map(|slot| flight.step(slot, Some(&plan))).collect();
        assert_ne!(ends[7].position(), ends[8].position());
        let mut restarted = imprecise();
        restarted.restore(&ends[7]);
        assert_eq!(restarted.step(9, Some(&plan)), ends[8]);
        let recorded = Plan { solver: SolverOutcome::Recorded as u32, ..Plan::fly_to(ends[8].position(), Mode::Fly) };
        let mut again = imprecise();
        again.restore(&ends[7]);
        assert_eq!(again.step(9, Some(&recorded)).position(), ends[8].position());
    }

    #[test]
    fn service_out_of_range_of_the_end_position_is_refused() {
        let text = "name = \"x\"\n[uav]\nposition_error_m = 3.0\n";
        let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        let sensors = [60.0, 50.0].map(|x_m| SensorNode { x_m, y_m: 50.0, gain: 1e-5, ..SensorNode::default() });
        let mut flight = Flight::new(&scenario, &sensors);
        let reports: Vec<FlightReport> = (1..=1_000).map(|slot| flight.step(slot, Some(&plan(&[0, 1])))).collect();
        let at = |x_m: f64| Position::new(x_m, 50.0);
        let is_missed = |report: &FlightReport, x_m: f64| !within(&report.position().xy(), &at(x_m), 10.0);
        for report in &reports {
            let missed = [60.0, 50.0].map(|x_m| u32::from(is_missed(report, x_m))).iter().sum();
            assert_eq!((report.served, report.refused), (2 - missed, missed));
        }
        let missed = reports.iter().filter(|report| is_missed(report, 60.0)).count();
        assert!((500..700).contains(&missed), "a little more than half: the rim is curved; {missed}");
    }

    #[test]
    fn line_of_sight_is_drawn_by_slot_and_sensor_with_the_channels_probability() {
        let text = "name = \"x\"\nslots = 20000\nslot_s = 0.01\n[link]\nmodel = \"probabilistic-los\"\ncomm_s = 0.01\n\
                    environment = \"high-rise\"\ncomm_radius_m = 60.0\n[uav]\naltitude_m = 40.0\n";
        let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        let sensor = SensorNode { x_m: 80.0, y_m: 50.0, gain: 1e-6, ..SensorNode::default() };
        let mut flight = Flight::new(&scenario, &[sensor]);
        let links: Vec<_> = (1..=20_000).map(|slot| flight.step(slot, Some(&plan(&[0]))).links[0]).collect();
        let channel = Channel::of(&scenario.link);
        let link = channel.line_of_sight().unwrap();
        let fraction = links.iter().map(|link| f64::from(link.line_of_sight)).sum::<f64>() / 20_000.0;
        let probability = link.los_probability(&Uplink::at(1.0, 900.0, 40.0));
        let error = (probability * (1.0 - probability) / 20_000.0).sqrt();
        assert!((fraction - probability).abs() < 5.0 * error, "{fraction} against {probability}");
        // The expected rate is the mean of the draws, within five standard errors.
        let los = link.los_rate_bps(900.0, 40.0);
        let nlos = link.nlos_rate_bps(900.0, 40.0);
        let mean = links.iter().map(|link| link.rate_bps).sum::<f64>() / 20_000.0;
        assert!((mean - link.expected_rate_bps(&Uplink::at(1.0, 900.0, 40.0))).abs() < 5.0 * error * (los - nlos));
        assert_eq!(Flight::new(&scenario, &[sensor]).step(7, Some(&plan(&[0]))).links[0], links[6]);
    }

    #[test]
    fn a_hovering_uav_keeps_a_frozen_line_of_sight() {
        let flown = |seed: u64| {
            let text = format!(
                "name = \"x\"\nseed = {seed}\n[link]\nmodel = \"probabilistic-los\"\nenvironment = \"high-rise\"\n\
                 comm_radius_m = 60.0\nlos_correlation_m = 30.0\nfading = \"rician\"\n[uav]\naltitude_m = 40.0\n"
            );
            let scenario = Scenario::parse(&text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
            let sensor = |x_m: f64| SensorNode { x_m, y_m: 50.0, gain: 1e-6, ..SensorNode::default() };
            let mut flight = Flight::new(&scenario, &[sensor(80.0), sensor(80.000_001)]);
            let links: Vec<_> = (1..=50).map(|slot| flight.step(slot, Some(&plan(&[0, 1]))).links).collect();
            let first = links[0][0].line_of_sight;
            assert!(links.iter().all(|links| links[0].line_of_sight == first && links[1].line_of_sight == first));
            assert!(links[1..].iter().all(|links| links[0].rate_bps != links[1].rate_bps), "fading is drawn for each");
            first
        };
        // P_L = 0.43 at 53°: some missions have it, others do not.
        let seen: u32 = (0..40).map(flown).sum();
        assert!((5..=35).contains(&seen), "{seen} of 40");
    }

    proptest! {
        #[test]
        fn flights_in_wind_stay_in_reach_and_area(
            wind_mps in [-14.0..14.0, -14.0..14.0], sigma_m in 0.0..60.0, acceleration_mps2 in prop::option::of(1.0..200.0),
            start_m in [0.0..=100.0, 0.0..=100.0], seed in 0u64..1000,
            away in [-60.0..60.0, -60.0..60.0],
        ) {
            let acceleration = acceleration_mps2.map_or(String::new(), |a| format!("acceleration_mps2 = {a:?}\n"));
            let text = format!(
                "name = 'x'\nseed = {seed}\n[uav]\nmax_speed_mps = 20.0\nwind_mps = {wind_mps:?}\n\
                 position_error_m = {sigma_m:?}\nstart_m = {start_m:?}\n{acceleration}"
            );
            let scenario = Scenario::parse(&text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
            let mut flight = Flight::new(&scenario, &[]);
            for slot in 1..=5 {
                let from = flight.vehicle.position.xy();
                let to = from + nalgebra::Vector2::from(away);
                let report = flight.step(slot, Some(&Plan::fly_to([to.x, to.y, 20.0], Mode::Fly)));
                let end = report.position().xy();
                let is_inside = scenario.area.contains(&to, 0.0);
                prop_assert_eq!(report.mode == Mode::Fly as u32, is_inside && scenario.reaches(&from, &to));
                prop_assert!(report.mode == Mode::Fly as u32 || !is_inside || !within(&from, &to, scenario.reach_m()));
                prop_assert!(scenario.reaches(&from, &end) && scenario.area.contains(&end, 0.0), "{} to {}", from, end);
                prop_assert!(within(&from, &end, scenario.farthest_m()));
            }
        }

        #[test]
        fn no_plan_makes_the_uav_violate_its_limits(
            x_m in prop::num::f64::ANY, y_m in prop::num::f64::ANY, z_m in prop::num::f64::ANY,
            count in any::<u32>(), ids in prop::collection::vec(0u32..8, MAX_SERVED), mode in any::<u32>(),
        ) {
            let mut plan = Plan { mode, ..Plan::fly_to([x_m, y_m, z_m], Mode::Serve) };
            plan.schedule(&ids);
            plan.served = count;
            let mut flight = flight();
            let report = flight.step(1, Some(&plan));
            prop_assert!(within(&report.position().xy(), &Position::new(50.0, 50.0), 30.0));
            prop_assert!(report.served <= 4);
            for (i, link) in report.served_links().iter().enumerate() {
                prop_assert!(link.distance_m <= 10.0 * (1.0 + 1e-9));
                prop_assert!(report.served_links()[..i].iter().all(|other| other.sensor < link.sensor));
            }
        }
    }
}
