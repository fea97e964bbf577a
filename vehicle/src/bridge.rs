//! The vehicles of a fleet in the place of flight-sim: plans in, orders out, reports of where the vehicles really are.
//!
//! No clock, no iceoryx2 and no MAVLink: those are left to [`crate::node`] and [`crate::link`].

use nalgebra::Point3;
use skysink_common::battery::Battery;
use skysink_common::message::{FlightReport, HeardLink, HoldReason, Mode, Plan, SensorNode};
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::ByUav;
use skysink_flight_sim::Fleet;
use skysink_flight_sim::outside::{REACHED_M, mode_at_end};

use crate::autopilot::NamedModes;
use crate::control::VehicleControl;
use crate::frame::AreaFrame;
use crate::preflight::{Assignment, PreflightRefusal};
use crate::saved::SavedVehicle;
use crate::table::State;
use crate::telemetry::{Order, Telemetry};

/// Energy that a battery has to have before take-off in a scenario without one, as a fraction of its capacity.
const DEFAULT_BATTERY: f64 = 0.3;

/// Energy below which a vehicle returns in a scenario without a battery, as a fraction of its capacity.
const DEFAULT_LOW_BATTERY: f64 = 0.15;

/// Time without a plan after which the vehicles return [s], and in slots: the longer of the two. It is measured by
/// clock, as a run that stands still ends no slots.
const PATIENCE_S: f64 = 30.0;
const PATIENCE_SLOTS: f64 = 3.0;

/// Time that vehicles at their starts wait for others before they return [s]: a climb may take as long.
const COMPANY_S: f64 = 150.0;

/// How a bridge begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beginning {
    /// As the first of a run; of one that is resumed, with what that has saved.
    First,
    /// After the end of the bridge before, in this run; the mission has begun if `in_mission`.
    Restarted {
        /// Whether slots were flown.
        in_mission: bool,
    },
}

/// The side of the bridge on the link to a vehicle.
#[derive(Debug, Clone, Default)]
pub struct OwnSide {
    /// Its system.
    pub system: u8,
    /// The modes of the vehicle that its address names.
    pub modes: NamedModes,
}

/// A refusal to take off, or a mission that was over before it began, with the number of the vehicle, from 1.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VehicleRefusal {
    /// The number of the vehicle.
    pub number: usize,
    /// Why.
    pub why: PreflightRefusal,
}

/// The distances to the waypoints at the ends of slots.
#[derive(Debug, Clone, Copy, Default)]
pub struct SlotEnds {
    /// Slots that were flown to a waypoint, with a position that was believed all the time.
    pub flown: u64,
    /// Those that have ended within [`REACHED_M`] of it.
    pub reached: u64,
    /// The greatest distance [m].
    pub farthest_m: f64,
    /// Further slots with a waypoint, in which the position was not known or not believed at some time.
    pub doubtful: u64,
}

impl SlotEnds {
    /// What is said of them when the mission has ended.
    pub fn said(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if self.doubtful > 0 {
            lines.push(format!(
                "in {} slots with a waypoint the position was not known or not believed: they are not counted as flown",
                self.doubtful
            ));
        }
        if self.flown + self.doubtful == 0 {
            lines.push("no slot was flown to a waypoint".to_owned());
        } else if self.flown > 0 {
            let percent = 100.0 * self.reached as f64 / self.flown as f64;
            lines.push(format!(
                "{percent:.1} % of {} slots ended within {REACHED_M} m of the waypoint, the farthest {:.1} m from it",
                self.flown, self.farthest_m
            ));
        }
        lines
    }
}

/// A vehicle with the order of the slot.
struct Member {
    control: VehicleControl,
    /// The altitude of its waypoints [m]; `None` if they have their own.
    altitude_m: Option<f64>,
    /// Energy of its full battery [J]; `None` without one.
    capacity_j: Option<f64>,
    /// Whether it has hovered at its start, or was in its mission before.
    has_begun: bool,
    /// The plan that it follows; `None` if there is none.
    plan: Option<Plan>,
    /// Why it does not.
    refusal: HoldReason,
    /// The time since boot [s] at the start of slot 1.
    begin_s: Option<f64>,
    /// Whether its position was not known or not believed at some time of the slot.
    is_doubtful: bool,
}

