//! The check of a flight: its plans are flown again in the exact model of the instance.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;
use skysink_common::error::{InputError, read_bytes};
use skysink_common::message::{FlightReport, Mode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{Plans, SlotRecord};
use skysink_common::stop::Stop;
use skysink_mission::bounds::{MissionBounds, bounds};
use skysink_mission::drive::{Observer, Planned, drive};
use skysink_mission::meter::MissionMeter;
use skysink_mission::metrics::MetricValues;
use skysink_mission::record::{RunFolder, is_run_folder};
use skysink_mission::trace::TraceHash;
use skysink_mission::{MissionError, Plant};
use skysink_planner::settings;

use crate::best::{BestFlight, Measure, ReferenceValue, best_file, gap};
use crate::instance::{LIBRARY, Library, OpenInstance};
use crate::plan_file::{self, PLAN, PlannedFlight, PlannedMove};

/// A flight over an instance that was flown again: one mission, or one for each seed of a policy instance.
#[derive(Debug)]
pub struct FlownFlight {
    /// The instance.
    pub open: OpenInstance,
    /// The plans, by seed.
    pub plans: BTreeMap<u64, PlannedFlight>,
    /// What is compared.
    pub measure: Measure,
    /// Its value; the mean over the seeds.
    pub value: f64,
    /// Who planned it, as far as the files say.
    pub by: Option<String>,
    /// What is lost, by seed [bit].
    lost_bits: BTreeMap<u64, u64>,
}

/// The place of a flight in the library.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Placement {
    /// The instance.
    pub instance: String,
    /// What is compared.
    pub measure: Measure,
    /// The value of the flight; the mean over the seeds of a policy instance.
    pub value: f64,
    /// Its place among the best known flight and the strategies of Skysink, from 1; equals share the better one.
    pub place: usize,
    /// Number of those that it is compared with, itself included.
    pub of: usize,
    /// The next better one.
    pub ahead: Option<NamedValue>,
    /// The next worse one.
    pub behind: Option<NamedValue>,
    /// The value of the best known flight.
    pub best: Option<f64>,
    /// The fraction of the value that separates it from the best known flight, at most 1; negative if it is better.
    pub gap_to_best: Option<f64>,
    /// The bound on the value of every flight.
    pub bound: Option<f64>,
    /// The fraction of the value that separates it from the bound, at most 1.
    pub gap_to_bound: Option<f64>,
}

/// The value of a flight that is compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NamedValue {
    /// A strategy with its budget, or `best known`.
    pub by: String,
    /// Its value.
    pub value: f64,
}

impl Library {
    /// Flies the flight again that is in `paths`: run folders, or plan files. There is one for each seed of a policy
    /// instance, unless a plan file has the column `seed`. `instance` is the name for plan files that do not have it.
    ///
    /// # Errors
    /// If a file is refused, the scenario of a run differs from that of the instance, a plan cannot be flown, a seed is
    /// missing, or on a stop.
    pub fn verify(&self, paths: &[PathBuf], instance: Option<&str>, stop: &Stop) -> Result<FlownFlight, MissionError> {
        let sources = paths.iter().map(|path| FlightSource::read(path)).collect::<Result<Vec<_>, _>>()?;
        self.fly_again(&sources, instance, stop)
    }

