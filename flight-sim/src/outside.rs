//! Vehicles from outside: the orders that they get, and what their reports become.
//!
//! How they fly is left to a [`Vehicle`](OutsideVehicle), the transport to `node` and to other languages.

use nalgebra::Point3;
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, HoldReason, LinkReport, MAX_SERVED, Mode, Plan, SensorNode};
use skysink_common::possible::Message as _;
use skysink_common::scenario::{Area, Scenario};
use skysink_common::slot_record::ByUav;

use crate::fleet::Fleet;

/// A slot ends at the waypoint if it ends this near to it [m]; farther away the vehicle is en route.
pub const REACHED_M: f64 = 2.0;

/// A position farther than this from the area is not believed [m]. Nearer, a vehicle
/// may be anywhere: a lost link may have hidden a long flight, and a run may be resumed from elsewhere.
pub const ASTRAY_M: f64 = 1e5;

/// The mode of a slot that has followed `plan` and ends at `position` [m]; farther than `reached_m` [m] from the
/// waypoint the vehicle is en route.
#[must_use]
pub fn mode_at_end(plan: &Plan, position: &Point3<f64>, reached_m: f64) -> Mode {
    match Mode::from_repr(plan.mode).unwrap_or_default() {
        Mode::Charge => Mode::Charge,
        _ if (position - plan.waypoint()).norm() > reached_m => Mode::EnRoute,
        mode @ (Mode::Transit | Mode::Return) => mode,
        _ => Mode::Serve,
    }
}

/// What a vehicle is to do in a slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlotOrder {
    /// The slot, from 1.
    pub slot: u64,
    /// The number of the UAV.
    pub uav: usize,
    /// Where it was at the end of the slot before [m].
    pub position: Point3<f64>,
    /// The plan. One that must not be followed, or that is not there, is to stay at `position` and serve nobody.
    pub plan: Plan,
    /// Why it holds.
    pub hold: HoldReason,
    /// When the slot ends in a paced run, on the monotonic clock [ns]; `None` without a pace.
    pub ends_ns: Option<u64>,
}

/// A vehicle that flies orders.
pub trait OutsideVehicle {
    /// Called once before the first slot, or after a restart: the published sensor nodes, and the last report of each
    /// UAV, by its number.
    ///
    /// # Errors
    /// If it cannot fly there.
    fn begin(&mut self, _sensors: &[SensorNode], _reports: &[FlightReport]) -> Result<(), InputError> {
        Ok(())
    }

    /// Flies a slot, and reports where the vehicle is at its end: [`FlightReport::at`], and what else it knows. The
    /// mode counts only if it is [`Mode::Down`], which is final. Links are filled in.
    ///
    /// # Errors
    /// If it fails, which ends the run.
    fn fly(&mut self, order: &SlotOrder) -> Result<FlightReport, InputError>;

    /// Bits that real sensor nodes have delivered in the last slot, by id; `None` for what the scenario's channel
    /// carries to those in range. They do not count while the UAV holds, charges or is down.
    fn delivered(&mut self) -> Option<Vec<(u32, u64)>> {
        None
    }
}

/// The vehicles of a mission: where they were, and the channel above them.
#[derive(Debug, Clone)]
pub struct OutsideFleet {
    /// Where they were, and what they hear there.
    pub(crate) fleet: Fleet,
    area: Area,
    /// The published sensor nodes.
    sensors: Vec<SensorNode>,
    /// Time of communication in a slot [s].
    comm_s: f64,
    /// By UAV: the altitude of its waypoints [m]; `None` if they have their own.
    altitudes_m: ByUav<Option<f64>>,
    reached_m: f64,
}

