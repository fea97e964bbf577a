//! A decision with NaN or infinity is an error of its strategy.

use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_planner::strategy::{Decision, Setup, rule};

/// What ends a mission whose strategy hovers, but wants to fly to `x_m` [m] in `slot`.
fn ended_by(slot: u64, x_m: f64) -> (u64, String) {
    let scenario = Scenario::letter(Overrides::default()).unwrap();
    let list = SensorList::of(&scenario).unwrap();
    let make = &mut |_: &Setup<'_>| {
        Ok(rule(move |view| {
            let mut decision = Decision::stay(view);
            if view.slot == slot {
                decision.waypoint.x = x_m;
            }
            Some(decision)
        }))
    };
    let mut mission = Mission::by(&scenario, &list, make, &Stop::default()).unwrap();
    let error = mission.drive(&mut [], &Stop::default()).map_err(|error| {
        assert_eq!(error.exit_code(), 2);
        error.to_string()
    });
    (mission.slot(), error.err().unwrap_or_default())
}

#[test]
fn the_error_names_the_strategy_the_slot_and_the_waypoint() {
    for (x_m, text) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf"), (f64::NEG_INFINITY, "-inf")] {
        let expected =
            format!("strategy uts: slot 7, UAV 0: waypoint [{text}, 50, 20]: expected finite coordinates [m]");
        assert_eq!(ended_by(7, x_m), (6, expected));
    }
    let (flown, error) = ended_by(7, 1e9); // out of reach: refused, and the mission goes on
    assert_eq!((flown > 7, error.as_str()), (true, ""));
}
