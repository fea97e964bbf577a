//! Links by place (decision D32): the signal-to-noise ratio (SNR) of each sensor node over a grid of positions of the
//! UAV, and the rate that each SNR carries.

mod arrays;
mod steps;
mod written;

use std::path::Path;
use std::sync::Arc;

use nalgebra::Point3;
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};
use strum::VariantNames;

use super::model::{ChannelModel, Draw, Slopes, Uplink};
use super::table::Step;
use crate::csv_rows::{grid_axes, read_rows};
use crate::error::{InputError, read_bytes, read_text};
use crate::geometry::Position;
use crate::interpolation::interpolate;
use crate::keys::Only;
use crate::random::{Purpose, Streams, normal_cdf, normal_pair};
use crate::shared::SharedValues;

/// Keys of the model `map`.
pub(crate) const ONLY: Only = Only { key: "model", values: &["map"], expected: Some("it only with model = \"map\"") };

/// Most points of all grids of a map.
const MOST_POINTS: usize = 5_000_000;

/// SNRs of a map [dB].
const SNRS_DB: std::ops::RangeInclusive<f64> = -300.0..=300.0;

/// The level of a link that carries nothing.
const NO_LINK: f64 = f64::NEG_INFINITY;

/// When a link that counts is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum LinkService {
    /// At the end of the slot, from the waypoint.
    Waypoint,
    /// At the end of the slot before, where the UAV has already seen it.
    Observed,
}

/// Levels of links over places: SNRs with the steps of their rates, or rates.
///
/// In each cell of a grid the level is trilinear, beyond the grid constant; a cell with an empty corner has no link.
#[derive(Debug, Clone)]
pub struct LinkMap {
    /// The sensor node of each grid by its id or name; empty for all that have none of their own.
    names: Arc<[String]>,
    /// Whether the names can only be ids, as of arrays: a sensor node may have the id of another as its name.
    are_ids: bool,
    /// Shared by the copies at the places of the sensor nodes of each seed.
    grids: Arc<[LevelGrid]>,
    /// SNR from which on each rate is carried [dB], and the rate [bit/s], both ascending; `None` if levels are rates.
    steps: Option<Vec<[f64; 2]>>,
    /// The grids of the sensor nodes with one of their own, by the bits of their positions.
    of_places: FxHashMap<[u64; 2], usize>,
}

/// The level of one sensor node, or of all, over a grid of positions of the UAV.
#[derive(Debug, Clone, PartialEq)]
struct LevelGrid {
    /// Positions east, north and up [m], each ascending.
    axes_m: [Vec<f64>; 3],
    /// SNR [dB] or rate [bit/s], by east, then north, then up; [`NO_LINK`] where there is none.
    levels: Vec<f64>,
    highest: f64,
}

/// A row of the file: the sensor node, three coordinates [m], and the level.
type Row = (String, f64, f64, f64, Option<f64>);

impl LinkMap {
    /// The id of a sensor node that the name of its grid states, `7` or `#7`.
    #[must_use]
    pub fn id_of(name: &str) -> Option<usize> {
        name.strip_prefix(BY_ID).unwrap_or(name).parse().ok()
    }

    /// Parses the text of the file `path`: a row for each point of the grid of each sensor node, in any order. `steps`
    /// are those of the file of rates, if there is one.
    ///
    /// # Errors
    /// If a row is invalid, or the rows of a sensor node are no grid.
    pub fn parse(text: &str, path: &Path, steps: Option<Vec<[f64; 2]>>) -> Result<Self, InputError> {
        let refuse = |message: String| InputError::new("channel", path, message);
        if text.lines().count() > MOST_POINTS + 1 {
            return Err(refuse(format!("more than {MOST_POINTS} points: expected at most as many")));
        }
        let are_rates = text.lines().next().is_some_and(|header| header.contains("rate_bps"));
        let (level, expected) = match are_rates {
            true => ("rate_bps", "a sensor or nothing, three finite numbers, and a rate from 0 to 1e300 or nothing"),
            false => ("snr_db", "a sensor or nothing, three finite numbers, and -300 to 300 dB or nothing"),
        };
        let is_level = |level: f64| if are_rates { (0.0..=1e300).contains(&level) } else { SNRS_DB.contains(&level) };
        let is_row =
            |row: &Row| [row.1, row.2, row.3].iter().all(|at_m| at_m.is_finite()) && row.4.is_none_or(is_level);
        let columns = ["sensor", "x_m", "y_m", "z_m", level];
        let mut rows: Vec<Row> = read_rows(text, &columns, expected, is_row).map_err(refuse)?;
        if rows.is_empty() {
            return Err(refuse("line 1: no rows: expected a row for each point of a grid".to_owned()));
        }
        if !are_rates && steps.is_none() {
            return Err(refuse("snr_db: expected the rates of each SNR as link.rates, or rate_bps".to_owned()));
        }
        rows.sort_by(|a, b| a.partial_cmp(b).expect("the numbers are finite"));
        let of_sensors = || rows.chunk_by(|a, b| a.0 == b.0);
        let grids = of_sensors().map(LevelGrid::new).collect::<Result<Vec<_>, _>>().map_err(refuse)?.into();
        let mut names: Vec<String> = of_sensors().map(|rows| rows[0].0.clone()).collect();
        let id = |name: &String| name.strip_prefix(BY_ID).and_then(|id| id.parse::<usize>().ok());
        let are_ids = names.iter().any(|name| id(name).is_some())
            && names.iter().all(|name| name.is_empty() || id(name).is_some());
        names.iter_mut().filter(|_| are_ids).for_each(|name| *name = name.replace(BY_ID, ""));
        let steps = steps.filter(|_| !are_rates);
        Ok(Self { names: names.into(), are_ids, grids, steps, of_places: FxHashMap::default() })
    }

