//! Line of sight among buildings: a link has it exactly if the segment from the sensor node to the UAV meets no
//! building (decision D16). The planner knows the map.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use crate::airspace::Polygon;
use crate::geometry::Position;
use crate::keys::Only;
use crate::shared::SharedValues;

/// Keys of the model `buildings`.
pub(crate) const ONLY: Only =
    Only { key: "model", values: &["buildings"], expected: Some("it only with model = \"buildings\"") };

/// The buildings of an area, closed at their tops, and the height of the antennas of the sensor nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Buildings {
    /// Their outlines and heights [m].
    outlines: Vec<(Polygon, f64)>,
    sensors_height_m: f64,
}

impl Buildings {
    /// Buildings with these outlines and heights [m], among sensor nodes `sensors_height_m` [m] above the ground.
    #[must_use]
    pub fn new(outlines: impl Iterator<Item = (Polygon, f64)>, sensors_height_m: f64) -> Self {
        Self { outlines: outlines.collect(), sensors_height_m }
    }

    /// The buildings as a channel holds them: equal ones are held once.
    #[must_use]
    pub fn shared(self) -> Arc<Self> {
        static ALL: SharedValues<Buildings> = SharedValues::new();
        ALL.share(self, Self::eq)
    }

    /// Height of the sensor nodes [m].
    pub fn sensors_height_m(&self) -> f64 {
        self.sensors_height_m
    }

    /// Whether a sensor node at `sensor` and a UAV at `uav` [m] see each other. A building that is as high as the UAV
    /// below it hides it.
    pub fn sees(&self, sensor: &Position, uav: &Point3<f64>) -> bool {
        let sensor = Point3::new(sensor.x, sensor.y, self.sensors_height_m);
        let (lower, rise) = if uav.z < sensor.z { (*uav, sensor - uav) } else { (sensor, uav - sensor) };
        self.outlines.iter().all(|(outline, height_m)| !meets(outline, *height_m, &lower, &rise))
    }
}

/// Whether the segment from `lower` along `rise`, which does not fall, meets a building.
fn meets(outline: &Polygon, height_m: f64, lower: &Point3<f64>, rise: &Vector3<f64>) -> bool {
    if lower.z > height_m {
        return false;
    }
    // The part of the segment that is not higher than the building.
    let low_part = if rise.z > height_m - lower.z { (height_m - lower.z) / rise.z } else { 1.0 };
    outline.entry(&lower.xy(), &(lower + rise * low_part).xy(), 0.0, false).is_some()
}
