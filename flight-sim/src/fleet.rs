//! One slot of all UAVs: they move one after the other, and no two serve the same sensor node.
//!
//! What one UAV does is left to [`crate::flight`].

use nalgebra::Point3;
use skysink_common::channel::Channel;
use skysink_common::interpolation::interpolate;
use skysink_common::message::{FlightReport, HeardLink, HoldReason, LinkReport, Mode, Plan, SensorNode, SolverOutcome};
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::ByUav;

use crate::flight::Flight;
use crate::orders::Orders;

/// The UAVs of a mission over their field.
#[derive(Debug, Clone)]
pub struct Fleet {
    uavs: ByUav<Flight>,
    /// Least distance between the ends of slots of two UAVs [m] (decision D23); 0 for any.
    separation_m: f64,
    slot_s: f64,
    pads: Pads,
}

/// The pads of several bases in a slot (decision D34); of a single base, which has a pad for everybody, none.
#[derive(Debug, Clone, Default)]
struct Pads {
    /// By site: how many it has.
    all: Vec<u32>,
    /// By site: how many are free for the UAVs that have yet to move and are not in a swap.
    free: Vec<u32>,
}

impl Pads {
    fn of(scenario: &Scenario) -> Self {
        let base = scenario.landing_base();
        let sites = base.iter().flat_map(|base| base.sites());
        Self { all: sites.map(|site| site.charger.pads).collect(), free: Vec::new() }
    }

    /// Begins a slot in which the UAVs charge of whose number `charges` is true: those that have begun a swap of their
    /// battery keep their pads.
    fn begin(&mut self, uavs: &[Flight], charges: impl Fn(usize) -> bool) {
        self.free.clone_from(&self.all);
        if self.free.is_empty() {
            return;
        }
        let is_swapping = |(number, uav): &(usize, &Flight)| uav.vehicle.swapped_slots > 0 && charges(*number);
        for site in uavs.iter().enumerate().filter(is_swapping).filter_map(|(_, uav)| uav.vehicle.pad_site()) {
            self.free[site] = self.free[site].saturating_sub(1);
        }
    }

    /// Takes a pad for `uav`, if it is to charge and has none; whether it has to wait for one.
    fn refuses(&mut self, uav: &Flight, charges: bool) -> bool {
        if !charges || self.free.is_empty() || uav.vehicle.swapped_slots > 0 {
            return false;
        }
        let Some(site) = uav.vehicle.pad_site() else { return false };
        let is_full = self.free[site] == 0;
        self.free[site] = self.free[site].saturating_sub(1);
        is_full
    }
}