/// How long the vehicles wait for a plan, by clock.
#[derive(Debug, Clone, Copy)]
struct Patience {
    /// When the last plan has come, or the vehicles were ready for one [s].
    planned_s: Option<f64>,
    /// How long the bridge was suspended since then [s].
    suspended_s: f64,
    /// Time without a plan after which the vehicles return [s].
    plan_s: f64,
    /// The same for the next plan: longer before the first.
    next_s: f64,
}

/// The vehicles of a fleet.
pub struct Bridge {
    fleet: Fleet,
    members: Vec<Member>,
    slot_s: f64,
    /// When the first vehicle was ready, and others were not [s].
    waiting_s: Option<f64>,
    patience: Patience,
    /// What the vehicles have achieved.
    pub ends: SlotEnds,
}

/// The state in which the control of a vehicle begins: `saved` is that of the bridge before, `mode` what the vehicle's
/// last report says.
fn begun(saved: Option<State>, beginning: Beginning, mode: Mode) -> State {
    match (saved, beginning) {
        (None, _) if mode == Mode::Down => State::Done, // of a run on another host
        (None, _) if mode == Mode::Return => State::Silent, // a pilot's mode will show
        (None, _) => State::Check { may_fly_on: false },
        (Some(state), Beginning::First) => state.resumed(),
        (Some(state), Beginning::Restarted { .. }) => state.restarted(),
    }
}

impl Bridge {
    /// The vehicles of `scenario` at `frame`, over the published sensor nodes. They begin where `reports` say: at the
    /// starts, or where a run that is resumed has left them, in the states that were `saved`, if any were. `own` are
    /// the sides of the bridge on their links.
    #[must_use]
    pub fn new(
        scenario: &Scenario,
        sensors: &[SensorNode],
        frame: AreaFrame,
        reports: &[FlightReport],
        beginning: Beginning,
        saved: &[SavedVehicle],
        own: &[OwnSide],
    ) -> Self {
        let mut fleet = Fleet::new(scenario, sensors);
        fleet.restore(reports);
        let member = |(uav, report): (usize, &FlightReport)| {
            let keys = scenario.uav_of(uav);
            let battery = Battery::finite(&scenario.of_uav(uav));
            let altitude_m = keys.fixed_altitude_m();
            // Where the vehicle stood, it climbs.
            let in_range_m =
                |z_m: f64| keys.climb().map_or(z_m, |climb| z_m.clamp(climb.min_altitude_m, climb.max_altitude_m));
            let position = report.position();
            let assignment = Assignment {
                frame,
                start: Point3::new(position.x, position.y, altitude_m.unwrap_or_else(|| in_range_m(position.z))),
                speed_mps: keys.max_speed_mps,
                battery: battery.map_or(DEFAULT_BATTERY, |battery| battery.initial_j / battery.capacity_j),
                low_battery: battery.map_or(DEFAULT_LOW_BATTERY, |battery| battery.reserve_j / battery.capacity_j),
                own_system: own[uav].system,
                modes: own[uav].modes.clone(),
            };
            let before = saved.get(uav);
            let state = begun(before.map(|before| before.state), beginning, report.flown_mode());
            let mut control = VehicleControl::new(assignment, state, before);
            control.say_restored(before.map_or(state, |before| before.state));
            let was_over = beginning == Beginning::First && control.is_committed();
            let has_begun = was_over || beginning == Beginning::Restarted { in_mission: true };
            Member {
                control,
                altitude_m,
                capacity_j: battery.map(|battery| battery.capacity_j),
                has_begun,
                plan: None,
                refusal: HoldReason::NoPlan,
                begin_s: None,
                is_doubtful: false,
            }
        };
        let plan_s = PATIENCE_S.max(PATIENCE_SLOTS * scenario.slot_s);
        Self {
            members: reports.iter().enumerate().map(member).collect(),
            fleet,
            slot_s: scenario.slot_s,
            waiting_s: None,
            patience: Patience { planned_s: None, suspended_s: 0.0, plan_s, next_s: plan_s },
            ends: SlotEnds::default(),
        }
    }

    /// Takes in a message of the vehicle of a UAV, by its number from 0.
    pub fn hear(&mut self, uav: usize, telemetry: &Telemetry, now_s: f64) {
        self.members[uav].control.hear(telemetry, now_s);
    }