    /// Reads the map in the file `path`, with the steps in the file `rates`, before its sensor nodes are known.
    ///
    /// # Errors
    /// If a file cannot be read, or is no map.
    pub fn read(path: &Path, rates: Option<&Path>) -> Result<Arc<Self>, InputError> {
        let steps = match rates {
            Some(rates) => Some(Self::parse_steps(&read_text("channel", rates)?, rates)?),
            None => None,
        };
        if arrays::is_named(path) {
            let map = arrays::read(&read_bytes("channel", path)?, steps);
            return Ok(map.map_err(|message| InputError::new("channel", path, message))?.shared());
        }
        Ok(Self::parse(&read_text("channel", path)?, path, steps)?.shared())
    }

    /// The sensor nodes with a grid of their own, by id or name, and whether there is a grid for all others.
    pub fn names(&self) -> (&[String], bool) {
        let has_others = self.names.first().is_some_and(String::is_empty);
        (&self.names[usize::from(has_others)..], has_others)
    }

    /// Whether [`Self::names`] can only be ids.
    pub fn are_ids(&self) -> bool {
        self.are_ids
    }

    /// With the positions [m] of the sensor nodes of [`Self::names`], in their order.
    #[must_use]
    pub fn at_places(mut self, places: &[Position]) -> Self {
        let first = self.names.len() - places.len();
        self.of_places = places.iter().zip(first..).map(|(place, grid)| (key(place), grid)).collect();
        self
    }

    /// Whether it has the places of all sensor nodes with a grid of their own.
    pub fn is_placed(&self) -> bool {
        self.names().0.len() == self.of_places.len()
    }

    /// Whether levels are rates, without SNRs.
    pub fn has_rates(&self) -> bool {
        self.steps.is_none()
    }

    /// Number of grids, and of their points.
    pub fn size(&self) -> [usize; 2] {
        [self.grids.len(), self.grids.iter().map(|grid| grid.levels.len()).sum()]
    }

    /// The map as a channel holds it: equal ones are held once.
    #[must_use]
    pub fn shared(self) -> Arc<Self> {
        static ALL: SharedValues<LinkMap> = SharedValues::new();
        ALL.share(self, |known, map| known == map && known.are_ids == map.are_ids)
    }

    /// The grid of the sensor node at `sensor`; `None` if there is none.
    fn grid(&self, sensor: &Position) -> Option<&LevelGrid> {
        let own = if self.of_places.is_empty() { None } else { self.of_places.get(&key(sensor)) };
        let others = || self.names().1.then_some(&0);
        own.or_else(others).map(|&grid| &self.grids[grid])
    }

    /// The positions of the UAV [m], east, north and up, in the grid of the sensor node at `sensor`; `None` without
    /// one.
    pub fn axes_m(&self, sensor: &Position) -> Option<&[Vec<f64>; 3]> {
        self.grid(sensor).map(|grid| &grid.axes_m)
    }

    /// The level of the link of the sensor node at `sensor` to the UAV at `uav` [m].
    pub fn level(&self, sensor: &Position, uav: &Point3<f64>) -> f64 {
        self.grid(sensor).map_or(NO_LINK, |grid| grid.level(uav))
    }

