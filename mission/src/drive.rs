//! Driving a mission: a pilot plans its slots, the plant flies them, and observers take them in.

use nalgebra::Point3;
use skysink_common::message::{PathPoint, Plan, QueuesHeader};
use skysink_common::slot_record::{ByUav, SlotRecord};
use skysink_common::stop::{Stop, Stopped};
use skysink_flight_sim::Orders;
use skysink_planner::FleetPlanner;

use crate::error::MissionError;
use crate::plant::Plant;

/// Plans a mission's slots.
///
/// ```
/// use skysink_common::{message::Mode, message::Plan, scenario::Scenario, sensors::SensorList, slot_record::Plans};
/// use skysink_mission::{Orders, Plant, drive, drive::Ended, drive::Pilot};
/// struct Centre;
/// impl Pilot for Centre {
///     fn orders(&mut self, plant: &Plant) -> Result<Orders, Ended> {
///         let centre = Plan::fly_to([50.0, 50.0, 20.0], Mode::Transit);
///         Ok(plant.flights().iter().map(|_| Some(centre)).collect::<Plans>().into())
///     }
/// }
/// let scenario = Scenario::letter(Default::default()).unwrap();
/// let mut plant = Plant::new(&scenario, &SensorList::of(&scenario).unwrap());
/// drive(&mut plant, &mut Centre, &mut [], &Default::default()).unwrap();
/// assert_eq!(plant.flight(0).position(), [50.0, 50.0, 20.0].into());
/// ```
pub trait Pilot {
    /// The plans of the next slot, one for each UAV, of which `None` holds; or its flights, which were reported.
    ///
    /// # Errors
    /// If it ends the mission here, or fails.
    fn orders(&mut self, plant: &Plant) -> Result<Orders, Ended>;

    /// The path that the last plan of the UAV number `uav` belongs to, with the waypoint of its slot first [m]; empty
    /// for a pilot that plans one slot.
    fn path(&self, _uav: usize) -> &[Point3<f64>] {
        &[]
    }
}

/// Takes in the slots of a mission, in order.
///
/// ```
/// use skysink_common::{scenario::Scenario, sensors::SensorList, slot_record::SlotRecord};
/// use skysink_mission::{Mission, MissionError, Plant, drive::Observer};
/// struct SlotsWithLosses(Vec<u64>);
/// impl Observer for SlotsWithLosses {
///     fn slot(&mut self, record: &SlotRecord, _: &Plant) -> Result<(), MissionError> {
///         self.0.extend((record.header.lost_bits > 0).then_some(record.slot()));
///         Ok(())
///     }
/// }
/// let scenario = Scenario::letter(Default::default()).unwrap();
/// let mut mission = Mission::new(&scenario, &SensorList::of(&scenario).unwrap()).unwrap();
/// let mut losses = SlotsWithLosses(Vec::new());
/// mission.drive(&mut [&mut losses], &Default::default()).unwrap();
/// assert_eq!(losses.0.is_empty(), mission.header().totals.lost_bits == 0);
/// ```
pub trait Observer {
    /// Takes in the plant where the mission begins.
    ///
    /// # Errors
    /// Ends the mission.
    fn begin(&mut self, _plant: &Plant) -> Result<(), MissionError> {
        Ok(())
    }

    /// Takes in the next slot, and the plant after it.
    ///
    /// # Errors
    /// Ends the mission.
    fn slot(&mut self, record: &SlotRecord, plant: &Plant) -> Result<(), MissionError>;
}

/// Takes in the slots of a mission by their records alone, which is all that a ring of processes leaves. Each is also
/// an [`Observer`].
///
/// ```
/// use skysink_common::slot_record::SlotRecord;
/// use skysink_mission::{MissionError, drive::Observer, drive::SlotSink};
/// struct Count(u64);
/// impl SlotSink for Count {
///     fn add(&mut self, _: &SlotRecord) -> Result<(), MissionError> {
///         self.0 += 1;
///         Ok(())
///     }
/// }
/// let _: &dyn Observer = &Count(0);
/// ```
pub trait SlotSink {
    /// Takes in the ledger where the mission begins.
    fn start(&mut self, _header: &QueuesHeader) {}

    /// Adds the next slot.
    ///
    /// # Errors
    /// If the slot is impossible or cannot be written; the sink is then unchanged.
    fn add(&mut self, record: &SlotRecord) -> Result<(), MissionError>;
}

impl<T: SlotSink> Observer for T {
    fn begin(&mut self, plant: &Plant) -> Result<(), MissionError> {
        self.start(&plant.header());
        Ok(())
    }

