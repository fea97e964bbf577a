//! Decisions with NaN or infinity, which are errors of a strategy.

use skysink_common::error::InputError;
use skysink_common::message::Plan;

use super::FleetPlanner;

impl FleetPlanner {
    /// Refuses the plans of `slot`, one for each UAV, if the waypoint of one has NaN or infinity: no UAV can fly there,
    /// so its strategy has computed something wrong.
    ///
    /// # Errors
    /// With the strategy, the slot, the UAV and the waypoint.
    pub fn require_finite(&self, slot: u64, plans: &[Plan]) -> Result<(), InputError> {
        let is_finite = |plan: &Plan| plan.waypoint().iter().all(|coordinate| coordinate.is_finite());
        let Some(uav) = plans.iter().position(|plan| !is_finite(plan)) else { return Ok(()) };
        let strategy = &self.members[uav].planner.strategy_name;
        let waypoint = plans[uav].waypoint();
        let message = format_args!(
            "slot {slot}, UAV {uav}: waypoint [{}, {}, {}]: expected finite coordinates [m]",
            waypoint.x, waypoint.y, waypoint.z
        );
        Err(InputError::of_argument("strategy", strategy, message))
    }
}