    /// The highest level of the sensor node at `sensor`, wherever the UAV is.
    pub fn highest_level(&self, sensor: &Position) -> f64 {
        self.grid(sensor).map_or(NO_LINK, |grid| grid.highest)
    }

    /// The rate [bit/s] of a level.
    fn rate_bps(&self, level: f64) -> f64 {
        let Some(steps) = &self.steps else { return level.max(0.0) };
        let reached = steps.partition_point(|[snr_db, _]| *snr_db <= level);
        if reached == 0 { 0.0 } else { steps[reached - 1][1] }
    }
}

/// What begins a name that can only be an id: a sensor node may have a number as its name.
const BY_ID: char = '#';

/// Maps are equal whether their names can only be ids or not.
impl PartialEq for LinkMap {
    fn eq(&self, other: &Self) -> bool {
        let Self { names, are_ids: _, grids, steps, of_places } = self;
        let has_same_grids = || Arc::ptr_eq(grids, &other.grids) || *grids == other.grids;
        *names == other.names && *steps == other.steps && *of_places == other.of_places && has_same_grids()
    }
}

/// A position in bits.
pub(super) fn key(place: &Position) -> [u64; 2] {
    [place.x.to_bits(), place.y.to_bits()]
}

impl LevelGrid {
    /// The grid of these rows, sorted.
    fn new(rows: &[Row]) -> Result<Self, String> {
        let points: Vec<[f64; 3]> = rows.iter().map(|row| [row.1, row.2, row.3]).collect();
        let named =
            |[x_m, y_m, z_m]: [f64; 3]| format!("sensor `{}`, x_m = {x_m}, y_m = {y_m}, z_m = {z_m}", rows[0].0);
        let axes_m = grid_axes(&points, named)?;
        let levels: Vec<f64> = rows.iter().map(|row| row.4.unwrap_or(NO_LINK)).collect();
        let highest = levels.iter().copied().fold(NO_LINK, f64::max);
        Ok(Self { axes_m, levels, highest })
    }

    fn level(&self, at: &Point3<f64>) -> f64 {
        let [east, north, up] = [0, 1, 2].map(|axis| Step::of(&self.axes_m[axis], at[axis]));
        let [_, rows, heights] = [0, 1, 2].map(|axis| self.axes_m[axis].len());
        let node = |x: usize, y: usize, z: usize| self.levels[(x * rows + y) * heights + z];
        between(east, |x| between(north, |y| between(up, |z| node(x, y, z))))
    }
}

/// Linear between two levels, and never above both; none if one has none.
fn between(step: Step, level: impl Fn(usize) -> f64) -> f64 {
    let low = level(step.index);
    if step.fraction == 0.0 {
        return low;
    }
    let high = level(step.index + 1);
    let is_link = low.is_finite() && high.is_finite();
    if is_link { interpolate(low, high, step.fraction).min(low.max(high)) } else { NO_LINK }
}

/// What a planner takes for the SNR that does not know the map: it falls with the distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkLaw {
    /// At 1 m [dB].
    pub snr_db: f64,
    /// Path loss exponent.
    pub exponent: f64,
}

impl LinkLaw {
    /// The SNR of an uplink [dB].
    pub(super) fn snr_db(&self, uplink: &Uplink) -> f64 {
        self.snr_db - 5.0 * self.exponent * (uplink.d2_m2 + uplink.z_m * uplink.z_m).log10()
    }
}

/// The parameters of an uplink of a map.
#[derive(Debug, Clone, PartialEq)]
pub struct MapChannel {
    /// The map.
    pub map: Arc<LinkMap>,
    /// Standard deviation of the residual of the SNR [dB].
    pub residual_db: f64,
    /// Correlation distance of a residual that stays for the mission [m]; `None` if it is redrawn in every slot.
    pub residual_m: Option<f64>,
    /// Whether the link of a slot has been seen before it.
    pub is_observed: bool,
    /// What is taken for the SNR instead of the map.
    pub law: Option<LinkLaw>,
    /// Time for communication in a slot, `τ_c` [s].
    pub comm_s: f64,
}

impl MapChannel {
    /// The level of an uplink; where it has no place the highest of the map.
    fn level(&self, uplink: &Uplink) -> f64 {
        match self.law {
            _ if !uplink.in_sight => NO_LINK,
            Some(law) => law.snr_db(uplink),
            None if uplink.level == f64::INFINITY => {
                self.map.grids.iter().map(|grid| grid.highest).fold(NO_LINK, f64::max)
            }
            None => uplink.level,
        }
    }

