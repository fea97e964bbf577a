//! The recording of a comparison: simulates all missions in parallel, slot by slot.

use skysink_common::message::{PathPoint, Plan};
use skysink_common::sensors::SensorList;
use skysink_lab::metrics::Metric;
use skysink_mission::error::FileContext as _;
use skysink_mission::record::UNFINISHED;
use skysink_mission::{Mission, Replay};
use skysink_viewer::{self as viewer, Comparison, Sinks, SlotView};

use super::{Error, FlightSource, Path, RECORDING, ShownContender, Stop, fs};

/// A mission in the recording.
enum RecordedMission {
    Planned(Box<Mission>),
    Replayed(Box<Replay>),
}

impl RecordedMission {
    fn mission(&self) -> &Mission {
        match self {
            Self::Planned(mission) => mission,
            Self::Replayed(replay) => replay.mission(),
        }
    }

    /// Advances by one slot and returns its plan, without its planning time; `None` after the last slot.
    fn next_plan(&mut self) -> Result<Option<Plan>, Error> {
        let flown = match self {
            Self::Planned(mission) => mission.next(),
            Self::Replayed(replay) => replay.next_slot()?,
        };
        Ok(flown.map(|flown| Plan { plan_ns: 0, ..flown.plan }))
    }
}

/// Simulates the missions in parallel, slot by slot, and writes the recording `path`.
pub(super) fn record(shown: &[ShownContender], path: &Path, stop: &Stop) -> Result<(), Error> {
    // Written to a temporary folder until it is complete.
    let folder = path.parent().unwrap_or(Path::new("."));
    let temporary = tempfile::Builder::new().prefix(".comparison.").suffix(UNFINISHED).tempdir_in(folder).at(folder)?;
    let unfinished = temporary.path().join(RECORDING);
    let mut missions = Vec::new();
    let mut scenarios = Vec::new();
    for one in shown {
        let (scenario, list, mission) = match &one.flight {
            FlightSource::Planned(scenario) => {
                let list = SensorList::of(scenario)?;
                let mut mission = Mission::new(scenario, &list)?;
                mission.set_stop(stop);
                (scenario.as_ref().clone(), list, RecordedMission::Planned(Box::new(mission)))
            }
            FlightSource::Recorded(folder) => {
                let replay = Replay::open(folder)?;
                (replay.scenario().clone(), replay.list().clone(), RecordedMission::Replayed(Box::new(replay)))
            }
        };
        scenarios.push((scenario, list.nodes()));
        missions.push(mission);
    }
    let titles: Vec<String> = shown.iter().map(title).collect();
    let compared: Vec<viewer::ComparedMission> = shown
        .iter()
        .zip(&titles)
        .zip(&scenarios)
        .map(|((one, title), (scenario, sensors))| viewer::ComparedMission {
            label: &one.contender.label,
            title,
            scenario,
            sensors,
        })
        .collect();
    let sinks = Sinks { save: Some(unfinished.clone()), ..Sinks::default() };
    let name = shown.iter().map(|one| one.contender.label.as_str()).collect::<Vec<_>>().join(" vs ");
    let mut comparison = Comparison::open(&sinks, &name, &compared, &page(shown))?;
    let mut plans: Vec<Option<Plan>> = vec![None; missions.len()];
    let mut running: Vec<usize> = (0..missions.len()).collect();
    while !running.is_empty() {
        for &index in &running {
            log(&mut comparison, index, missions[index].mission(), plans[index].as_ref())?;
        }
        stop.check()?;
        let mut next = Vec::new();
        for &index in &running {
            plans[index] = missions[index].next_plan()?;
            if plans[index].is_some() {
                next.push(index);
            }
        }
        running = next;
    }
    comparison.close()?;
    fs::rename(&unfinished, path).at(path)?;
    Ok(())
}

fn log(comparison: &mut Comparison, index: usize, mission: &Mission, plan: Option<&Plan>) -> Result<(), Error> {
    let path: Vec<PathPoint> = mission.planner().path().iter().copied().map(PathPoint::from).collect();
    let header = mission.header();
    let view = SlotView {
        slot: header.head.slot,
        queues_bits: mission.queues_bits(),
        header: &header,
        plan,
        path: &path,
        flight: mission.last_flight(),
        slots_per_s: None,
        plan_ms: None,
    };
    Ok(comparison.log_slot(index, &view)?)
}

/// The title of a scene.
fn title(shown: &ShownContender) -> String {
    let loss = shown.contender.value(shown.seed, Metric::LossRate);
    let loss = loss.map_or_else(String::new, |loss| format!(" · η {loss:.4}"));
    format!("{}{loss}", shown.contender.label)
}

/// The Markdown table beside the scenes.
fn page(shown: &[ShownContender]) -> String {
    let mut page = String::from("| | η | delivered [Mbit] | flown [km] |\n|---|---|---|---|\n");
    for one in shown {
        let value = |metric, factor, decimals: usize| {
            one.contender
                .value(one.seed, metric)
                .map_or_else(String::new, |value| format!("{:.decimals$}", value * factor))
        };
        page += &format!(
            "| {} | {} | {} | {} |\n",
            one.contender.label,
            value(Metric::LossRate, 1.0, 4),
            value(Metric::DeliveredBits, 1e-6, 3),
            value(Metric::FlownM, 1e-3, 2),
        );
    }
    page + "\nQueues: blue empty, yellow full; red: loses data now, red dot: has lost some. All in the same slot.\n"
}
