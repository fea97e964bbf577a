//! The registry of the channel models, and the keys of `[link]`.
//!
//! A model is a file of this folder, a variant of [`Channel`] and of [`LinkModel`], and its keys in [`LinkBudget`]. All
//! others use its properties, [`ChannelModel`]: the expected rate of an uplink, its slopes with the position of the
//! UAV, and its rate in a slot. Planners use the expected rate; only flight-sim draws.
//!
//! Levels are in dB in the keys and in the sensor list; messages and channels are linear.

mod beacons;
mod buildings;
mod fading;
mod free_space;
mod frozen;
mod line_of_sight;
mod map;
mod model;
mod radio_rates;
mod table;

use std::path::PathBuf;
use std::sync::Arc;

use enum_dispatch::enum_dispatch;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use strum::VariantNames;

pub use buildings::Buildings;
pub(crate) use fading::SHADOWING_DB;
pub use fading::{Fading, FadingModel, K_DB};
pub use free_space::{FreeSpace, GainMode, draw_gain_db};
pub use frozen::DrawnChannel;
pub use line_of_sight::{Environment, LineOfSight, LosCurve, Sight};
pub use map::{LinkLaw, LinkMap, LinkService, MapChannel};
pub use model::{ChannelModel, Draw, Slopes, Uplink, carried_bits};
pub use radio_rates::PathLoss;
pub use table::{RateTable, TableChannel};

use crate::geometry::{Position, distance_squared};
use crate::keys::{Accepts, Interval, LEVEL_DB, NOT_NEGATIVE, PATH, POSITIVE};
use crate::presets;
use crate::random::Streams;
use crate::units::{ratio_of_db, watts_of_dbm};

/// Most resource blocks of a UAV, and so most served sensor nodes in a message.
pub const MAX_RESOURCE_BLOCKS: usize = 64;

/// The channel of all uplinks of a mission, one resource block wide.
#[enum_dispatch(ChannelModel)]
#[derive(Debug, Clone, PartialEq)]
pub enum Channel {
    /// Free space, with one gain per sensor node.
    FreeSpace(FreeSpace),
    /// In or out of line of sight, by the elevation angle or a map of buildings, with one gain for all sensor nodes.
    LineOfSight(LineOfSight),
    /// A table of rates by distance and altitude, for all sensor nodes.
    Table(TableChannel),
    /// A map of SNRs or rates over positions of the UAV, by sensor node.
    Map(MapChannel),
}

/// Channel model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum LinkModel {
    /// Line of sight at a fixed altitude (UTS eq. 4).
    FreeSpace,
    /// At random in or out of line of sight (UTS section IV).
    ProbabilisticLos,
    /// In line of sight where no building is in the way.
    Buildings,
    /// The rates of a file, by distance, altitude and probability.
    Table,
    /// The SNRs or rates of a file, by sensor node and position of the UAV.
    Map,
}

/// Correlation distances.
const CORRELATION_M: Accepts = Accepts::Number("0, or a finite number from 0.001", |distance_m| {
    distance_m == 0.0 || (1e-3..=f64::MAX).contains(&distance_m)
});

/// Noise levels.
const NOISE_DBM: Accepts =
    Accepts::Number("a finite level below 0 dBm (and not below -300)", |noise_dbm| (-300.0..0.0).contains(&noise_dbm));

/// Margins of a link.
const MARGIN_DB: Accepts = Accepts::Number("-100 to 100 dB", |margin_db| (-100.0..=100.0).contains(&margin_db));

/// Signal-to-noise ratios.
const SNR_DB: Accepts = Accepts::Number("-300 to 300 dB", |snr_db| (-300.0..=300.0).contains(&snr_db));

/// Standard deviations of shadowing.
const SIGMA_DB: Accepts = Accepts::Number("0 to 20 dB", |sigma_db| SHADOWING_DB.contains(&sigma_db));

/// Path loss exponent of a law without one.
const LAW_EXPONENT: f64 = 2.5;