impl Fleet {
    /// The UAVs at their starts, over the published sensor nodes.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: &[SensorNode]) -> Self {
        let mut kinds: Vec<Flight> = Vec::new();
        for kind in scenario.kinds() {
            let flight = kinds.first().map_or_else(|| Flight::new(&kind, sensors), |first| first.of_kind(&kind));
            kinds.push(flight);
        }
        let last = |uav: usize| scenario.endurance_s_of(uav).map_or(u64::MAX, |_| scenario.slots_of(uav));
        let flight = |(uav, start)| kinds[scenario.kind_of(uav)].of_uav(uav, start, last(uav));
        Self {
            uavs: scenario.starts().enumerate().map(flight).collect(),
            separation_m: scenario.uav.separation_m.unwrap_or(0.0),
            slot_s: scenario.slot_s,
            pads: Pads::of(scenario),
        }
    }

    /// These UAVs, whose links, of the distribution `law`, and ends of slots are drawn from another `seed`.
    #[must_use]
    pub fn redrawn(&self, law: &Channel, seed: u64) -> Self {
        Self { uavs: self.uavs.iter().map(|uav| uav.redrawn(law, seed)).collect(), ..self.clone() }
    }

    /// The reports of slot 0: the UAVs at their starts.
    pub fn start(&self) -> ByUav<FlightReport> {
        self.uavs.iter().map(Flight::start).collect()
    }

    /// Where the UAVs are [m].
    pub(crate) fn positions(&self) -> impl Iterator<Item = Point3<f64>> {
        self.uavs.iter().map(|uav| uav.vehicle.position)
    }

    /// Moves the UAVs to the ends of recorded flights of this mission.
    pub fn restore(&mut self, reports: &[FlightReport]) {
        self.uavs.iter_mut().zip(reports).for_each(|(uav, report)| uav.restore(report));
    }

    /// Flies `slot`, from 1, each UAV by its plan as [`Flight::step`] does; writes the reports to `reports`.
    ///
    /// A waypoint too near to the end of a UAV of lower number is refused (decision D23). A sensor node that a UAV of
    /// lower number serves is not served again; such requests count among those refused (decision D19). Of the UAVs
    /// that charge in a site those have its pads that have begun a swap, then those of the lowest numbers (decision
    /// D34).
    pub fn step<'a>(&mut self, slot: u64, plan_of: impl Fn(usize) -> Option<&'a Plan>, reports: &mut [FlightReport]) {
        self.pads.begin(&self.uavs, |number| self.uavs[number].charges(slot, plan_of(number)));
        for (number, uav) in self.uavs.iter_mut().enumerate() {
            let (lower, rest) = reports.split_at_mut(number);
            let plan = plan_of(number);
            let is_too_near = |plan: &&Plan| {
                // A recorded flight may have ended beside its waypoint.
                let flies = plan.mode != Mode::Charge as u32 && plan.solver != SolverOutcome::Recorded as u32;
                let is_near = |other: &FlightReport| uav.is_too_near(plan, &other.position().xy(), self.separation_m);
                self.separation_m > 0.0 && flies && lower.iter().any(is_near)
            };
            rest[0] = if plan.as_ref().is_some_and(is_too_near) && !uav.vehicle.is_down() && !uav.is_over(slot) {
                uav.refuse(HoldReason::Separation)
            } else if self.pads.refuses(uav, uav.charges(slot, plan)) {
                uav.await_pad()
            } else {
                uav.step(slot, plan)
            };
            rest[0].time_s = slot as f64 * self.slot_s;
            leave_to(lower, &mut rest[0]);
            uav.share_time(&mut rest[0]);
        }
    }

    /// Why vehicles that are where they were last observed must not follow `plans`, in the order of their numbers;
    /// [`HoldReason::None`] for those that may. As in [`Self::step`], the plan of a lower number goes first. Those of
    /// whose number `follows` is false may stay where they are, whatever is planned, or be on their way to where they
    /// were sent last, their `target`.
    pub fn refusals(
        &self,
        plans: &[Plan],
        follows: impl Fn(usize) -> bool,
        target: impl Fn(usize) -> Option<Point3<f64>>,
    ) -> ByUav<HoldReason> {
        let mut refusals: ByUav<HoldReason> = ByUav::new();
        for (number, (uav, plan)) in self.uavs.iter().zip(plans).enumerate() {
            let is_too_near = |other: usize| {
                let is_told = refusals.get(other) == Some(&HoldReason::None);
                let flies = is_told && plans[other].mode != Mode::Charge as u32;
                let is_near = |end: Point3<f64>| uav.is_too_near(plan, &end.xy(), self.separation_m);
                let is_at = self.uavs[other].vehicle.position;
                let on_its_way = || nearest_between(&is_at, &target(other).unwrap_or(is_at), &plan.waypoint());
                let strays = !flies || !follows(other);
                flies && is_near(plans[other].waypoint()) || strays && is_near(on_its_way())
            };
            let flies = self.separation_m > 0.0 && plan.mode != Mode::Charge as u32;
            let mut fixed = (0..plans.len()).filter(|&other| other < number || other > number && !follows(other));
            let is_crowded = flies && fixed.any(is_too_near);
            refusals.push(if is_crowded { HoldReason::Separation } else { uav.refusal(plan) });
        }
        refusals
    }

    /// Takes in where vehicles are at the end of `slot`, as `reports` say it, and fills in the links of these reports
    /// as [`Flight::observe`] does. A sensor node that a UAV of lower number serves is not served again.
    pub fn observe<'a>(
        &mut self,
        slot: u64,
        plan_of: impl Fn(usize) -> Option<&'a Plan>,
        reports: &mut [FlightReport],
    ) {
        let charges =
            |uav: &Flight, report: &FlightReport| report.flown_mode() == Mode::Charge && !uav.is_reported_down();
        self.pads.begin(&self.uavs, |number| charges(&self.uavs[number], &reports[number]));
        for (number, uav) in self.uavs.iter_mut().enumerate() {
            let (lower, rest) = reports.split_at_mut(number);
            let awaits_pad = self.pads.refuses(uav, charges(uav, &rest[0]));
            uav.observe(slot, plan_of(number), awaits_pad, &mut rest[0]);
            leave_to(lower, &mut rest[0]);
            uav.share_time(&mut rest[0]);
        }
    }

    /// What the UAVs hear at the end of `slot`, where `reports` say that they are (decision D32); nothing without
    /// `link.beacon_radius_m`.
    pub fn hear(&self, slot: u64, reports: &[FlightReport]) -> Vec<HeardLink> {
        let mut links = Vec::new();
        self.uavs.iter().zip(reports).for_each(|(uav, report)| uav.hear(slot, report, &mut links));
        links
    }

    /// Flies `slot` by `orders`: plans as [`Self::step`] does, or reported flights again ([`Flight::repeat`]).
    ///
    /// # Panics
    /// If there is not one order for each UAV.
    pub fn fly(&mut self, slot: u64, orders: &Orders, reports: &mut [FlightReport]) {
        let reported = match orders {
            Orders::Plans(plans) => return self.step(slot, |uav| plans[uav].as_ref(), reports),
            Orders::Reports(reported) => reported,
        };
        assert_eq!(reported.len(), self.uavs.len(), "expected a flight of each UAV");
        for (uav, (reported, report)) in self.uavs.iter_mut().zip(reported.iter().zip(reports)) {
            *report = uav.repeat(slot, reported);
            report.time_s = slot as f64 * self.slot_s;
            uav.share_time(report);
        }
    }
}

