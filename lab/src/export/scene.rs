//! The field as a `foxglove.SceneUpdate`: the area, zones and buildings as outlines, sensor nodes as labelled spheres.

use nalgebra::{Point3, UnitQuaternion};
use serde_json::{Value, json};

use super::mcap::{pose, timestamp, vector};
use super::mcap_log::AREA;
use super::track::GeodeticTrack;

/// With more sensor nodes, their labels hide the field.
const MOST_LABELS: usize = 1000;

/// Diameter of a sensor node, as a fraction of the longer side of the area.
const SENSOR_DIAMETER: f64 = 0.01;

/// `foxglove.LineType`: a closed polygon.
const LINE_LOOP: u32 = 1;

/// A colour: red, green, blue [0 to 1].
type Colour = [f64; 3];

const GREY: Colour = [0.5, 0.5, 0.5];
const RED: Colour = [0.85, 0.2, 0.15];
const BROWN: Colour = [0.6, 0.45, 0.3];
const BLUE: Colour = [0.15, 0.45, 0.85];

/// The scene: one entity, which stays for the whole log.
pub fn update(track: &GeodeticTrack<'_>) -> Value {
    let area = &track.run.scenario.area;
    let rectangle = [[0.0, 0.0], [area.width_m(), 0.0], [area.width_m(), area.height_m()], [0.0, area.height_m()]];
    let mut lines = vec![outline(area.boundary_m.as_deref().unwrap_or(&rectangle), 0.0, GREY)];
    lines.extend(area.no_fly.iter().flatten().map(|zone| outline(zone.corners(), 0.0, RED)));
    for building in area.building.iter().flatten() {
        lines.extend([0.0, building.height_m].map(|up_m| outline(&building.polygon_m, up_m, BROWN)));
    }
    let diameter_m = SENSOR_DIAMETER * area.width_m().max(area.height_m());
    let list = &track.run.list;
    let places = || list.sensors().iter().map(|sensor| Point3::new(sensor.position.x, sensor.position.y, 0.0));
    let size = vector(&Point3::new(diameter_m, diameter_m, diameter_m));
    let sphere = |place: Point3<f64>| json!({ "pose": level(&place), "size": size, "color": colour(BLUE) });
    let label = |(id, place): (usize, Point3<f64>)| {
        json!({
            "pose": level(&Point3::new(place.x, place.y, diameter_m)), "billboard": true, "font_size": 12.0,
            "scale_invariant": true, "color": colour(GREY), "text": list.label(id),
        })
    };
    let labelled = if list.sensors().len() <= MOST_LABELS { MOST_LABELS } else { 0 };
    let spheres: Vec<_> = places().map(sphere).collect();
    let texts: Vec<_> = places().enumerate().take(labelled).map(label).collect();
    let no: [u32; 0] = [];
    let entity = json!({
        "timestamp": timestamp(0.0), "frame_id": AREA, "id": "field", "lifetime": timestamp(0.0), "frame_locked": true,
        "metadata": no, "arrows": no, "cubes": no, "spheres": spheres, "cylinders": no, "lines": lines,
        "triangles": no, "texts": texts, "models": no,
    });
    json!({ "deletions": no, "entities": [entity] })
}

fn outline(corners: &[[f64; 2]], up_m: f64, line: Colour) -> Value {
    let points: Vec<_> = corners.iter().map(|&[x_m, y_m]| vector(&Point3::new(x_m, y_m, up_m))).collect();
    let no: [u32; 0] = [];
    json!({
        "type": LINE_LOOP, "pose": level(&Point3::origin()), "thickness": 2.0, "scale_invariant": true,
        "points": points, "color": colour(line), "colors": no, "indices": no,
    })
}

fn level(place: &Point3<f64>) -> Value {
    pose(place, &UnitQuaternion::identity())
}

fn colour([r, g, b]: Colour) -> Value {
    json!({ "r": r, "g": g, "b": b, "a": 1.0 })
}