    /// Advances to `now_s` [s]; calls `send` with the orders that are due, and `say` with lines for people.
    ///
    /// # Errors
    /// If a vehicle must not take off and no other flies, or others wait for it in vain. All are advanced all the same.
    pub fn poll(
        &mut self,
        now_s: f64,
        mut send: impl FnMut(usize, &Order),
        mut say: impl FnMut(usize, String),
    ) -> Result<(), VehicleRefusal> {
        let mut refused = self.check_patience(now_s).err();
        let are_all_checked = self.members.iter().all(|member| member.control.is_checked());
        let mut orders = Vec::new();
        let keeps_flying = |member: &Member| member.has_begun || member.control.is_flown_by_anybody();
        let is_another_flown = self.members.iter().any(keeps_flying);
        for (uav, Member { control, has_begun, is_doubtful, .. }) in self.members.iter_mut().enumerate() {
            let why = control.poll(now_s, are_all_checked, &mut orders);
            let is_refused_alone = why.filter(|_| !is_another_flown);
            refused = refused.or(is_refused_alone.map(|why| VehicleRefusal { number: uav + 1, why }));
            *has_begun |= control.state() == State::Fly { has_begun: true };
            *is_doubtful |= !control.has_current_position(now_s);
            orders.drain(..).for_each(|order| send(uav, &order));
            control.take_said().into_iter().for_each(|line| say(uav, line));
        }
        refused.map_or(Ok(()), Err)
    }

    /// Notes that the command to arm the vehicle of this number from 0 was not sent, because of `why`. Returns the
    /// lines for people.
    pub fn forget_arming(&mut self, uav: usize, why: &str) -> Vec<String> {
        let control = &mut self.members[uav].control;
        control.forget_arming(why);
        control.take_said()
    }

    /// Flies without the vehicle of this number from 0, because of `why`.
    ///
    /// # Errors
    /// If no other one has been armed, nor ended its mission.
    pub fn refuse(&mut self, uav: usize, why: String) -> Result<(), VehicleRefusal> {
        let mut others = self.members.iter().enumerate().filter(|(other, _)| *other != uav);
        if !others.any(|(_, other)| other.control.is_committed()) {
            return Err(VehicleRefusal { number: uav + 1, why: PreflightRefusal(why) });
        }
        self.members[uav].control.refuse(&why);
        Ok(())
    }

    /// Whether the slots can begin: all vehicles have hovered at their starts, or will not, but one has.
    pub fn has_begun(&self) -> bool {
        self.members.iter().any(|member| member.has_begun) && !self.members.iter().any(Member::is_awaited)
    }

    /// Number of vehicles.
    pub fn uavs(&self) -> usize {
        self.members.len()
    }

    /// The bridge's side of the vehicle of a UAV, by its number from 0.
    pub fn control(&self, uav: usize) -> &VehicleControl {
        &self.members[uav].control
    }

    /// Checks that there is a vehicle to fly.
    ///
    /// # Errors
    /// If all are on the ground again, and none has begun its mission.
    pub fn check_flyable(&self) -> Result<(), VehicleRefusal> {
        let is_over = |member: &Member| !member.has_begun && member.control.state() == State::Done;
        match self.members.first().filter(|_| self.members.iter().all(is_over)) {
            Some(first) => {
                let end = first.control.end();
                let why = PreflightRefusal(format!("its mission was over before it began: {end}: no slot was flown"));
                Err(VehicleRefusal { number: 1, why })
            }
            None => Ok(()),
        }
    }

    /// Notes that the bridge was suspended for `suspended_s` [s].
    pub fn note_suspension(&mut self, suspended_s: f64) {
        self.patience.suspended_s += suspended_s;
    }

    /// Believes nothing of the vehicles that was heard before `now_s` [s].
    pub fn doubt(&mut self, now_s: f64) {
        self.members.iter_mut().for_each(|member| member.control.doubt(now_s));
    }

    /// Waits at least `seconds` [s] for the first plan before the vehicles return.
    pub fn wait_at_first(&mut self, seconds: f64) {
        self.patience.next_s = self.patience.next_s.max(seconds);
    }

