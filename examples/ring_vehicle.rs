//! A vehicle of your own in the place of flight-sim: it flies at most 12 m/s, so that longer legs end before their
//! waypoint. Start it with `skysink run SCENARIO --vehicle target/debug/examples/ring_vehicle`, or by hand.

use std::process::ExitCode;

use skysink::worker;
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, Mode};
use skysink_flight_sim::outside::{OutsideVehicle, SlotOrder};

/// Farthest flight in a slot of 1 s [m].
const FARTHEST_M: f64 = 12.0;

struct Slow;

impl OutsideVehicle for Slow {
    fn fly(&mut self, order: &SlotOrder) -> Result<FlightReport, InputError> {
        let leg = order.plan.waypoint() - order.position;
        let flown = leg * (FARTHEST_M / leg.norm()).min(1.0); // infinite on the spot
        let mut report = FlightReport::at(order.position + flown, Mode::Serve);
        report.heading_deg = leg.x.atan2(leg.y).to_degrees().rem_euclid(360.0);
        Ok(report)
    }
}

/// Flies until the mission ends.
pub fn main() -> ExitCode {
    worker::fly_by(vec![Box::new(Slow)])
}
