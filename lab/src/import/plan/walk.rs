//! The times of a flight along the legs of a plan.
//!
//! A leg takes the longer of its way at its speed and of its climb or descent. Corners take no time: a vehicle that
//! brakes for them is slower.

use nalgebra::Point3;
use skysink_common::geometry::Position;
use skysink_common::scenario::TimedPoint;

use super::foreign_plan::ForeignPlan;

/// Times are rounded up to 1/PER_SECOND s, so that rounding makes no leg faster.
const PER_SECOND: f64 = 1e6;

/// A leg that ends a slot may be faster by this fraction: exported missions fly legs with speeds that are up to as much
/// slower.
const MAX_FASTER: f64 = 0.01;

/// A place of a flight and its time, after a leg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedPoint {
    /// Time since the start, above home [s], and place; z is the altitude above the ground [m].
    pub point: TimedPoint,
    /// The leg that leads there; `None` at the start.
    pub leg: Option<usize>,
}

impl ForeignPlan {
    /// The flight at ascending times, from above `home` [m] over the end of each leg, `places` [m], and the end of each
    /// hold. Legs of no length and no hold are left out. The legs whose numbers `ends_slot` takes end with a slot of
    /// `slot_s` [s]: they are slower, holds as long.
    pub fn walk(
        &self,
        home: Position,
        places: &[Position],
        slot_s: f64,
        ends_slot: impl Fn(usize) -> bool,
    ) -> Vec<PlannedPoint> {
        let [lowest_m, highest_m] = self.altitudes_m();
        let start_m = self.start_m.clamp(lowest_m, highest_m);
        let mut at = Point3::new(home.x, home.y, start_m);
        let mut time_s = 0.0;
        let mut points = vec![PlannedPoint { point: TimedPoint { time_s, at }, leg: None }];
        for (index, (leg, place)) in self.legs.iter().zip(places).enumerate() {
            let to = Point3::new(place.x, place.y, leg.altitude_m.clamp(lowest_m, highest_m));
            let way = to - at;
            let [climb_mps, descent_mps] = leg.vertical_mps;
            let vertical_mps = if way.z > 0.0 { climb_mps } else { descent_mps };
            let leg_s = (way.xy().norm() / leg.speed_mps).max(way.z.abs() / vertical_mps);
            let mut add =
                |time_s: f64| points.push(PlannedPoint { point: TimedPoint { time_s, at: to }, leg: Some(index) });
            if leg_s > 0.0 {
                time_s = match ends_slot(index) {
                    false => ((time_s + leg_s) * PER_SECOND).ceil() / PER_SECOND,
                    true => ((time_s + leg_s * (1.0 - MAX_FASTER)) / slot_s).ceil() * slot_s,
                };
                add(time_s);
            }
            if leg.hold_s > 0.0 {
                time_s = ((time_s + leg.hold_s) * PER_SECOND).round() / PER_SECOND;
                add(time_s);
            }
            at = to;
        }
        points
    }
}
