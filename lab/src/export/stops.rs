//! The waypoints of a vehicle mission: merges the slots of a flight into legs and holds, and omits waypoints that
//! collect little.

use nalgebra::{Point3, Vector3};
use skysink_common::airspace::Airspace;

use super::track::{GeodeticTrack, TrackPoint};

/// Tolerance for merging positions [m].
pub const MERGE_M: f64 = 0.05;

/// Lowest speed of a mission [m/s].
const LOWEST_MPS: f64 = 0.1;

/// A waypoint.
#[derive(Debug, Clone)]
pub struct VehicleStop {
    /// Position in the frame of the area [m]; z is the altitude above ground.
    pub position: Point3<f64>,
    /// How long the vehicle holds there [s].
    pub hold_s: f64,
    /// Ground speed on the leg to it [m/s]; `None` for a vertical leg or one of length 0.
    pub speed_mps: Option<f64>,
    /// The points of the track at which sensor nodes are served from here.
    pub services: Vec<usize>,
    /// Bits that they upload.
    pub bits: u64,
    /// The start of the leg to it [m], its first step [m], and its number of slots.
    from: Point3<f64>,
    step: Vector3<f64>,
    slots: u32,
}

impl VehicleStop {
    /// A waypoint on the way to another one, at `speed_mps` [m/s].
    pub fn on_way(position: Point3<f64>, speed_mps: f64) -> Self {
        Self {
            position,
            hold_s: 0.0,
            speed_mps: Some(speed_mps),
            services: Vec::new(),
            bits: 0,
            from: position,
            step: Vector3::zeros(),
            slots: 0,
        }
    }

    /// Whether it is one of the flight, and not on a way that the mission adds.
    pub fn is_flown(&self) -> bool {
        self.slots > 0
    }

    /// Whether the leg continues straight to `position` in the next slot, at the same speed and without a service or a
    /// hold.
    fn leads_to(&self, position: &Point3<f64>) -> bool {
        let is_passed = self.services.is_empty() && self.hold_s == 0.0;
        is_passed && (self.from + self.step * f64::from(self.slots + 1) - position).norm() <= MERGE_M
    }
}

/// The waypoints of a track. A slot is merged into the previous hold if the UAV stays within [`MERGE_M`]. It is merged
/// into the previous leg if it continues straight on at the same speed and no sensor node is served in between.
pub fn merge(track: &GeodeticTrack<'_>) -> Vec<VehicleStop> {
    let scenario = &track.run.scenario;
    let mut stops: Vec<VehicleStop> = Vec::new();
    for (index, pair) in (1..).zip(track.flown().windows(2)) {
        let [before, point]: &[TrackPoint<'_>; 2] = pair.try_into().expect("windows of two");
        let services: Vec<usize> = if point.served().is_empty() { vec![] } else { vec![index] };
        let bits = track.delivered_bits(index);
        let comm_s = if services.is_empty() { 0.0 } else { scenario.link.comm_s };
        let step = point.position - before.position;
        let ground_m = step.xy().norm();
        let leg_mps = match scenario.uav.acceleration_mps2 {
            Some(_) => scenario.uav.max_speed_mps, // reached on the leg, which is from rest to rest (decision D31)
            None => ground_m / scenario.slot_s,
        };
        match stops.last_mut() {
            Some(stop) if (point.position - stop.position).norm() <= MERGE_M => {
                stop.hold_s += scenario.slot_s;
                stop.services.extend(services);
                stop.bits += bits;
            }
            Some(stop) if stop.leads_to(&point.position) => {
                *stop = VehicleStop {
                    position: point.position,
                    hold_s: comm_s,
                    services,
                    bits,
                    slots: stop.slots + 1,
                    ..stop.clone()
                };
            }
            _ => {
                let stays = stops.is_empty() && step.norm() <= MERGE_M;
                stops.push(VehicleStop {
                    position: point.position,
                    hold_s: if stays { scenario.slot_s } else { comm_s },
                    speed_mps: Some(rounded(leg_mps)).filter(|_| ground_m > MERGE_M),
                    services,
                    bits,
                    from: before.position,
                    step,
                    slots: 1,
                });
            }
        }
    }
    stops
}

/// A speed [m/s] in whole millimetres per second, at least `LOWEST_MPS`.
pub fn rounded(speed_mps: f64) -> f64 {
    ((speed_mps * 1e3).round() / 1e3).max(LOWEST_MPS)
}

/// The waypoints from which at least `min_bits` are uploaded, with the ways around zones where others are omitted
/// between them. Such a way is flown at the highest speed of the legs that it replaces.
pub fn with_bits(stops: &[VehicleStop], min_bits: u64, start: Point3<f64>, airspace: &Airspace) -> Vec<VehicleStop> {
    let mut kept: Vec<VehicleStop> = Vec::new();
    for legs in stops.split_inclusive(|stop| stop.bits >= min_bits) {
        let Some(stop) = legs.last().filter(|stop| stop.bits >= min_bits) else { break };
        let speed_mps = legs.iter().filter_map(|leg| leg.speed_mps).reduce(f64::max);
        if let (Some(speed_mps), 2..) = (speed_mps, legs.len()) {
            let from = kept.last().map_or(start, |before| before.position);
            let bends = airspace.way(&from.xy(), &stop.position.xy());
            let bends = bends.iter().take(bends.len().saturating_sub(1));
            kept.extend(bends.map(|bend| VehicleStop::on_way(Point3::new(bend.x, bend.y, stop.position.z), speed_mps)));
        }
        kept.push(VehicleStop { speed_mps, ..stop.clone() });
    }
    kept
}
