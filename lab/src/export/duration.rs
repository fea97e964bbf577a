//! How long a vehicle takes for a mission, with acceleration, corners, holds, take-off and landing.
//!
//! A leg takes the longer of its horizontal and its vertical movement, each from rest to rest. Legs through a waypoint
//! without a hold overlap. A test compares four missions that ArduCopter 4.8 has flown in software.

use nalgebra::{Point3, Vector2};
use skysink_common::battery::Battery;
use skysink_common::geometry::Position;

use super::autopilot::{RampLimits, VehicleMotion};

/// A leg of a mission, to its waypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissionLeg {
    /// The waypoint [m]; z is the altitude above home, or above the ground below.
    pub to: Point3<f64>,
    /// Speed over ground [m/s].
    pub speed_mps: f64,
    /// Hold at the waypoint [s]; without one the vehicle flies through it.
    pub hold_s: f64,
}

/// Where a vehicle is at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedPosition {
    /// Time since arming [s].
    pub time_s: f64,
    /// The place over ground [m].
    pub at: Position,
}

/// What a mission takes.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct MissionEffort {
    /// Time from arming to landing [s].
    pub duration_s: f64,
    /// Energy from the battery, at the mean speed of each leg [J]; 0 without one.
    pub energy_j: f64,
}

/// A movement of a mission, or a stay.
struct Movement {
    duration_s: f64,
    /// Where it ends [m].
    to: Position,
    /// Horizontal distance [m].
    distance_m: f64,
    climb_m: f64,
}

/// Take-off at `home` to `altitude_m` [m], the legs, and the return and landing.
fn movements(motion: &VehicleMotion, home: Position, altitude_m: f64, legs: &[MissionLeg]) -> Vec<Movement> {
    let start = Point3::new(home.x, home.y, altitude_m);
    let stay = |duration_s, to, climb_m| Movement { duration_s, to, distance_m: 0.0, climb_m };
    let mut movements = vec![stay(motion.take_off_s(altitude_m), home, altitude_m)];
    for (index, leg) in legs.iter().enumerate() {
        let from = index.checked_sub(1).map_or(start, |before| legs[before].to);
        let overlap_s = legs.get(index + 1).map_or(0.0, |next| corner_s(motion, &from, leg, next));
        movements.push(Movement {
            duration_s: leg_s(motion, &from, leg) - overlap_s,
            to: leg.to.xy(),
            distance_m: (leg.to - from).xy().norm(),
            climb_m: leg.to.z - from.z,
        });
        movements.push(stay(leg.hold_s, leg.to.xy(), 0.0));
    }
    let last = legs.last().map_or(start, |leg| leg.to);
    let fastest_mps = legs.iter().map(|leg| leg.speed_mps).fold(0.0, f64::max);
    let back = MissionLeg { to: Point3::new(home.x, home.y, last.z), speed_mps: fastest_mps, hold_s: 0.0 };
    movements.push(Movement {
        duration_s: leg_s(motion, &last, &back),
        to: home,
        distance_m: (last.xy() - home).norm(),
        climb_m: 0.0,
    });
    movements.push(stay(motion.landing_s(last.z), home, 0.0));
    movements
}

/// What take-off at `home` to `altitude_m` [m], the legs, and the return and landing take. The energy is that of
/// `battery`.
pub fn effort(
    motion: &VehicleMotion,
    home: Position,
    altitude_m: f64,
    legs: &[MissionLeg],
    battery: Option<&Battery>,
) -> MissionEffort {
    let mut whole = MissionEffort::default();
    for Movement { duration_s, distance_m, climb_m, .. } in movements(motion, home, altitude_m, legs) {
        whole.duration_s += duration_s;
        whole.energy_j += battery.map_or(0.0, |battery| battery.leg_j(duration_s, distance_m, climb_m));
    }
    whole
}

/// When the vehicle is where, from arming at `home` to the end of the landing: between two times it moves on a straight
/// line.
pub fn timeline(motion: &VehicleMotion, home: Position, altitude_m: f64, legs: &[MissionLeg]) -> Vec<TimedPosition> {
    let mut time_s = 0.0;
    let moved = movements(motion, home, altitude_m, legs).into_iter().map(|movement| {
        time_s += movement.duration_s;
        TimedPosition { time_s, at: movement.to }
    });
    std::iter::once(TimedPosition { time_s: 0.0, at: home }).chain(moved).collect()
}

