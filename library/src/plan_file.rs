//! Plan files: where each UAV is after each slot, and whom it serves there, as any program can write them.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{Read as _, Write as _};
use std::path::Path;

use flate2::Compression;
use flate2::read::MultiGzDecoder;
use flate2::write::GzEncoder;
use nalgebra::Point3;
use serde::Deserialize;
use skysink_common::error::{InputError, did_you_mean, line_of, quoted};
use skysink_common::message::{MAX_SERVED, Mode, Plan};
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::ByUav;

/// The kind of input in messages.
pub(crate) const PLAN: &str = "plan file";

/// Begins the line that names the instance.
const INSTANCE: &str = "# instance: ";

/// Most bytes of a plan file, decompressed.
pub(crate) const MAX_BYTES: u64 = 1 << 28;

/// What a row is expected to be.
const EXPECTED: &str = "slot,x_m,y_m,scheduled, and optionally uav,z_m,mode,seed, as slots.csv has them";

/// The columns of a plan file in any order; those of `slots.csv` that are not of the plan are not read.
const COLUMNS: [&str; 13] = [
    "slot",
    "x_m",
    "y_m",
    "scheduled",
    "uav",
    "z_m",
    "mode",
    "seed",
    "delivered_bits",
    "lost_bits",
    "queued_bits",
    "refused",
    "energy_j",
];

/// How many of them every plan file has.
const REQUIRED: usize = 4;

/// A row of a plan file.
#[derive(Deserialize)]
struct PlanRow {
    seed: Option<u64>,
    slot: u64,
    uav: Option<usize>,
    x_m: f64,
    y_m: f64,
    z_m: Option<f64>,
    scheduled: String,
    mode: Option<String>,
    delivered_bits: Option<u64>,
    lost_bits: Option<u64>,
    queued_bits: Option<u64>,
}

/// What a UAV does in a slot.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedMove {
    /// The line of the file, from 1.
    pub line: usize,
    /// Where the UAV is after the slot [m].
    pub position: Point3<f64>,
    /// The sensor nodes that it serves, ascending.
    pub scheduled: Vec<u32>,
    /// Its mode.
    pub mode: Mode,
    /// The bits delivered and lost in the slot, and those queued after it, where the file says so.
    pub ledger: [Option<u64>; 3],
}

impl PlannedMove {
    /// The plan that leads to it; `None` for a UAV that holds its position.
    pub fn plan(&self) -> Option<Plan> {
        if self.mode == Mode::Hold {
            return None;
        }
        let mut plan = Plan::fly_to(self.position, self.mode);
        plan.schedule(&self.scheduled);
        Some(plan)
    }
}

/// The moves of all UAVs in all slots of a mission.
pub type PlannedFlight = Vec<ByUav<PlannedMove>>;

/// The instance that the first lines of a plan file name.
pub(crate) fn instance_of(text: &str) -> Option<&str> {
    text.lines().take_while(|line| line.starts_with('#')).find_map(|line| line.strip_prefix(INSTANCE)).map(str::trim)
}

/// The text of a plan file, compressed or not.
pub(crate) fn text_of(bytes: &[u8], path: &Path) -> Result<String, InputError> {
    let refuse = |message: &str| InputError::new(PLAN, path, message);
    let mut text = Vec::new();
    let read = match bytes {
        [0x1f, 0x8b, ..] => MultiGzDecoder::new(bytes).take(MAX_BYTES).read_to_end(&mut text),
        _ => bytes.take(MAX_BYTES).read_to_end(&mut text),
    };
    read.map_err(|error| refuse(&format!("{error}: expected text, or text compressed by gzip")))?;
    if text.len() as u64 == MAX_BYTES {
        return Err(too_large(path));
    }
    let text = String::from_utf8(text).map_err(|_| refuse("expected UTF-8 text"))?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text)) // as spreadsheets write it
}

/// The refusal of a plan file that is too large.
pub(crate) fn too_large(path: &Path) -> InputError {
    InputError::new(PLAN, path, format_args!("expected at most {} MB", MAX_BYTES / 1_000_000))
}

