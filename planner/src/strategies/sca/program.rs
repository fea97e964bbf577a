//! A convex approximation of all stops of a flight and their times, as a cone program.
//!
//! **Variables.** Of stop m its point `q_m`, its last slot `τ_m`, and the slots in which it serves, `x_m`. Of service j
//! of an SN what was lost before it, `o_j`; of one over a link that cannot empty a full buffer from everywhere in range
//! also the queue after it, `b_j`, what the link carries in a slot, `ρ_j`, and a root of the bits, `u_j`.
//!
//! **Flight.** `f_m = τ_m − τ_{m−1} − x_m + 1` slots bring the UAV from stop to stop. No leg takes more whole slots
//! than the k of the flight before, `d = ‖q_m − q_{m−1}‖/(V τ) ≤ k`, and as a slot can only be saved as a whole, `f_m`
//! is at least `max(1, k − 1)`. The part of the last slot counts by a concave function that is 0 without it and 1 with
//! all of it, `f_m ≥ k − 1 + φ(d − k + 1)`, `φ(e) = ln(1 + e/ε)/ln(1 + 1/ε)`, of which the tangent is taken: so short
//! rests vanish, and long ones do not matter. Every SN of a stop is in range, `‖q_m − w_i‖ ≤ d_c`.
//!
//! **Queues.** Before service j the queue is `b_{j−1} + a (τ_j − τ_{j−1}) − o_j`, at most the buffer. Of it the service
//! takes all, or at most `κ x_m ρ_j`: an SN has the share `κ = min(1, n/|S_m|)` of the slots.
//!
//! **Approximations.** `ρ_j` is at most the tangent of the capacity in the squared distance, a lower bound in free
//! space, where the capacity is convex in it. `u² ≤ x ρ` is a cone, and the bits are at most `κ (2 û u − û²) ≤ κ u²`. A
//! hat marks values of the flight before.
//!
//! **Objective.** The least `Σ w_i o_j` relative to what is sampled in a slot, and with little weight early stops.

use clarabel::solver::SupportedConeT::SecondOrderConeT;
use nalgebra::Vector2;
use skysink_common::channel::ChannelModel;
use skysink_common::geometry::{Position, above};

use super::rehearsal::Rehearsal;
use super::stops::{FlownService, TimedStop, range};
use crate::cone_program::ConeProgram;
use crate::geometry::disks::Disk;
use crate::mission_table::MissionTable;

/// Tolerance of Clarabel: what is found is rounded to slots, and only better flights are kept.
const TOLERANCE: f64 = 1e-6;

/// Weight of stops that are a slot earlier, relative to what is sampled in one.
const EARLY: f64 = 1e-3;

/// Range that the program keeps to, relative to `d_c`: it may miss its constraints by its tolerance.
const WITHIN: f64 = 1.0 - 1e-6;

/// Longest leg of whole slots that the program allows, relative to their reach, for the same reason.
const WHOLE: f64 = 1.0 - 1e-5;

/// ε: the part of a slot that counts as about a third of it.
const SHORT: f64 = 0.1;

/// Relative step of the squared distance for the slope of a capacity.
const STEP: f64 = 1e-4;

/// Variables of a stop: x and y of its point, from the one before in units of the reach, its end, and its slots.
const STOP: usize = 4;
const END: usize = 2;
const SLOTS: usize = 3;

/// Variables of a service: what is lost before it, the queue after it, capacity, and root of the bits; the first alone
/// if the link empties every queue.
const LEFT: usize = 1;
const CARRIED: usize = 2;
const ROOT: usize = 3;
const LIMITED: usize = 4;

/// The stops at their best by the program around them; `None` if it is not solved, or there are none.
pub(super) fn improved(flight: &Rehearsal, stops: &[TimedStop]) -> Option<Vec<TimedStop>> {
    if stops.is_empty() {
        return None;
    }
    let program = StopProgram::new(flight, stops);
    let found = program.solved()?;
    Some(stops.iter().zip(found.chunks(STOP)).map(|(stop, found)| moved(flight, stop, found)).collect())
}

