//! Maps of the trajectories of finished runs, side by side on one sheet.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;
use skysink_common::base::{Base, BaseArea};
use skysink_common::build::{VERSION, build, commit_of};
use skysink_common::channel::LinkMap;
use skysink_common::error::InputError;
use skysink_common::geometry::{Position, above, within};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::ByUav;
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::replay::Replay;
use skysink_mission::trace::RecordedSlot;

use super::request::SheetOptions;
use crate::drawing::levels::LevelMap;
use crate::drawing::map::{AreaKind, AreaOutline, MapSensor, MapSheet, TrajectoryMap};
use crate::error::LabError;

/// The maximum number of runs whose names are part of the file name.
const MOST_NAMES: usize = 3;

/// Cells of a map of links along the longer side of the area.
const CELLS: f64 = 100.0;

/// A sheet of maps that has been drawn.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DrawnMaps {
    /// The runs.
    pub runs: Vec<MappedRun>,
    /// The files of the sheet.
    pub files: Vec<PathBuf>,
}

/// A run on a map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MappedRun {
    /// Its folder.
    pub run: PathBuf,
    /// Name of the scenario.
    pub scenario: String,
    /// The strategy, or the label of an external planner.
    pub strategy: String,
    /// The seed.
    pub seed: u64,
    /// Slots flown.
    pub slots: u64,
    /// Slots of its mission: more in a run that has ended early.
    pub planned_slots: u64,
    /// Data loss rate η, in the slots flown.
    pub loss_rate: f64,
}

impl MappedRun {
    /// The slots flown, in words: `300`, or `25 of 300`.
    #[must_use]
    pub fn flown(&self) -> String {
        let Self { slots, planned_slots, .. } = self;
        if slots < planned_slots { format!("{slots} of {planned_slots}") } else { slots.to_string() }
    }
}

/// Replays the runs in these folders and draws a map of each, in their order, over the map of the links of the sensor
/// node `links_of`, or of the best, if there is one. Existing files of the same name are replaced.
///
/// # Errors
/// If a folder is not that of a run that has ended, or was changed, a file cannot be written, or on a stop.
///
/// # Panics
/// If there is no run.
pub fn draw_maps(
    folders: &[PathBuf],
    links_of: Option<&str>,
    sheet: &SheetOptions,
    stop: &Stop,
) -> Result<DrawnMaps, LabError> {
    sheet.check()?;
    let mapped = folders.iter().map(|run| map(run, links_of, stop)).collect::<Result<Vec<_>, _>>()?;
    let (runs, mut maps): (Vec<_>, Vec<_>) = mapped.into_iter().unzip();
    let strategies: BTreeSet<&str> = runs.iter().map(|run| run.strategy.as_str()).collect();
    for (run, map) in runs.iter().zip(&mut maps) {
        // Runs of one strategy are named by their folders.
        let name = if strategies.len() == runs.len() { run.strategy.clone() } else { name_of(&run.run)? };
        let part = if run.slots < run.planned_slots { format!(", slots {}", run.flown()) } else { String::new() };
        map.title = format!("{name}: η = {:.3}{part}", run.loss_rate);
    }
    let missions: BTreeSet<String> = runs.iter().map(|run| format!("{}, seed {}", run.scenario, run.seed)).collect();
    let missions: Vec<String> = missions.into_iter().collect();
    let footer = format!("{} · skysink {VERSION} ({})", missions.join("; "), commit_of(build()));
    let mut labels = folders.iter().zip(&maps).filter_map(|(folder, map)| Some((folder, &*map.links.as_ref()?.label)));
    if let Some((first, expected)) = labels.next()
        && let Some((other, label)) = labels.find(|&(_, label)| label != expected)
    {
        let expected = format!("expected the {expected}, as of {}; draw a figure for each", first.display());
        let message = format!("it has the {label}: {expected}");
        return Err(InputError::new("run folder", other, message).into());
    }
    let look = sheet.look(footer, &format!(" · built from {}", build()));
    let drawn = MapSheet { look, maps, fraction_label: "queue fill at the end".to_owned() };
    let beside = || folders[0].parent().unwrap_or(Path::new("")).join("plots");
    let folder = sheet.out.clone().unwrap_or_else(beside);
    fs::create_dir_all(&folder).at(&folder)?;
    let stem = folder.join(file_name(folders)?);
    Ok(DrawnMaps { runs, files: drawn.draw(&stem)? })
}

/// The flight of a run, and its map without a title.
fn map(run: &Path, links_of: Option<&str>, stop: &Stop) -> Result<(MappedRun, TrajectoryMap), LabError> {
    let mut replay = Replay::open(run)?;
    let mut flown: Vec<ByUav<RecordedSlot>> = Vec::new();
    replay.drive(&mut [&mut flown], stop)?;
    let scenario = replay.scenario();
    let nodes = replay.list().sensors().iter().zip(replay.plant().field().queues_bits());
    let mut sensors: Vec<MapSensor> = nodes
        .map(|(sensor, &queue_bits)| MapSensor {
            position_m: sensor.position.coords.into(),
            fraction: f64::from(queue_bits) / f64::from(sensor.capacity_bits),
            energy: None,
        })
        .collect();
    let features = replay.plant().field().features();
    sensors.iter_mut().enumerate().for_each(|(id, sensor)| sensor.energy = features.level(id));
    let path_m = |uav: usize| {
        let ends = flown.iter().map(|slot| slot[uav].position);
        std::iter::once(scenario.start_of(uav)).chain(ends).map(|at| at.xy().coords.into()).collect()
    };
    let map = TrajectoryMap {
        title: String::new(),
        width_m: scenario.area.width_m(),
        height_m: scenario.area.height_m(),
        links: links(run, scenario, replay.list(), links_of)?,
        areas: areas(scenario),
        names: site_names(scenario),
        sensors,
        paths_m: (0..scenario.uav.uavs()).map(path_m).collect(),
    };
    let mapped = MappedRun {
        run: run.to_owned(),
        scenario: scenario.name.clone(),
        strategy: replay.label().to_owned(),
        seed: scenario.seed,
        slots: flown.len() as u64,
        planned_slots: scenario.slots,
        loss_rate: replay.summary().loss_rate,
    };
    Ok((mapped, map))
}