/// Refuses a header without a column that every plan file over this scenario has, or with an unknown or a repeated one.
fn check_header(header: &csv::StringRecord, path: &Path, scenario: &Scenario) -> Result<(), InputError> {
    let refuse = |what: String| InputError::new(PLAN, path, what);
    let of_model = [("uav", scenario.uav.uavs() > 1), ("z_m", scenario.uav_kinds().any(|uav| uav.climb().is_some()))];
    let of_model = of_model.iter().filter(|(_, is_there)| *is_there).map(|(name, _)| name);
    let mut required = COLUMNS[..REQUIRED].iter().chain(of_model);
    if let Some(missing) = required.find(|name| !header.iter().any(|column| column == **name)) {
        return Err(refuse(format!("column {missing} is missing: expected {EXPECTED}")));
    }
    for (at, column) in header.iter().enumerate() {
        if header.iter().take(at).any(|other| other == column) {
            return Err(refuse(format!("column {}: it is there twice", quoted(column))));
        }
        if !COLUMNS.contains(&column) {
            let meant = did_you_mean(column, COLUMNS).map(|meant| format!("; did you mean `{meant}`?"));
            let meant = meant.unwrap_or_default();
            return Err(refuse(format!("column {}: expected {EXPECTED}{meant}", quoted(column))));
        }
    }
    Ok(())
}

/// The flights of the plan file `path` over an instance with this scenario, by seed; those of a file without the column
/// `seed` have the seed of `scenario`. Seeds are 1 to `seeds`.
pub(crate) fn parse(
    text: &str,
    path: &Path,
    scenario: &Scenario,
    seeds: u64,
) -> Result<BTreeMap<u64, PlannedFlight>, InputError> {
    let refuse = |message: &str| InputError::new(PLAN, path, message);
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|error| refuse(&error.to_string()))?.clone();
    check_header(&header, path, scenario)?;
    let mut flights: BTreeMap<u64, PlannedFlight> = BTreeMap::new();
    for record in reader.records() {
        let record = record.map_err(|error| {
            let line = line_of(text, error.position());
            refuse(&format!("line {line}: expected {} fields, as in the header", header.len()))
        })?;
        let line = usize::try_from(line_of(text, record.position())).unwrap_or(usize::MAX);
        let refuse = |expected: &str| {
            let words = quoted(&record.iter().collect::<Vec<_>>().join(","));
            InputError::line(PLAN, path, line, &words, format_args!("expected {expected}"))
        };
        let row: PlanRow = record.deserialize(Some(&header)).map_err(|error| {
            let column = match error.kind() {
                csv::ErrorKind::Deserialize { err, .. } => err.field().and_then(|field| header.get(field as usize)),
                _ => None,
            };
            let kind = |column: &str| if column.ends_with("_m") { "a number" } else { "a whole number" };
            refuse(&column.map_or_else(|| EXPECTED.to_owned(), |column| format!("{} as {column}", kind(column))))
        })?;
        let seed = row.seed.unwrap_or(scenario.seed);
        if !(1..=seeds).contains(&seed) {
            return Err(refuse(&format!("seed 1 to {seeds}")));
        }
        let flight = flights.entry(seed).or_default();
        let uavs = scenario.uav.uavs();
        if row.uav.is_some_and(|uav| uav >= uavs) {
            return Err(refuse(&format!("uav 0 to {}", uavs - 1)));
        }
        let is_begun = flight.last().is_some_and(|slot: &ByUav<_>| slot.len() < uavs);
        if !is_begun {
            flight.push(ByUav::new());
        }
        let slot = flight.len() as u64;
        let moves = flight.last_mut().expect("at least one slot");
        if (row.slot, row.uav.unwrap_or(moves.len())) != (slot, moves.len()) || slot > scenario.slots {
            let uav = if uavs > 1 { format!(" of UAV {}", moves.len()) } else { String::new() };
            return Err(refuse(&match slot > scenario.slots {
                true => format!("the end, after {} slots", scenario.slots),
                false => format!("slot {slot}{uav}"),
            }));
        }
        let altitude_m = scenario.uav_of(moves.len()).altitude_m;
        moves.push(planned(row, line, altitude_m).map_err(|expected| refuse(&expected))?);
    }
    whole(flights, scenario).map_err(|message| refuse(&message))
}