crate::keys! {
    /// `[link]`: the radio. Each channel model has its own keys.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct LinkBudget {
        /// A radio by name, such as `"lora-sf7"`: the rates of its row in "Which radio, which drone" as a `"table"`,
        /// `resource_blocks`, and `comm_radius_m`, the range from the lowest altitude. Keys beside it have priority.
        preset: Option<String>, Accepts::OneOf(presets::radios::NAMES);
        /// Path loss exponent of the radio.
        preset_exponent: Option<f64> = 2.5, line_of_sight::EXPONENT, presets::ONLY;
        /// Margin for fading and for the attitude of antennas [dB].
        preset_margin_db: Option<f64> = 15.0, MARGIN_DB, presets::ONLY;
        /// Standard deviation of log-normal shadowing [dB], redrawn in every slot; 0: none.
        preset_sigma_db: Option<f64> = 0.0, SIGMA_DB, presets::ONLY;
        /// Channel model; in `"table"` the rates of `file`, in `"map"` its links by place (decision D32), whatever
        /// bandwidth, power, noise and gains.
        model: LinkModel = "free-space", Accepts::OneOf(LinkModel::VARIANTS);
        /// Bandwidth of each resource block, `W` [Hz].
        bandwidth_hz: f64 = 5e6, POSITIVE;
        /// Transmission power of an SN, `p` [W].
        tx_power_w: f64 = 0.05, POSITIVE;
        /// Noise power, `σ²` [dBm], for any bandwidth.
        noise_dbm: Option<f64> = -100.0, NOISE_DBM;
        /// Noise power density [dBm/Hz], `σ²` for each hertz of `bandwidth_hz`; instead of `noise_dbm`. Thermal noise
        /// is -174, to which the noise figure of the receiver adds.
        noise_dbm_per_hz: Option<f64>, NOISE_DBM;
        /// Reference gain at 1 m, `α` [dB]; from an interval each SN draws its own, uniformly in dB.
        gain_db: Option<Interval> = [-55.0, -50.0], LEVEL_DB.or_interval(), free_space::ONLY;
        /// Whether `gain_db` is redrawn in every slot.
        gain: Option<GainMode> = "static", Accepts::OneOf(GainMode::VARIANTS), free_space::ONLY;
        /// Surroundings, with published curves, or `los`.
        environment: Option<Environment> = "urban", Accepts::OneOf(Environment::VARIANTS), line_of_sight::ONLY;
        /// Probability of line of sight over the elevation angle; instead of `environment`. Either
        /// `{ a = 12.08, b = 0.11 }` or `{ b1 = , b2 = , b3 = , b4 = }`.
        los: Option<LosCurve>, Accepts::TableOf(line_of_sight::LOS), line_of_sight::ONLY;
        /// Gain at 1 m of every SN, `β0` [dB].
        reference_gain_db: Option<f64> = -60.0, LEVEL_DB, line_of_sight::EITHER;
        /// Path loss exponent in line of sight, `α_L`.
        los_exponent: Option<f64> = 2.5, line_of_sight::EXPONENT, line_of_sight::EITHER;
        /// Path loss exponent out of line of sight, `α_N`.
        nlos_exponent: Option<f64> = 3.5, line_of_sight::EXPONENT, line_of_sight::EITHER;
        /// Additional gain out of line of sight, `μ` [dB].
        nlos_extra_db: Option<f64> = -20.0, LEVEL_DB, line_of_sight::EITHER;
        /// SNR gap of a real modem, `Γ` [dB].
        snr_gap_db: Option<f64> = 8.2, line_of_sight::GAP_DB, line_of_sight::EITHER;
        /// Standard deviations of log-normal shadowing in and out of line of sight [dB], redrawn in every slot; absent:
        /// none.
        shadowing_db: Option<[f64; 2]>, Accepts::Rule("[in, out of line of sight], 0 to 20 dB each"), buildings::ONLY;
        /// Correlation distance [m] of a line of sight that stays for the mission; 0 or absent: redrawn in every slot.
        los_correlation_m: Option<f64>, CORRELATION_M, line_of_sight::ONLY;
        /// CSV file with the columns `distance_m,altitude_m,probability,rate_bps`: the rates [bit/s] that a link does
        /// not exceed with these probabilities, at a grid of horizontal distances and altitudes of the UAV. In `"map"`
        /// the columns `sensor,x_m,y_m,z_m,snr_db`, or `rate_bps`: the links of an SN, by name or id, or of all others,
        /// at a grid of positions of the UAV; or `.npz` of arrays.
        file: Option<PathBuf>, PATH, table::FILE;
        /// CSV file with the columns `snr_db,rate_bps`: the SNRs [dB] from which on each rate [bit/s] is carried.
        rates: Option<PathBuf>, PATH, map::ONLY;
        /// Standard deviation of the SNR about that of the map [dB]; 0 or absent: none.
        residual_db: Option<f64>, SIGMA_DB, map::ONLY;
        /// Correlation distance [m] of a residual that stays for the mission; 0 or absent: redrawn in every slot.
        residual_m: Option<f64>, CORRELATION_M, map::ONLY;
        /// The link that counts: from the waypoint, `"waypoint"`, or at the end of the slot before, `"observed"`;
        /// `"waypoint"` if absent.
        service: Option<LinkService>, Accepts::OneOf(LinkService::VARIANTS), map::ONLY;
        /// SNR at 1 m [dB] of the law of a planner without the map, `planner.links = "law"`.
        law_snr_db: Option<f64>, SNR_DB, map::ONLY;
        /// Path loss exponent of that law; 2.5 if absent.
        law_exponent: Option<f64>, line_of_sight::EXPONENT, map::ONLY;
        /// Radius on the ground [m] within which a UAV hears the SNRs of SNs at the end of each slot, scheduled or not;
        /// absent: none (decision D32).
        beacon_radius_m: Option<f64>, POSITIVE, beacons::ONLY;
        /// Fading of the power, redrawn in every slot; absent: none.
        fading: Option<FadingModel>, Accepts::OneOf(FadingModel::VARIANTS);
        /// Power of the dominant path relative to all others, `K` [dB]; -inf for none (Rayleigh).
        k_db: Option<f64> = 10.0, fading::K_DB, fading::ONLY;
        /// Communication radius on the ground, `d_c` [m].
        comm_radius_m: f64 = 10.0, POSITIVE;
        /// Time for communication in a slot, `τ_c` [s]; at most `slot_s`.
        comm_s: f64 = 0.1, POSITIVE;
        /// What of `comm_s` passes before a first bit, in a slot before which the UAV has not served the SN [s]; less
        /// than `comm_s` (decision D39).
        setup_s: Option<f64>, NOT_NEGATIVE;
        /// Most airtime of an SN as a fraction of `duty_window_s`; absent: all. It sends no more, and a service without
        /// airtime left is refused (decision D33).
        duty_cycle: Option<f64>, Accepts::Number("a fraction above 0, at most 1", |duty| duty > 0.0 && duty <= 1.0);
        /// The sliding window of `duty_cycle` [s], of whole slots; 3600 if absent.
        duty_window_s: Option<f64>, POSITIVE;
        /// How the SNs that are served in a slot share `comm_s`: each has all of it, `"blocks"`, or they have equal
        /// parts (decision D39); `"blocks"` if absent.
        sharing: Option<Sharing>, Accepts::OneOf(Sharing::VARIANTS);
        /// Resource blocks, `n`, the most SNs served in a slot.
        resource_blocks: usize = 4, Accepts::Whole(1, MAX_RESOURCE_BLOCKS as u64);
        also {
            /// The rates of `file`, or of `preset`, which the scenario reads.
            #[serde(skip)]
            pub table: Option<Arc<RateTable>>,
            /// The map of `file`, with the model `map`.
            #[serde(skip)]
            pub map: Option<Arc<LinkMap>>,
            /// The buildings of the area, with the model `buildings`.
            #[serde(skip)]
            pub buildings: Option<Arc<Buildings>>,
        }
    }
}

