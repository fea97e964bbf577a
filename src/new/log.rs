//! `skysink new --log`: links by place and a fixed flight from a flight log (decision D32).

use std::path::{Path, PathBuf};

use skysink_common::channel::LinkMap;
use skysink_common::error::{InputError, read_text};
use skysink_common::geodata::projection::Projection;
use skysink_common::geometry::Position;
use skysink_common::keys::{Setting, SettingOrigin};
use skysink_common::scenario::{MOST_TRACK_SLOTS, RATES, Scenario};
use skysink_common::sensors::SensorList;
use skysink_lab::import::{FittedLaw, FlightLog, Frame, LogRow, MapGrid, Measured};
use toml::Value;

use super::additions::{Additions, LINKS, MOST_OF_NODE, MOST_POINTS};
use super::field::LIST;
use super::presets::Lines;

/// The file of the log, and that of the fixed flight.
const LOG: &str = "log.csv";
const TRACK: &str = "track.csv";

/// The files of a log.
pub const FILES: [&str; 3] = [LOG, RATES, LIST];

/// Least side of a bin [m]: that of the positions of a satellite receiver with their errors.
const BIN_M: f64 = 10.0;

/// Rows of a log farther than this from its median altitude are of a climb [m].
const LEVEL_M: f64 = 10.0;

/// Speed that no UAV with a log has [m/s].
const MOST_MPS: f64 = 100.0;

/// Largest standard deviation of a residual [dB].
const MOST_DB: f64 = 20.0;

/// A folder with a flight log, and the rates of its SNRs.
pub struct LoggedFlight {
    folder: PathBuf,
    log: FlightLog,
    altitude_m: f64,
    left_out: usize,
    rates: Vec<[f64; 2]>,
}

impl LoggedFlight {
    /// Reads `log.csv` and `rates.csv` in `folder`.
    ///
    /// # Errors
    /// If a file is refused, or fewer than two times are at the median altitude.
    pub fn read(folder: &Path) -> Result<Self, InputError> {
        let mut log = FlightLog::read(&folder.join(LOG))?;
        let rates = folder.join(RATES);
        let rates = LinkMap::parse_steps(&read_text("rates", &rates)?, &rates)?;
        let (altitude_m, left_out) = log.keep_level(LEVEL_M);
        let read =
            Self { folder: folder.to_owned(), log, altitude_m: (altitude_m * 10.0).round() / 10.0, left_out, rates };
        if read.altitude_m <= 0.0 {
            return Err(read.refuse(&format!("median z_m = {altitude_m}: expected altitudes above the ground")));
        }
        Ok(read)
    }

    fn refuse(&self, message: &str) -> InputError {
        InputError::new("flight log", &self.path(), message)
    }

    /// The file with its places.
    pub fn path(&self) -> PathBuf {
        self.folder.join(LOG)
    }

    /// The list of its sensor nodes, if there is no other.
    pub fn sensors(&self) -> PathBuf {
        self.folder.join(LIST)
    }

    /// The frame of its positions.
    pub fn frame(&self) -> Frame {
        self.log.frame
    }

    /// Its positions, in its frame.
    pub fn positions(&self) -> Vec<[f64; 2]> {
        self.log.rows.iter().map(|row| row.position).collect()
    }

    /// The map, its rates, and the flight in the area of `draft`, which lies by `shift` [m] beside the positions in
    /// metres; with their `lines`.
    ///
    /// # Errors
    /// If a sensor node is unknown, none was heard, or the flight is shorter than a slot or impossibly fast.
    pub fn additions(
        &self,
        draft: &Scenario,
        list: &SensorList,
        shift: [f64; 2],
        lines: &mut Lines,
    ) -> Result<Additions, InputError> {
        let projection = draft.area.origin().map(Projection::at);
        let in_area = |row: &LogRow| match (self.log.frame, &projection) {
            (Frame::Geodetic, Some(projection)) => {
                projection.project(row.position[0], row.position[1]).expect("the area encloses the log")
            }
            _ => Position::from(row.position) + Position::from(shift).coords,
        };
        let places: Vec<Position> = self.log.rows.iter().map(in_area).collect();
        let mut additions = Additions::default();
        self.add_track(draft, &places, lines, &mut additions)?;
        self.add_links(draft, list, &places, lines, &mut additions)?;
        Ok(additions)
    }

