//! The recording of a comparison: every mission flown again, slot by slot beside the others.

use skysink_common::message::{PathPoint, Plan};
use skysink_common::sensors::SensorList;
use skysink_lab::metrics::Metric;
use skysink_mission::error::FileContext as _;
use skysink_mission::record::UNFINISHED;
use skysink_mission::{Mission, Replay};
use skysink_viewer::{self as viewer, Comparison, Sinks, SlotView};

use super::{Error, Flight, Path, RECORDING, Shown, Stop, fs};

/// A mission that is flown again.
enum Again {
    Planned(Box<Mission>),
    OnRecord(Box<Replay>),
}

impl Again {
    fn mission(&self) -> &Mission {
        match self {
            Self::Planned(mission) => mission,
            Self::OnRecord(replay) => replay.mission(),
        }
    }

    fn next_plan(&mut self) -> Result<Option<Plan>, Error> {
        let flown = match self {
            Self::Planned(mission) => mission.next(),
            Self::OnRecord(replay) => replay.next_slot()?,
        };
        Ok(flown.map(|flown| Plan { plan_ns: 0, ..flown.plan }))
    }
}

/// Flies the missions again, slot by slot beside each other, into the recording `path`.
pub(super) fn record(shown: &[Shown], path: &Path, stop: &Stop) -> Result<(), Error> {
    // In a folder of its own until it is whole: nobody else can have put anything there.
    let folder = path.parent().unwrap_or(Path::new("."));
    let own = tempfile::Builder::new().prefix(".comparison.").suffix(UNFINISHED).tempdir_in(folder).at(folder)?;
    let begun = own.path().join(RECORDING);
    let mut missions = Vec::new();
    let mut scenarios = Vec::new();
    for one in shown {
        let (scenario, list, again) = match &one.flight {
            Flight::Planned(scenario) => {
                let list = SensorList::of(scenario)?;
                let mut mission = Mission::new(scenario, &list)?;
                mission.set_stop(stop);
                (scenario.as_ref().clone(), list, Again::Planned(Box::new(mission)))
            }
            Flight::OnRecord(folder) => {
                let replay = Replay::open(folder)?;
                (replay.scenario().clone(), replay.list().clone(), Again::OnRecord(Box::new(replay)))
            }
        };
        scenarios.push((scenario, list.nodes()));
        missions.push(again);
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
    let sinks = Sinks { save: Some(begun.clone()), ..Sinks::default() };
    let name = shown.iter().map(|one| one.contender.label.as_str()).collect::<Vec<_>>().join(" beside ");
    let mut comparison = Comparison::open(&sinks, &name, &compared, &page(shown))?;
    let mut plans: Vec<Option<Plan>> = vec![None; missions.len()];
    let mut under_way: Vec<usize> = (0..missions.len()).collect();
    while !under_way.is_empty() {
        for &index in &under_way {
            log(&mut comparison, index, missions[index].mission(), plans[index].as_ref())?;
        }
        stop.check()?;
        let mut next = Vec::new();
        for &index in &under_way {
            plans[index] = missions[index].next_plan()?;
            if plans[index].is_some() {
                next.push(index);
            }
        }
        under_way = next;
    }
    comparison.close()?;
    fs::rename(&begun, path).at(path)?;
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

/// Written over a scene.
fn title(shown: &Shown) -> String {
    let loss = shown.contender.value(shown.seed, Metric::LossRate);
    let loss = loss.map_or_else(String::new, |loss| format!(" · η {loss:.4}"));
    format!("{}{loss}", shown.contender.label)
}

/// The table beside the scenes.
fn page(shown: &[Shown]) -> String {
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