impl OutsideFleet {
    /// The vehicles at their starts, over the published sensor nodes. A slot that ends farther than `reached_m` [m]
    /// from its waypoint has not reached it.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: &[SensorNode], reached_m: f64) -> Self {
        Self {
            fleet: Fleet::new(scenario, sensors),
            area: scenario.area.clone(),
            sensors: sensors.to_vec(),
            comm_s: scenario.link.comm_s,
            altitudes_m: (0..scenario.uav.uavs()).map(|uav| scenario.uav_of(uav).fixed_altitude_m()).collect(),
            reached_m,
        }
    }

    /// The orders of a slot by its plans, `None` if there are none in time. A waypoint that is out of reach, outside
    /// the area or behind a zone is refused, and so is charging outside the base.
    pub fn orders(&self, slot: u64, plans: Option<&[Plan]>) -> ByUav<SlotOrder> {
        let refusals = plans.map(|plans| self.fleet.refusals(plans, |_| true, |_| None));
        let order = |(uav, position): (usize, Point3<f64>)| {
            let plan = plans.and_then(|plans| plans.get(uav)).copied();
            let refusal = refusals.as_ref().and_then(|refusals| refusals.get(uav)).copied();
            let hold = refusal.unwrap_or(HoldReason::NoPlan);
            let stay = Plan::fly_to(position, Mode::Hold);
            let mut plan = plan.filter(|_| hold == HoldReason::None).unwrap_or(stay);
            // Whatever its altitude was: a plan keeps the one that it finds.
            plan.z_m = self.altitudes_m[uav].unwrap_or(plan.z_m);
            SlotOrder { slot, uav, position, plan, hold, ends_ns: None }
        };
        self.fleet.positions().enumerate().map(order).collect()
    }

    /// Checks that the vehicles can be where they say.
    ///
    /// # Errors
    /// If a number is not finite, or a position is farther than [`ASTRAY_M`] from the area.
    pub fn check(&self, reports: &[FlightReport]) -> Result<(), InputError> {
        for (uav, report) in reports.iter().enumerate() {
            let refuse = |message: &str| Err(InputError::of_argument("uav", &uav.to_string(), message));
            let FlightReport { x_m, y_m, z_m, .. } = *report;
            if !self.area.contains(&report.position().xy(), ASTRAY_M) || !(-ASTRAY_M..=ASTRAY_M).contains(&z_m) {
                let km = ASTRAY_M / 1e3;
                return refuse(&format!("position = ({x_m}, {y_m}, {z_m}): expected at most {km} km from the area"));
            }
            let said = FlightReport { served: 0, energy_j: 0.0, ..*report }; // links and energy are filled in
            if !FlightReport::are_possible(&[said]) {
                return refuse("time, velocity, heading and covariance: expected numbers, finite but for the heading");
            }
        }
        Ok(())
    }

    /// Completes the `reports` of the vehicles that have flown these `orders`: modes, refusals, and links.
    pub fn complete(&mut self, slot: u64, orders: &[SlotOrder], reports: &mut [FlightReport]) {
        for (order, report) in orders.iter().zip(&mut *reports) {
            report.hold = order.hold as u32;
            report.refused = u32::from(!matches!(order.hold, HoldReason::None | HoldReason::NoPlan));
            if report.mode != Mode::Down as u32 {
                let flown = mode_at_end(&order.plan, &report.position(), self.reached_m);
                report.mode = if order.hold == HoldReason::None { flown } else { Mode::Hold } as u32;
            }
        }
        let plan_of =
            |uav: usize| orders.get(uav).filter(|order| order.hold == HoldReason::None).map(|order| &order.plan);
        self.fleet.observe(slot, plan_of, reports);
        for report in &mut *reports {
            report.mode = report.flown_mode() as u32;
        }
    }

    /// Replaces the links of a completed `report` by those over which real sensor nodes have delivered these bits, by
    /// id; none in a slot in which its UAV holds, charges or is down.
    ///
    /// # Errors
    /// If there are more than [`MAX_SERVED`], a sensor node is unknown or named twice, or its bits are impossible.
    pub fn deliver(&self, bits: &[(u32, u64)], report: &mut FlightReport) -> Result<(), InputError> {
        let is_possible = |(id, bits): &(u32, u64)| (*id as usize) < self.sensors.len() && *bits <= MOST_BITS;
        let mut bits = bits.to_vec();
        bits.sort_unstable();
        let is_twice = bits.windows(2).any(|pair| pair[0].0 == pair[1].0);
        if bits.len() > MAX_SERVED || is_twice || !bits.iter().all(is_possible) {
            let expected =
                format_args!("expected at most {MAX_SERVED} ids of sensor nodes, each with whole bits, 0 or above");
            return Err(InputError::of_argument("bits", &format!("{bits:?}"), expected));
        }
        if !matches!(report.flown_mode(), Mode::Serve | Mode::Fly | Mode::Transit | Mode::Return | Mode::EnRoute) {
            return Ok(());
        }
        report.links = [LinkReport::default(); MAX_SERVED];
        report.served = u32::try_from(bits.len()).expect("at most MAX_SERVED");
        for (link, (sensor, delivered)) in report.links.iter_mut().zip(bits) {
            let node = &self.sensors[sensor as usize];
            let distance_m = (report.x_m - node.x_m).hypot(report.y_m - node.y_m);
            *link = LinkReport {
                sensor,
                line_of_sight: 1,
                distance_m,
                elevation_deg: report.z_m.atan2(distance_m).to_degrees(),
                rate_bps: delivered as f64 / self.comm_s,
                capacity_bits: delivered,
            };
        }
        report.mode = report.flown_mode() as u32;
        Ok(())
    }
}