/// A stop where the program puts it, in the area; around zones where it was if zones are in the way.
fn moved(flight: &Rehearsal, stop: &TimedStop, found: &[f64]) -> TimedStop {
    let table = flight.view.table;
    let step = Vector2::new(found[0], found[1]) * table.limits.reach_m;
    let point = table.clamp_to_area(&(stop.point + step));
    let point = if table.airspace.nearest(&point) == point { point } else { stop.point };
    TimedStop { point, slots: found[SLOTS], end_slots: found[END], ..stop.clone() }
}

/// A service with its variables.
#[derive(Clone, Copy)]
struct StopVisit {
    stop: usize,
    service: FlownService,
    /// The index of its first variable.
    first: usize,
    /// The capacity where the stop is, and its slope in the squared distance [bit, bit/m²]; `None` if the link empties
    /// every queue.
    limit: Option<[f64; 2]>,
}

struct StopProgram<'a> {
    flight: &'a Rehearsal<'a>,
    stops: &'a [TimedStop],
    /// The visits of each SN, and the variable of what it loses at the end.
    visits: Vec<(u32, Vec<StopVisit>, usize)>,
    cones: ConeProgram,
}

impl<'a> StopProgram<'a> {
    fn new(flight: &'a Rehearsal<'a>, stops: &'a [TimedStop]) -> Self {
        let table = flight.view.table;
        let mut by_sensor: Vec<Vec<StopVisit>> = vec![Vec::new(); table.sensors.count()];
        let mut variables = STOP * stops.len();
        for (index, stop) in stops.iter().enumerate() {
            for &service in &stop.services {
                let limit = limit_of(flight, stop, service.id);
                let visit = StopVisit { stop: index, service, first: variables, limit };
                by_sensor[service.id as usize].push(visit);
                variables += if limit.is_some() { LIMITED } else { 1 };
            }
        }
        let mut visits = Vec::new();
        for (id, of_sensor) in (0..).zip(by_sensor).filter(|(_, visits)| !visits.is_empty()) {
            visits.push((id, of_sensor, variables));
            variables += 1;
        }
        Self { flight, stops, visits, cones: ConeProgram::new(variables) }
    }

    fn solved(mut self) -> Option<Vec<f64>> {
        let table = self.flight.view.table;
        let value = |id: u32| table.sensors.weights.factor(id as usize);
        let ids = table.sensors.ids();
        let sampled_bits: f64 = ids.map(|id| value(id) * table.sensors.sampler(id).mean_bits).sum();
        let scale_bits = if sampled_bits > 0.0 { sampled_bits } else { 1.0 };
        for stop in 0..self.stops.len() {
            self.cones.linear[STOP * stop + END] = EARLY / self.stops.len() as f64;
            self.take_time(stop);
        }
        let visits = std::mem::take(&mut self.visits);
        for (id, visits, last) in &visits {
            let cost = value(*id) * buffer_bits(table, *id) / scale_bits;
            self.fill_and_empty(*id, visits, *last, cost);
        }
        for stop in 0..self.stops.len() {
            self.fly(stop);
        }
        for visit in visits.iter().flat_map(|(_, visits, _)| visits) {
            self.carry(visit);
        }
        self.cones.solve(TOLERANCE).map(|solution| solution.x)
    }

    /// Whole slots of flight and service.
    fn take_time(&mut self, index: usize) {
        let stop = &self.stops[index];
        let [end, slots] = [END, SLOTS].map(|variable| STOP * index + variable);
        let least = (stop.flight_slots - 1.0).max(1.0);
        // τ_m − τ_{m−1} − x_m + 1 ≥ least
        self.cones.at_least_0(1.0 - least, &between(index, slots));
        self.cones.at_least_0(-stop.least_slots(self.flight.view.table), &[(slots, -1.0)]);
        if index + 1 == self.stops.len() {
            self.cones.at_least_0(self.flight.slots as f64, &[(end, 1.0)]);
        }
    }

