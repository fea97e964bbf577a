//! What visits carry, where that depends on the elevation or on the place, and the range of visits.

use std::borrow::Cow;

use skysink_common::channel::{ChannelModel, Uplink};
use skysink_common::interpolation::interpolate;
use skysink_common::scenario::Scenario;

use crate::mission_table::MissionTable;

/// Entries of the capacity table where the rate depends on the elevation, over `d²` from 0 to `d_c²`.
pub(super) const TABLE: usize = 64;

/// Capacities by the squared distance, from 0 to that of the rim, in sight and not [bit].
pub type CapacityTable = [[f64; TABLE + 1]; 2];

/// The last entry of the inner fifth of the disk.
const NEAR_STEPS: usize = TABLE / 5;

/// Steps between the altitudes that are compared.
const LEVELS: u32 = 16;

/// Margin of the planned range for position errors, in standard deviations.
const MARGIN: f64 = 1.5;

/// Least planned range with that margin, as a fraction of the communication radius.
const LEAST_RANGE: f64 = 0.5;

/// The scenario with a smaller range, so that most slots end in the range of their visits with position errors, too.
pub(super) fn with_margin(scenario: &Scenario) -> Cow<'_, Scenario> {
    let Some(sigma_m) = scenario.uav.position_error_m else { return Cow::Borrowed(scenario) };
    let mut within = scenario.clone();
    let radius_m = &mut within.link.comm_radius_m;
    *radius_m = (*radius_m - MARGIN * sigma_m).max(*radius_m * LEAST_RANGE);
    Cow::Owned(within)
}

/// Expected bits of a visit with a full buffer, over `d²`, in sight and not, from the altitude from which most is taken
/// of [`nearest_by_entry`]; of equals the lowest.
///
/// The capacity of each draw is limited to the buffer: excess capacity of a good draw does not make up for a bad one.
pub(super) fn best_capacities_bits(scenario: &Scenario, table: &MissionTable) -> CapacityTable {
    let [low_m, high_m] =
        scenario.uav.climb().map_or([scenario.uav.altitude_m; 2], |climb| [climb.min_altitude_m, climb.max_altitude_m]);
    let rim_m2 = scenario.link.comm_radius_m * scenario.link.comm_radius_m;
    let buffers_bits = table.sensors.ids().map(|id| table.sensors.sampler(id).capacity_bits);
    let buffer_bits = u64::from(buffers_bits.max().unwrap_or(0));
    let taken_bits = |rate_bps: f64| table.channel.capacity_bits(rate_bps).min(buffer_bits) as f64;
    let gain = table.sensors.gains.iter().copied().fold(0.0, f64::max);
    let expected_bits = |d2_m2: f64, z_m: f64, in_sight: bool| {
        table.channel.mean_over_draws(&Uplink { in_sight, ..table.channel.uplink_at(gain, d2_m2, z_m) }, &taken_bits)
    };
    let altitude_bits = |z_m: f64, in_sight: bool| -> [f64; TABLE + 1] {
        std::array::from_fn(|step| expected_bits(rim_m2 * step as f64 / TABLE as f64, z_m, in_sight))
    };
    let (z_m, seen) = if low_m == high_m {
        (low_m, altitude_bits(low_m, true))
    } else {
        let nearest = nearest_by_entry(table, scenario.link.comm_radius_m);
        let levels_m = (0..=LEVELS).map(|level| interpolate(low_m, high_m, f64::from(level) / f64::from(LEVELS)));
        let levels = levels_m.map(|z_m| {
            let bits = altitude_bits(z_m, true);
            let taken_bits = bits.iter().zip(&nearest).map(|(bits, count)| bits * count).sum::<f64>();
            (taken_bits, z_m, bits)
        });
        let best = levels.reduce(|a, b| if b.0 > a.0 { b } else { a });
        let (_, z_m, bits) = best.expect("at least one level");
        (z_m, bits)
    };
    [seen, if table.channel.depends_on_place() { altitude_bits(z_m, false) } else { seen }]
}

/// Sensors by the entry of their squared distance: each as often in the inner fifth of its disk, from which most are
/// served, and the n − 1 nearest in range as far as they are from above it.
fn nearest_by_entry(table: &MissionTable, comm_radius_m: f64) -> [f64; TABLE + 1] {
    let mut nearest = [0.0; TABLE + 1];
    nearest[..=NEAR_STEPS].fill(table.sensors.count() as f64 / (NEAR_STEPS + 1) as f64);
    let rim_m2 = comm_radius_m * comm_radius_m;
    let mut away_m2: Vec<f64> = Vec::new();
    for id in table.sensors.ids() {
        away_m2.clear();
        table.sensors.grid.visit(table.sensors.position(id), comm_radius_m, |node, d2_m2| {
            if node.id != id {
                away_m2.push(d2_m2);
            }
        });
        let others = (table.limits.blocks() - 1).min(away_m2.len());
        if others < away_m2.len() {
            away_m2.select_nth_unstable_by(others, f64::total_cmp);
        }
        away_m2[..others].iter().for_each(|d2_m2| nearest[entry_at(*d2_m2, rim_m2)] += 1.0);
    }
    nearest
}

/// The entry of the capacity table at the squared distance `d2_m2` [m²], where that of the rim is `rim_m2`.
#[inline]
pub(super) fn entry_at(d2_m2: f64, rim_m2: f64) -> usize {
    ((d2_m2 / rim_m2 * TABLE as f64).round() as usize).min(TABLE)
}
