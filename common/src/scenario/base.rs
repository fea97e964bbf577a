//! `[base]` and `[uav.battery]`: where UAVs land and charge, and the energy that they carry (decisions D9 to D13 and
//! D34).

use serde::{Deserialize, Serialize};

use super::area::CORNERS;
use crate::base::Charger;
use crate::keys::{Accepts, NOT_NEGATIVE, POSITIVE};
use crate::slack::SLOTS_SLACK;

/// Radii of bases.
const RADIUS_M: Accepts =
    Accepts::Number("metres, 0.001 or above", |radius_m| radius_m >= 0.001 && radius_m.is_finite());

crate::keys! {
    /// `[base]`: the disk, or the polygons, in which a UAV lands and charges (decision D9).
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct BaseKeys {
        /// Its centre, `[x, y]` [m]; the default is the start of the UAV, and a checked scenario has the key.
        position_m: Option<[f64; 2]>, Accepts::Rule("a position in the area");
        /// Its radius [m].
        radius_m: Option<f64> = 1.0, RADIUS_M;
        /// Corners of polygons, `[[[x, y], ...], ...]` [m], instead of `position_m` and `radius_m`; a UAV may land in
        /// any of them.
        areas_m: Option<Vec<Vec<[f64; 2]>>>,
            Accepts::Rule("a list of polygons, `[[[x, y], [x, y], [x, y], ...], ...]` [m]");
        /// Power of the charger [W]; at 0 a UAV only lands.
        charge_w: f64 = 0.0, NOT_NEGATIVE;
        /// `[[base.site]]`: several bases, each with a charger of its own, instead of the other keys (decision D34).
        site: Option<Vec<SiteKeys>>, Accepts::TablesOf(SiteKeys::KEYS);
    }
}

impl Default for BaseKeys {
    fn default() -> Self {
        Self { position_m: None, radius_m: Some(1.0), areas_m: None, charge_w: 0.0, site: None }
    }
}

/// Pads of a site by default.
const PADS: u32 = 64;

crate::keys! {
    /// `[[base.site]]`: one of several bases, with its charger (decision D34).
    #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct SiteKeys {
        /// Centre of a disk, `[x, y]` [m]; required without `area_m`.
        position_m: Option<[f64; 2]>, Accepts::Rule("a position in the area");
        /// Its radius [m]; default 1.
        radius_m: Option<f64>, RADIUS_M;
        /// Corners of a polygon, `[[x, y], ...]` [m], instead of `position_m` and `radius_m`.
        area_m: Option<Vec<[f64; 2]>>, CORNERS;
        /// Power of its charger [W]; default 0: a UAV only lands.
        charge_w: Option<f64>, NOT_NEGATIVE;
        /// UAVs that charge there at the same time; default 64. Others have landed, and wait.
        pads: Option<u32>, Accepts::Whole(1, 64);
        /// Time after which the battery of a UAV that stays there is full [s], instead of `charge_w`.
        swap_s: Option<f64>, POSITIVE;
    }
}

impl SiteKeys {
    /// Its radius [m].
    pub fn radius_m(&self) -> f64 {
        self.radius_m.unwrap_or(1.0)
    }

    /// What it gives to a UAV that stays in it, in slots of `slot_s` [s].
    pub fn charger(&self, slot_s: f64) -> Charger {
        Charger {
            charge_w: self.charge_w.unwrap_or_default(),
            swap_slots: self.swap_s.map(|swap_s| (swap_s / slot_s - SLOTS_SLACK).ceil() as u64), // saturates
            pads: self.pads.unwrap_or(PADS),
        }
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