    /// The queue of an SN, relative to its buffer, whose overflows cost `cost`.
    fn fill_and_empty(&mut self, id: u32, visits: &[StopVisit], last: usize, cost: f64) {
        let table = self.flight.view.table;
        let buffer_bits = buffer_bits(table, id);
        let sampled = table.sensors.sampler(id).mean_bits / buffer_bits;
        let begun = (f64::from(self.flight.view.belief.queues_bits[id as usize]) / buffer_bits).min(1.0);
        // The queue, as a number and factors of variables, when it was emptied last; then what is sampled since.
        let mut number: f64 = begun;
        let mut queue: Vec<(usize, f64)> = Vec::new();
        for visit in visits {
            let end = STOP * visit.stop + END;
            queue.extend([(end, sampled), (visit.first, -1.0)]);
            self.overflow(number, &queue, visit.first, cost);
            (number, queue) = match visit.limit {
                None => (0.0, Vec::new()),
                Some(limit) => {
                    self.empty(visit, limit, buffer_bits, number, &queue);
                    (0.0, vec![(visit.first + LEFT, 1.0)])
                }
            };
            queue.push((end, -sampled));
        }
        number += sampled * self.flight.slots as f64;
        queue.push((last, -1.0));
        self.overflow(number, &queue, last, cost);
        if self.flight.collects {
            queue.iter().for_each(|(variable, factor)| self.cones.linear[*variable] += cost * factor);
        }
    }

    /// At most a full buffer stays, and the rest is lost.
    fn overflow(&mut self, number: f64, queue: &[(usize, f64)], lost: usize, cost: f64) {
        self.cones.linear[lost] += cost;
        self.cones.at_least_0(0.0, &[(lost, -1.0)]);
        self.cones.at_least_0(1.0 - number, queue);
    }

    /// What a service over a limited link leaves: `b ≥ queue − κ (2 û u − û²)`.
    fn empty(&mut self, visit: &StopVisit, limit: [f64; 2], buffer_bits: f64, number: f64, queue: &[(usize, f64)]) {
        let root = (self.stops[visit.stop].slots * limit[0] / buffer_bits).sqrt();
        let share = self.share(visit.stop);
        let mut factors = queue.to_vec();
        factors.extend([(visit.first + LEFT, -1.0), (visit.first + ROOT, -2.0 * share * root)]);
        self.cones.at_least_0(-number - share * root * root, &factors);
        self.cones.at_least_0(0.0, &[(visit.first + LEFT, -1.0)]);
    }

    /// The share of the slots of a stop that each of its SNs has.
    fn share(&self, stop: usize) -> f64 {
        (self.flight.view.table.limits.blocks() as f64 / self.stops[stop].services.len() as f64).min(1.0)
    }

    /// The leg to a stop, and the ranges that it has to be in.
    fn fly(&mut self, index: usize) {
        let table = self.flight.view.table;
        let reach_m = table.limits.reach_m;
        let stop = &self.stops[index];
        let x = STOP * index;
        let from = index.checked_sub(1).map_or(self.flight.view.ground(), |before| self.stops[before].point);
        let away = (stop.point - from) / reach_m;
        let whole = stop.flight_slots;
        self.cones.cone(SecondOrderConeT(3));
        self.cones.row((whole * WHOLE).max(away.norm()), &[]);
        (0..2).for_each(|axis| self.cones.row(away[axis], &between_points(index, axis)));
        if whole > 1.0 {
            // f ≥ k − 1 + φ(ê) + φ'(ê) (d − k + 1 − ê)
            let rest = (away.norm() / WHOLE - whole + 1.0).clamp(0.0, 1.0);
            let share = (rest / SHORT).ln_1p() / SHORT.recip().ln_1p();
            let slope = 1.0 / ((SHORT + rest) * SHORT.recip().ln_1p());
            let fixed = (whole - 1.0) + share - slope * (whole - 1.0 + rest);
            self.cones.cone(SecondOrderConeT(3));
            let factors = between(index, x + SLOTS);
            let scaled: Vec<(usize, f64)> =
                factors.iter().map(|(variable, factor)| (*variable, factor * WHOLE / slope)).collect();
            self.cones.row((1.0 - fixed) * WHOLE / slope, &scaled);
            (0..2).for_each(|axis| self.cones.row(away[axis], &between_points(index, axis)));
        }
        for service in &stop.services {
            let reached = range(table, service.id);
            let from_centre = (stop.point - reached.centre) / reached.radius_m;
            self.cones.stay_within(from_centre.norm().max(WITHIN), &from_centre, x, reach_m / reached.radius_m);
        }
    }