    /// The numbers of the vehicles that others fly, from 1.
    pub fn overridden(&self) -> impl Iterator<Item = usize> {
        let numbered = (1..).zip(&self.members);
        numbered.filter(|(_, member)| member.control.state() == State::HandsOff).map(|(number, _)| number)
    }

    /// Sends the vehicles home if there has been no plan for too long.
    ///
    /// # Errors
    /// If a vehicle waits at its start for another for too long.
    fn check_patience(&mut self, now_s: f64) -> Result<(), VehicleRefusal> {
        let flies_on =
            |control: &VehicleControl| matches!(control.state(), State::Fly { .. }) && control.end().is_empty();
        let hovers = |member: &Member| member.has_begun && flies_on(&member.control);
        if !self.has_begun() && self.members.iter().any(hovers) {
            let waiting_s = *self.waiting_s.get_or_insert(now_s);
            let mut awaited = (1..).zip(&self.members).filter(|(_, member)| member.is_awaited());
            if let Some((number, _)) = awaited.next().filter(|_| now_s - waiting_s > COMPANY_S) {
                let why = format!("it is not ready {COMPANY_S} s after another: no slot is flown");
                return Err(VehicleRefusal { number, why: PreflightRefusal(why) });
            }
        }
        if self.patience.planned_s.is_none() && self.has_begun() {
            self.patience = Patience { planned_s: Some(now_s), suspended_s: 0.0, ..self.patience };
        }
        let Patience { planned_s, suspended_s, next_s, .. } = self.patience;
        if let Some(planned_s) = planned_s.filter(|planned_s| now_s - planned_s > next_s) {
            let cause = if suspended_s > 0.0 {
                format!(": the bridge itself was suspended for {suspended_s:.0} s of them")
            } else {
                String::new()
            };
            self.return_home(&format!("no plan has come for {:.0} s{cause}", now_s - planned_s));
        }
        Ok(())
    }

    /// Whether no vehicle will fly any more: all fly home, as far as they say so, or have landed.
    pub fn is_homebound(&self) -> bool {
        self.members.iter().all(|Member { control, .. }| control.is_homebound())
    }

    /// Whether any vehicle that is not on the ground is heard.
    pub fn is_heard(&self, now_s: f64) -> bool {
        let is_heard = |Member { control, .. }: &Member| control.state() != State::Done && control.is_heard(now_s);
        self.members.iter().any(is_heard)
    }

    /// Whether all vehicles are on the ground.
    pub fn has_landed(&self) -> bool {
        self.members.iter().all(|Member { control, .. }| control.state() == State::Done)
    }

    /// Sends all vehicles home, because of `why`.
    pub fn return_home(&mut self, why: &str) {
        self.members.iter_mut().for_each(|Member { control, .. }| control.return_home(why));
    }

    /// Expects the plan of the next slot: until there is one, the vehicles go on to their last waypoints, and hold
    /// there.
    pub fn await_plan(&mut self) {
        for member in &mut self.members {
            member.plan = None;
            member.refusal = HoldReason::NoPlan;
            member.is_doubtful = false;
        }
    }

    /// Notes that `slot`, from 1, has begun `ago_s` [s] ago, by which the clocks of the vehicles are read.
    pub fn begin(&mut self, slot: u64, ago_s: f64) {
        let before_s = (slot - 1) as f64 * self.slot_s + ago_s;
        for member in &mut self.members {
            let begin_s = member.control.vehicle.fix().map(|fix| fix.boot_s - before_s);
            member.begin_s = member.begin_s.or(begin_s);
        }
    }

    /// Flies the plans of the slot, in the order of the UAVs. Those that flight-sim would refuse are not flown, and
    /// nobody charges.
    pub fn fly(&mut self, plans: &[Plan], now_s: f64) {
        let plan_s = self.patience.plan_s;
        self.patience = Patience { planned_s: Some(now_s), suspended_s: 0.0, plan_s, next_s: plan_s };
        let follows = |uav: usize| self.members[uav].control.follows_plans(now_s);
        let target = |uav: usize| self.members[uav].control.target();
        let refusals = self.fleet.refusals(plans, follows, target);
        for ((member, plan), refusal) in self.members.iter_mut().zip(plans).zip(refusals) {
            let plan = Plan { z_m: member.altitude_m.unwrap_or(plan.z_m), ..*plan };
            member.refusal = if plan.mode == Mode::Charge as u32 { HoldReason::Base } else { refusal };
            member.plan = Some(plan);
            if member.refusal == HoldReason::None {
                member.control.fly_to(plan.waypoint(), now_s);
            }
        }
    }