    /// Flies the plans of these sources again.
    pub(crate) fn fly_again(
        &self,
        sources: &[FlightSource],
        instance: Option<&str>,
        stop: &Stop,
    ) -> Result<FlownFlight, MissionError> {
        instance.map_or(Ok(()), |name| self.find(name).map(drop))?;
        let mut open: Option<OpenInstance> = None;
        let mut plans = BTreeMap::new();
        let mut by = BTreeSet::new();
        let mut measures = Vec::new();
        let mut values = BTreeMap::new();
        let mut lost_bits = BTreeMap::new();
        for source in sources {
            let name = source.instance(instance, open.as_ref())?;
            if open.is_none() {
                open = Some(self.open(self.find(&name)?)?);
            }
            let open = open.as_ref().expect("it was just opened");
            by.extend(source.by.clone());
            for (seed, flight) in source.flights(open)? {
                let refuse = |what: &str| InputError::new(PLAN, &source.plans, format_args!("seed {seed}: {what}"));
                let (measure, value, lost) = fly(open, seed, &flight, &source.plans, stop)?;
                measures.push(measure);
                values.insert(seed, value);
                lost_bits.insert(seed, lost);
                if plans.insert(seed, flight).is_some() {
                    let expected = if open.instance.seeds > 1 { "one flight for each seed" } else { "one flight" };
                    return Err(refuse(&format!("it is given twice: expected {expected}")).into());
                }
            }
        }
        let open =
            open.ok_or_else(|| InputError::of_argument("flights", "none", "expected a run folder or a plan file"))?;
        if let Some(missing) = (1..=open.instance.seeds).find(|seed| !plans.contains_key(seed)) {
            let what = format_args!("seed {missing} is missing: expected seeds 1 to {}", open.instance.seeds);
            return Err(InputError::new(PLAN, &sources[0].plans, what).into());
        }
        let measure = measures[0];
        let value = mean(values.into_values()); // in the order of seeds, so that it has the same bits in any other
        let by = (!by.is_empty()).then(|| by.into_iter().collect::<Vec<_>>().join(", "));
        Ok(FlownFlight { measure, value, lost_bits, by, plans, open })
    }
}

impl FlownFlight {
    /// The bound on the value of every flight, the mean over the seeds; `None` where there is none.
    ///
    /// # Errors
    /// If the scenario of a seed is refused.
    pub(crate) fn bound(&self) -> Result<Option<f64>, MissionError> {
        // The bounds know of no sensor node that stops sampling.
        if self.open.scenario.node_traits().may_die {
            return Ok(None);
        }
        let of_seed = |(&seed, &lost_bits): (&u64, &u64)| {
            let scenario = self.open.of_seed(seed)?;
            let found = bounds(&scenario, &SensorList::of(&scenario)?, lost_bits);
            let MissionBounds { loss_bound, objective_bound, score_bound, .. } = found;
            Ok(match self.measure {
                Measure::LossRate => Some(loss_bound),
                Measure::WeightedLossRate => None,
                Measure::Objective => objective_bound,
                Measure::Score => score_bound,
            })
        };
        let bounds = self.lost_bits.iter().map(of_seed).collect::<Result<Option<Vec<f64>>, MissionError>>()?;
        Ok(bounds.map(|bounds| mean(bounds.into_iter())))
    }

    /// Its place in the library.
    ///
    /// # Errors
    /// If a file of the library is refused.
    pub fn placement(&self) -> Result<Placement, MissionError> {
        let Self { open, measure, value, .. } = self;
        let library = &open.library;
        let best = library.best(&open.instance)?;
        if let Some(best) = best.as_ref().filter(|best| best.measure != *measure) {
            let [expected, found] = [*measure, best.measure].map(Measure::label);
            let what = format_args!("measure {found}: expected {expected}, of the scenario");
            return Err(InputError::new(LIBRARY, &library.path(&best_file(&open.instance, "toml")), what).into());
        }
        let standings = library.standings()?;
        let latest = ReferenceValue::latest(&standings, &open.instance.name);
        let mut others: Vec<NamedValue> =
            latest.map(|one| NamedValue { by: one.strategy.clone(), value: one.value }).collect();
        others.extend(best.as_ref().map(|best| NamedValue { by: "best known".to_owned(), value: best.value }));
        others.sort_by(|a, b| a.value.total_cmp(&b.value));
        if *measure == Measure::Score {
            others.reverse();
        }
        let of = others.len() + 1;
        let place = others.partition_point(|other| measure.is_better(other.value, *value));
        let bound = best.as_ref().and_then(|best| best.bound);
        let best = best.map(|BestFlight { value, .. }| value);
        let gap_to = |reference: Option<f64>| reference.map(|reference| gap(*measure, *value, reference));
        Ok(Placement {
            instance: open.instance.name.clone(),
            measure: *measure,
            value: *value,
            place: place + 1,
            of,
            ahead: place.checked_sub(1).map(|ahead| others[ahead].clone()),
            behind: others.into_iter().find(|other| measure.is_better(*value, other.value)),
            best,
            gap_to_best: gap_to(best),
            bound,
            gap_to_bound: gap_to(bound),
        })
    }
}