    /// What a limited link carries: the tangent of its capacity, and the root of the bits.
    fn carry(&mut self, visit: &StopVisit) {
        let Some([capacity_bits, slope_bits]) = visit.limit else { return };
        let table = self.flight.view.table;
        let buffer_bits = buffer_bits(table, visit.service.id);
        let reach_m = table.limits.reach_m;
        let stop = &self.stops[visit.stop];
        let [x, carried, root] = [STOP * visit.stop, visit.first + CARRIED, visit.first + ROOT];
        let away = (stop.point - table.sensors.position(visit.service.id)) / reach_m;
        // ρ + g ‖q − w‖² ≤ most, in units of the reach
        let slope = slope_bits * reach_m * reach_m / buffer_bits;
        let most = capacity_bits / buffer_bits + slope * away.norm_squared();
        let width = 2.0 * slope.sqrt();
        self.cones.cone(SecondOrderConeT(4));
        self.cones.row(most + 1.0, &[(carried, 1.0)]);
        self.cones.row(most - 1.0, &[(carried, 1.0)]);
        for axis in 0..2 {
            self.cones.row(width * away[axis], &[(x + axis, -width)]);
        }
        // u² ≤ x ρ
        self.cones.cone(SecondOrderConeT(3));
        self.cones.row(0.0, &[(x + SLOTS, -1.0), (carried, -1.0)]);
        self.cones.row(0.0, &[(x + SLOTS, -1.0), (carried, 1.0)]);
        self.cones.row(0.0, &[(root, -2.0)]);
    }
}

/// The factors of `−(τ_m − τ_{m−1} − x_m)` for stop m, whose slots are the variable `slots`.
fn between(index: usize, slots: usize) -> Vec<(usize, f64)> {
    let mut factors = vec![(STOP * index + END, -1.0), (slots, 1.0)];
    factors.extend(index.checked_sub(1).map(|before| (STOP * before + END, 1.0)));
    factors
}

/// The factors of the step from the stop before, along an axis.
fn between_points(index: usize, axis: usize) -> Vec<(usize, f64)> {
    let before = index.checked_sub(1).map(|before| (STOP * before + axis, 1.0));
    before.into_iter().chain([(STOP * index + axis, -1.0)]).collect()
}

/// What SN `id` stores [bit], at least a bit.
fn buffer_bits(table: &MissionTable, id: u32) -> f64 {
    f64::from(table.sensors.sampler(id).stored_bits().max(1))
}

/// The capacity of a link at a stop, and how fast it falls in the squared distance [bit, bit/m²]; `None` if from the
/// rim of the range, too, a slot carries a full buffer.
fn limit_of(flight: &Rehearsal, stop: &TimedStop, id: u32) -> Option<[f64; 2]> {
    let table = flight.view.table;
    let Disk { centre, radius_m } = range(table, id);
    let away = stop.point - centre;
    let along = away.try_normalize(0.0).unwrap_or_else(Vector2::x);
    let z_m = flight.view.position.z;
    let carried_bits = |d2_m2: f64| {
        let at: Position = centre + along * d2_m2.sqrt();
        table.channel.expected_rate_bps(&table.uplink(id, &above(&at, z_m))) * table.limits.comm_s
    };
    if carried_bits(radius_m * radius_m) >= buffer_bits(table, id) {
        return None;
    }
    let d2_m2 = away.norm_squared();
    let step_m2 = STEP * (d2_m2 + z_m * z_m);
    let [here_bits, farther_bits] = [d2_m2, d2_m2 + step_m2].map(carried_bits);
    Some([here_bits, ((here_bits - farther_bits) / step_m2).max(0.0)])
}
