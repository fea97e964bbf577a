//! Vehicles in Python in the place of flight-sim: their orders, and the links above them.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};

use pyo3::prelude::*;
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, HoldReason, Mode, Plan, SensorNode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::ByUav;
use skysink_flight_sim::outside::{OutsideFleet, SlotOrder};
use skysink_planner::settings;

use crate::errors::refused;

/// Position [m], waypoint [m], sensor nodes to serve, mode, and whether the plan is late and refused.
type PyOrder = ([f64; 3], [f64; 3], Vec<u32>, String, bool, bool);

/// The vehicles of a ring, in the layout of its messages.
#[pyclass(name = "VehicleCore", module = "skysink", frozen)]
pub struct PyVehicleCore(Mutex<State>);

struct State {
    fleet: OutsideFleet,
    orders: ByUav<SlotOrder>,
}

impl PyVehicleCore {
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().expect("no call panics with it")
    }
}

/// Messages of one layout.
fn messages<T: bytemuck::Pod>(bytes: &[u8]) -> Vec<T> {
    bytemuck::pod_collect_to_vec(bytes)
}

#[pymethods]
impl PyVehicleCore {
    /// The vehicles of the scenario in a file at their starts, over published sensor nodes. A slot that ends farther
    /// than `reached_m` [m] from its waypoint has not reached it.
    #[new]
    fn new(scenario: PathBuf, nodes: &[u8], reached_m: f64) -> PyResult<Self> {
        let scenario = Scenario::read(&scenario, Overrides::default()).and_then(settings::resolve).map_err(refused)?;
        let nodes: Vec<SensorNode> = messages(nodes);
        let place = |node: &SensorNode| [node.x_m, node.y_m];
        let list = SensorList::of(&scenario).map_err(refused)?;
        if !list.nodes().iter().map(place).eq(nodes.iter().map(place)) {
            let expected = "expected the scenario of the run, whose sensor nodes are others";
            return Err(refused(InputError::new("scenario", &scenario.path, expected)));
        }
        let fleet = OutsideFleet::new(&scenario, &nodes, reached_m);
        Ok(Self(Mutex::new(State { fleet, orders: ByUav::new() })))
    }

    /// The reports of slot 0.
    fn start(&self) -> Vec<u8> {
        bytemuck::cast_slice(&self.state().fleet.start()).to_vec()
    }

    /// Moves the vehicles to where they were at the end of a slot that they have reported.
    fn restore(&self, reports: &[u8]) {
        self.state().fleet.restore(&messages::<FlightReport>(reports));
    }

    /// What the vehicles are to do in a slot, by its plans, or None if there are none in time.
    #[pyo3(signature = (slot, plans))]
    fn orders(&self, slot: u64, plans: Option<&[u8]>) -> Vec<PyOrder> {
        let mut state = self.state();
        let plans: Option<Vec<Plan>> = plans.map(messages);
        state.orders = state.fleet.orders(slot, plans.as_deref());
        let order = |order: &SlotOrder| {
            let mode = Mode::from_repr(order.plan.mode).unwrap_or_default();
            let is_late = order.hold == HoldReason::NoPlan;
            let is_refused = !is_late && order.hold != HoldReason::None;
            let [position, waypoint] = [order.position, order.plan.waypoint()].map(Into::into);
            (position, waypoint, order.plan.scheduled().to_vec(), mode.to_string(), is_late, is_refused)
        };
        state.orders.iter().map(order).collect()
    }

    /// The reports of the vehicles that have flown the last orders, with modes and links. Refuses those that cannot be.
    fn complete(&self, slot: u64, reports: &[u8]) -> PyResult<Vec<u8>> {
        let mut state = self.state();
        let mut reports: Vec<FlightReport> = messages(reports);
        let State { fleet, orders } = &mut *state;
        fleet.check(&reports).map_err(refused)?;
        fleet.complete(slot, orders, &mut reports);
        Ok(bytemuck::cast_slice(&reports).to_vec())
    }
}
