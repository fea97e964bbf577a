//! The recording of a comparison: simulates all missions on a common timeline.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use skysink_common::markup::markdown;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_lab::sweep::manifest::RECORDING;
use skysink_mission::error::FileContext as _;
use skysink_mission::files::UNFINISHED;
use skysink_mission::metrics::Metric;
use skysink_mission::{Mission, Replay};
use skysink_viewer::{self as viewer, Comparison, Sinks, SlotView};

use super::contenders::ShownContender;
use crate::error::Error;
use crate::slot_views::SlotViews;

/// Simulates the missions one after another, and writes the recording `path`.
pub fn record(shown: &[ShownContender], path: &Path, stop: &Stop) -> Result<(), Error> {
    // Written to a temporary folder until it is complete.
    let folder = path.parent().unwrap_or(Path::new("."));
    let temporary = tempfile::Builder::new().prefix(".comparison.").suffix(UNFINISHED).tempdir_in(folder).at(folder)?;
    let unfinished = temporary.path().join(RECORDING);
    let lists = shown.iter().map(|one| SensorList::of(&one.scenario)).collect::<Result<Vec<_>, _>>()?;
    let sensors = shown.iter().zip(&lists).map(|(one, list)| Arc::new(list.sensors_of(&one.scenario)));
    let sensors: Vec<_> = sensors.collect();
    let compared = shown.iter().zip(&sensors).map(|(one, sensors)| viewer::ComparedMission {
        label: one.contender.label.clone(),
        title: title(one),
        scenario: &one.scenario,
        sensors,
    });
    let sinks = Sinks { save: Some(unfinished.clone()), ..Sinks::default() };
    let name = shown.iter().map(|one| one.contender.label.as_str()).collect::<Vec<_>>().join(" vs ");
    let mut comparison = Comparison::open(&sinks, &name, compared, &page(shown))?;
    for (index, (one, list)) in shown.iter().zip(&lists).enumerate() {
        let views = &mut SlotViews(|view: &SlotView| comparison.log_slot(index, view));
        match &one.run {
            None => Mission::new(&one.scenario, list)?.drive(&mut [views], stop)?.unless_stopped()?,
            Some(folder) => Replay::open(folder)?.drive(&mut [views], stop)?,
        }
    }
    comparison.close()?;
    fs::rename(&unfinished, path).at(path)?;
    Ok(())
}

/// The title of a scene.
fn title(shown: &ShownContender) -> String {
    let loss = shown.contender.value(shown.scenario.seed, Metric::LossRate);
    let loss = loss.map_or_else(String::new, |loss| format!(" · η {loss:.4}"));
    format!("{}{loss}", shown.contender.label)
}

/// The Markdown table beside the scenes.
fn page(shown: &[ShownContender]) -> String {
    let mut page = String::from("| | η | delivered [Mbit] | flown [km] |\n|---|---|---|---|\n");
    for one in shown {
        let value = |metric, factor, decimals: usize| {
            one.contender
                .value(one.scenario.seed, metric)
                .map_or_else(String::new, |value| format!("{:.decimals$}", value * factor))
        };
        page += &format!(
            "| {} | {} | {} | {} |\n",
            markdown(&one.contender.label),
            value(Metric::LossRate, 1.0, 4),
            value(Metric::DeliveredBits, 1e-6, 3),
            value(Metric::FlownM, 1e-3, 2),
        );
    }
    page + "\nQueues: blue empty, yellow full; red: loses data now, red dot: has lost some. All in the same slot.\n"
}