    /// What the vehicles hear of sensor nodes at the end of `slot`, by the channel of the scenario.
    pub fn heard_links(&self, slot: u64, reports: &[FlightReport]) -> Vec<HeardLink> {
        self.fleet.hear(slot, reports)
    }

    /// Ends `slot`: writes where the vehicles are to `reports`, with their links.
    pub fn end(&mut self, slot: u64, reports: &mut [FlightReport], now_s: f64) {
        for (member, report) in self.members.iter().zip(reports.iter_mut()) {
            *report = member.report(report, slot as f64 * self.slot_s, now_s);
            let Some(plan) = member.plan.filter(|_| member.flies_plan()) else { continue };
            if member.is_doubtful || !member.control.has_current_position(now_s) {
                self.ends.doubtful += 1;
            } else {
                let away_m = (report.position() - plan.waypoint()).norm();
                self.ends.flown += 1;
                self.ends.reached += u64::from(away_m <= REACHED_M);
                self.ends.farthest_m = self.ends.farthest_m.max(away_m);
            }
        }
        let members = &self.members;
        self.fleet.observe(slot, |uav| members[uav].plan.as_ref().filter(|_| members[uav].flies_plan()), reports);
    }
}

impl Member {
    /// Whether it has not hovered at its start, but may yet.
    fn is_awaited(&self) -> bool {
        let has_ended =
            matches!(self.control.state(), State::Home { .. } | State::HandsOff | State::Silent | State::Done);
        !has_ended && !self.has_begun
    }

    /// Whether it flies to the waypoint of its plan.
    fn flies_plan(&self) -> bool {
        self.plan.is_some() && self.refusal == HoldReason::None && self.control.takes_waypoints()
    }

    /// What it reports at the end of a slot, at `end_s` of the mission [s] if its clock is not known, without links,
    /// after the report `before`.
    fn report(&self, before: &FlightReport, end_s: f64, now_s: f64) -> FlightReport {
        let Self { control, plan, .. } = self;
        let vehicle = &control.vehicle;
        let position = control.position().unwrap_or_else(|| before.position());
        let mut report = FlightReport::at(position, Mode::Hold);
        if let Some(fix) = vehicle.fix() {
            report.velocity_mps = fix.velocity_mps;
            report.heading_deg = fix.heading_deg;
        }
        report.time_s = vehicle.fix().zip(self.begin_s).map_or(end_s, |(fix, begin_s)| fix.boot_s - begin_s);
        if let Some([horizontal_m, vertical_m]) = vehicle.accuracy_m {
            let [horizontal_m2, vertical_m2] = [horizontal_m.powi(2), vertical_m.powi(2)];
            report.covariance_m2 = [horizontal_m2, 0.0, 0.0, horizontal_m2, 0.0, vertical_m2];
        }
        report.energy_j = self.capacity_j.zip(vehicle.power.left).map_or(f64::INFINITY, |(full_j, left)| full_j * left);
        let mode = match (control.state(), plan) {
            (State::Done, _) => Mode::Down,
            (State::Home { .. } | State::HandsOff | State::Silent, _) => Mode::Return,
            (_, Some(plan)) if self.flies_plan() && control.has_current_position(now_s) => {
                match mode_at_end(plan, &position, REACHED_M) {
                    Mode::Return => Mode::Transit, // it follows plans: the next bridge does not send it home
                    mode => mode,
                }
            }
            _ => Mode::Hold,
        };
        report.mode = mode as u32;
        if mode == Mode::Hold {
            let hold = match self.refusal {
                HoldReason::None if control.has_refused() => HoldReason::Waypoint,
                HoldReason::None => HoldReason::Unknown,
                refusal => refusal,
            };
            report.refused = u32::from(!matches!(hold, HoldReason::Unknown | HoldReason::NoPlan));
            report.hold = hold as u32;
        }
        report
    }
}

/// The reports of slot 0, as [`Fleet::start`] makes them.
#[must_use]
pub fn start(scenario: &Scenario) -> ByUav<FlightReport> {
    Fleet::new(scenario, &[]).start()
}