impl Channel {
    /// The channel of a checked scenario.
    ///
    /// # Panics
    /// If keys of its model are absent; never in a checked scenario.
    #[must_use]
    pub fn of(link: &LinkBudget) -> Self {
        let channel = match link.model {
            LinkModel::FreeSpace => link.free_space().map(Self::FreeSpace),
            LinkModel::ProbabilisticLos | LinkModel::Buildings => link.line_of_sight().map(Self::LineOfSight),
            LinkModel::Table => link.by_table().map(Self::Table),
            LinkModel::Map => link.by_map().map(Self::Map),
        };
        channel.expect("a checked scenario has the keys of its model")
    }

    /// The model that is in or out of line of sight; `None` for others.
    pub fn line_of_sight(&self) -> Option<&LineOfSight> {
        match self {
            Self::LineOfSight(model) => Some(model),
            Self::FreeSpace(_) | Self::Table(_) | Self::Map(_) => None,
        }
    }

    /// The map of links, where its places are known; `None` for other channels.
    #[inline]
    pub fn map(&self) -> Option<&MapChannel> {
        match self {
            Self::Map(model) if model.law.is_none() => Some(model),
            _ => None,
        }
    }

    /// Whether links of the same length differ by place: among buildings, or by a map.
    #[inline]
    pub fn depends_on_place(&self) -> bool {
        self.map().is_some() || self.buildings().is_some()
    }