    /// The draw with a standard normal `residual`.
    pub fn draw_at(&self, uplink: &Uplink, residual: f64) -> Draw {
        let level = self.snr_db(uplink, residual);
        Draw { line_of_sight: level > NO_LINK, rate_bps: self.map.rate_bps(level) }
    }

    /// The SNR [dB], or the rate of a map of rates, with a standard normal `residual`.
    pub(super) fn snr_db(&self, uplink: &Uplink, residual: f64) -> f64 {
        self.level(uplink) + self.residual_db * residual
    }

    /// The residual of `sensor` in `slot`, where it is redrawn in every slot: standard normal.
    pub(super) fn slot_residual(&self, streams: &Streams, slot: u64, sensor: u32) -> f64 {
        let drawn = || normal_pair(&mut streams.stream(Purpose::LinkResidual, slot, sensor))[0];
        if self.residual_db > 0.0 { drawn() } else { 0.0 }
    }

    /// The steps, if the SNR has a residual.
    fn drawn_steps(&self) -> Option<&[[f64; 2]]> {
        self.map.steps.as_deref().filter(|_| self.residual_db > 0.0)
    }
}

impl ChannelModel for MapChannel {
    fn expected_rate_bps(&self, uplink: &Uplink) -> f64 {
        self.mean_over_draws(uplink, &|rate_bps| rate_bps)
    }

    /// A map is taken as flat. By the law, with `x = D²`, `∂/∂x Σ Δr Φ((SNR − s)/σ) = −Σ Δr φ((SNR − s)/σ)/σ · 5n/(x ln
    /// 10)`.
    fn slopes(&self, uplink: &Uplink) -> Slopes {
        let (Some(law), Some(steps)) = (self.law, self.drawn_steps()) else {
            return Slopes { by_distance2: 0.0, by_elevation: 0.0 };
        };
        let density = |snr_db: f64| (-0.5 * snr_db * snr_db).exp() / (std::f64::consts::TAU.sqrt() * self.residual_db);
        let law_db = self.level(uplink);
        let mut before_bps = 0.0;
        let by_level: f64 = steps
            .iter()
            .map(|[snr_db, rate_bps]| {
                let more_bps = rate_bps - std::mem::replace(&mut before_bps, *rate_bps);
                more_bps * density((law_db - snr_db) / self.residual_db)
            })
            .sum();
        let distance2_m2 = uplink.d2_m2 + uplink.z_m * uplink.z_m;
        let by_distance2 = -by_level * 5.0 * law.exponent / (distance2_m2 * std::f64::consts::LN_10);
        Slopes { by_distance2, by_elevation: 0.0 }
    }

    /// What a planner without the map does not know is at random for it.
    fn is_random(&self) -> bool {
        self.residual_db > 0.0 || self.law.is_some()
    }

    fn draw(&self, uplink: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> Draw {
        self.draw_at(uplink, self.slot_residual(streams, slot, sensor))
    }

    fn best_rate_bps(&self, uplink: &Uplink) -> f64 {
        let level = self.level(uplink);
        let highest = self.drawn_steps().and_then(<[_]>::last).filter(|_| level > NO_LINK);
        highest.map_or_else(|| self.map.rate_bps(level), |[_, rate_bps]| *rate_bps)
    }

    fn best_drawn_rate_bps(&self, uplink: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> f64 {
        match self.residual_m {
            Some(_) => self.best_rate_bps(uplink),
            None => self.draw(uplink, streams, slot, sensor).rate_bps,
        }
    }

    /// `v(0) + Σ (v(r_k) − v(r_{k−1})) Φ((SNR − s_k)/σ)`.
    fn mean_over_draws(&self, uplink: &Uplink, value: &dyn Fn(f64) -> f64) -> f64 {
        let level = self.level(uplink);
        let Some(steps) = self.drawn_steps().filter(|_| level > NO_LINK) else {
            return value(self.map.rate_bps(level));
        };
        let mut before = value(0.0);
        let mut mean = before;
        for [snr_db, rate_bps] in steps {
            let more = value(*rate_bps) - before;
            before += more;
            mean += more * normal_cdf((level - snr_db) / self.residual_db);
        }
        mean
    }

    /// A residual that stays, or that was observed, may be known when a plan is made.
    fn best_mean_over_draws(&self, uplink: &Uplink, value: &dyn Fn(f64) -> f64) -> f64 {
        let is_known = self.residual_m.is_some() || self.is_observed;
        if is_known { value(self.best_rate_bps(uplink)) } else { self.mean_over_draws(uplink, value) }
    }

    fn depends_on_elevation(&self) -> bool {
        self.law.is_none()
    }

    fn has_own_gains(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests;