/// The point of the way from `from` to `to` that is nearest to `at`, seen from above.
fn nearest_between(from: &Point3<f64>, to: &Point3<f64>, at: &Point3<f64>) -> Point3<f64> {
    let way = (to - from).xy();
    let rest = (at - from).xy();
    let part = if way.norm_squared() > 0.0 { way.dot(&rest) / way.norm_squared() } else { 0.0 };
    interpolate(*from, *to, part.clamp(0.0, 1.0))
}

/// Takes the links out of `report` to sensor nodes that a flight of `lower` serves.
fn leave_to(lower: &[FlightReport], report: &mut FlightReport) {
    let is_contended = |link: &LinkReport| lower.iter().any(|other| other.serves(link.sensor));
    let mut kept = 0;
    for index in 0..report.served_links().len() {
        let link = report.links[index];
        if !is_contended(&link) {
            report.links[kept] = link;
            kept += 1;
        }
    }
    let contended = report.served_links().len() - kept;
    report.links[kept..kept + contended].fill(LinkReport::default());
    report.served -= contended as u32; // at most MAX_SERVED
    report.refused += contended as u32;
    if report.served == 0 && report.mode == Mode::Serve as u32 {
        report.mode = Mode::Fly as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orders::ReportedFlight;
    use proptest::prelude::*;
    use skysink_common::channel::carried_bits;
    use skysink_common::checkpoint::Checkpoint as _;
    use skysink_common::scenario::Overrides;

    fn fleet(keys: &str) -> Fleet {
        let text =
            format!("name = 'x'\nslots = 100\nslot_s = 2.0\n[uav]\ncount = 2\nstarts_m = [[50, 50], [60, 50]]\n{keys}");
        Fleet::new(&Scenario::parse(&text, std::path::Path::new("x.toml"), Overrides::default()).unwrap(), &[])
    }

    #[test]
    fn sensor_nodes_share_the_time_of_a_slot_and_new_contacts_are_set_up() {
        let text = "name = 'x'\nslots = 9\n[link]\ncomm_s = 0.6\nsetup_s = 0.1\nsharing = 'equal'\n";
        let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        let sensor = |x_m: f64| SensorNode { x_m, y_m: 50.0, gain: 1e-5, ..SensorNode::default() };
        let mut fleet = Fleet::new(&scenario, &[49.0, 50.0, 51.0].map(sensor));
        let mut reports = fleet.start();
        // By hand: new contacts have 0.5 s, others 0.6 s, each divided among those that are served.
        let slots: [(&[u32], &[f64]); 5] =
            [(&[0], &[0.5]), (&[0, 1], &[0.3, 0.25]), (&[0, 1, 2], &[0.2, 0.2, 0.5 / 3.0]), (&[], &[]), (&[2], &[0.5])];
        for (slot, (ids, times_s)) in (1..).zip(slots) {
            let mut restarted = fleet.clone();
            restarted.restore(&reports);
            let mut plan = Plan::fly_to([50.0, 50.0, 20.0], Mode::Serve);
            plan.schedule(ids);
            for fleet in [&mut fleet, &mut restarted] {
                fleet.step(slot, |_| Some(&plan), &mut reports);
                let links = reports[0].served_links();
                let found: Vec<u64> = links.iter().map(|link| link.capacity_bits).collect();
                let expected = |(link, time_s): (&LinkReport, &f64)| carried_bits(link.rate_bps, *time_s);
                assert_eq!(found, links.iter().zip(times_s).map(expected).collect::<Vec<_>>(), "slot {slot}");
                assert_eq!(found.len(), ids.len());
            }
        }
    }

    #[test]
    fn a_repeated_slot_has_the_time_of_the_slot() {
        let mut fleet = fleet("");
        let flown = ReportedFlight {
            position: [55.0, 50.0, 20.0].into(),
            mode: Mode::Fly,
            served: Vec::new(),
            refused: 0,
            energy_j: f64::INFINITY,
        };
        let mut reports = fleet.start();
        let orders = Orders::Reports(reports.iter().map(|_| flown.clone()).collect());
        fleet.fly(3, &orders, &mut reports);
        assert!(reports.iter().all(|report| report.time_s == 6.0 && report.x_m == 55.0), "{reports:?}");
    }

    #[test]
    fn each_uav_has_its_own_position_errors() {
        let mut fleet = fleet("position_error_m = 1.0\n");
        let plan = Plan::fly_to([55.0, 50.0, 20.0], Mode::Fly);
        let mut reports = fleet.start();
        fleet.step(1, |_| Some(&plan), &mut reports);
        assert_ne!(reports[0].position(), reports[1].position());
    }

    #[test]
    fn after_its_own_endurance_a_uav_refuses_every_plan_but_charging() {
        let mut fleet = fleet("must_land = true\nendurances_s = [2.0, 4.0]\n[base]\nposition_m = [10, 10]\n");
        let refused = |fleet: &mut Fleet, mode| {
            let plan = Plan::fly_to([50.0, 50.0, 20.0], mode);
            let mut reports = fleet.start();
            fleet.step(2, |_| Some(&plan), &mut reports);
            reports[0].refused
        };
        assert_eq!([Mode::Fly, Mode::Charge].map(|mode| refused(&mut fleet, mode)), [1, 0]);
    }

    /// The energy [J] and the refusals of two UAVs at one site after each slot of 2 s, flown by these modes, `h` a
    /// hover and `c` to charge. Restarted after each slot, the fleet flies the same.
    fn at_one_site(charger: &str, modes: &[&str]) -> Vec<[(f64, u32); 2]> {
        let keys = format!(
            "[uav.battery]\ncapacity_j = 1000.0\ninitial = 0.5\n[[base.site]]\nposition_m = [55, 50]\nradius_m = 20.0\n\
             {charger}\n[[base.site]]\nposition_m = [5, 5]\ncharge_w = 9.0\n"
        );
        let mut fleet = fleet(&keys);
        let mut reports = fleet.start();
        let flown = |(slot, modes): (usize, &&str)| {
            let of = |(mode, x_m): (char, f64)| {
                let mode = if mode == 'c' { Mode::Charge } else { Mode::Fly };
                Plan::fly_to([x_m, 50.0, 20.0], mode)
            };
            let plans: Vec<Plan> = modes.chars().zip([50.0, 60.0]).map(of).collect();
            let mut restarted = fleet.clone();
            let mut saved = Vec::new();
            reports.save(&mut saved);
            let mut again = fleet.start();
            again.restore(&saved).unwrap();
            restarted.restore(&again);
            fleet.step(slot as u64 + 1, |uav| Some(&plans[uav]), &mut reports);
            restarted.step(slot as u64 + 1, |uav| Some(&plans[uav]), &mut again);
            assert_eq!(reports, again, "slot {}", slot + 1);
            [0, 1].map(|uav| {
                let FlightReport { energy_j, refused, hold, .. } = reports[uav];
                assert_eq!(hold == HoldReason::Pad as u32, refused == 1);
                (energy_j, refused)
            })
        };
        modes.iter().enumerate().map(flown).collect()
    }

    #[test]
    fn the_uav_of_the_lower_number_has_the_pad_until_it_is_full() {
        // 100 W for 2 s are 200 J: the first is full after three slots, and then needs no pad.
        let flown = at_one_site("charge_w = 100.0\npads = 1", &["cc"; 7]);
        let wait = |energy_j| [(energy_j, 0), (500.0, 1)];
        let charges = |energy_j| [(1_000.0, 0), (energy_j, 0)];
        let expected =
            [700.0, 900.0, 1_000.0].map(wait).into_iter().chain([700.0, 900.0, 1_000.0, 1_000.0].map(charges));
        assert_eq!(flown, expected.collect::<Vec<_>>());
        let both = at_one_site("charge_w = 100.0\npads = 2", &["cc"; 2]);
        assert_eq!(both, [[(700.0, 0); 2], [(900.0, 0); 2]]);
        // While the first hovers beside it, the second has the pad.
        assert_eq!(at_one_site("charge_w = 100.0\npads = 1", &["hc", "cc"])[1][1], (700.0, 1));
    }

    #[test]
    fn a_battery_is_swapped_in_one_stay_of_whole_slots() {
        // 5 s are three slots of 2 s; the second UAV begins its own after them.
        let flown = at_one_site("swap_s = 5.0\npads = 1", &["cc"; 6]);
        let energy_j = |uav: usize| flown.iter().map(move |slot| slot[uav].0).collect::<Vec<_>>();
        assert_eq!(energy_j(0), [500.0, 500.0, 1_000.0, 1_000.0, 1_000.0, 1_000.0]);
        assert_eq!(energy_j(1), [500.0, 500.0, 500.0, 500.0, 500.0, 1_000.0]);
        assert_eq!(flown.iter().map(|slot| slot[1].1).collect::<Vec<_>>(), [1, 1, 1, 0, 0, 0]);
        // A hover of 2 · 168.49 J ends the first stay.
        let flown = at_one_site("swap_s = 5.0", &["cc", "cc", "hc", "cc", "cc", "cc"]);
        let hovered_j = 500.0 - 336.98;
        for (slot, expected_j) in [500.0, 500.0, hovered_j, hovered_j, hovered_j, 1_000.0].into_iter().enumerate() {
            assert!((flown[slot][0].0 - expected_j).abs() < 1e-9, "slot {}: {flown:?}", slot + 1);
        }
        assert_eq!(flown[2][1], (1_000.0, 0));
    }

    #[test]
    fn a_uav_that_has_begun_a_swap_keeps_the_pad() {
        // A swap is three slots. The second UAV begins it while the first hovers; the first comes in slot 2, waits for
        // slots 2 and 3, and has the pad in slots 4 to 6.
        let flown = at_one_site("swap_s = 5.0\npads = 1", &["hc", "cc", "cc", "cc", "cc", "cc"]);
        assert_eq!(flown.iter().map(|slot| slot[0].1).collect::<Vec<_>>(), [0, 1, 1, 0, 0, 0]);
        let hovered_j = 500.0 - 336.98;
        for (slot, expected_j) in
            [hovered_j, hovered_j, hovered_j, hovered_j, hovered_j, 1_000.0].into_iter().enumerate()
        {
            assert!((flown[slot][0].0 - expected_j).abs() < 1e-9, "slot {}: {flown:?}", slot + 1);
        }
        let second: Vec<(f64, u32)> = flown.iter().map(|slot| slot[1]).collect();
        assert_eq!(second, [500.0, 500.0, 1_000.0, 1_000.0, 1_000.0, 1_000.0].map(|energy_j| (energy_j, 0)));
        // Who leaves the pad in the middle of a swap has no claim to it.
        let flown = at_one_site("swap_s = 5.0\npads = 1", &["hc", "ch", "cc", "cc"]);
        assert_eq!(flown.iter().map(|slot| slot[1].1).collect::<Vec<_>>(), [0, 0, 1, 1]);
        // A charge is not a swap: the lower number has the pad as soon as it comes.
        let flown = at_one_site("charge_w = 100.0\npads = 1", &["hc", "cc"]);
        assert_eq!(flown[1].map(|(_, refused)| refused), [0, 1]);
    }

    #[test]
    fn a_uav_that_does_not_follow_its_plan_is_kept_clear_of_where_it_is() {
        let text = "name = 'x'\n[uav]\ncount = 2\nmax_speed_mps = 30.0\nseparation_m = 15.0\nstarts_m = [[50, 50], [50, 70]]\n";
        let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        let plan = |y_m: f64| Plan::fly_to([50.0, y_m, 20.0], Mode::Fly);
        let fleet = Fleet::new(&scenario, &[]);
        let refusals = |plans: [f64; 2], holds: usize| {
            let refusals = fleet.refusals(&plans.map(plan), |uav| uav != holds, |_| None);
            refusals.iter().map(|&refusal| refusal == HoldReason::Separation).collect::<Vec<_>>()
        };
        // The second is planned to go away, and stays; the first, the same.
        assert_eq!((refusals([60.0, 90.0], 9), refusals([60.0, 90.0], 1)), (vec![false, false], vec![true, false]));
        assert_eq!((refusals([30.0, 60.0], 9), refusals([30.0, 60.0], 0)), (vec![false, false], vec![false, true]));
    }

    #[test]
    fn a_uav_that_does_not_follow_its_plan_is_kept_clear_of_its_way_to_where_it_was_sent() {
        let text =
            "name = 'x'\n[uav]\ncount = 2\nseparation_m = 6.0\nmax_speed_mps = 40.0\nstarts_m = [[70, 62], [60, 50]]\n";
        let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        let fleet = Fleet::new(&scenario, &[]);
        let is_refused = |x_m: f64, y_m: f64, target: Option<[f64; 3]>| {
            let plans = [[x_m, y_m], [90.0, 90.0]].map(|[x_m, y_m]| Plan::fly_to([x_m, y_m, 20.0], Mode::Fly));
            let target = |uav| target.filter(|_| uav == 1).map(Point3::from);
            fleet.refusals(&plans, |uav| uav == 0, target)[0] == HoldReason::Separation
        };
        let sent = Some([74.0, 50.0, 20.0]);
        assert_eq!([74.0, 67.0, 60.0, 79.0].map(|x_m| is_refused(x_m, 51.0, sent)), [true; 4]);
        assert_eq!([81.0, 53.0].map(|x_m| is_refused(x_m, 51.0, sent)), [false; 2], "beyond either end");
        assert_eq!([(67.0, 57.0, sent), (67.0, 51.0, None)].map(|(x_m, y_m, to)| is_refused(x_m, y_m, to)), [false; 2]);
    }

    proptest! {
        #[test]
        fn refusals_before_the_flight_match_those_in_flight(
            waypoints in prop::collection::vec((-5.0..105.0f64, -5.0..105.0f64, any::<bool>()), 3),
        ) {
            let text = "name = 'x'\n[area]\nno_fly = [{ polygon_m = [[60.0, 45.0], [70.0, 45.0], [70.0, 55.0], [60.0, 55.0]] }]\n\
                        [uav]\ncount = 3\nseparation_m = 15.0\nstarts_m = [[50, 50], [50, 70], [50, 30]]\n";
            let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
            let plan = |&(x_m, y_m, charges): &(f64, f64, bool)| {
                Plan::fly_to([x_m, y_m, 20.0], if charges { Mode::Charge } else { Mode::Fly })
            };
            let plans: Vec<Plan> = waypoints.iter().map(plan).collect();
            let mut fleet = Fleet::new(&scenario, &[]);
            let refusals: Vec<u32> = fleet.refusals(&plans, |_| true, |_| None).iter().map(|&refusal| refusal as u32).collect();
            let mut reports = fleet.start();
            fleet.step(1, |uav| Some(&plans[uav]), &mut reports);
            let holds: Vec<u32> = reports.iter().map(|report| report.hold).collect();
            prop_assert_eq!(refusals, holds);
        }
    }
}