    /// Adds the track, with its rows at the ends of the slots.
    fn add_track(
        &self,
        draft: &Scenario,
        places: &[Position],
        lines: &mut Lines,
        additions: &mut Additions,
    ) -> Result<(), InputError> {
        let rows = &self.log.rows;
        let begin_s = rows[0].time_s;
        let slots = ((rows[rows.len() - 1].time_s - begin_s) / draft.slot_s + 1e-9).floor();
        if slots < 1.0 {
            return Err(self.refuse(&format!("it lasts less than a slot: expected {} s or more", draft.slot_s)));
        }
        if slots > MOST_TRACK_SLOTS as f64 {
            let line = rows[rows.len() - 1].line;
            let expected = format!("expected at most {MOST_TRACK_SLOTS}, the most of a track");
            return Err(self.refuse(&format!("line {line}: {slots} slots after the first row: {expected}")));
        }
        let mut next = 0;
        let mut text = "slot,x_m,y_m\n".to_owned();
        let mut waypoints_m: Vec<Position> = Vec::new();
        let mut fastest_mps: f64 = 0.0;
        for slot in 0..=slots as u64 {
            let time_s = begin_s + slot as f64 * draft.slot_s;
            while next + 1 < rows.len() && rows[next].time_s < time_s {
                next += 1;
            }
            let before = next.saturating_sub(1);
            let span_s = rows[next].time_s - rows[before].time_s;
            let part = if span_s > 0.0 { ((time_s - rows[before].time_s) / span_s).clamp(0.0, 1.0) } else { 1.0 };
            let at = places[before] + (places[next] - places[before]) * part;
            let at = at.map(|along_m| (along_m * 1e3).round() / 1e3);
            if let Some(last) = waypoints_m.last() {
                let speed_mps = (at - last).norm() / draft.slot_s;
                if speed_mps > MOST_MPS {
                    let line = rows[next].line;
                    let expected = format!("expected at most {MOST_MPS} m/s");
                    return Err(self.refuse(&format!("line {line}: {speed_mps:.1} m/s to there: {expected}")));
                }
                fastest_mps = fastest_mps.max(speed_mps);
            }
            text += &format!("{slot},{},{}\n", at.x, at.y);
            waypoints_m.push(at);
        }
        additions.files.push((TRACK, text));
        let start_m = Value::from(vec![waypoints_m[0].x, waypoints_m[0].y]);
        let waypoints_m = waypoints_m[1..].iter().map(|at| Value::from(vec![at.x, at.y, self.altitude_m]));
        let replaced = |key: &str, value| Setting { key: key.to_owned(), value, origin: SettingOrigin::Replacement };
        additions.overrides.keys =
            vec![replaced("uav.start_m", start_m), replaced("uav.waypoints_m", waypoints_m.collect::<Vec<_>>().into())];
        lines.set("slots", &format!("slots = {slots}"), "Number of slots, T: the length of the log");
        lines.set(
            "uav.altitude_m",
            &format!("altitude_m = {:?}", self.altitude_m),
            "Altitude, H [m], the log's median",
        );
        let max_speed_mps = draft.uav.max_speed_mps.max((fastest_mps * 10.0).ceil() / 10.0 + 0.1);
        lines.set("uav.max_speed_mps", &format!("max_speed_mps = {max_speed_mps:?}"), "Maximum speed, V [m/s]");
        let endurance_s = draft.uav.endurance_s.max(slots * draft.slot_s);
        lines.set("uav.endurance_s", &format!("endurance_s = {endurance_s:?}"), "Endurance, T_e [s]");
        if self.left_out > 0 {
            let left_out = self.left_out;
            additions.notes.push(format!(
                "flight log: {left_out} rows farther than {LEVEL_M} m from the altitude of {} m are left out",
                self.altitude_m
            ));
        }
        Ok(())
    }