    fn slot(&mut self, record: &SlotRecord, _plant: &Plant) -> Result<(), MissionError> {
        self.add(record)
    }
}

/// How a mission ended.
///
/// ```
/// use skysink_common::stop::Stopped;
/// use skysink_mission::drive::End;
/// assert_eq!(End::OutOfPlans.unless_stopped(), Ok(()));
/// assert_eq!(End::Stopped(Stopped(2)).unless_stopped(), Err(Stopped(2)));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// All slots are flown.
    Complete,
    /// The pilot has no more plans, as at the end of a trace.
    OutOfPlans,
    /// A stop was requested.
    Stopped(Stopped),
}

impl End {
    /// Fails if the mission was stopped.
    ///
    /// # Errors
    /// [`Stopped`] with the signal.
    pub fn unless_stopped(self) -> Result<(), Stopped> {
        match self {
            Self::Stopped(stopped) => Err(stopped),
            Self::Complete | Self::OutOfPlans => Ok(()),
        }
    }
}

/// Why a slot was not flown.
///
/// ```
/// use skysink_mission::drive::{End, Ended};
/// let stopped = skysink_common::stop::Stopped(15);
/// assert!(matches!(Ended::from(stopped), Ended::At(End::Stopped(_)))); // by `?`
/// ```
#[derive(Debug)]
pub enum Ended {
    /// The mission ends here.
    At(End),
    /// It has failed.
    Failed(MissionError),
}

impl From<MissionError> for Ended {
    fn from(error: MissionError) -> Self {
        Self::Failed(error)
    }
}

impl From<Stopped> for Ended {
    fn from(stopped: Stopped) -> Self {
        Self::At(End::Stopped(stopped))
    }
}

/// Drives a mission from where the plant stands to its end, or until `stop`.
///
/// # Errors
/// If the pilot or an observer fails.
///
/// ```
/// use skysink_common::{scenario::Scenario, sensors::SensorList, stop::Stop};
/// use skysink_mission::{Plant, drive, drive::End};
/// use skysink_planner::FleetPlanner;
/// let scenario = Scenario::letter(Default::default()).unwrap();
/// let list = SensorList::of(&scenario).unwrap();
/// let mut plant = Plant::new(&scenario, &list);
/// let mut planner = FleetPlanner::until(&scenario, &list.nodes(), &Stop::default()).unwrap();
/// assert_eq!(drive(&mut plant, &mut planner, &mut [], &Stop::default()).unwrap(), End::Complete);
/// assert_eq!(plant.slot(), scenario.slots);
/// ```
pub fn drive(
    plant: &mut Plant,
    pilot: &mut dyn Pilot,
    observers: &mut [&mut dyn Observer],
    stop: &Stop,
) -> Result<End, MissionError> {
    for observer in &mut *observers {
        observer.begin(plant)?;
    }
    loop {
        match step(plant, pilot, stop) {
            Ok(()) => {}
            Err(Ended::At(end)) => return Ok(end),
            Err(Ended::Failed(error)) => return Err(error),
        }
        for observer in &mut *observers {
            observer.slot(plant.record(), plant)?;
        }
    }
}

/// Plans and flies the next slot: [`drive`] for callers that look at each slot themselves.
///
/// # Errors
/// If the mission is over, stopped, or fails; the plant is then unchanged.
///
/// ```
/// use skysink_common::{scenario::Scenario, sensors::SensorList};
/// use skysink_mission::{Plant, drive::Planned, drive::step};
/// let scenario = Scenario::letter(Default::default()).unwrap();
/// let mut plant = Plant::new(&scenario, &SensorList::of(&scenario).unwrap());
/// let mut two_holds = Planned([[None].into(), [None].into()].into_iter());
/// while step(&mut plant, &mut two_holds, &Default::default()).is_ok() {}
/// assert_eq!(plant.slot(), 2);
/// ```
pub fn step(plant: &mut Plant, pilot: &mut dyn Pilot, stop: &Stop) -> Result<(), Ended> {
    if plant.is_over() {
        return Err(Ended::At(End::Complete));
    }
    stop.check()?;
    let orders = pilot.orders(plant)?;
    stop.check()?; // a search that was stopped may be incomplete
    plant.fly(&orders);
    for uav in 0..plant.flights().len() {
        plant.add_path(uav, pilot.path(uav).iter().map(|point| PathPoint::of(uav, point)));
    }
    Ok(())
}

