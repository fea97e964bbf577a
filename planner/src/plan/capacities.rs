//! What visits carry, where that depends on the elevation or on the place, and the range of visits.

use std::borrow::Cow;

use skysink_common::channel::{ChannelModel, Uplink};
use skysink_common::scenario::Scenario;

use crate::mission_table::MissionTable;

/// Entries of the capacity table where the rate depends on the elevation, over `d²` from 0 to `d_c²`.
pub(super) const TABLE: usize = 64;

/// Entries for which the altitude is optimised: the inner fifth of the disk, from which most sensors are served.
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

/// Expected bits of a visit with a full buffer, over `d²`, from the altitude that is best for nearby sensors; of equals
/// the lowest.
///
/// The capacity of each draw is limited to the buffer: excess capacity of a good draw does not make up for a bad one.
pub(super) fn best_capacities_bits(scenario: &Scenario, table: &MissionTable, in_sight: bool) -> [f64; TABLE + 1] {
    let [low_m, high_m] =
        scenario.uav.climb().map_or([scenario.uav.altitude_m; 2], |climb| [climb.min_altitude_m, climb.max_altitude_m]);
    let rim_m2 = scenario.link.comm_radius_m * scenario.link.comm_radius_m;
    let buffers_bits = table.sensors.ids().map(|id| table.sensors.sampler(id).capacity_bits);
    let buffer_bits = u64::from(buffers_bits.max().unwrap_or(0));
    let taken_bits = |rate_bps: f64| table.channel.capacity_bits(rate_bps).min(buffer_bits) as f64;
    let gain = table.sensors.gains.iter().copied().fold(0.0, f64::max);
    let expected_bits = |d2_m2: f64, z_m: f64| {
        table.channel.mean_over_draws(&Uplink { in_sight, ..table.channel.uplink_at(gain, d2_m2, z_m) }, &taken_bits)
    };
    let level_bits = |level: u32| -> [f64; TABLE + 1] {
        let z_m = low_m + (high_m - low_m) * f64::from(level) / f64::from(LEVELS);
        std::array::from_fn(|step| expected_bits(rim_m2 * step as f64 / TABLE as f64, z_m))
    };
    let near_bits = |bits: &[f64; TABLE + 1]| bits[..=NEAR_STEPS].iter().sum::<f64>();
    let best = (0..=LEVELS).map(level_bits).reduce(|a, b| if near_bits(&b) > near_bits(&a) { b } else { a });
    best.expect("at least one level")
}
