//! `[base]` and `[uav.battery]`: where UAVs land and charge, and the energy that they carry (decisions D9 to D13).

use serde::{Deserialize, Serialize};

use crate::keys::{Accepts, NOT_NEGATIVE, POSITIVE};

crate::keys! {
    /// `[base]`: the disk, or the polygons, in which a UAV lands and charges (decision D9).
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct BaseKeys {
        /// Its centre, `[x, y]` [m]; the default is the start of the UAV, and a checked scenario has the key.
        position_m: Option<[f64; 2]>, Accepts::Rule("a position in the area");
        /// Its radius [m].
        radius_m: Option<f64> = 1.0, Accepts::Number("metres, 0.001 or above", |radius_m| radius_m >= 0.001 && radius_m.is_finite());
        /// Corners of polygons, `[[[x, y], ...], ...]` [m], instead of `position_m` and `radius_m`; a UAV may land in
        /// any of them.
        areas_m: Option<Vec<Vec<[f64; 2]>>>, Accepts::Rule("a list of polygons, `[[[x, y], [x, y], [x, y], ...], ...]` [m]");
        /// Power of the charger [W]; at 0 a UAV only lands.
        charge_w: f64 = 0.0, NOT_NEGATIVE;
    }
}

impl Default for BaseKeys {
    fn default() -> Self {
        Self { position_m: None, radius_m: Some(1.0), areas_m: None, charge_w: 0.0 }
    }
}

/// Capacities in which the energy of a slot is not lost in rounding.
const CAPACITY_J: Accepts =
    Accepts::Number("joules above 0, at most 1e12", |capacity_j| capacity_j > 0.0 && capacity_j <= 1e12);

crate::keys! {
    /// `[uav.battery]`: the energy of the UAV (decision D10).
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct BatteryKeys {
        /// Energy of the full battery [J]; required.
        capacity_j: f64, CAPACITY_J;
        /// Energy before slot 1, as a fraction of the capacity.
        initial: f64 = 1.0, Accepts::Number("0 to 1", |fraction| (0.0..=1.0).contains(&fraction));
        /// Energy that the way home leaves in the battery, as a fraction of the capacity.
        reserve: f64 = 0.1, Accepts::Number("0 or above, below 1", |fraction| (0.0..1.0).contains(&fraction));
        /// Weight of the UAV, `w` [N]: a climb of 1 m takes `w` joules.
        weight_n: f64 = 20.0, POSITIVE;
    }
}