/// Plans with the strategy of the scenario or another.
impl Pilot for FleetPlanner {
    fn orders(&mut self, plant: &Plant) -> Result<Orders, Ended> {
        let plans = plan_next(self, plant);
        self.require_finite(plant.slot() + 1, &plans).map_err(MissionError::from)?;
        Ok(Orders::Plans(plans.into_iter().map(Some).collect()))
    }

    fn path(&self, uav: usize) -> &[Point3<f64>] {
        let path = FleetPlanner::path(self, uav);
        if path.len() > 1 { path } else { &[] }
    }
}

/// Observes the last slot, and plans the next one with a planner that has planned all slots before.
#[must_use]
pub fn plan_next(planner: &mut FleetPlanner, plant: &Plant) -> ByUav<Plan> {
    let received = plant.received();
    let sensed = plant.sensed(&received);
    planner.observe(&sensed);
    planner.step(&sensed)
}

/// A pilot whose plans, or orders, are known before, slot by slot.
///
/// ```
/// use skysink_common::{scenario::Scenario, sensors::SensorList};
/// use skysink_mission::{Mission, Plant, drive, drive::Planned};
/// let scenario = Scenario::letter(Default::default()).unwrap();
/// let list = SensorList::of(&scenario).unwrap();
/// let mut mission = Mission::new(&scenario, &list).unwrap();
/// let mut again = Plant::new(&scenario, &list);
/// let mut same = Planned(mission.by_ref().map(|record| record.plans().clone()));
/// drive(&mut again, &mut same, &mut [], &Default::default()).unwrap();
/// assert_eq!(again.header(), mission.header());
/// ```
#[derive(Debug)]
pub struct Planned<I>(pub I);

impl<I: Iterator<Item: Into<Orders>>> Pilot for Planned<I> {
    fn orders(&mut self, _plant: &Plant) -> Result<Orders, Ended> {
        self.0.next().map(Into::into).ok_or(Ended::At(End::OutOfPlans))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::atomic::Ordering;

    use super::*;
    use crate::Mission;
    use proptest::prelude::*;
    use skysink_common::message::{HoldReason, Mode};
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::sensors::SensorList;
    use skysink_common::slot_record::Plans;
    use skysink_common::slot_record::UAV;
    use skysink_planner::settings;

    const SLOTS: u64 = 12;

    fn scenario(strategy: &'static str, seed: u64) -> Scenario {
        let text = format!("name = 'x'\nslots = {SLOTS}\n[sensors]\nsampling_bps = [50.0, 9000.0]\n");
        let overrides = Overrides { strategy: Some(strategy), seed: Some(seed), ..Overrides::default() };
        Scenario::parse(&text, Path::new("x.toml"), overrides).and_then(settings::resolve).unwrap()
    }

    fn world(strategy: &'static str, seed: u64) -> (Plant, FleetPlanner) {
        let scenario = scenario(strategy, seed);
        let list = SensorList::of(&scenario).unwrap();
        (Plant::new(&scenario, &list), FleetPlanner::until(&scenario, &list.nodes(), &Stop::default()).unwrap())
    }

    /// Keeps what it was given: the slot where the mission began, and the records.
    #[derive(Default)]
    struct Kept {
        begun_after: Option<u64>,
        records: Vec<SlotRecord>,
        /// Fails in this slot.
        fails_in: Option<u64>,
    }

    impl Observer for Kept {
        fn begin(&mut self, plant: &Plant) -> Result<(), MissionError> {
            self.begun_after = Some(plant.slot());
            Ok(())
        }

        fn slot(&mut self, record: &SlotRecord, plant: &Plant) -> Result<(), MissionError> {
            assert_eq!((record.slot(), record.header), (plant.slot(), plant.header()));
            if self.fails_in == Some(record.slot()) {
                return Err(MissionError::Stopped(Stopped(99)));
            }
            self.records.push(record.clone());
            Ok(())
        }
    }

    /// Requests a stop after a slot.
    struct StopAfter<'a>(u64, &'a Stop);