/// The flights, if there are some and each has all slots of the mission; otherwise what is missing.
fn whole(flights: BTreeMap<u64, PlannedFlight>, scenario: &Scenario) -> Result<BTreeMap<u64, PlannedFlight>, String> {
    let is_whole = |flight: &PlannedFlight| {
        flight.len() as u64 == scenario.slots && flight.iter().all(|moves| moves.len() == scenario.uav.uavs())
    };
    match flights.iter().find(|(_, flight)| !is_whole(flight)) {
        None if !flights.is_empty() => Ok(flights),
        None => Err(format!("it has no slot: expected rows {EXPECTED}")),
        Some((seed, flight)) => {
            let [found, expected] = [flight.len() as u64, scenario.slots];
            let after = flight.last().map_or(0, |moves| moves.len());
            let missing = if after < scenario.uav.uavs() { format!(" before UAV {after}") } else { String::new() };
            let at = format_args!("it ends in slot {found} of seed {seed}{missing}");
            Err(format!("{at}: expected {expected} slots of each UAV"))
        }
    }
}

/// The move of a row, at the altitude `altitude_m` [m] without one.
fn planned(row: PlanRow, line: usize, altitude_m: f64) -> Result<PlannedMove, String> {
    let ids = row.scheduled.split_ascii_whitespace().map(|id| id.parse().ok()).collect::<Option<Vec<u32>>>();
    let scheduled = ids.filter(|ids| ids.len() <= MAX_SERVED && ids.is_sorted_by(|a, b| a < b));
    let scheduled =
        scheduled.ok_or("as scheduled the numbers of sensor nodes from 0 on, ascending, separated by spaces")?;
    let by_default = if scheduled.is_empty() { Mode::Fly } else { Mode::Serve };
    let mode = match row.mode {
        Some(name) => name.parse().map_err(|_| format!("a mode, as in slots.csv, not `{}`", quoted(&name)))?,
        None => by_default,
    };
    let position = Point3::new(row.x_m, row.y_m, row.z_m.unwrap_or(altitude_m));
    if !position.iter().all(|coordinate_m| coordinate_m.is_finite()) {
        return Err("a position of finite numbers".to_owned());
    }
    Ok(PlannedMove { line, position, scheduled, mode, ledger: [row.delivered_bits, row.lost_bits, row.queued_bits] })
}

/// The compressed plan file of flights over the instance `name`, in `scenarios` of theirs. Columns of defaults are left
/// out.
pub(crate) fn write(name: &str, flights: &BTreeMap<u64, PlannedFlight>, scenario: &Scenario) -> Vec<u8> {
    let moves = || flights.values().flatten().flatten();
    let has_uav = scenario.uav.uavs() > 1;
    let is_level = |(uav, one): (usize, &PlannedMove)| one.position.z == scenario.uav_of(uav).altitude_m;
    let are_level = flights.values().flatten().all(|moves| moves.iter().enumerate().all(is_level));
    let has_z = scenario.uav_kinds().any(|uav| uav.climb().is_some()) || !are_level;
    let has_mode = moves().any(|one| one.mode != if one.scheduled.is_empty() { Mode::Fly } else { Mode::Serve });
    let has_seed = flights.keys().any(|seed| *seed != scenario.seed);
    let columns = [(has_seed, "seed,"), (true, "slot,"), (has_uav, "uav,"), (true, "x_m,y_m,"), (has_z, "z_m,")];
    let columns = columns.into_iter().chain([(has_mode, "mode,"), (true, "scheduled\n")]);
    let mut text = format!("{INSTANCE}{name}\n");
    text.extend(columns.filter(|(is_there, _)| *is_there).map(|(_, column)| column));
    for (seed, flight) in flights {
        for (slot, moves) in (1..).zip(flight) {
            for (uav, PlannedMove { position, scheduled, mode, .. }) in moves.iter().enumerate() {
                let mut cell = |is_there: bool, value: &dyn std::fmt::Display| {
                    if is_there {
                        write!(text, "{value},").expect("a string takes everything");
                    }
                };
                cell(has_seed, seed);
                cell(true, &slot);
                cell(has_uav, &uav);
                cell(true, &position.x);
                cell(true, &position.y);
                cell(has_z, &position.z);
                cell(has_mode, mode);
                let ids: Vec<String> = scheduled.iter().map(u32::to_string).collect();
                text += &(ids.join(" ") + "\n");
            }
        }
    }
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(text.as_bytes()).and_then(|()| encoder.finish()).expect("memory takes everything")
}
