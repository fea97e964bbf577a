//! The vehicle missions of all UAVs of a run: plans them, checks them, and writes their files.

use super::clearance::MissionClearance;
use super::fence;
use super::format::{ExportedMission, MissionFormat};
use super::mission_options::VehicleMissionOptions;
use super::track::GeodeticTrack;
use super::{separation, summary, vehicle, warnings};
use skysink_common::error::InputError;

/// The missions of a run in a format.
#[derive(Debug, Default)]
pub struct RenderedMissions {
    /// The lines about them.
    pub lines: Vec<String>,
    /// The content of the files of each UAV, one for each part.
    pub texts: Vec<Vec<Vec<u8>>>,
}

/// Plans, checks and writes the missions of these tracks, one for each UAV.
///
/// # Errors
/// If a vehicle must not or cannot fly a mission, the format does not hold it, or UAVs would come too near to each
/// other.
pub fn render(
    format: &MissionFormat,
    tracks: &[GeodeticTrack<'_>],
    options: &VehicleMissionOptions,
) -> Result<RenderedMissions, InputError> {
    let mut rendered = RenderedMissions::default();
    let mut missions = Vec::with_capacity(tracks.len());
    for track in tracks {
        let scenario = &track.run.scenario;
        let mission = vehicle::plan(track, options)?;
        let refuse = |message: String| InputError::new("scenario", &scenario.path, message);
        let notes = (format.check)(&mission, options).map_err(refuse)?;
        let corners = fence::border(&scenario.area, options.fence_margin);
        let fence = format.without_fence.is_none().then_some(&corners[..]);
        let clearance = MissionClearance::of(track, &mission, fence, options.margin_m());
        let warnings = warnings::of(track, &mission, &clearance, fence.map(<[_]>::len));
        let lines = summary::lines(track, options, &mission, &clearance).into_iter();
        let lines = lines.chain(format.without_fence.map(str::to_owned)).chain(notes);
        let lines = lines.chain(warnings.into_iter().map(|text| format!("warning: {text}")));
        let prefix = if tracks.len() == 1 { String::new() } else { format!("UAV {}: ", track.uav) };
        rendered.lines.extend(lines.map(|line| prefix.clone() + &line));
        let fence = corners.iter().map(|corner| track.place(corner)).collect::<Result<_, _>>()?;
        let exported = ExportedMission { track, mission: &mission, options, fence };
        rendered.texts.push(mission.parts.iter().map(|part| (format.write)(&exported, part)).collect());
        missions.push(mission);
    }
    if let Some(track) = tracks.first() {
        rendered.lines.extend(separation::lines(&track.run.scenario, &missions, options.stagger)?);
    }
    Ok(rendered)
}
