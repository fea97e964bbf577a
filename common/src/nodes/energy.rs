//! The batteries of the sensor nodes (SNs), in whole nanojoules: what a slot takes of them, and deaths (decision D33).
//!
//! `initial + harvested = used + spilled + left` holds as an equality of integers. What a dead SN loses is left to
//! [`crate::ledger`].

pub(super) mod harvest;
mod keys;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use harvest::HarvestTrace;
pub use keys::{NodeEnergyKeys, WakeMode};

use super::keys::NodeKeys;
use super::model::{Answer, NodeModel, NodeService, SlotEnd};
use super::row::{Declared, NodeColumn, NodeFile, NodeSetup, NodeTraits};
use crate::checkpoint::{CheckpointError, decode_first, encode};
use crate::error::InputError;
use crate::geometry::{Position, within};
use crate::keys::{NOT_NEGATIVE, Rule};
use crate::per_sensor::PerSensor;
use crate::queues::blocks;
use crate::simd::BLOCK;
use keys::CAPACITY_J;

/// The battery of an SN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeBattery {
    /// Energy of the full battery [J].
    pub capacity_j: f64,
    /// Harvested power [W].
    pub harvest_w: f64,
}

/// An energy [J] in whole nanojoules.
fn nanojoules(energy_j: f64) -> u64 {
    (energy_j * 1e9).round() as u64 // saturates
}

/// The energy of all SNs since the mission's start [nJ].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct NodeEnergyTotals {
    /// In the batteries before slot 1.
    pub initial_nj: u128,
    /// Harvested.
    pub harvested_nj: u128,
    /// Taken by sleeping, sampling, listening and services.
    pub used_nj: u128,
    /// Harvested into full batteries.
    pub spilled_nj: u128,
}

/// The charges of all SNs.
#[derive(Debug, Clone, PartialEq)]
pub struct Charges {
    keys: NodeEnergyKeys,
    slot_s: f64,
    /// Taken in each slot, and of a slot of listening, if not all slots are [nJ].
    slot_nj: u64,
    listen_nj: u64,
    /// Where the SNs are, and from how far a UAV wakes them [m].
    positions: Arc<[Position]>,
    radius_m: f64,
    capacity_nj: PerSensor<u64>,
    harvest_nj: PerSensor<u64>,
    /// What SNs harvest instead.
    harvest: Option<HarvestTrace>,
    /// Left, by id [nJ]; 0 in a dead SN.
    charge_nj: Vec<u64>,
    totals: NodeEnergyTotals,
    /// Number of dead SNs, and the slots in which the first died, and half of all were dead.
    dead: usize,
    first_death: Option<u64>,
    half_dead: Option<u64>,
    /// Bits that dead SNs have lost.
    lost_bits: u64,
}

impl Charges {
    /// The charges before slot 1 of SNs with these batteries at `positions`, which harvest by `harvest` if there is
    /// one, in slots of `slot_s` [s], and which a UAV wakes from `radius_m` [m].
    #[must_use]
    pub fn new(
        keys: NodeEnergyKeys,
        slot_s: f64,
        batteries: &[NodeBattery],
        harvest: Option<HarvestTrace>,
        positions: impl Iterator<Item = Position>,
        radius_m: f64,
    ) -> Self {
        let sleep_nj = nanojoules(keys.sleep_w * slot_s);
        let listen_nj = nanojoules(keys.listen_w.unwrap_or_default() * slot_s);
        let capacities_nj = batteries.iter().map(|battery| nanojoules(battery.capacity_j).max(1));
        let initial_nj = |capacity_nj: u64| ((capacity_nj as f64 * keys.initial).round() as u64).clamp(1, capacity_nj);
        let charge_nj: Vec<u64> = capacities_nj.clone().map(initial_nj).collect();
        let totals = NodeEnergyTotals { initial_nj: sum(&charge_nj), ..NodeEnergyTotals::default() };
        let is_listening = keys.wake == Some(WakeMode::Always);
        let is_woken = keys.wake == Some(WakeMode::Scheduled);
        Self {
            slot_nj: if is_listening { sleep_nj.saturating_add(listen_nj) } else { sleep_nj },
            listen_nj: if is_woken { listen_nj } else { 0 },
            positions: if is_woken { positions.collect() } else { Arc::default() },
            radius_m,
            capacity_nj: PerSensor::new(capacities_nj.collect()),
            harvest_nj: PerSensor::new(batteries.iter().map(|own| nanojoules(own.harvest_w * slot_s)).collect()),
            harvest,
            charge_nj,
            totals,
            dead: 0,
            first_death: None,
            half_dead: None,
            lost_bits: 0,
            keys,
            slot_s,
        }
    }

