//! The planner of a scenario, whose `[planner]` is checked, with the strategy of that name or another.

use std::borrow::Cow;
use std::sync::Arc;

use skysink_common::belief::Belief;
use skysink_common::error::InputError;
use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;
use skysink_common::stop::Stop;

use crate::mission_table::MissionTable;
use crate::planner::Planner;
use crate::settings;
use crate::strategy::{MakeStrategy, Registered, Setup, Team};

/// The scenario whose range is smaller by `uav.waypoint_margin_m`: waypoints keep that distance from `d_c`.
fn with_waypoint_margin(scenario: &Scenario) -> Cow<'_, Scenario> {
    let Some(margin_m) = scenario.uav.waypoint_margin_m else { return Cow::Borrowed(scenario) };
    let mut within = scenario.clone();
    within.link.comm_radius_m -= margin_m;
    Cow::Owned(within)
}

impl Planner {
    /// The planner of a scenario with the sensor nodes `sensors`, SN i at entry i.
    ///
    /// # Errors
    /// If `[planner]` of the scenario is refused; never for one that [`settings::resolve`] returned.
    pub fn new(scenario: &Scenario, sensors: &[SensorNode]) -> Result<Self, InputError> {
        let make = Registered::of(scenario)?.make;
        Self::by(scenario, sensors, &mut |setup| Ok(make(setup)), &Stop::default())
    }

    /// The planner with the strategy that `make` makes instead of the scenario's. `stop` ends long preparations and
    /// searches; a plan made after the request must not be flown.
    ///
    /// # Errors
    /// As [`Planner::new`], and those of `make`.
    pub fn by(
        scenario: &Scenario,
        sensors: &[SensorNode],
        make: &mut MakeStrategy<'_>,
        stop: &Stop,
    ) -> Result<Self, InputError> {
        Self::over(scenario, Arc::new(Sensors::of(scenario, sensors)), make, None, stop)
    }

    /// The same for a UAV of a team, with these sensor nodes, whatever the cells of their grid.
    ///
    /// # Errors
    /// As [`Planner::by`].
    pub fn over(
        scenario: &Scenario,
        sensors: Arc<Sensors>,
        make: &mut MakeStrategy<'_>,
        team: Option<Team<'_>>,
        stop: &Stop,
    ) -> Result<Self, InputError> {
        let scenario = &*with_waypoint_margin(scenario);
        let settings = settings::check(scenario)?;
        let belief = Belief::new(scenario, &sensors, settings.estimated());
        let table = MissionTable::new(scenario, belief.known_sensors(sensors));
        let setup = Setup { scenario, settings: &settings, table: &table, belief: &belief, team, stop };
        let strategy = make(&setup)?;
        Ok(Self::with(&setup, strategy))
    }
}
