//! The ground below a flight, as far as the sensor nodes tell it.

use rstar::primitives::GeomWithData;
use rstar::{PointDistance, RTree};
use skysink_common::geometry::Position;
use skysink_common::interpolation::interpolate;
use skysink_common::sensors::SensorList;

/// Pairs of sensor nodes nearer to each other than this [m] tell no slope: the error of their altitudes would make it
/// too steep. Within this distance of a place their altitudes themselves bound the ground.
const LEAST_DISTANCE_M: f64 = 5.0;

/// Sensor nodes around a place whose bounds on its ground are taken; with fewer than all, the bounds are wider.
const NEIGHBOURS: usize = 8;

/// Maximum number of sensor nodes of which every pair tells a slope, evenly taken from the list; the others tell the
/// slopes to their neighbours.
const MAX_PAIRED: usize = 2000;

/// How much steeper the ground may be than the steepest slope between two sensor nodes, which is a mean.
const STEEPER: f64 = 1.25;

/// Distance between the places of a leg whose ground is computed [m].
const STEP_M: f64 = 5.0;

/// The altitude of the ground at the sensor nodes, and its bounds between them for a ground that is nowhere steeper
/// than a slope:
/// `min_i (g_i + s d_i)` and `max_i (g_i − s d_i)` at distances `d_i` from ground `g_i`. The slope s is `STEEPER`
/// times the steepest between two sensor nodes.
#[derive(Debug)]
pub struct Ground {
    /// The sensor nodes with the altitude of the ground [m].
    sensors: RTree<GeomWithData<[f64; 2], f64>>,
    /// The slope, rise over run.
    slope: f64,
}

impl Ground {
    /// The ground of a list; `None` if the list does not tell it.
    pub fn of(list: &SensorList) -> Option<Self> {
        let sensors = list.sensors().iter().zip(list.ground_m());
        let sensors: Vec<_> =
            sensors.map(|(sensor, &ground_m)| GeomWithData::new(sensor.position.into(), ground_m)).collect();
        if sensors.is_empty() {
            return None;
        }
        let mut ground = Self { sensors: RTree::bulk_load(sensors), slope: 0.0 };
        ground.slope = STEEPER * ground.steepest();
        Some(ground)
    }

    /// Adds a place [m] whose ground is known [m].
    pub fn add(&mut self, at: &Position, ground_m: f64) {
        self.sensors.insert(GeomWithData::new((*at).into(), ground_m));
        self.slope = STEEPER * self.steepest();
    }

    /// The steepest slope between two sensor nodes.
    fn steepest(&self) -> f64 {
        let slope = |distance_m: f64, rise_m: f64| {
            if distance_m < LEAST_DISTANCE_M { 0.0 } else { rise_m.abs() / distance_m }
        };
        let near = self.sensors.iter().flat_map(|sensor| {
            let at = Position::from(*sensor.geom());
            let neighbours = self.neighbours(&at);
            neighbours.map(|(distance_m, ground_m)| slope(distance_m, ground_m - sensor.data)).collect::<Vec<_>>()
        });
        let paired: Vec<_> = self.sensors.iter().step_by(self.sensors.size().div_ceil(MAX_PAIRED).max(1)).collect();
        let far = paired.iter().enumerate().flat_map(|(index, first)| {
            let others = paired[..index].iter();
            others.map(move |second| slope(first.distance_2(second.geom()).sqrt(), first.data - second.data))
        });
        near.chain(far).fold(0.0, f64::max)
    }

    /// Distance [m] and altitude [m] of the sensor nodes that are nearest to `at` [m], one there included.
    fn neighbours(&self, at: &Position) -> impl Iterator<Item = (f64, f64)> {
        let nearest = self.sensors.nearest_neighbor_iter_with_distance_2(&[at.x, at.y]);
        nearest.take(NEIGHBOURS + 1).map(|(sensor, squared_m2)| (squared_m2.sqrt(), sensor.data))
    }

    /// Whether the altitudes differ.
    pub fn is_hilly(&self) -> bool {
        let mut altitudes_m = self.sensors.iter().map(|sensor| sensor.data);
        let first_m = altitudes_m.next();
        altitudes_m.any(|altitude_m| Some(altitude_m) != first_m)
    }

    /// The highest that the ground can be at a place [m].
    pub fn highest_m(&self, at: &Position) -> f64 {
        let bound_m = self.neighbours(at).map(|(distance_m, ground_m)| ground_m + self.slope * distance_m);
        self.here_m(at).chain([bound_m.fold(f64::INFINITY, f64::min)]).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The lowest that the ground can be at a place [m].
    pub fn lowest_m(&self, at: &Position) -> f64 {
        let bound_m = self.neighbours(at).map(|(distance_m, ground_m)| ground_m - self.slope * distance_m);
        self.here_m(at).chain([bound_m.fold(f64::NEG_INFINITY, f64::max)]).fold(f64::INFINITY, f64::min)
    }

    /// The altitudes of the sensor nodes within [`LEAST_DISTANCE_M`] of a place [m].
    fn here_m(&self, at: &Position) -> impl Iterator<Item = f64> {
        self.sensors.locate_within_distance([at.x, at.y], LEAST_DISTANCE_M * LEAST_DISTANCE_M).map(|sensor| sensor.data)
    }

    /// The highest that the ground can be on the straight line between two places [m].
    pub fn highest_between_m(&self, from: &Position, to: &Position) -> f64 {
        let steps = ((to - from).norm() / STEP_M).ceil().max(1.0);
        let step_m = (to - from).norm() / steps;
        let highest = (0..=steps as u64).map(|step| self.highest_m(&interpolate(*from, *to, step as f64 / steps)));
        highest.fold(f64::NEG_INFINITY, f64::max) + self.slope * step_m / 2.0
    }
}
