//! A planner with arbitrary input, or with an arbitrary checkpoint.

use arbitrary::{Result, Unstructured};
use skysink_common::checkpoint::Checkpoint;
use skysink_common::geometry::{Position, above};
use skysink_common::message::{FlightReport, Mode, PathPoint, Plan, SensorNode};
use skysink_common::possible::are_possible_paths;
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::UAV;
use skysink_common::told::{Received, Sensed, Told};
use skysink_flight_sim::Flight;
use skysink_mission::Mission;
use skysink_planner::{FleetPlanner, Planner};

use crate::messages::report;
use crate::world::{corrupt, file, planned};

/// Slots that are flown before a checkpoint is saved.
const FLOWN_SLOTS: u64 = 6;

/// For any input, the planner schedules known sensor nodes, and the plan is feasible from every position of the UAV.
pub fn message(u: &mut Unstructured) -> Result<()> {
    let (list, scenario) = planned(u)?;
    let foreign = u.arbitrary::<u8>()? % 4;
    let mut nodes = list.nodes();
    for node in nodes.iter_mut().take(foreign.into()) {
        let [x_m, y_m, gain] = u.arbitrary()?;
        *node = SensorNode { x_m, y_m, gain, ..*node };
    }
    let mut planner = Planner::new(&scenario, &nodes).expect("its keys were checked");
    let fixed_m = scenario.uav.altitude_m;
    let altitudes = scenario.uav.climb().map_or(fixed_m..=fixed_m, |climb| climb.min_altitude_m..=climb.max_altitude_m);
    for _ in 0..2 {
        let slot = u.arbitrary()?;
        let [x_m, y_m, altitude_m] = u.arbitrary()?;
        let position = Position::new(x_m, y_m);
        let queues: [u32; 10] = u.arbitrary()?;
        planner.observe(u.arbitrary()?, &report(u, 2)?, &queues);
        let plan = planner.step(slot, above(&position, altitude_m), &queues);
        let ids = plan.scheduled();
        assert!(plan.served as usize == ids.len() && ids.len() <= scenario.link.resource_blocks, "{plan:?}");
        assert!(ids.iter().all(|&id| (id as usize) < nodes.len()) && ids.is_sorted_by(|a, b| a < b), "{plan:?}");
        if foreign == 0 && scenario.area.contains(&position, 0.0) && altitudes.contains(&altitude_m) {
            let here = FlightReport::at(above(&position, altitude_m), Mode::Hold);
            fly(&scenario, &nodes, &here, slot, &plan);
            let path: Vec<_> = planner.path().iter().map(|point| PathPoint::of(UAV, point)).collect();
            assert!(are_possible_paths(&path, &scenario.area, 1), "{path:?} from {here:?}");
        }
    }
    Ok(())
}

/// A planner refuses a corrupted checkpoint and is unchanged, or restores it, and its next plan is feasible.
pub fn checkpoint(u: &mut Unstructured) -> Result<()> {
    let (list, scenario) = planned(u)?;
    let queues: [u32; 10] = u.arbitrary()?;
    let mut mission = Mission::new(&scenario, list).expect("its keys were checked");
    mission.by_ref().take(FLOWN_SLOTS as usize).for_each(drop);
    let here = *mission.plant().flight(UAV);
    let planner = &mut mission.planner;
    let original = saved(planner);
    let path = file("checkpoint", &original);
    corrupt(&path, u)?;
    let checkpoint = std::fs::read(path).expect("the checkpoint is there");
    if planner.restore(&checkpoint).is_err() {
        assert_eq!(saved(planner), original);
        assert_ne!(checkpoint, original, "a checkpoint of its own is refused");
    }
    let told = Told::from(&queues);
    let sensed = Sensed { slot: FLOWN_SLOTS, flights: &[here], told, received: &Received::NOTHING };
    planner.observe(&sensed);
    let plan = planner.step(&sensed)[UAV];
    let report = fly(&scenario, &list.nodes(), &here, FLOWN_SLOTS + 1, &plan);
    let mut again = FleetPlanner::from(Planner::new(&scenario, &list.nodes()).expect("its keys were checked"));
    again.restore(&saved(planner)).expect("what a planner saves is a checkpoint");
    assert_eq!(saved(&again), saved(planner));
    let [plan, same] = [planner, &mut again].map(|planner| {
        let sensed = Sensed { slot: FLOWN_SLOTS + 1, flights: &[report], told, received: &Received::NOTHING };
        planner.observe(&sensed);
        Plan { plan_ns: 0, ..planner.step(&sensed)[UAV] }
    });
    assert_eq!(format!("{plan:?}"), format!("{same:?}"));
    Ok(())
}

fn saved(planner: &impl Checkpoint) -> Vec<u8> {
    let mut bytes = Vec::new();
    planner.save(&mut bytes);
    bytes
}

/// Flies the plan of a slot, which must be feasible from `here`.
fn fly(scenario: &Scenario, nodes: &[SensorNode], here: &FlightReport, slot: u64, plan: &Plan) -> FlightReport {
    let mut flight = Flight::new(scenario, nodes);
    flight.restore(here);
    let report = flight.step(slot, Some(plan));
    assert_eq!((report.hold, report.refused), (0, 0), "{plan:?} from {here:?}");
    report
}
