//! The map in degrees, of a scenario with an origin: area, sensor nodes, flown paths and UAVs.

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{GeoLineStrings, GeoPoints};
use re_sdk_types::components::Radius;
use skysink_common::geodata::projection::Projection;
use skysink_common::geometry::Position;
use skysink_common::message::FlightReport;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use crate::canvas::Canvas;
use crate::colour;
use crate::names::SensorNames;
use crate::uav::name_of;
use crate::zones::outlines;

/// Root of the map.
pub const GEO: &str = "geo";
/// The border of the area; below it the outlines of zones, buildings and base.
pub const AREA: &str = "geo/area";
/// The sensor nodes.
pub const SENSORS: &str = "geo/sensors";
/// The path flown since the last drawn slot, of the first UAV; those of the others are below it, by number.
pub const TRAIL: &str = "geo/trail";
/// The UAVs.
pub const UAVS: &str = "geo/uavs";

/// Latitude and longitude [°].
type Degrees = [f64; 2];

/// The map of a mission.
pub(crate) struct GeoMap {
    projection: Projection,
    /// Positions of each UAV since the last drawn slot, that slot first.
    flown: Vec<Vec<Degrees>>,
}

impl GeoMap {
    /// Logs what stays; `None` without an origin.
    pub(crate) fn open(
        canvas: &Canvas,
        scenario: &Scenario,
        sensors: &Sensors,
        names: &SensorNames,
    ) -> RecordingStreamResult<Option<Self>> {
        let Some(origin) = scenario.area.origin() else { return Ok(None) };
        let uavs = scenario.uav.uavs();
        let map = Self { projection: Projection::at(origin), flown: vec![Vec::new(); uavs] };
        let [width_m, depth_m] = [scenario.area.width_m(), scenario.area.height_m()];
        let corners = [[0.0, 0.0], [width_m, 0.0], [width_m, depth_m], [0.0, depth_m], [0.0, 0.0]];
        let border: Vec<_> = corners.iter().filter_map(|&[x_m, y_m]| map.degrees(&Position::new(x_m, y_m))).collect();
        let thin = [Radius::new_ui_points(1.0)];
        let border = GeoLineStrings::from_lat_lon([border]).with_radii(thin).with_colors([colour::MAP_AREA]);
        canvas.log_static(AREA, &border)?;
        for (name, outlines, colour) in outlines(scenario) {
            let in_degrees =
                |outline: &Vec<Position>| outline.iter().filter_map(|at| map.degrees(at)).collect::<Vec<_>>();
            let lines = GeoLineStrings::from_lat_lon(outlines.iter().map(in_degrees));
            canvas.log_static(format!("{AREA}/{name}"), &lines.with_radii(thin).with_colors([colour]))?;
        }
        let nodes = GeoPoints::from_lat_lon(sensors.positions.iter().filter_map(|at| map.degrees(at)))
            .with_radii([Radius::new_ui_points(4.0)])
            .with_colors([colour::MAP_SENSOR]);
        canvas.log_static(SENSORS, &nodes)?;
        if let Some(names) = names.component() {
            canvas.log_static(SENSORS, &names)?;
        }
        for uav in 0..uavs {
            let style = GeoLineStrings::update_fields()
                .with_radii([Radius::new_ui_points(1.5)])
                .with_colors([colour::on_map(uav)]);
            canvas.log_static(name_of(TRAIL, uav), &style)?;
        }
        let style = GeoPoints::update_fields()
            .with_radii([Radius::new_ui_points(6.0)])
            .with_colors((0..uavs).map(colour::on_map));
        canvas.log_static(UAVS, &style)?;
        Ok(Some(map))
    }

    /// Adds the positions after a slot.
    pub(crate) fn observe(&mut self, flights: &[FlightReport]) {
        for (uav, flight) in flights.iter().enumerate().take(self.flown.len()) {
            let here = self.degrees(&flight.position().xy());
            self.flown[uav].extend(here);
        }
    }

    /// Draws the UAVs at their positions after the last observed slot, and their paths.
    pub(crate) fn draw(&mut self, canvas: &Canvas) -> RecordingStreamResult<()> {
        let here: Vec<Option<Degrees>> = self.flown.iter().map(|flown| flown.last().copied()).collect();
        self.log_flown(canvas)?;
        self.flown.iter_mut().zip(&here).for_each(|(flown, here)| flown.extend(here));
        canvas.show(UAVS, &GeoPoints::update_fields().with_positions(here.into_iter().flatten()))
    }

    /// Logs the paths since the last drawn slot, and starts the next ones: missed slots interrupt them.
    pub(crate) fn log_flown(&mut self, canvas: &Canvas) -> RecordingStreamResult<()> {
        for (uav, flown) in self.flown.iter_mut().enumerate() {
            let flown = std::mem::take(flown);
            let strips = (flown.len() > 1).then_some(flown);
            canvas.append(name_of(TRAIL, uav), &GeoLineStrings::update_fields().with_line_strings(strips))?;
        }
        Ok(())
    }

    /// A position of the plane in degrees; `None` beyond the rim of the Earth.
    fn degrees(&self, position: &Position) -> Option<Degrees> {
        self.projection.unproject(position).map(|at| [at.lat_deg, at.lon_deg])
    }
}
