//! What the UAVs hear of links (decision D32). Missions without `link.beacon_radius_m` contain none of this.

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::LineStrips3D;
use re_sdk_types::components::Radius;
use skysink_common::message::{FlightReport, HeardLink};
use skysink_common::scenario::Scenario;

use crate::canvas::Canvas;
use crate::colour;
use crate::layer::{Layer, LayerRow, LayerSetup, OpenLayer};
use crate::shapes::{Point, drawn};
use crate::slot::SlotView;

/// What the UAVs hear of links, a line each, brighter for a higher SNR; only with `link.beacon_radius_m`.
pub const HEARD: &str = "world/heard";

/// The links that are heard.
pub(crate) const LAYER: LayerRow = LayerRow { legend, ..LayerRow::new(HeardLinks::open) };

/// The links that the UAVs of the scene hear.
struct HeardLinks {
    feet: Vec<Point>,
}

impl HeardLinks {
    fn open(canvas: &Canvas, LayerSetup { scenario, sensors, .. }: LayerSetup<'_>) -> OpenLayer {
        if scenario.link.beacon_radius_m.is_none() {
            return Ok(None);
        }
        canvas.log_static(HEARD, &LineStrips3D::update_fields().with_radii([Radius::new_ui_points(0.6)]))?;
        let feet = sensors.positions.iter().map(|position| [position.x as f32, position.y as f32, 0.0]).collect();
        Ok(Some(Box::new(Self { feet })))
    }

    fn show(&self, canvas: &Canvas, flights: &[FlightReport], heard: &[HeardLink]) -> RecordingStreamResult<()> {
        let ends = |link: &HeardLink| {
            let uav = flights.get(link.uav as usize)?;
            Some(([drawn(uav.position()), *self.feet.get(link.sensor as usize)?], colour::of_snr(link.snr_db)))
        };
        let (strips, colours): (Vec<_>, Vec<_>) = heard.iter().filter_map(ends).unzip();
        canvas.show(HEARD, &LineStrips3D::update_fields().with_strips(strips).with_colors(colours))
    }
}

impl Layer for HeardLinks {
    fn log_slot(&mut self, canvas: &Canvas, view: &SlotView) -> RecordingStreamResult<()> {
        self.show(canvas, view.flights, view.heard)
    }

    fn log_missed(&mut self, canvas: &Canvas) -> RecordingStreamResult<()> {
        self.show(canvas, &[], &[])
    }
}

fn legend(scenario: &Scenario) -> Option<String> {
    let radius_m = scenario.link.beacon_radius_m?;
    let [lowest_db, highest_db] = colour::HEARD_DB;
    Some(format!("| thin line, dim → bright | SNR heard, within {radius_m} m: {lowest_db} → {highest_db} dB |\n"))
}
