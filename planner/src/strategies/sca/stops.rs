//! The stops of a flight: where it serves, for how long, and whom.

use skysink_common::geometry::Position;

use super::rehearsal::{FlownSlot, Rehearsal};
use crate::geometry::disks::{Disk, project};
use crate::mission_table::MissionTable;

/// Most of a buffer that fills during a stop: the cone program takes all that it serves as served at its end.
const FILLED: f64 = 0.25;

/// The service of a sensor node (SN) in a slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FlownService {
    pub id: u32,
    /// What it uploads [bit].
    pub bits: u64,
    /// What its link carries [bit].
    pub carried_bits: u64,
}

/// Slots that follow on each other and serve the same SNs.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TimedStop {
    pub point: Position,
    /// The services, one for each SN, ascending by id; bits are those of its last slot.
    pub services: Vec<FlownService>,
    /// The slots in which it serves.
    pub slots: f64,
    /// The flight to it, less than a slot of which is never saved at once [slots].
    pub flight_slots: f64,
    /// Its end, since the flight began [slots].
    pub end_slots: f64,
}

impl TimedStop {
    pub fn ids(&self) -> Vec<u32> {
        self.services.iter().map(|service| service.id).collect()
    }

    pub fn whole_slots(&self) -> u64 {
        self.slots.round().max(1.0) as u64
    }

    /// The least slots in which all its SNs have a turn.
    pub fn least_slots(&self, table: &MissionTable) -> f64 {
        self.services.len().max(1).div_ceil(table.limits.blocks().max(1)) as f64
    }
}

pub(super) fn range(table: &MissionTable, id: u32) -> Disk {
    Disk { centre: *table.sensors.position(id), radius_m: table.limits.comm_radius_m }
}

/// The stops of a flight, without services that save nothing.
pub(super) fn stops_of(flight: &Rehearsal) -> Vec<TimedStop> {
    let is_kept = kept_services(flight);
    let table = flight.view.table;
    let mut stops: Vec<TimedStop> = Vec::new();
    let mut last = None;
    for (index, FlownSlot { end, services }) in flight.flown.iter().enumerate() {
        let kept = services.iter().enumerate().filter(|(place, _)| is_kept[index][*place]);
        let mut services: Vec<FlownService> = kept.map(|(_, service)| *service).collect();
        if services.is_empty() {
            continue;
        }
        services.sort_by_key(|service| service.id);
        let adjoins = last.is_some_and(|last: usize| last + 1 == index);
        last = Some(index);
        let begin = stops.last().map_or((flight.view.ground(), 0.0), |stop| (stop.point, stop.end_slots));
        let slot = index as f64 + 1.0;
        match stops.last_mut() {
            Some(stop) if adjoins && goes_on(table, stop, end, &services) => {
                join(stop, &services);
                stop.point = *end;
                stop.end_slots = slot;
                stop.slots += 1.0;
            }
            _ => {
                let least = ((end - begin.0).norm() / table.limits.reach_m).ceil().max(1.0);
                let flight_slots = (slot - begin.1).min(least);
                stops.push(TimedStop { point: *end, services, slots: 1.0, flight_slots, end_slots: slot });
            }
        }
    }
    stops
}

/// Whether a slot that ends at `end` goes on with a stop: it serves an SN again, one point is in range of all, and
/// their buffers hold what is sampled meanwhile.
fn goes_on(table: &MissionTable, stop: &TimedStop, end: &Position, services: &[FlownService]) -> bool {
    let is_again = |service: &FlownService| stop.services.iter().any(|other| other.id == service.id);
    let all = stop.services.iter().chain(services);
    let ranges: Vec<Disk> = all.map(|service| range(table, service.id)).collect();
    let is_short = |id: u32| stop.slots + 1.0 <= FILLED * table.sensors.sampler(id).fill_slots();
    let all_short = stop.services.iter().chain(services).all(|service| is_short(service.id));
    all_short && services.iter().any(is_again) && project(end, &ranges).is_some()
}

fn join(stop: &mut TimedStop, services: &[FlownService]) {
    for service in services {
        match stop.services.binary_search_by_key(&service.id, |other| other.id) {
            Ok(place) => stop.services[place] = *service,
            Err(place) => stop.services.insert(place, *service),
        }
    }
}

/// Which services of each slot are needed: for each SN they are left out one after another, those that upload least
/// first, as long as no more is lost.
fn kept_services(flight: &Rehearsal) -> Vec<Vec<bool>> {
    let mut is_kept: Vec<Vec<bool>> = flight.flown.iter().map(|slot| vec![true; slot.services.len()]).collect();
    let mut by_sensor: Vec<Vec<(usize, usize)>> = vec![Vec::new(); flight.view.table.sensors.count()];
    for (index, slot) in flight.flown.iter().enumerate() {
        for (place, service) in slot.services.iter().enumerate() {
            by_sensor[service.id as usize].push((index, place));
        }
    }
    for (id, places) in (0..).zip(&by_sensor).filter(|(_, places)| !places.is_empty()) {
        let service = |&(index, place): &(usize, usize)| flight.flown[index].services[place];
        let mut kept: Vec<bool> = places.iter().map(|place| service(place).bits > 0).collect();
        let lost_bits = |kept: &[bool]| {
            let visits = places.iter().zip(kept).filter(|(_, kept)| **kept);
            lost_bits(flight, id, visits.map(|(place, _)| (place.0 as f64 + 1.0, service(place).carried_bits as f64)))
        };
        let least_bits = lost_bits(&kept);
        let mut order: Vec<usize> = (0..places.len()).filter(|&visit| kept[visit]).collect();
        order.sort_by_key(|&visit| (service(&places[visit]).bits, visit));
        for visit in order {
            kept[visit] = false;
            kept[visit] = lost_bits(&kept) > least_bits;
        }
        places.iter().zip(&kept).for_each(|(&(index, place), &kept)| is_kept[index][place] = kept);
    }
    is_kept
}

/// What SN `id` loses [bit] that is served in these slots by links that carry so much [bit].
fn lost_bits(flight: &Rehearsal, id: u32, visits: impl Iterator<Item = (f64, f64)>) -> f64 {
    let sampler = flight.view.table.sensors.sampler(id);
    let capacity_bits = f64::from(sampler.stored_bits());
    let mut queue_bits = f64::from(flight.view.belief.queues_bits[id as usize]);
    let mut lost_bits = 0.0;
    let mut since = 0.0;
    for (slot, carried_bits) in visits.chain([(flight.slots as f64, 0.0)]) {
        queue_bits += sampler.mean_bits * (slot - since);
        lost_bits += (queue_bits - capacity_bits).max(0.0);
        queue_bits = (queue_bits.min(capacity_bits) - carried_bits).max(0.0);
        since = slot;
    }
    lost_bits + if flight.collects { queue_bits } else { 0.0 }
}