/// The map of the links of the sensor node `of` at the altitude of the UAV, or of the best within the communication
/// radius; `None` without a map.
fn links(run: &Path, scenario: &Scenario, list: &SensorList, of: Option<&str>) -> Result<Option<LevelMap>, InputError> {
    let refuse = |name: &str, expected: String| InputError::of_argument("--links-of", name, expected);
    let Some(map) = &scenario.link.map else {
        let expected = || format!("{}: expected a run with link.model = \"map\"", run.display());
        return of.map_or(Ok(None), |name| Err(refuse(name, expected())));
    };
    let id_of = |name: &str| {
        let mut named = list.ids_named(name);
        let id = named.next().or_else(|| LinkMap::id_of(name).filter(|id| *id < list.sensors().len()));
        let id = id.filter(|_| named.next().is_none());
        id.ok_or_else(|| refuse(name, format!("{}: expected the name or the id of one sensor node", run.display())))
    };
    let chosen = of.map(id_of).transpose()?;
    let nodes: Vec<Position> = list.sensors().iter().map(|sensor| sensor.position).collect();
    let radius_m = scenario.link.comm_radius_m;
    let [width_m, height_m] = [scenario.area.width_m(), scenario.area.height_m()];
    let cell_m = width_m.max(height_m) / CELLS;
    let [columns, rows] = [width_m, height_m].map(|side_m| (side_m / cell_m).ceil() as usize);
    let unit = if map.has_rates() { 1e3 } else { 1.0 };
    let level = |row: usize, column: usize| {
        let at = Position::new(column as f64 + 0.5, row as f64 + 0.5) * cell_m;
        let uav = above(&at, scenario.uav.altitude_m);
        let near = nodes.iter().filter(|node| within(node, &at, radius_m));
        let level = match chosen {
            Some(id) => map.level(&nodes[id], &uav),
            None => near.map(|node| map.level(node, &uav)).fold(f64::NEG_INFINITY, f64::max),
        };
        let is_link = level.is_finite() && (level > 0.0 || !map.has_rates());
        is_link.then_some(level / unit)
    };
    let what = if map.has_rates() { "rate [kbit/s]" } else { "SNR [dB]" };
    let label = chosen.map_or_else(|| format!("best {what}"), |id| format!("{what} of {}", list.label(id)));
    let row = |row: usize| (0..columns).map(|column| level(row, column)).collect();
    Ok(Some(LevelMap { label, cell_m, rows: (0..rows).map(row).collect() }))
}

/// The boundary, the zones, the buildings and the base of a scenario.
fn areas(scenario: &Scenario) -> Vec<(AreaKind, AreaOutline)> {
    let area = &scenario.area;
    let of = |kind: AreaKind| move |corners: &[[f64; 2]]| (kind, AreaOutline::Polygon(corners.to_vec()));
    let boundary = area.boundary_m.iter().map(|corners_m| of(AreaKind::Boundary)(corners_m));
    let no_fly = area.no_fly.iter().flatten().map(|zone| of(AreaKind::NoFly)(zone.corners()));
    let buildings = area.building.iter().flatten().map(|building| of(AreaKind::Building)(&building.polygon_m));
    let corners_m = |area: &BaseArea| area.polygon.corners().iter().map(|at| at.coords.into()).collect();
    let of_shape = |shape: &Base| -> Vec<AreaOutline> {
        match shape {
            Base::Disk { centre, radius_m } => vec![AreaOutline::Disk(centre.coords.into(), *radius_m)],
            Base::Areas(areas) => areas.iter().map(|area| AreaOutline::Polygon(corners_m(area))).collect(),
            Base::Sites(_) => Vec::new(), // a shape is none
        }
    };
    let base: Vec<AreaOutline> = scenario.landing_base().iter().flat_map(Base::shapes).flat_map(of_shape).collect();
    let base = base.into_iter().map(|outline| (AreaKind::Base, outline));
    boundary.chain(no_fly).chain(buildings).chain(base).collect()
}

/// The names of several bases, with their pads, where they are.
fn site_names(scenario: &Scenario) -> Vec<([f64; 2], String)> {
    let sites = scenario.landing_base().filter(|base| !base.sites().is_empty());
    sites.iter().flat_map(Base::names).map(|(at, name)| (at.coords.into(), name)).collect()
}

/// The file name without extension: the names of the first runs.
fn file_name(runs: &[PathBuf]) -> Result<String, LabError> {
    let names = runs.iter().take(MOST_NAMES).map(|run| name_of(run)).collect::<Result<Vec<_>, _>>()?;
    let others = match runs.len().saturating_sub(MOST_NAMES) {
        0 => String::new(),
        others => format!("-and-{others}-more"),
    };
    Ok(format!("map-{}{others}", names.join("-")))
}

/// The name of a folder.
fn name_of(run: &Path) -> Result<String, LabError> {
    let whole = fs::canonicalize(run).at(run)?;
    let name = whole.file_name().ok_or_else(|| InputError::new("run folder", run, "it has no name"))?;
    Ok(name.to_string_lossy().into_owned())
}