    /// What is left, by id [nJ]; 0 in a dead SN.
    pub fn charges_nj(&self) -> &[u64] {
        &self.charge_nj
    }

    /// What is left, by id, as a fraction of the capacity.
    pub fn fractions(&self) -> impl Iterator<Item = f64> {
        self.charge_nj.iter().enumerate().map(|(id, &nj)| nj as f64 / self.capacity_nj.of(id) as f64)
    }

    /// The sums since the mission's start.
    pub fn totals(&self) -> NodeEnergyTotals {
        self.totals
    }

    /// Whether all energy is accounted for.
    pub fn is_balanced(&self) -> bool {
        let NodeEnergyTotals { initial_nj, harvested_nj, used_nj, spilled_nj, .. } = self.totals;
        let given_nj = initial_nj.checked_add(harvested_nj);
        given_nj.is_some()
            && given_nj == used_nj.checked_add(spilled_nj).and_then(|nj| nj.checked_add(sum(&self.charge_nj)))
    }

    /// What the mission came to by now.
    pub fn summed_up(&self, delivered_bits: u64) -> NodeEnergyUse {
        let at_s = |slot: Option<u64>| slot.map(|slot| slot as f64 * self.slot_s);
        NodeEnergyUse {
            used_j: self.totals.used_nj as f64 / 1e9,
            harvested_j: (self.totals.harvested_nj - self.totals.spilled_nj) as f64 / 1e9,
            energy_per_bit_j: (delivered_bits > 0).then(|| self.totals.used_nj as f64 / 1e9 / delivered_bits as f64),
            residual_min: self.fractions().fold(1.0, f64::min),
            residual_mean: self.fractions().sum::<f64>() / self.charge_nj.len() as f64,
            dead: self.dead,
            first_death_s: at_s(self.first_death),
            half_dead_s: at_s(self.half_dead),
            lost_to_death_bits: self.lost_bits,
        }
    }

    /// Takes up to `use_nj` [nJ] from the battery of SN `sensor`.
    fn take(&mut self, sensor: usize, use_nj: u64) {
        let taken_nj = use_nj.min(self.charge_nj[sensor]);
        self.charge_nj[sensor] -= taken_nj;
        self.totals.used_nj += u128::from(taken_nj);
    }

    /// Ends `slot` for the live SN `sensor`, which has sampled `bits` [bit], with `uavs` that wake those in range:
    /// first it uses energy, then it harvests. Returns whether it dies.
    fn end_slot_of(&mut self, slot: u64, sensor: usize, bits: u64, uavs: &[Position]) -> bool {
        let is_near = |uav: &Position| within(&self.positions[sensor], uav, self.radius_m);
        let listen_nj = if self.listen_nj > 0 && uavs.iter().any(is_near) { self.listen_nj } else { 0 };
        let sample_nj = nanojoules(self.keys.sample_j_per_bit * bits as f64);
        self.take(sensor, self.slot_nj.saturating_add(listen_nj).saturating_add(sample_nj));
        if self.charge_nj[sensor] == 0 {
            self.dead += 1;
            self.first_death.get_or_insert(slot);
            if 2 * self.dead >= self.charge_nj.len() {
                self.half_dead.get_or_insert(slot);
            }
            return true;
        }
        let of_file_w = self.harvest.as_ref().and_then(|harvest| harvest.harvest_w(slot, sensor));
        let harvest_nj = of_file_w.map_or_else(|| self.harvest_nj.of(sensor), |own_w| nanojoules(own_w * self.slot_s));
        let stored_nj = harvest_nj.min(self.capacity_nj.of(sensor) - self.charge_nj[sensor]);
        self.charge_nj[sensor] += stored_nj;
        self.totals.harvested_nj += u128::from(harvest_nj);
        self.totals.spilled_nj += u128::from(harvest_nj - stored_nj);
        false
    }
}