    /// The channel of a planner that takes `law` for the map; that of other models.
    #[must_use]
    pub fn by_law(self, law: LinkLaw) -> Self {
        match self {
            Self::Map(model) => Self::Map(MapChannel { law: Some(law), ..model }),
            other => other,
        }
    }

    /// The model whose line of sight is random; `None` for others.
    pub fn random_sight(&self) -> Option<&LineOfSight> {
        self.line_of_sight().filter(|model| model.buildings().is_none())
    }

    /// The uplink of a sensor node with `gain` at the position `sensor`, to the UAV at `uav`.
    #[inline]
    pub fn uplink(&self, gain: f64, sensor: &Position, uav: &Point3<f64>) -> Uplink {
        if self.depends_on_place() { self.uplink_by_place(gain, sensor, uav) } else { Uplink::new(gain, sensor, uav) }
    }

    /// The same by a map, or among buildings.
    #[inline(never)]
    fn uplink_by_place(&self, gain: f64, sensor: &Position, uav: &Point3<f64>) -> Uplink {
        if let Some(MapChannel { map, .. }) = self.map() {
            return Uplink { level: map.level(sensor, uav), ..Uplink::new(gain, sensor, uav) };
        }
        let uplink = self.uplink_at(gain, distance_squared(&uav.xy(), sensor), uav.z);
        Uplink { in_sight: self.buildings().is_none_or(|buildings| buildings.sees(sensor, uav)), ..uplink }
    }

    /// The uplink of a sensor node with `gain` at the squared horizontal distance `d2_m2` [m²], to the UAV at the
    /// altitude `z_m` [m], in sight of each other.
    #[inline]
    pub fn uplink_at(&self, gain: f64, d2_m2: f64, z_m: f64) -> Uplink {
        Uplink::at(gain, d2_m2, z_m - self.buildings().map_or(0.0, Buildings::sensors_height_m))
    }

    /// Whole bits that an uplink of `rate_bps` [bit/s] carries in one slot: `floor(r τ_c)` (UTS eq. 7).
    #[inline]
    pub fn capacity_bits(&self, rate_bps: f64) -> u64 {
        let comm_s = match self {
            Self::FreeSpace(model) => model.comm_s,
            Self::LineOfSight(model) => model.comm_s,
            Self::Table(model) => model.comm_s,
            Self::Map(model) => model.comm_s,
        };
        carried_bits(rate_bps, comm_s)
    }

    /// The buildings that decide on line of sight; `None` for other channels.
    #[inline]
    pub fn buildings(&self) -> Option<&Buildings> {
        self.line_of_sight().and_then(LineOfSight::buildings)
    }
}

/// How the sensor nodes that are served in a slot share its time for communication.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Sharing {
    /// Each has all of it, on a resource block of its own.
    Blocks,
    /// They have equal parts: there is one receiver.
    Equal,
}

