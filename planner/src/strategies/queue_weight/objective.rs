//! The objective of `queue_weight`, and the best set of sensor nodes (SNs) for a waypoint.

use std::cmp::Reverse;

use arrayvec::ArrayVec;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use skysink_common::channel::{ChannelModel, Uplink};
use skysink_common::message::MAX_SERVED;
use strum::VariantNames;

use crate::mission_table::MissionTable;
use crate::strategy::View;

/// The service of an SN [bit], by which its queue is multiplied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Service {
    /// What is uploaded, `min(Q_i, floor(r_i τ_c))`.
    Upload,
    /// What the link carries, `floor(r_i τ_c)`.
    Capacity,
}

pub(super) struct QueueWeightObjective {
    /// Price of energy, V [bit²/J].
    pub(super) price_bits2_per_j: f64,
    pub(super) service: Service,
    /// The terms of the SNs in range [bit²], with their ids; working memory.
    pub(super) terms: Vec<(Reverse<u64>, u32)>,
}

impl QueueWeightObjective {
    /// Whether the objective is the plain one of `max-weight`.
    pub(super) fn is_plain(&self) -> bool {
        self.price_bits2_per_j == 0.0 && self.service == Service::Upload
    }

    /// Whether links empty the queues of `ids` from every point in range at the UAV's altitude: the service does not
    /// depend on the waypoint.
    pub(super) fn is_level(&self, view: &View, ids: &[u32]) -> bool {
        let MissionTable { sensors, channel, limits, .. } = view.table;
        self.service == Service::Upload
            && ids.iter().all(|&id| {
                let gain = sensors.gains[id as usize];
                let rim = channel.uplink_at(gain, limits.comm_radius_m.powi(2), view.position.z);
                let rim = Uplink { in_sight: !channel.depends_on_place(), ..rim };
                let capacity_bits = channel.capacity_bits(channel.expected_rate_bps(&rim));
                capacity_bits > u64::from(view.belief.queues_bits[id as usize]) // more: the slack of decision D5
            })
    }

    /// The term of SN `id` with the UAV at `uav` [bit²]: queue times service, times its weight (decision D25). Terms
    /// above 2^64 − 1 count as that.
    pub(super) fn term_bits2(&self, view: &View, uav: &Point3<f64>, id: u32) -> u64 {
        let table = view.table;
        let queue_bits = u64::from(view.belief.queues_bits[id as usize]);
        let capacity_bits = table.capacity_bits(id, uav);
        let term_bits2 = queue_bits.saturating_mul(match self.service {
            Service::Upload => capacity_bits.min(queue_bits),
            Service::Capacity => capacity_bits,
        });
        let weights = &table.sensors.weights;
        if weights.are_equal() { term_bits2 } else { (term_bits2 as f64 * weights.of(id as usize)) as u64 }
    }

    /// The energy [J] of flying to `uav` in the slot.
    pub(super) fn energy_j(&self, view: &View, uav: &Point3<f64>) -> f64 {
        view.table.motion.battery().flight_j(&(uav - view.position))
    }

    /// The objective [bit²] at `uav`, with the SNs that contribute `terms_bits2`.
    pub(super) fn value(&self, view: &View, uav: &Point3<f64>, terms_bits2: impl Iterator<Item = u64>) -> f64 {
        let sum_bits2: u128 = terms_bits2.map(u128::from).sum();
        let price = if self.price_bits2_per_j > 0.0 { self.price_bits2_per_j * self.energy_j(view, uav) } else { 0.0 };
        sum_bits2 as f64 - price
    }

    /// The objective [bit²] at `uav` with the SNs `ids`.
    pub(super) fn value_of(&self, view: &View, uav: &Point3<f64>, ids: &[u32]) -> f64 {
        self.value(view, uav, ids.iter().map(|&id| self.term_bits2(view, uav, id)))
    }

    /// The objective [bit²] at `uav` with the best set of SNs in range.
    pub(super) fn best_value(&mut self, view: &View, uav: &Point3<f64>) -> f64 {
        let mut terms = std::mem::take(&mut self.terms);
        terms.clear();
        view.table.sensors.grid.visit_within(&uav.xy(), view.table.limits.comm_radius_m, |node| {
            if view.answer(node.id).sends() {
                terms.push((Reverse(self.term_bits2(view, uav, node.id)), node.id));
            }
        });
        if terms.len() > view.table.limits.blocks() {
            terms.select_nth_unstable(view.table.limits.blocks());
            terms.truncate(view.table.limits.blocks());
        }
        let value = self.value(view, uav, terms.iter().map(|(Reverse(term), _)| *term));
        self.terms = terms;
        value
    }

    /// The best set of SNs in range of `uav`, ascending by id.
    pub(super) fn best_set(&mut self, view: &View, uav: &Point3<f64>) -> ArrayVec<u32, MAX_SERVED> {
        self.best_value(view, uav);
        let mut ids: ArrayVec<u32, MAX_SERVED> = self.terms.iter().map(|(_, id)| *id).collect();
        ids.sort_unstable();
        ids
    }
}