    impl SlotSink for StopAfter<'_> {
        fn add(&mut self, record: &SlotRecord) -> Result<(), MissionError> {
            if record.slot() == self.0 {
                self.1.flag().store(15, Ordering::Relaxed);
            }
            Ok(())
        }
    }

    #[test]
    fn every_observer_receives_every_slot_in_order() {
        let (mut plant, mut planner) = world("uts", 1);
        let mut first = Kept::default();
        let mut second = Kept::default();
        let end = drive(&mut plant, &mut planner, &mut [&mut first, &mut second], &Stop::default());
        assert_eq!(end.unwrap(), End::Complete);
        for kept in [&first, &second] {
            assert_eq!(kept.begun_after, Some(0));
            assert!(kept.records.iter().map(SlotRecord::slot).eq(1..=SLOTS));
        }
    }

    #[test]
    fn a_mission_continues_from_the_state_of_the_plant() {
        let (mut plant, mut planner) = world("uts", 1);
        for _ in 0..5 {
            step(&mut plant, &mut planner, &Stop::default()).unwrap();
        }
        let mut kept = Kept::default();
        drive(&mut plant, &mut planner, &mut [&mut kept], &Stop::default()).unwrap();
        assert_eq!((kept.begun_after, kept.records.len() as u64), (Some(5), SLOTS - 5));
        let ended = step(&mut plant, &mut planner, &Stop::default());
        assert!(matches!(ended, Err(Ended::At(End::Complete))));
    }

    #[test]
    fn a_stop_ends_the_mission_between_two_slots() {
        let stop = Stop::default();
        let (mut plant, mut planner) = world("uts", 1);
        let mut kept = Kept::default();
        let end = drive(&mut plant, &mut planner, &mut [&mut StopAfter(4, &stop), &mut kept], &stop).unwrap();
        assert_eq!((end, plant.slot(), kept.records.len()), (End::Stopped(Stopped(15)), 4, 4));
        assert!(end.unless_stopped().is_err() && End::Complete.unless_stopped().is_ok());
    }

    #[test]
    fn a_stop_after_the_last_slot_has_no_effect() {
        let stop = Stop::default();
        let (mut plant, mut planner) = world("uts", 1);
        let end = drive(&mut plant, &mut planner, &mut [&mut StopAfter(SLOTS, &stop)], &stop).unwrap();
        assert_eq!(end, End::Complete);
    }

    #[test]
    fn an_observer_that_fails_ends_the_mission() {
        let (mut plant, mut planner) = world("uts", 1);
        let mut failing = Kept { fails_in: Some(3), ..Kept::default() };
        let mut later = Kept::default();
        let end = drive(&mut plant, &mut planner, &mut [&mut failing, &mut later], &Stop::default());
        assert!(matches!(end, Err(MissionError::Stopped(Stopped(99)))));
        assert_eq!((plant.slot(), later.records.len()), (3, 2));
    }

    #[test]
    fn recorded_plans_end_the_mission_and_a_missing_one_is_a_hold() {
        let (mut plant, _) = world("uts", 1);
        let start = plant.flight(UAV).position();
        let mut kept = Kept::default();
        let mut pilot =
            Planned([None, Some(Plan::fly_to(start, Mode::Serve))].map(|plan| Plans::from_buf([plan])).into_iter());
        let end = drive(&mut plant, &mut pilot, &mut [&mut kept], &Stop::default()).unwrap();
        assert_eq!((end, plant.slot()), (End::OutOfPlans, 2));
        let holds = kept.records.iter().map(|record| record.flights()[UAV].hold);
        assert!(holds.eq([HoldReason::NoPlan as u32, HoldReason::None as u32]));
    }

    #[test]
    fn only_a_strategy_that_looks_ahead_has_a_path() {
        for (strategy, looks_ahead) in [("uts", false), ("horizon", true)] {
            let (mut plant, mut planner) = world(strategy, 1);
            step(&mut plant, &mut planner, &Stop::default()).unwrap();
            let path = plant.record().uavs().next().unwrap().path;
            assert_eq!(path.len() > 1, looks_ahead, "{strategy}");
            assert_eq!(path.is_empty(), !looks_ahead, "{strategy}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20))]

        #[test]
        fn drive_and_single_steps_give_the_same_mission(seed in 1u64..1_000) {
            let scenario = scenario("gfs", seed);
            let list = SensorList::of(&scenario).unwrap();
            let mut kept = Kept::default();
            let mut driven = Mission::new(&scenario, &list).unwrap();
            driven.drive(&mut [&mut kept], &Stop::default()).unwrap();
            let stepped: Vec<SlotRecord> = Mission::new(&scenario, &list).unwrap().collect();
            let headers = |records: &[SlotRecord]| records.iter().map(|record| record.header).collect::<Vec<_>>();
            prop_assert_eq!(headers(&kept.records), headers(&stepped));
            prop_assert!(kept.records.iter().zip(&stepped).all(|(one, other)| one.flights() == other.flights()));
            // The plans of the mission lead to it once more.
            let mut again = Kept::default();
            let mut pilot = Planned(stepped.iter().map(|record| record.plans().clone()));
            drive(&mut Plant::new(&scenario, &list), &mut pilot, &mut [&mut again], &Stop::default()).unwrap();
            prop_assert_eq!(headers(&again.records), headers(&stepped));
        }
    }
}