impl NodeModel for Charges {
    fn answer(&self, sensor: usize) -> Answer {
        if self.charge_nj[sensor] == 0 { Answer::Dead } else { Answer::Queue }
    }

    fn may_refuse(&self) -> bool {
        true
    }

    /// The SN wakes, and sends.
    fn serve(&mut self, service: &NodeService) {
        let NodeService { sensor, bits, rate_bps, .. } = *service;
        let sent_s = if bits > 0 { bits as f64 / rate_bps } else { 0.0 };
        self.take(sensor, nanojoules(self.keys.wake_j.unwrap_or_default() + self.keys.tx_w * sent_s));
    }

    fn discard(&mut self, _sensor: usize, bits: u32) {
        self.lost_bits += u64::from(bits);
    }

    /// Batteries are used and charged, and an SN whose battery is empty dies (decision D33). What a dead one samples is
    /// lost.
    fn end_slot(&mut self, end: &SlotEnd<'_>, died: &mut Vec<u32>) {
        for sensors in blocks(self.charge_nj.len()) {
            let mut bits = [0; BLOCK];
            end.sampling.fill(end.slot, sensors.clone(), &mut bits[..sensors.len()]);
            for (sensor, bits) in sensors.zip(bits) {
                if end.was_dead(sensor) {
                    self.lost_bits += bits;
                } else if self.end_slot_of(end.slot, sensor, bits, end.uavs) {
                    died.push(sensor as u32); // a scenario has at most 10^7 SNs
                }
            }
        }
    }

    fn level(&self, sensor: usize) -> Option<f64> {
        Some(self.charge_nj[sensor] as f64 / self.capacity_nj.of(sensor) as f64)
    }

    fn most_bytes(&self) -> usize {
        size_of::<u64>() * self.charge_nj.len()
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        let Self { totals, first_death, half_dead, lost_bits, .. } = *self;
        let charge_nj = bytemuck::cast_slice(&self.charge_nj).to_vec();
        encode(&SavedCharges { charge_nj, totals, first_death, half_dead, lost_bits }, bytes);
    }

    fn restore(&mut self, slot: u64, _queues_bits: &[u32], bytes: &mut &[u8]) -> Result<(), CheckpointError> {
        let (saved, left) = decode_first(bytes)?;
        let SavedCharges { charge_nj, totals, first_death, half_dead, lost_bits } = saved;
        let charge_nj: Vec<u64> = bytemuck::pod_collect_to_vec(&charge_nj);
        let dead = charge_nj.iter().filter(|&&nj| nj == 0).count();
        let restored = Self { charge_nj, totals, dead, first_death, half_dead, lost_bits, ..self.clone() };
        let fits = |(id, &nj): (usize, &u64)| nj <= self.capacity_nj.of(id);
        let is_possible = restored.charge_nj.len() == self.charge_nj.len()
            && restored.charge_nj.iter().enumerate().all(fits)
            && totals.initial_nj == self.totals.initial_nj
            && restored.is_balanced()
            && first_death.is_some() == (dead > 0)
            && half_dead.is_some() == (2 * dead >= self.charge_nj.len())
            && [first_death, half_dead].iter().flatten().all(|death| (1..=slot).contains(death));
        CheckpointError::ensure(is_possible, "possible charges of this field")?;
        *self = restored;
        *bytes = left;
        Ok(())
    }
}

impl Declared for Charges {
    const KEY: &'static str = "[sensors.energy]";