/// Time of a leg from rest to rest [s].
pub fn leg_s(motion: &VehicleMotion, from: &Point3<f64>, leg: &MissionLeg) -> f64 {
    let step = leg.to - from;
    let distance_m = step.xy().norm();
    let settling_s = if leg.hold_s > 0.0 { motion.settling_s } else { motion.response_s };
    let flown_s = if distance_m > 0.0 { straight_s(&motion.horizontal, distance_m, leg.speed_mps) } else { 0.0 };
    let rate_mps = if step.z > 0.0 { motion.climb_mps } else { motion.descent_mps };
    let climbed_s = if step.z == 0.0 { 0.0 } else { straight_s(&motion.vertical, step.z.abs(), rate_mps) };
    let moved_s = flown_s.max(climbed_s);
    if moved_s > 0.0 { moved_s + settling_s } else { 0.0 }
}

/// Time of a straight line from rest to rest [s], at most at `speed_mps` [m/s]. Speeding up and braking are symmetric.
fn straight_s(ramp: &RampLimits, distance_m: f64, speed_mps: f64) -> f64 {
    // The mean speed of a symmetric ramp is half the speed that it reaches.
    let ramp_m = |speed_mps: f64| speed_mps * ramp_s(ramp, speed_mps) / 2.0;
    let top_mps = largest(speed_mps, |top_mps| 2.0 * ramp_m(top_mps) <= distance_m);
    let cruise_m = if top_mps < speed_mps { 0.0 } else { distance_m - 2.0 * ramp_m(speed_mps) };
    2.0 * ramp_s(ramp, top_mps) + cruise_m / speed_mps
}

/// The largest value from 0 to `most` that `fits`, by bisection; all smaller ones fit, too.
fn largest(most: f64, fits: impl Fn(f64) -> bool) -> f64 {
    if fits(most) {
        return most;
    }
    let mut range = [0.0, most];
    for _ in 0..60 {
        let middle = f64::midpoint(range[0], range[1]);
        range[usize::from(!fits(middle))] = middle;
    }
    range[0]
}

/// Time from rest to a speed [s]: `v/a`; with jerk j `a/j + v/a`, or `2 √(v/j)` where the acceleration a is not
/// reached.
fn ramp_s(ramp: &RampLimits, speed_mps: f64) -> f64 {
    let acceleration_mps2 = ramp.acceleration_mps2;
    match ramp.jerk_mps3 {
        None => speed_mps / acceleration_mps2,
        Some(jerk_mps3) if speed_mps * jerk_mps3 < acceleration_mps2 * acceleration_mps2 => {
            2.0 * (speed_mps / jerk_mps3).sqrt()
        }
        Some(jerk_mps3) => acceleration_mps2 / jerk_mps3 + speed_mps / acceleration_mps2,
    }
}

/// Distance from rest [m] after a time [s]: `j t³/6` while the acceleration rises, then at constant acceleration.
fn begun_m(ramp: &RampLimits, time_s: f64) -> f64 {
    let acceleration_mps2 = ramp.acceleration_mps2;
    let Some(jerk_mps3) = ramp.jerk_mps3 else { return acceleration_mps2 * time_s * time_s / 2.0 };
    let full_s = acceleration_mps2 / jerk_mps3;
    let jerked_s = time_s.min(full_s);
    let on_s = time_s - jerked_s;
    jerk_mps3 * jerked_s.powi(3) / 6.0
        + jerk_mps3 * full_s * full_s / 2.0 * on_s
        + acceleration_mps2 * on_s * on_s / 2.0
}

/// How long before the end of `leg` from `from` the `next` one begins [s]: a waypoint without hold is passed within
/// [`VehicleMotion::radius_m`], while the vehicle still brakes. The legs overlap for at most half of each, and not at
/// all for a vehicle that stops at each waypoint.
///
/// In the middle of an overlap T each leg is `d(T/2)` from the waypoint ([`begun_m`]), in the directions −u and v of
/// the legs: the vehicle passes at `|v − u| d(T/2)`.
fn corner_s(motion: &VehicleMotion, from: &Point3<f64>, leg: &MissionLeg, next: &MissionLeg) -> f64 {
    let direction = |from: &Point3<f64>, to: &Point3<f64>| (to - from).xy().try_normalize(1e-9);
    let (Some(before), Some(after)) = (direction(from, &leg.to), direction(&leg.to, &next.to)) else { return 0.0 };
    let Some(radius_m) = motion.radius_m.filter(|_| leg.hold_s <= 0.0) else { return 0.0 };
    let turn: Vector2<f64> = after - before;
    let most_s =
        (leg_s(motion, from, leg) - motion.response_s).min(leg_s(motion, &leg.to, next) - motion.response_s) / 2.0;
    largest(most_s.max(0.0), |overlap_s| turn.norm() * begun_m(&motion.horizontal, overlap_s / 2.0) <= radius_m)
}