/// Where plans are read from.
pub(crate) struct FlightSource {
    /// The plan file, or the trace of a run.
    plans: PathBuf,
    text: String,
    /// The scenario of a run, with its sensor nodes.
    run: Option<(Scenario, SensorList, PathBuf)>,
    /// Who planned.
    by: Option<String>,
}

impl FlightSource {
    /// The plan file `path` with this content.
    pub(crate) fn plan_file(path: &Path, bytes: &[u8]) -> Result<Self, InputError> {
        Ok(Self { plans: path.to_owned(), text: plan_file::text_of(bytes, path)?, run: None, by: None })
    }

    /// Reads a plan file, or the run in a folder.
    fn read(path: &Path) -> Result<Self, MissionError> {
        let plan_file = |path: &Path| {
            if fs::metadata(path).is_ok_and(|file| file.len() > plan_file::MAX_BYTES) {
                return Err(plan_file::too_large(path));
            }
            let bytes = read_bytes(PLAN, path)?;
            Self::plan_file(path, &bytes)
        };
        if !path.is_dir() {
            return Ok(plan_file(path)?);
        }
        if !is_run_folder(path) {
            return Err(InputError::new("run folder", path, "expected the folder of a run, or a plan file").into());
        }
        let folder = RunFolder::open_to_read(path)?;
        let mode = folder.run_mode();
        let scenario_path = folder.scenario();
        let scenario = Scenario::read(&scenario_path, Overrides::default()).and_then(settings::resolve)?;
        if mode.has_reported_flights() {
            let what = "an external flight-sim reported its flights: expected those of the model";
            return Err(InputError::new("run folder", path, what).into());
        }
        let planner = mode.external_planner.clone().unwrap_or_else(|| scenario.planner.strategy.clone());
        let list = SensorList::of(&scenario)?;
        let trace = plan_file(&folder.slots())?;
        // Who changes a trace is somebody else; of a run that has not ended nobody can tell.
        let hash = format!("{:016x}", TraceHash::of(&trace.text));
        let by = folder.summary().ok().filter(|summary| summary.trace_hash == hash).map(|_| planner);
        Ok(Self { run: Some((scenario, list, scenario_path)), by, ..trace })
    }

    /// The name of its instance, which is that of the files before.
    fn instance(&self, given: Option<&str>, open: Option<&OpenInstance>) -> Result<String, MissionError> {
        let refuse = |what: String| InputError::new(PLAN, &self.plans, what).into();
        let own = self.run.as_ref().map(|(scenario, ..)| scenario.name.as_str());
        let own = own.or_else(|| plan_file::instance_of(&self.text));
        let known = given.or_else(|| open.map(|open| open.instance.name.as_str()));
        match (own, known) {
            (Some(own), Some(known)) if own != known => {
                Err(refuse(format!("it is of the instance {own}: expected {known}")))
            }
            (Some(name), _) | (None, Some(name)) => Ok(name.to_owned()),
            (None, None) => {
                Err(refuse("it names no instance: expected a first line `# instance: NAME`, or --instance".to_owned()))
            }
        }
    }

    /// Its flights over the instance, by seed.
    fn flights(&self, open: &OpenInstance) -> Result<BTreeMap<u64, PlannedFlight>, MissionError> {
        let scenario = match &self.run {
            Some((scenario, list, path)) => {
                open.require_same(scenario, list, path)?;
                if open.instance.seeds > 1 { scenario } else { &open.scenario } // nothing is drawn
            }
            None => &open.scenario,
        };
        Ok(plan_file::parse(&self.text, &self.plans, scenario, open.instance.seeds)?)
    }
}

/// The mean of at least one value.
fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

/// Flies the plans of a seed, from the file `path`, and returns what is compared, its value, and what is lost [bit].
fn fly(
    open: &OpenInstance,
    seed: u64,
    flight: &PlannedFlight,
    path: &Path,
    stop: &Stop,
) -> Result<(Measure, f64, u64), MissionError> {
    let scenario = open.of_seed(seed)?;
    let list = SensorList::of(&scenario)?;
    let mut plant = Plant::new(&scenario, &list);
    let mut meter = MissionMeter::new(&scenario, &list);
    let mut pilot = Planned(flight.iter().map(|moves| moves.iter().map(PlannedMove::plan).collect::<Plans>()));
    let blocks: Vec<usize> = scenario.by_uav(|own| own.link.resource_blocks).collect();
    let sensors = list.sensors().len();
    let mut same = SameFlight { moves: flight, path, blocks, sensors };
    drive(&mut plant, &mut pilot, &mut [&mut meter, &mut same], stop)?.unless_stopped()?;
    require_landed(&scenario, &plant, path)?;
    let values: MetricValues = meter.values(&plant, None, None);
    let (measure, value) = Measure::of(&scenario, &values);
    Ok((measure, value, plant.field().totals().lost_bits))
}

