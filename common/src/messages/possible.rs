//! Which messages of the ring are possible. Every process refuses the others, before it computes with them.

use crate::geometry::Position;
use crate::message::{
    Commit, FlightReport, HeardLink, MAX_PATH_POINTS, MAX_SERVED, Mode, NodeAnswer, PathPoint, Plan, QueuesHeader,
    SensorNode, SensorsHeader, SlotHeader, Tick,
};
use crate::nodes::Answer;
use crate::scenario::Area;

/// A message of the ring, or the header of one.
pub trait Message: Sized {
    /// Whether a process can compute with these messages. Any numbers are possible where the reader itself checks them,
    /// as flight-sim does with a plan and the viewer with a path.
    #[must_use]
    fn are_possible(_: &[Self]) -> bool {
        true
    }
}

impl Message for u32 {}
impl Message for Commit {}
impl Message for PathPoint {}
impl Message for Plan {}
impl Message for SensorsHeader {}
impl Message for SlotHeader {}
impl Message for Tick {}

impl Message for f64 {
    /// Rates that are finite and not below 0.
    fn are_possible(rates_bps: &[Self]) -> bool {
        are_finite(rates_bps.iter().copied()) && rates_bps.iter().all(|&rate_bps| rate_bps >= 0.0)
    }
}

impl Message for NodeAnswer {
    /// Numbers of answers.
    fn are_possible(answers: &[Self]) -> bool {
        let is_known = |number: u8| Answer::from_repr(number).is_some();
        answers.iter().all(|node| is_known(node.answer) && is_known(node.known))
    }
}

impl Message for FlightReport {
    /// Positions, velocities, covariances and links have finite numbers. The links are at most [`MAX_SERVED`], by
    /// ascending sensor node, and none if the UAV holds, charges or is down: a trace with others could not be flown
    /// again. A battery is swapped only while the UAV charges. A position outside the area is possible, because a real
    /// vehicle may have been there.
    fn are_possible(flights: &[Self]) -> bool {
        flights.iter().all(|flight| {
            let links = flight.served_links();
            let numbers = links.iter().flat_map(|link| [link.distance_m, link.elevation_deg, link.rate_bps]);
            let is_idle = matches!(flight.flown_mode(), Mode::Hold | Mode::Charge | Mode::Down);
            let state = [flight.x_m, flight.y_m, flight.z_m, flight.time_s].into_iter().chain(flight.velocity_mps);
            are_finite(state.chain(flight.covariance_m2).chain(numbers))
                && links.is_sorted_by(|before, after| before.sensor < after.sensor)
                && !flight.energy_j.is_nan()
                && !flight.heading_deg.is_nan()
                && flight.served as usize <= if is_idle { 0 } else { MAX_SERVED }
                && (flight.swapped_slots == 0 || flight.flown_mode() == Mode::Charge)
        })
    }
}

impl Message for HeardLink {
    /// Finite SNRs, each link once, by ascending UAV and sensor node.
    fn are_possible(links: &[Self]) -> bool {
        links.iter().all(|link| link.snr_db.is_finite())
            && links.is_sorted_by(|before, after| (before.uav, before.sensor) < (after.uav, after.sensor))
    }
}

impl Message for SensorNode {
    /// Finite positions, gains, rates and weights; neither gains nor rates are below 0, and weights are above 0.
    fn are_possible(nodes: &[Self]) -> bool {
        nodes.iter().all(|node| {
            are_finite([node.x_m, node.y_m, node.gain, node.sampling_bps, node.weight])
                && node.gain >= 0.0
                && node.sampling_bps >= 0.0
                && node.weight > 0.0
        })
    }
}

impl Message for QueuesHeader {
    /// Totals whose fraction of lost slots is finite and not below 0. The recorder checks that the bits balance.
    fn are_possible(headers: &[Self]) -> bool {
        headers.iter().all(|header| header.totals.lost_slots.is_finite() && header.totals.lost_slots >= 0.0)
    }
}

/// Whether these numbers are finite in single precision, in which they are drawn.
fn are_finite(numbers: impl IntoIterator<Item = f64>) -> bool {
    numbers.into_iter().all(|number| (number as f32).is_finite())
}