/// Most bits of a sensor node in a slot.
const MOST_BITS: u64 = (1 << 62) - 1;

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;

    /// The paper's mission over two SNs, at (50, 50) and (70, 50), and a vehicle at (50, 50).
    fn fleet() -> OutsideFleet {
        let sensor = |x_m: f64| SensorNode { x_m, y_m: 50.0, gain: 1e-5, ..SensorNode::default() };
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        OutsideFleet::new(&scenario, &[50.0, 70.0].map(sensor), REACHED_M)
    }

    fn plan(x_m: f64, ids: &[u32]) -> Plan {
        let mut plan = Plan::fly_to([x_m, 50.0, 20.0], Mode::Serve);
        plan.schedule(ids);
        plan
    }

    /// The report of a vehicle that ends slot 1 at `x_m`.
    fn flown(plans: Option<&[Plan]>, x_m: f64) -> FlightReport {
        let mut fleet = fleet();
        let orders = fleet.orders(1, plans);
        let mut reports = [FlightReport::at([x_m, 50.0, 20.0], Mode::Serve)];
        fleet.complete(1, &orders, &mut reports);
        reports[0]
    }

    fn mode(report: &FlightReport) -> Mode {
        Mode::from_repr(report.mode).unwrap()
    }

    #[test]
    fn a_vehicle_serves_at_its_waypoint_and_in_range_while_en_route() {
        let there = flown(Some(&[plan(70.0, &[1])]), 69.0);
        assert_eq!((mode(&there), there.served, there.links[0].sensor), (Mode::Serve, 1, 1));
        let before = flown(Some(&[plan(70.0, &[1])]), 62.0);
        assert_eq!((mode(&before), before.served), (Mode::EnRoute, 1), "8 m from it");
        let far = flown(Some(&[plan(70.0, &[1])]), 55.0);
        assert_eq!((mode(&far), far.served, far.refused), (Mode::EnRoute, 0, 1), "15 m from it");
        assert_eq!(mode(&flown(Some(&[plan(70.0, &[])]), 70.0)), Mode::Fly);
    }

    #[test]
    fn an_infeasible_or_late_plan_becomes_a_hold_order() {
        for (plans, hold, refused) in [
            (Some([plan(90.0, &[1])]), HoldReason::Waypoint, 1),
            (Some([plan(f64::NAN, &[1])]), HoldReason::Waypoint, 1),
            (Some([Plan::fly_to([50.0, 50.0, 20.0], Mode::Charge)]), HoldReason::Base, 1),
            (None, HoldReason::NoPlan, 0),
        ] {
            let plans = plans.as_ref().map(|plans| &plans[..]);
            let order = fleet().orders(1, plans)[0];
            assert_eq!((order.hold, order.plan.waypoint(), order.plan.served), (hold, order.position, 0));
            let report = flown(plans, 50.5);
            assert_eq!((mode(&report), report.hold, report.refused), (Mode::Hold, hold as u32, refused));
            assert_eq!((report.x_m, report.served), (50.5, 0), "where it is is where it says");
        }
    }

    #[test]
    fn orders_return_to_the_altitude_of_the_scenario() {
        let mut fleet = fleet();
        fleet.fleet.restore(&[FlightReport::at([50.0, 50.0, 3.0], Mode::Serve)]);
        let kept = Plan::fly_to([60.0, 50.0, 3.0], Mode::Serve);
        for plans in [Some(&[kept][..]), None] {
            assert_eq!(fleet.orders(2, plans)[0].plan.z_m, 20.0);
        }
    }

    #[test]
    fn measured_energy_is_used_if_the_scenario_has_a_battery() {
        for (battery, expected_j) in [("[uav.battery]\ncapacity_j = 1e5\n", 5e4), ("", f64::INFINITY)] {
            let text = format!("name = 'a'\n{battery}");
            let scenario = Scenario::parse(&text, std::path::Path::new("a"), Overrides::default()).unwrap();
            let mut fleet = OutsideFleet::new(&scenario, &[], REACHED_M);
            let orders = fleet.orders(1, None);
            let mut reports = [FlightReport { energy_j: 5e4, ..FlightReport::at([50.0, 50.0, 20.0], Mode::Serve) }];
            fleet.complete(1, &orders, &mut reports);
            assert_eq!(reports[0].energy_j, expected_j);
        }
    }

    #[test]
    fn a_vehicle_may_report_any_finite_position_near_the_area() {
        let at = |x_m: f64, z_m: f64| FlightReport::at([x_m, 50.0, z_m], Mode::Serve);
        for possible in [at(-99_999.0, 20.0), at(50.0, -3.0), FlightReport { energy_j: f64::NAN, ..at(50.0, 20.0) }] {
            assert_eq!(fleet().check(&[possible]), Ok(()), "{possible:?}");
        }
        let says = |report: FlightReport| fleet().check(&[report]).unwrap_err().to_string();
        let expected = "uav 0: position = (100101, 50, 20): expected at most 100 km from the area";
        assert_eq!(says(at(100_101.0, 20.0)), expected);
        assert!(
            [at(f64::NAN, 20.0), at(50.0, f64::NAN), at(50.0, 1e9)].into_iter().all(|at| says(at).contains("100 km"))
        );
        assert!(says(FlightReport { velocity_mps: [0.0, f64::NAN, 0.0], ..at(50.0, 20.0) }).contains("finite"));
    }

    #[test]
    fn a_vehicle_that_was_down_stays_down_whatever_it_reports() {
        let mut fleet = fleet();
        let fly = |fleet: &mut OutsideFleet, slot, mode| {
            let orders = fleet.orders(slot, Some(&[plan(50.0, &[0])]));
            let mut reports = [FlightReport::at([50.0, 50.0, 20.0], mode)];
            fleet.complete(slot, &orders, &mut reports);
            reports[0]
        };
        let flown = [(1, Mode::Fly), (2, Mode::Down), (3, Mode::Fly)].map(|(slot, mode)| fly(&mut fleet, slot, mode));
        assert_eq!(flown.each_ref().map(mode), [Mode::Serve, Mode::Down, Mode::Down]);
        assert_eq!(flown.map(|report| (report.served, report.refused)), [(1, 0), (0, 0), (0, 0)]);
        let mut restarted = self::fleet();
        restarted.fleet.restore(&flown[2..]);
        assert_eq!(mode(&fly(&mut restarted, 4, Mode::Fly)), Mode::Down);
    }

    #[test]
    fn orders_start_at_the_reported_position() {
        let mut fleet = fleet();
        fleet.fleet.restore(&[FlightReport::at([10.0, 20.0, 20.0], Mode::Serve)]);
        let order = fleet.orders(2, Some(&[plan(50.0, &[])]))[0];
        assert_eq!((order.position, order.hold), (Point3::new(10.0, 20.0, 20.0), HoldReason::Waypoint));
    }
}