    const COLUMNS: &'static [NodeColumn] = &[
        NodeColumn {
            name: "capacity_j",
            key: "sensors.energy.capacity_j",
            accepts: CAPACITY_J,
            words: "battery of the SN, only with `[sensors.energy]`",
            of_keys: |sensors| sensors.energy.as_ref()?.capacity_j,
        },
        NodeColumn {
            name: "harvest_w",
            key: "sensors.energy.harvest_w",
            accepts: NOT_NEGATIVE,
            words: "harvested power of the SN, only with `[sensors.energy]`",
            of_keys: |sensors| Some(sensors.energy.as_ref()?.harvest_w),
        },
    ];

    const FILE: Option<NodeFile> = Some(NodeFile {
        name: "harvest.csv",
        key: "sensors.energy.harvest_file",
        of_keys: |sensors| sensors.energy.as_mut()?.harvest_file.as_mut(),
    });

    const UNPLANNED: Option<&'static str> =
        Some("batteries of sensor nodes: deaths, when they are known, but no charges");

    fn traits(keys: &NodeKeys<'_>) -> Option<NodeTraits> {
        let _ = keys.sensors.energy.as_ref()?;
        let traits = NodeTraits { may_refuse: true, loses_initial: true, ..NodeTraits::default() };
        Some(NodeTraits { may_die: true, has_level: true, ..traits })
    }

    fn check(keys: &NodeKeys<'_>, rule: Rule<'_>) -> Result<(), InputError> {
        let Some(energy) = &keys.sensors.energy else { return Ok(()) };
        let is_listening = matches!(energy.wake, Some(WakeMode::Always | WakeMode::Scheduled));
        let expected = "none without wake = \"always\" or \"scheduled\"";
        rule(is_listening || energy.listen_w.is_none(), "sensors.energy.listen_w", expected)?;
        let expected = "listen_w, the power of listening, beside it";
        rule(!is_listening || energy.listen_w.is_some(), "sensors.energy.wake", expected)?;
        let has_radio = energy.wake == Some(WakeMode::Radio);
        let expected = "wake_j, the energy of a service, beside it";
        rule(!has_radio || energy.wake_j.is_some(), "sensors.energy.wake", expected)?;
        let has_capacity = energy.capacity_j.is_some() || keys.sensors.file.is_some();
        rule(has_capacity, "sensors.energy", "capacity_j in it, or a column of that name in sensors.file")
    }

    fn make(setup: &NodeSetup<'_>) -> Option<Self> {
        let keys = setup.keys.sensors.energy.clone()?;
        let [capacities_j, harvests_w] = ["capacity_j", "harvest_w"].map(setup.column);
        let battery = |(&capacity_j, &harvest_w): (&f64, &f64)| NodeBattery { capacity_j, harvest_w };
        let batteries: Vec<NodeBattery> = capacities_j.iter().zip(harvests_w).map(battery).collect();
        let positions = (0..batteries.len()).map(setup.position);
        let radius_m = setup.keys.link.comm_radius_m;
        Some(Self::new(keys, setup.keys.slot_s, &batteries, setup.file.cloned(), positions, radius_m))
    }
}

/// The sum of charges [nJ].
fn sum(charge_nj: &[u64]) -> u128 {
    charge_nj.iter().copied().map(u128::from).sum()
}

/// The checkpoint of charges.
#[derive(Serialize, Deserialize)]
struct SavedCharges {
    /// `u64` by sensor node, in native byte order.
    #[serde(with = "serde_bytes")]
    charge_nj: Vec<u8>,
    totals: NodeEnergyTotals,
    first_death: Option<u64>,
    half_dead: Option<u64>,
    lost_bits: u64,
}

/// What the batteries of the sensor nodes gave in a mission, and which are dead, as in `summary.json`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NodeEnergyUse {
    /// Taken by all sensor nodes [J].
    pub used_j: f64,
    /// Harvested by all of them [J], without what full batteries spilled.
    pub harvested_j: f64,
    /// Taken for each bit delivered [J]; `None` if none was.
    pub energy_per_bit_j: Option<f64>,
    /// Least energy left, as a fraction of the capacity.
    pub residual_min: f64,
    /// Mean energy left, as a fraction of the capacity.
    pub residual_mean: f64,
    /// Sensor nodes that are dead.
    pub dead: usize,
    /// The time at whose end the first died [s]; `None` if none did.
    pub first_death_s: Option<f64>,
    /// The time at whose end half of them were dead [s]; `None` if they are not.
    pub half_dead_s: Option<f64>,
    /// Bits that dead sensor nodes held or have sampled, a part of `lost_bits`.
    pub lost_to_death_bits: u64,
}

#[cfg(test)]
mod tests;