/// Whether these links are those of so many UAVs and sensor nodes.
#[must_use]
pub fn are_known_links(links: &[HeardLink], uavs: usize, sensors: usize) -> bool {
    links.iter().all(|link| (link.uav as usize) < uavs && (link.sensor as usize) < sensors)
}

/// Whether these are paths of some of so many UAVs, in the order of their numbers: each of 1 to [`MAX_PATH_POINTS`]
/// points over the area, with altitudes that are finite in single precision, in which they are drawn.
#[must_use]
pub fn are_possible_paths(points: &[PathPoint], area: &Area, uavs: usize) -> bool {
    let border_m = area.border_slack_m();
    let is_over_area = |point: &PathPoint| area.contains(&Position::new(point.x_m, point.y_m), border_m);
    let is_short = |path: &[PathPoint]| path.len() <= MAX_PATH_POINTS && (path[0].uav as usize) < uavs;
    !points.is_empty()
        && points.is_sorted_by_key(|point| point.uav)
        && points.chunk_by(|a, b| a.uav == b.uav).all(is_short)
        && points.iter().all(|point| is_over_area(point) && are_finite([point.z_m]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ledger::Totals;
    use crate::message::LinkReport;
    use nalgebra::Point3;

    /// A flight that serves the SNs 3 and 7.
    fn flight() -> FlightReport {
        let mut flight = FlightReport::at([50.0, 20.0, 30.0], Mode::Serve);
        flight.served = 2;
        for (link, sensor) in flight.links.iter_mut().zip([3, 7]) {
            *link = LinkReport { sensor, rate_bps: 1e6, ..LinkReport::default() };
        }
        flight
    }

    #[test]
    fn a_flight_with_one_impossible_number_is_refused() {
        let spoil: [fn(&mut FlightReport); 15] = [
            |flight| flight.energy_j = f64::NAN,
            |flight| flight.mode = Mode::Charge as u32,
            |flight| flight.x_m = f64::NAN,
            |flight| flight.y_m = f64::NEG_INFINITY,
            |flight| flight.z_m = 1e300,
            |flight| flight.links[1].rate_bps = f64::NAN,
            |flight| flight.links[0].distance_m = f64::INFINITY,
            |flight| flight.links[0].elevation_deg = f64::NAN,
            |flight| flight.links[1].sensor = 3,
            |flight| flight.links[1].sensor = 2,
            |flight| flight.served = 3,
            |flight| flight.served = u32::MAX,
            |flight| flight.mode = Mode::Hold as u32,
            |flight| flight.mode = 77,
            |flight| flight.swapped_slots = 1,
        ];
        for (number, spoil) in spoil.into_iter().enumerate() {
            let mut spoilt = flight();
            spoil(&mut spoilt);
            assert!(!FlightReport::are_possible(&[flight(), spoilt]), "{number}");
        }
    }

    #[test]
    fn answers_are_queues_silence_or_death() {
        let answers = [[0, 0], [1, 1], [2, 0], [2, 2]].map(|[answer, known]| NodeAnswer { answer, known });
        assert!(NodeAnswer::are_possible(&[]) && NodeAnswer::are_possible(&answers));
        for [answer, known] in [[7, 0], [0, 7], [3, 3], [255, 2]] {
            assert!(!NodeAnswer::are_possible(&[answers[0], NodeAnswer { answer, known }]), "{answer} {known}");
        }
    }

    #[test]
    fn links_that_are_heard_are_finite_known_and_ascend() {
        let links = |of: &[(u32, u32, f32)]| -> Vec<HeardLink> {
            of.iter().map(|&(uav, sensor, snr_db)| HeardLink { uav, sensor, snr_db }).collect()
        };
        let good = links(&[(0, 3, -4.5), (0, 7, 12.0), (1, 2, 0.0)]);
        assert!(HeardLink::are_possible(&[]) && HeardLink::are_possible(&good) && are_known_links(&good, 2, 8));
        assert!(!are_known_links(&good, 1, 8) && !are_known_links(&good, 2, 7));
        for bad in [[(0, 3, f32::NAN), (1, 0, 1.0)], [(0, 3, 1.0), (0, 3, 1.0)], [(1, 0, 1.0), (0, 3, f32::INFINITY)]] {
            assert!(!HeardLink::are_possible(&links(&bad)), "{bad:?}");
        }
        assert!(!HeardLink::are_possible(&links(&[(1, 0, 1.0), (0, 3, 1.0)])), "descending");
    }

    #[test]
    fn unused_fields_of_a_flight_are_not_checked() {
        let mut flight = flight();
        assert!(FlightReport::are_possible(&[flight]));
        flight.links[2] = LinkReport { sensor: 0, rate_bps: f64::NAN, ..LinkReport::default() };
        assert!(FlightReport::are_possible(&[flight]), "two links count");
        assert!(FlightReport::are_possible(&[FlightReport::at([-5.0, 1e6, 0.0], Mode::Hold)]), "outside the area");
    }

    #[test]
    fn rates_must_be_non_negative_numbers() {
        assert!(f64::are_possible(&[0.0, 175.0]));
        assert!([-0.1, f64::NAN, f64::INFINITY].iter().all(|&bps| !f64::are_possible(&[1.0, bps])));
    }

    #[test]
    fn sensor_nodes_and_totals_with_an_impossible_number_are_refused() {
        let node = SensorNode { gain: 1e-5, sampling_bps: 100.0, ..SensorNode::default() };
        assert!(SensorNode::are_possible(&[node]));
        for spoilt in [
            SensorNode { x_m: f64::NAN, ..node },
            SensorNode { y_m: 1e39, ..node },
            SensorNode { gain: -1.0, ..node },
            SensorNode { sampling_bps: f64::NAN, ..node },
            SensorNode { weight: 0.0, ..node },
            SensorNode { weight: f64::NAN, ..node },
        ] {
            assert!(!SensorNode::are_possible(&[node, spoilt]), "{spoilt:?}");
        }
        for (lost_slots, is_possible) in [(0.0, true), (2.5, true), (-0.1, false), (f64::NAN, false)] {
            let totals = Totals { lost_slots, ..Totals::default() };
            let header = QueuesHeader { totals, ..QueuesHeader::default() };
            assert_eq!(QueuesHeader::are_possible(&[header]), is_possible, "{lost_slots}");
        }
    }

    const AREA: Area = Area::new(100.0, 50.0);

    #[test]
    fn a_path_has_1_to_64_points() {
        for (count, is_possible) in [(0, false), (1, true), (64, true), (65, false), (100_000, false)] {
            assert_eq!(are_possible_paths(&vec![PathPoint::default(); count], &AREA, 1), is_possible, "{count} points");
        }
    }

    #[test]
    fn paths_must_belong_to_existing_uavs_in_order() {
        let of =
            |uavs: &[u32]| -> Vec<_> { uavs.iter().map(|&uav| PathPoint { uav, ..PathPoint::default() }).collect() };
        for (uavs, is_possible) in
            [(&[0, 0, 1, 2][..], true), (&[1], true), (&[0, 1, 0], false), (&[3], false), (&[0, u32::MAX], false)]
        {
            assert_eq!(are_possible_paths(&of(uavs), &AREA, 3), is_possible, "{uavs:?}");
        }
        assert!(are_possible_paths(&of(&[vec![0; 64], vec![2; 64]].concat()), &AREA, 3));
        assert!(!are_possible_paths(&of(&[vec![0; 64], vec![2; 65]].concat()), &AREA, 3));
    }

    #[test]
    fn a_path_with_one_impossible_point_is_refused() {
        let good = [100.0, 50.0, 20.0];
        let point = |at: [f64; 3]| PathPoint::of(0, &Point3::from(at));
        assert!(are_possible_paths(&[good, [0.0, 0.0, 1e9]].map(point), &AREA, 1), "the rim is part of the area");
        for (axis, value) in [
            (0, f64::NAN),
            (1, f64::NAN),
            (2, f64::NAN),
            (0, f64::INFINITY),
            (1, f64::NEG_INFINITY),
            (2, f64::INFINITY),
            (2, -1e300),
            (0, 100.1),
            (1, 50.1),
            (0, -0.1),
        ] {
            let mut bad = good;
            bad[axis] = value;
            assert!(!are_possible_paths(&[good, bad].map(point), &AREA, 1), "{bad:?}");
        }
    }
}
