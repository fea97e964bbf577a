//! Known or estimated sampling of sensor nodes (SNs), and their deadlines, the times of overflow.

use super::{Setup, View};

/// The sampling of all SNs.
pub(super) struct Sampling {
    /// Sampled per slot, `s_i τ` [bit], by id.
    mean_bits: Vec<f64>,
    /// Buffers, `B` [bit], by id.
    capacity_bits: Vec<u32>,
}

impl Sampling {
    /// The sampling of the SNs of a mission.
    pub fn new(setup: &Setup) -> Self {
        let mean_bits = setup.sensors.iter().map(|sensor| sensor.sampling_bps * setup.scenario.slot_s).collect();
        Self { mean_bits, capacity_bits: setup.sensors.iter().map(|sensor| sensor.capacity_bits).collect() }
    }

    /// Known or estimated bits per slot of SN `id`; `None` if it does not sample.
    pub fn mean_bits(&self, view: &View, id: u32) -> Option<f64> {
        let mean_bits = view.estimate.map_or(self.mean_bits[id as usize], |estimate| estimate.mean_bits(id));
        (mean_bits > 0.0).then_some(mean_bits)
    }

    /// Buffer of SN `id` [bit].
    pub fn capacity_bits(&self, id: u32) -> u32 {
        self.capacity_bits[id as usize]
    }

    /// Slots until SN `id` overflows: the room in its buffer divided by its bits per slot; `None` if it does not
    /// sample.
    pub fn deadline_slots(&self, view: &View, id: u32) -> Option<f64> {
        let room_bits = f64::from(self.capacity_bits(id)) - f64::from(view.queues_bits[id as usize]);
        self.mean_bits(view, id).map(|mean_bits| room_bits / mean_bits)
    }
}