impl LinkBudget {
    /// The time for communication [s] of one of `served` SNs in a slot, in a contact that `is_new` (decision D39).
    pub fn contact_s(&self, served: usize, is_new: bool) -> f64 {
        let setup_s = self.setup_s.filter(|_| is_new).unwrap_or(0.0);
        let shares = if self.sharing == Some(Sharing::Equal) { served.max(1) as f64 } else { 1.0 };
        (self.comm_s - setup_s) / shares
    }

    /// The link as plans reckon with it: every contact is new, and as many SNs as possible share a slot.
    #[must_use]
    pub fn planned(&self) -> Self {
        Self { comm_s: self.contact_s(self.resource_blocks, true), ..self.clone() }
    }

    /// Noise power, `σ²` [W].
    pub fn noise_w(&self) -> f64 {
        match self.noise_dbm_per_hz {
            Some(density_dbm) => watts_of_dbm(density_dbm) * self.bandwidth_hz,
            None => watts_of_dbm(self.noise_dbm.expect("a checked scenario has a form of the noise")),
        }
    }

    /// Whether line of sight stays for the mission.
    pub fn stays_in_sight(&self) -> bool {
        self.los_correlation_m.is_some_and(|correlation_m| correlation_m > 0.0)
    }

    /// The fading of the links, if their power fades.
    fn fading(&self) -> Option<Fading> {
        self.fading.and(self.k_db).map(Fading::rician)
    }

    /// Range [dB] of the reference gain at 1 m; in the probabilistic model, which has one gain, both ends are `β0`.
    pub fn gain_range_db(&self) -> [f64; 2] {
        self.gain_db.map_or([self.reference_gain_db.unwrap_or_default(); 2], Interval::ends)
    }

    /// The law of a planner without the map, if the link has one.
    pub fn law(&self) -> Option<LinkLaw> {
        let exponent = self.law_exponent.unwrap_or(LAW_EXPONENT);
        self.law_snr_db.map(|snr_db| LinkLaw { snr_db, exponent })
    }

    fn by_table(&self) -> Option<TableChannel> {
        Some(TableChannel { table: self.table.clone()?, comm_s: self.comm_s })
    }

    fn by_map(&self) -> Option<MapChannel> {
        let residual_m = self.residual_m.filter(|residual_m| *residual_m > 0.0);
        let residual_db = self.residual_db.unwrap_or(0.0);
        let is_observed = self.service == Some(LinkService::Observed);
        let map = self.map.clone()?;
        Some(MapChannel { map, residual_db, residual_m, is_observed, law: None, comm_s: self.comm_s })
    }

    fn free_space(&self) -> Option<FreeSpace> {
        let Self { bandwidth_hz, tx_power_w, comm_s, .. } = *self;
        let redrawn_db = (self.gain? == GainMode::PerSlot).then_some(self.gain_db?.ends());
        Some(FreeSpace { bandwidth_hz, tx_power_w, noise_w: self.noise_w(), comm_s, redrawn_db, fading: self.fading() })
    }

    fn line_of_sight(&self) -> Option<LineOfSight> {
        let Self { bandwidth_hz, tx_power_w, comm_s, .. } = *self;
        let noise_w = self.noise_w();
        let los_snr = tx_power_w * ratio_of_db(self.reference_gain_db?) / (noise_w * ratio_of_db(self.snr_gap_db?));
        Some(LineOfSight {
            bandwidth_hz,
            comm_s,
            sight: match &self.buildings {
                Some(buildings) => Sight::Buildings(Arc::clone(buildings)),
                None => Sight::Curve(self.los.or_else(|| self.environment.map(Environment::curve))?),
            },
            los_snr,
            nlos_snr: ratio_of_db(self.nlos_extra_db?) * los_snr,
            los_exponent: self.los_exponent?,
            nlos_exponent: self.nlos_exponent?,
            correlation_m: self.los_correlation_m.filter(|&correlation_m| correlation_m > 0.0),
            fading: self.fading(),
            shadowing: self
                .shadowing_db
                .filter(|sigmas| *sigmas != [0.0; 2])
                .map(|sigmas| sigmas.map(Fading::log_normal)),
        })
    }
}
