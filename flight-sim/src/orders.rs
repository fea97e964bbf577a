//! What the UAVs are to do in a slot: plans that they fly, or flights that another flight-sim has reported.

use nalgebra::Point3;
use skysink_common::message::{Mode, Plan, SolverOutcome};
use skysink_common::slot_record::{ByUav, Plans};

/// What the UAVs are to do in a slot.
#[expect(clippy::large_enum_variant, reason = "the plan of a single UAV is not allocated in every slot")]
#[derive(Debug, Clone, PartialEq)]
pub enum Orders {
    /// The plan of each UAV; one without a plan holds its position.
    Plans(Plans),
    /// The flight of each UAV as another flight-sim has reported it, which is repeated.
    Reports(ByUav<ReportedFlight>),
}

impl From<Plans> for Orders {
    fn from(plans: Plans) -> Self {
        Self::Plans(plans)
    }
}

impl Orders {
    /// The plans, or those that lead to the reported flights.
    #[must_use]
    pub fn plans(&self) -> Plans {
        match self {
            Self::Plans(plans) => plans.clone(),
            Self::Reports(flights) => flights.iter().map(|flight| Some(flight.plan())).collect(),
        }
    }
}

/// A slot of a UAV as another flight-sim has reported it.
#[derive(Debug, Clone, PartialEq)]
pub struct ReportedFlight {
    /// Where it ended [m].
    pub position: Point3<f64>,
    /// What was flown.
    pub mode: Mode,
    /// The served sensor nodes, ascending.
    pub served: Vec<u32>,
    /// Requests that were refused.
    pub refused: u32,
    /// Energy in the battery after the slot [J]; infinite without one.
    pub energy_j: f64,
}

impl ReportedFlight {
    /// The plan that leads there, with as many refused requests.
    #[must_use]
    pub fn plan(&self) -> Plan {
        let solver = SolverOutcome::Recorded as u32;
        let mut plan = Plan { solver, ..Plan::fly_to(self.position, self.mode) };
        plan.schedule(&self.served[..self.served.len().min(plan.ids.len())]);
        plan.served = plan.served.saturating_add(self.refused); // the ids after the schedule are `NOBODY`
        plan
    }
}