/// Refuses a flight that ends outside of the base where it has to land (decision D13), which only planners see to.
fn require_landed(scenario: &Scenario, plant: &Plant, path: &Path) -> Result<(), InputError> {
    let Some(base) = scenario.landing_base().filter(|_| scenario.must_land()) else { return Ok(()) };
    let positions = plant.flights().iter().map(FlightReport::position);
    match positions.enumerate().find(|(_, position)| !base.contains(&position.xy())) {
        Some((uav, at)) => {
            let what = format_args!("UAV {uav} ends at [{}, {}]: expected it in the base", at.x, at.y);
            Err(InputError::new(PLAN, path, what))
        }
        None => Ok(()),
    }
}

/// Refuses a plan that is not flown as it says.
struct SameFlight<'a> {
    moves: &'a PlannedFlight,
    path: &'a Path,
    /// By UAV: most SNs at once.
    blocks: Vec<usize>,
    /// Number of SNs.
    sensors: usize,
}

impl Observer for SameFlight<'_> {
    fn begin(&mut self, _plant: &Plant) -> Result<(), MissionError> {
        Ok(())
    }

    fn slot(&mut self, record: &SlotRecord, _plant: &Plant) -> Result<(), MissionError> {
        let moves = &self.moves[record.slot() as usize - 1];
        for (planned, row) in moves.iter().zip(record.uavs()) {
            let refuse = |what: String| {
                let line = format_args!("line {}: slot {}: {what}", planned.line, record.slot());
                Err(InputError::new(PLAN, self.path, line).into())
            };
            if let Some(what) = self.deviation(planned, row.flight, self.blocks[row.uav]) {
                return refuse(what);
            }
            let header = &record.header;
            let found = [header.delivered_bits, header.lost_bits, header.totals.queued_bits];
            let names = ["delivered_bits", "lost_bits", "queued_bits"];
            for ((name, expected), found) in names.into_iter().zip(planned.ledger).zip(found) {
                if let Some(expected) = expected.filter(|&expected| expected != found) {
                    return refuse(format!("{name} = {expected}: expected {found}, as the instance gives"));
                }
            }
        }
        Ok(())
    }
}

impl SameFlight<'_> {
    /// How a flight differs from its plan.
    fn deviation(&self, planned: &PlannedMove, flight: &FlightReport, blocks: usize) -> Option<String> {
        let served: Vec<u32> = flight.served_links().iter().map(|link| link.sensor).collect();
        let at = flight.position();
        let to = planned.position;
        let mode = flight.flown_mode();
        if mode == Mode::Down {
            return Some("the UAV is down: expected enough energy; it charges in the mode `charge` only".to_owned());
        }
        if at != to {
            let [found, stays] = [to, at].map(|point| format!("[{}, {}, {}]", point.x, point.y, point.z));
            let away_m = (to - at).norm();
            return Some(format!(
                "position {found}: in the mode `{}` the UAV stays at {stays}, {away_m:.9} m away: expected one that a \
                 slot reaches, in the area, outside of zones, apart from other UAVs, and not rounded away",
                planned.mode
            ));
        }
        if let Some(id) = planned.scheduled.iter().find(|id| !served.contains(id)) {
            let count = planned.scheduled.len();
            let sensors = self.sensors;
            return Some(match (*id as usize >= sensors, count > blocks) {
                (true, _) => format!("sensor node {id}: expected a number from 0 to {}", sensors - 1),
                (_, true) => format!("{count} sensor nodes are scheduled: expected at most {blocks} at once"),
                _ => format!("sensor node {id} is not served: expected one in range that no other UAV serves"),
            });
        }
        (mode != planned.mode).then(|| format!("mode {}: expected {mode}, as it is flown", planned.mode))
    }
}
