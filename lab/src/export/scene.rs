//! The field as markers of ROS 2: area, zones and buildings as outlines, sensor nodes as spheres with names.

use super::mcap::AREA;
use super::ros2::{Marker, RosHeader};
use super::track::GeodeticTrack;

/// With more sensor nodes, their labels hide the field.
const MOST_LABELS: usize = 1000;

/// Diameter of a sensor node, as a fraction of the longer side of the area.
const SENSOR_DIAMETER: f64 = 0.01;

/// Width of an outline, as a fraction of the diameter of a sensor node.
const OUTLINE_WIDTH: f64 = 0.2;

/// The shapes of `visualization_msgs/Marker`.
const LINE_STRIP: i32 = 4;
const SPHERE_LIST: i32 = 7;
const TEXT_VIEW_FACING: i32 = 9;

/// A colour: red, green, blue, opacity [0 to 1].
type Colour = [f32; 4];

const GREY: Colour = [0.5, 0.5, 0.5, 1.0];
const RED: Colour = [0.85, 0.2, 0.15, 1.0];
const BROWN: Colour = [0.6, 0.45, 0.3, 1.0];
const BLUE: Colour = [0.15, 0.45, 0.85, 1.0];

/// The markers of the field, which stay for the whole log.
pub fn markers(track: &GeodeticTrack<'_>) -> Vec<Marker> {
    let area = &track.run.scenario.area;
    let list = &track.run.list;
    let diameter_m = SENSOR_DIAMETER * area.width_m().max(area.height_m());
    let marker = |namespace, shape, colour: Colour| Marker {
        header: RosHeader::new(0.0, AREA),
        namespace,
        shape,
        orientation: [0.0, 0.0, 0.0, 1.0],
        scale_m: [diameter_m; 3],
        colour,
        frame_locked: true,
        ..Marker::default()
    };
    let outline = |corners: &[[f64; 2]], up_m: f64, colour: Colour| Marker {
        scale_m: [OUTLINE_WIDTH * diameter_m, 0.0, 0.0],
        points: corners.iter().chain(&corners[..1]).map(|&[x_m, y_m]| [x_m, y_m, up_m]).collect(),
        ..marker("outlines", LINE_STRIP, colour)
    };
    let rectangle = [[0.0, 0.0], [area.width_m(), 0.0], [area.width_m(), area.height_m()], [0.0, area.height_m()]];
    let mut markers = vec![outline(area.boundary_m.as_deref().unwrap_or(&rectangle), 0.0, GREY)];
    markers.extend(area.no_fly.iter().flatten().map(|zone| outline(zone.corners(), 0.0, RED)));
    for building in area.building.iter().flatten() {
        markers.extend([0.0, building.height_m].map(|up_m| outline(&building.polygon_m, up_m, BROWN)));
    }
    let positions = || list.sensors().iter().map(|sensor| sensor.position);
    let points = positions().map(|position| [position.x, position.y, 0.0]).collect();
    markers.push(Marker { points, ..marker("sensor nodes", SPHERE_LIST, BLUE) });
    if list.sensors().len() <= MOST_LABELS {
        markers.extend(positions().enumerate().map(|(id, position)| Marker {
            position: [position.x, position.y, diameter_m],
            text: list.label(id),
            ..marker("names", TEXT_VIEW_FACING, GREY)
        }));
    }
    for (id, marker) in (0..).zip(&mut markers) {
        marker.id = id;
    }
    markers
}