    /// Adds the map of links and its rates.
    fn add_links(
        &self,
        draft: &Scenario,
        list: &SensorList,
        places: &[Position],
        lines: &mut Lines,
        additions: &mut Additions,
    ) -> Result<(), InputError> {
        let mut heard = Vec::new();
        let mut farthest_m: f64 = 1.0;
        let nodes: Vec<Position> = list.sensors().iter().map(|sensor| sensor.position).collect();
        for (row, at) in self.log.rows.iter().zip(places) {
            let Some((name, snr_db)) = &row.heard else { continue };
            let mut named = list.ids_named(name);
            let by_id = name.parse().ok().filter(|id| *id < nodes.len());
            let (Some(sensor), None) = (named.next().or(by_id), named.next()) else {
                let expected = "expected the name or the id of one sensor node";
                return Err(self.refuse(&format!("line {}: sensor `{name}`: {expected}", row.line)));
            };
            farthest_m = farthest_m.max((at - nodes[sensor]).norm());
            heard.push((sensor, *at, *snr_db));
        }
        let sides_m = [draft.area.width_m(), draft.area.height_m()];
        let most = (MOST_POINTS / nodes.len()).min(MOST_OF_NODE);
        let grid = MapGrid::over(sides_m, BIN_M, most, self.altitude_m);
        let measured = Measured::of(grid, nodes.clone(), &heard);
        let measured = measured.ok_or_else(|| self.refuse("no snr_db: expected SNRs of sensor nodes"))?;
        let shape = [nodes.len(), 1, grid.nodes[1], grid.nodes[0]];
        let rounded_db = |level: &f64| (level * 100.0).round().clamp(-3e4, 3e4) / 100.0;
        let levels_db: Vec<f64> = measured.levels_db().iter().map(rounded_db).collect();
        let map = LinkMap::of_arrays(grid.axes_m(), &shape, &levels_db, Some(self.rates.clone()));
        let map = map.map_err(|message| self.refuse(&message))?;
        additions.files.extend(map.to_csv().1.map(|rates| (RATES, rates)));
        additions.add_map(map, list).map_err(|message| self.refuse(&message))?;

        let FittedLaw { snr_db, exponent } = measured.law();
        let residual_db = measured.residual_db().map(|residual_db| residual_db.min(MOST_DB));
        let residual = residual_db.map_or_else(String::new, |residual_db| {
            format!("residual_db = {residual_db:.2}                # about the mean of a bin\n")
        });
        lines.set_map(format!(
            "model = \"map\"                     # the links of the log, by place\nfile = \"{LINKS}\"\nrates = \"{RATES}\"\n\
             {residual}law_snr_db = {:.2}                # for planner.links = \"law\"\nlaw_exponent = {exponent:.3}\n",
            snr_db.clamp(-300.0, 300.0)
        ));
        let radius = format!("comm_radius_m = {:?}", farthest_m.ceil());
        lines.set("link.comm_radius_m", &radius, "d_c [m]: as far as SNRs were logged");
        let [error_db, law_db] = measured.errors_db;
        let error = match law_db {
            0.0 => "too few to tell how good".to_owned(),
            _ => format!(
                "each left out and predicted: {error_db:.1} dB rms with residuals over {} m, {law_db:.1} dB by a law of \
                 the distance alone",
                measured.length_m
            ),
        };
        additions.notes.push(format!("links: {} bins of {} m, {error}", measured.count(), grid.step_m));
        let unheard: Vec<String> = measured.unheard().map(|sensor| list.label(sensor)).collect();
        if !unheard.is_empty() {
            let [count, names] =
                [unheard.len().to_string(), unheard.into_iter().take(5).collect::<Vec<_>>().join(", ")];
            additions.warnings.push(format!("{count} sensor nodes have no SNR in the log, and so no link: {names}"));
        }
        Ok(())
    }
}

/// The start of the track is the UAV's.
pub const TRACK_LINE: &str = "track = \"track.csv\"               # the log's flight; strategies only schedule\n";
